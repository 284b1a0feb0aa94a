"""Compiling an MJCF into the model that is rendered and the one that is stepped."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from gantrysim.base.errors import InputError, between
from gantrysim.machine.naming import rename
from gantrysim.machine.row import ROW_NUMBERS
from gantrysim.machine.sizes import check_sizes

_TIMESTEPS = 1e-7, 1.0  # [s]


def compile_mjcf(
    source: Path | mujoco.MjSpec, names: Mapping[str, str] | None = None
) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Return an MJCF and its compiled model, with room for the servo's row and without MuJoCo's automatic reset.

    Args:
        source: file or MJCF.
        names: new names of elements, given before the compilation, see `rename`.
    """
    try:
        spec = _read(source) if isinstance(source, Path) else source
        rename(spec, names or {})
        spec.nuserdata = max(int(spec.nuserdata), ROW_NUMBERS)
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # MuJoCo's bindings warn of a singular inertia by it
            compiled = spec.compile()
    except InputError:
        raise
    except UserWarning as warning:
        raise InputError(f"MuJoCo warns: {' '.join(str(warning).split())}") from None
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(" ".join(str(error).split())) from None
    if compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION or compiled.opt.disableactuator:
        raise InputError("disables its actuators; the servo needs them")
    if compiled.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise InputError(
            'integrator RK4 calls the servo four times a step: give <option integrator="implicitfast"/>, or Euler'
        )
    between("timestep", compiled.opt.timestep, *_TIMESTEPS, "s")
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    _no_force_early(compiled)
    return spec, compiled


def _read(source: Path) -> mujoco.MjSpec:
    """Return the MJCF in a file, or the MJCF of a machine from its table in a TOML file, alone or beside a URDF."""
    if source.suffix.lower() in (".toml", ".urdf"):
        from gantrysim.machine.design.build import mjcf_in  # slow to import, and for tables alone

        return mujoco.MjSpec.from_string(mjcf_in(source))
    check_sizes(source)
    return mujoco.MjSpec.from_file(str(source))


def _no_force_early(compiled: mujoco.MjModel) -> None:
    """Take a dcmotor's force from its current at the beginning of a step.

    MuJoCo compiles it to be taken from the current at the end. With semi-implicit Euler, whose positions lead by half a
    step, motion is then about a step early, and every loop seems more stable than it is. From the beginning, the force
    is late by the half step by which positions are early, and the error falls with the square of the step.
    """
    compiled.actuator_actearly[:] = False


def without_visuals(spec: mujoco.MjSpec, compiled: mujoco.MjModel) -> mujoco.MjModel:
    """Return a compiled model without visual-only elements; its dynamics are the same to the last bit.

    Steps need not place these geoms, cameras and lights, and copies hold no textures. MuJoCo keeps a geom that defines
    a body's inertia; if a sensor uses a camera, the result is the compiled model itself.
    """
    # a second compilation, as MuJoCo cannot remove elements from a compiled model
    bare = spec.copy()
    bare.compiler.discardvisual = True
    bare.visual = mujoco.MjSpec().visual
    # nan: to be computed. An array, as MuJoCo would drop an interrupt while it converts a list
    bare.stat.center = np.full(3, np.nan)
    bare.stat.extent = np.nan
    bare.stat.meansize = np.nan
    for element in (*bare.cameras, *bare.lights):
        bare.delete(element)
    try:
        physics = bare.compile()
    except (ValueError, mujoco.FatalError):  # such as of a sensor whose camera is gone
        return compiled
    physics.opt.disableflags = compiled.opt.disableflags
    _no_force_early(physics)
    return physics
