"""Machines whose physics step is linear but for their motors, read off MuJoCo and checked against it."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only_view
from gantrysim.base.errors import InputError, short_text
from gantrysim.engine.native.plant import MAX_DOFS, PLANT, RESISTIVE, SOURCE, STATE, WOUND, move
from gantrysim.machine.axis import PER_SI
from gantrysim.machine.compiling import scratch_data
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    BUS_VOLTAGE,
    COGGING,
    COULOMB,
    CURRENT_RATE,
    MOTOR_CONSTANT,
    RESISTANCE,
    STATIC,
    STRIBECK,
    TIME_CONSTANT,
    activation_slots,
    driven_joints,
)
from gantrysim.record.run import Run

# Unit states by which the mechanics is read: powers of two, by which nothing is rounded. A stiff axis that were 1 m off
# would be faster than MuJoCo allows.
_PLACE = 2.0**-10  # [m]
_SPEED = 1.0  # [m/s]
_FORCE = 2.0**10  # [N]

# The check: random states, and the largest difference to MuJoCo's step relative to the largest term.
_STATES = 2
_ROUNDING = 1e-11
_FASTEST_SPEED = 2.0  # of an axis without a limit [m/s]
_FARTHEST_POSITION = 1e3  # of such an axis [mm]

# other parameters of MuJoCo's dcmotor that must be 0: of temperature and slew rate, and gains of a controller
_UNKNOWN_DYNAMICS = (2, 7)
_UNKNOWN_GAINS = (4, 5, 6)
_POLES = 1  # in biasprm
_PHASE = 2
_REMEMBERED_MODELS = 64  # models of which the linear machine is remembered


@dataclass(frozen=True, eq=False)
class Linear:
    """A machine for the compiled loop.

    Attributes:
        plant: the machine, (1,) of `PLANT`.
        slots: where MuJoCo's activations have each axis' bristle and current, -1 for none, (axes, 2).
    """

    plant: NDArray[np.void]
    slots: NDArray[np.int64]

    def write(self, state: np.void, data: mujoco.MjData) -> None:
        """Write a state, of `STATE`, into MuJoCo's data."""
        data.qpos[:] = state["place"][: len(data.qpos)]
        data.qvel[:] = state["speed"][: len(data.qvel)]
        for name, axes, slots in self._activations():
            data.act[slots] = state[name][axes]

    def read(self, state: np.void, data: mujoco.MjData) -> None:
        """Read a state, of `STATE`, out of MuJoCo's data."""
        state["place"][: len(data.qpos)] = data.qpos
        state["speed"][: len(data.qvel)] = data.qvel
        for name, axes, slots in self._activations():
            state[name][axes] = data.act[slots]

    def _activations(self) -> Iterator[tuple[str, NDArray[np.intp], NDArray[np.int64]]]:
        """Yield the name of a motor's state, the axes that have it, and where in the activations."""
        for name, slots in zip(("bristle", "current"), self.slots.T, strict=True):
            axes = np.flatnonzero(slots >= 0)
            yield name, axes, slots[axes]


@lru_cache(_REMEMBERED_MODELS)
def linear_machine(machine: Machine, model: mujoco.MjModel) -> Linear | None:
    """Return a machine for the compiled loop; None where MuJoCo's step differs from it by more than rounding.

    Args:
        machine: the machine.
        model: its model that is stepped, without stops.
    """
    if not could_be_linear(model):
        return None
    data = scratch_data(model)
    linear = linear_with(read_responses(machine, model, data), model)
    return linear if agrees(machine, model, data, linear) else None


def could_be_linear(model: mujoco.MjModel) -> bool:
    """Return whether all joints slide, not too many of them, and a known actuator drives each axis' joint."""
    if model.nv > MAX_DOFS:
        return False
    sliding = model.nq == model.nv and bool((model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE).all())
    known = model.nu == model.nactuator and not (model.nplugin or model.nmocap or model.nflex)
    return sliding and known and all(_is_known(model, a) for a in range(model.nactuator))


def _is_known(model: mujoco.MjModel, a: int) -> bool:
    gain = model.actuator_gaintype[a]
    if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_JOINT:
        return False
    if gain == mujoco.mjtGain.mjGAIN_DCMOTOR:
        dynamics = model.actuator_dynprm[a, _UNKNOWN_DYNAMICS]
        gains = model.actuator_gainprm[a, _UNKNOWN_GAINS]
        takes_torque = model.actuator_ctrlspec[a] == mujoco.mjtCtrlInput.mjINPUT_FF
        return bool(takes_torque and not dynamics.any() and not gains.any())
    plain = model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
    return bool(gain == mujoco.mjtGain.mjGAIN_FIXED and plain and model.actuator_actnum[a] == 0)


