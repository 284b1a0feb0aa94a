"""From the table of a machine, or the table beside a URDF, to its MJCF."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import mujoco
import numpy as np
from scipy.linalg import eigh, null_space

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.input_files import read_toml
from gantrysim.machine.design.arrangements import bridge, cantilever, corexy, moving_table, tandem
from gantrysim.machine.design.mjcf import Mjcf, TableMjcf
from gantrysim.machine.design.table import Drive, MachineTable, read_table
from gantrysim.machine.design.urdf import SUFFIX, is_urdf_table, read_urdf_table, table_of_urdf, urdf_mjcf

# Undamped modes of a compiled model.

_STIFFNESS_STEP = 1e-7  # of a joint for the stiffness [m or rad]
_SWINGS = 1.0  # squared frequency below which a mode is free motion [rad²/s²]


def modes(model: mujoco.MjModel, qpos: Floats | None = None, locked: Sequence[int] = ()) -> tuple[Floats, Floats]:
    """Return the frequencies of the oscillating modes, rising, (n,) [Hz], and their shapes, (nv, n).

        K v = w² M v    for v = N a,    J N = 0

    with the mass matrix M, the stiffness K of springs and tendons by central differences, and the Jacobian J of the
    equality constraints.

    Args:
        model: the compiled model.
        qpos: position, by default the model's reference.
        locked: degrees of freedom that are held.
    """
    model = copy.copy(model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    nv = model.nv
    equilibrium = model.qpos0 if qpos is None else qpos
    mass = np.zeros((nv, nv))
    stiffness = np.zeros((nv, nv))

    def force(step: Floats) -> Floats:
        data.qpos[:] = equilibrium
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        mujoco.mj_forward(model, data)
        return data.qfrc_spring.copy()

    for k, step in enumerate(_STIFFNESS_STEP * np.eye(nv)):
        stiffness[:, k] = (force(-step) - force(step)) / (2 * _STIFFNESS_STEP)
    force(np.zeros(nv))
    mujoco.mj_fullM(model, data, mass)
    equal = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    free = null_space(np.concatenate([data.efc_J.reshape(-1, nv)[equal], np.eye(nv)[list(locked)]]))
    if not free.size:
        return np.zeros(0), np.zeros((nv, 0))
    square, shapes = eigh(free.T @ (0.5 * (stiffness + stiffness.T)) @ free, free.T @ mass @ free)
    swings = square > max(_SWINGS, 1e-9 * square.max())
    return np.sqrt(square[swings]) / (2 * np.pi), free @ shapes[:, swings]


ARRANGEMENTS: dict[str, Callable[[MachineTable], TableMjcf]] = {
    "bridge": bridge,
    "table": moving_table,
    "cantilever": cantilever,
    "tandem": tandem,
    "corexy": corexy,
}
_LONGEST_STEP = 2.5e-4  # longest physics step [s]
# largest angle by which the fastest mode turns in a physics step [rad]; smaller with a stepper in open loop, whose
# field only friction damps: half the error of its torque
_PER_STEP = 1.0
_PER_STEP_UNDAMPED = 0.5


def mjcf_of(table: MachineTable) -> str:
    """Return the MJCF of a machine, complete in one text, with a physics step that its fastest mode allows."""
    slides = [slide for slide in (table.x, table.y, table.z) if slide is not None]
    return _text(ARRANGEMENTS[table.arrangement](table), [*(slide.drive for slide in slides), table.belts])


def _text(mjcf: Mjcf, drives: Iterable[Drive | None]) -> str:
    frequencies, _ = modes(mujoco.MjModel.from_xml_string(mjcf.text()))
    field_rates = [drive.field_rate for drive in drives if drive is not None]
    fastest = max(2 * math.pi * float(frequencies.max(initial=0.0)), *field_rates)
    step = _LONGEST_STEP
    largest_angle = _PER_STEP_UNDAMPED if any(field_rates) else _PER_STEP
    # halved, so that it stays a fraction of usual servo periods
    while fastest * step > largest_angle:
        step /= 2
    return mjcf.text(step)


def mjcf_in(file: Path) -> str:
    """Return the MJCF of the machine whose table a TOML file holds, or of a URDF with its table beside it.

    Raises:
        InputError: a file that cannot be read, a key that is unknown, missing or out of its bounds, or a URDF without
            a table.
    """
    source = table_of_urdf(file) if file.suffix.lower() == SUFFIX else file
    content = read_toml(source, f"machine {source}")
    try:
        if file.suffix.lower() == SUFFIX or is_urdf_table(content):
            table, urdf, root = read_urdf_table(source, content)
            return _text(urdf_mjcf(table, urdf, root), [axis.drive for axis in table.axes.values()])
        return mjcf_of(read_table(source))
    except InputError:
        raise
    except (ArithmeticError, ValueError, mujoco.FatalError) as error:  # of values far from any machine
        text = " ".join(str(error).split())
        raise InputError(
            f"machine {source}: its values do not make a machine: one is far too large or too small: {text}"
        ) from None