class Responses(NamedTuple):
    """How speeds after a step, forces of springs and dampers before it, and the nozzle depend on a state.

    Rows are the n speeds, 2 m forces on each axis' joint and on its load's, and the nozzle's three coordinates [mm].

    Attributes:
        of_place: per place of each joint, (n + 2 m + 3, n).
        of_speed: per speed of each joint, (n + 2 m + 3, n).
        of_force: per force on each joint, (n + 2 m + 3, n).
        at_zero: where places and speeds are 0, (n + 2 m + 3,).
    """

    of_place: Floats
    of_speed: Floats
    of_force: Floats
    at_zero: Floats


def read_responses(machine: Machine, model: mujoco.MjModel, data: mujoco.MjData) -> Responses:
    """Read the mechanics by steps from unit states, with the motors off.

    Args:
        machine: the machine.
        model: its model that is stepped.
        data: a state, to be overwritten.
    """
    joints = range(int(model.nv))
    off = copy.copy(model)
    off.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    dofs = model.jnt_dofadr[driven_joints(model)]
    loads = [address.load for address in machine.addresses]
    sensed = np.concatenate([dofs, [model.jnt_dofadr[max(load, 0)] for load in loads]])

    def stepped(array: Floats | None = None, k: int = 0, value: float = 0.0) -> Floats:
        """Return speeds after a step from one state, passive forces and the nozzle before it."""
        mujoco.mj_resetData(off, data)
        if array is not None:
            array[k] += value
        mujoco.mj_step(off, data)
        frame = data.xmat[machine.work].reshape(3, 3)
        tip = 1e3 * frame.T @ (data.site_xpos[machine.nozzle] - data.xpos[machine.work])
        return np.concatenate([data.qvel, data.qfrc_passive[sensed], tip])

    standing = stepped()
    of_place = np.array([(stepped(data.qpos, j, _PLACE) - standing) / _PLACE for j in joints]).T
    of_speed = np.array([(stepped(data.qvel, j, _SPEED) - standing) / _SPEED for j in joints]).T
    of_force = np.array([(stepped(data.qfrc_applied, j, _FORCE) - standing) / _FORCE for j in joints]).T
    return Responses(of_place, of_speed, of_force, standing - of_place @ model.qpos0)


def linear_with(responses: Responses, model: mujoco.MjModel) -> Linear:
    """Return a machine for the compiled loop, with the motors of a model that is stepped."""
    n = int(model.nv)
    m = int(model.nactuator)
    dofs = model.jnt_dofadr[driven_joints(model)]
    of_place, of_speed, of_force, at_zero = responses
    plants = np.zeros(1, PLANT)
    plant = plants[0]
    plant["dofs"] = n
    plant["axes"] = m
    plant["step"] = model.opt.timestep
    plant["of_speed"][:n, :n] = of_speed[:n]
    plant["of_place"][:n, :n] = of_place[:n]
    plant["push"][:n, :m] = of_force[:n, dofs]
    plant["constant"][:n] = at_zero[:n]
    springs = slice(n, n + 2 * m)
    plant["passive_of_place"][: 2 * m, :n] = of_place[springs]
    plant["passive_of_speed"][: 2 * m, :n] = of_speed[springs]
    plant["passive_at_rest"][: 2 * m] = at_zero[springs]
    plant["tip"][:, :n] = of_place[n + 2 * m :]
    plant["tip_at_rest"] = at_zero[n + 2 * m :]
    for a in range(m):
        for name, value in _motor(model, a).items():
            plant[name][a] = value
    return Linear(plants, np.array([activation_slots(model, a) for a in range(m)]).reshape(m, 2))


def _motor(model: mujoco.MjModel, a: int) -> dict[str, float]:
    gains = model.actuator_gainprm[a]
    dynamics = model.actuator_dynprm[a]
    bias = model.actuator_biasprm[a]
    values = {
        "dof": model.jnt_dofadr[model.actuator_trnid[a, 0]],
        "gear": model.actuator_gear[a, 0],
        "kind": SOURCE,
        "gain": gains[0],
        "lowest": -np.inf,
        "highest": np.inf,
        "weakest": -np.inf,
        "strongest": np.inf,
    }
    clamped = model.actuator_ctrllimited[a] and not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    if clamped:
        values["lowest"], values["highest"] = model.actuator_ctrlrange[a]
    if model.actuator_forcelimited[a]:
        values["weakest"], values["strongest"] = model.actuator_forcerange[a]
    if model.actuator_gaintype[a] != mujoco.mjtGain.mjGAIN_DCMOTOR:
        return values
    lag = dynamics[TIME_CONSTANT]
    return values | {
        "kind": WOUND if lag > 0 else RESISTIVE,
        "constant_of_motor": gains[MOTOR_CONSTANT],
        "resistance": gains[RESISTANCE],
        "bus": gains[BUS_VOLTAGE] if gains[BUS_VOLTAGE] > 0 else np.inf,
        "lag": lag,
        "remains": np.exp(-model.opt.timestep / lag) if lag > 0 else 0.0,
        "rate": dynamics[CURRENT_RATE] if dynamics[CURRENT_RATE] > 0 else np.inf,
        "cogging": bias[COGGING],
        "teeth": bias[_POLES],
        "phase": bias[_PHASE],
        "stiffness": dynamics[BRISTLE_STIFFNESS],
        "damping": dynamics[BRISTLE_DAMPING],
        "coulomb": bias[COULOMB],
        "static": bias[STATIC],
        "stribeck": bias[STRIBECK],
    }


def agrees(machine: Machine, model: mujoco.MjModel, data: mujoco.MjData, linear: Linear) -> bool:
    """Return whether steps from random states are MuJoCo's, but for rounding."""
    random = np.random.default_rng(0)
    ours, theirs = np.zeros(2, STATE)
    step: Any = move
    joints = model.jnt_dofadr[driven_joints(model)]
    low, high = (
        np.array([axis.travel for axis in machine.plain_axes]).clip(-_FARTHEST_POSITION, _FARTHEST_POSITION).T
        / PER_SI["mm"]
    )
    fastest = np.array([axis.speed_limit / PER_SI[axis.unit] for axis in machine.plain_axes])
    peak = np.array([axis.peak_torque for axis in machine.plain_axes])
    for _ in range(_STATES):
        mujoco.mj_resetData(model, data)
        data.qpos[:] += 1e-4 * random.standard_normal(model.nv)
        # anywhere on the axes: a spring may begin to act away from the middle
        data.qpos[joints] = random.uniform(low, high)
        data.qvel[:] = 1e-2 * random.standard_normal(model.nv)
        data.qvel[joints] = random.uniform(-1.5, 1.5, model.nactuator) * np.minimum(fastest, _FASTEST_SPEED)
        data.ctrl[:] = random.uniform(-2, 2, model.nactuator) * np.where(np.isfinite(peak), peak, 1.0)
        data.qfrc_applied[joints] = random.standard_normal(model.nactuator)
        data.act[:] = random.standard_normal(model.na)
        linear.read(ours, data)
        step(linear.plant[0], ours, data.ctrl.copy(), data.qfrc_applied[joints])
        mujoco.mj_step(model, data)
        linear.read(theirs, data)
        for name in ("place", "speed", "bristle", "current"):
            scale = np.abs(theirs[name]).max() + np.abs(ours["change"]).max()
            if not np.abs(ours[name] - theirs[name]).max() <= _ROUNDING * scale:
                return False
    return True


Engine = Literal["mujoco", "loop"]


def check_engine(engine: str) -> None:
    """Raise InputError for an engine that does not exist."""
    if not isinstance(engine, str) or engine not in get_args(Engine):
        raise InputError(f"engine {short_text(engine)}: must be {' or '.join(get_args(Engine))}")


_WORTH_SAYING = 1e-4  # [mm]


def difference_note(shown: Run, searched: Run) -> str:
    """Return a sentence on how far a run of MuJoCo's is from the loop's that a search made; empty within 0.1 µm.

    One count of an encoder that flips by rounding moves a run by a fraction of it.

    Args:
        shown: the run of MuJoCo's.
        searched: the run of the same job that the search made.
    """
    ticks = len(shown.time)
    if len(searched.time) != ticks:
        return f"MuJoCo's run, which is shown, has {ticks} servo ticks, the compiled loop's {len(searched.time)}."
    largest = max(float(np.abs(read_only_view(shown.nozzle) - read_only_view(searched.nozzle)).max()), 0.0)
    if largest <= _WORTH_SAYING:
        return ""
    return f"MuJoCo's run, which is shown, is up to {1e3 * largest:.1f} µm from the compiled loop's, which searched."
