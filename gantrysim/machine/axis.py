"""An axis of a machine, read from its joint, actuator and encoder in the compiled MJCF."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from gantrysim.errors import InputError

PER_SI = {"mm": 1e3, "deg": 180 / math.pi}  # in a metre, in a radian


@dataclass(frozen=True)
class Axis:
    """One driven axis, in its own unit u, s, N·m at the motor, A and V.

    Attributes:
        name: shared by joint, actuator and encoder.
        unit: u, "mm" for a slide and "deg" for a hinge.
        travel: lowest and highest position [u].
        scale: axis travel per radian of the motor: lead / 2 pi, or 1 / gear ratio in degrees [u/rad].
        inertia: motor torque per acceleration, with rotor, screw and everything the axis carries where all axes
            are at their reference [N·m·s²/u].
        viscous: motor torque per speed [N·m·s/u].
        coulomb: Coulomb friction at the motor [N·m].
        motor_constant: torque constant and back-EMF constant K [N·m/A]; nan for an ideal torque source.
        resistance: of the winding [ohm]; nan for an ideal torque source.
        lag: time constant of the winding, L/R [s].
        bus_voltage: the drive's limit [V]; inf where it has none.
        peak_torque: the drive's limit [N·m].
        declared_speed: the MJCF's own limit; inf where it states none [u/s].
        resolution: axis travel per encoder count, 0 for an exact measurement [u].
    """

    name: str
    unit: str
    travel: tuple[float, float]
    scale: float
    inertia: float
    viscous: float
    coulomb: float
    motor_constant: float
    resistance: float
    lag: float
    bus_voltage: float
    peak_torque: float
    declared_speed: float
    resolution: float

    @property
    def no_load_speed(self) -> float:
        """Speed at which the back-EMF is the bus voltage [u/s]."""
        return self.bus_voltage / self.motor_constant * self.scale if self.motor_constant > 0 else math.inf

    @property
    def speed_limit(self) -> float:
        """The declared speed, at most the no-load speed [u/s]."""
        return min(self.declared_speed, self.no_load_speed)


@dataclass(frozen=True)
class AxisAddress:
    """Where an axis lies in MuJoCo's arrays."""

    joint: int  # qpos
    control: int  # ctrl
    output: int  # actuator_length
    current: int  # act, -1 where the winding has no inductance


def named(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, source: Path) -> int:
    """Return the index of a named element, or raise InputError with the names that there are."""
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        label = {
            mujoco.mjtObj.mjOBJ_SITE: "site",
            mujoco.mjtObj.mjOBJ_BODY: "body",
            mujoco.mjtObj.mjOBJ_JOINT: "joint",
        }[kind]
        count = {"site": model.nsite, "body": model.nbody, "joint": model.njnt}[label]
        present = filter(None, (mujoco.mj_id2name(model, kind, i) for i in range(count)))
        raise InputError(f"model {source}: has no {label} named {name!r}; it has: {', '.join(present) or 'none'}")
    return int(index)


def read_axis(model: mujoco.MjModel, data: mujoco.MjData, i: int, source: Path) -> tuple[Axis, AxisAddress]:
    """Return the axis that the i-th actuator drives, and where it lies in MuJoCo's arrays."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i)
    if not name:
        raise InputError(f"model {source}: actuator {i} has no name; it must bear the name of its axis' joint")
    joint = named(model, mujoco.mjtObj.mjOBJ_JOINT, name, source)
    if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[i, 0] != joint:
        raise InputError(f"model {source}: actuator {name!r} must drive the joint {name!r}")
    unit = {mujoco.mjtJoint.mjJNT_SLIDE: "mm", mujoco.mjtJoint.mjJNT_HINGE: "deg"}.get(
        mujoco.mjtJoint(int(model.jnt_type[joint]))
    )
    if unit is None:
        raise InputError(f"model {source}: joint {name!r} must be a slide or a hinge")
    gear = float(model.actuator_gear[i, 0])
    if not gear > 0:
        what = {"mm": "2 pi / lead in rad/m", "deg": "turns of the motor per turn of the axis"}[unit]
        raise InputError(f"model {source}: gear of {name!r} = {gear:g}: must be greater than 0 ({what})")
    per_si = PER_SI[unit]
    scale = per_si / gear
    dof = int(model.jnt_dofadr[joint])
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)

    drive = _drive(model, i, name, source)
    limited = bool(model.jnt_limited[joint])
    travel = (float(model.jnt_range[joint, 0]) * per_si, float(model.jnt_range[joint, 1]) * per_si)
    declared = float(model.jnt_user[joint, 0]) * per_si if model.nuser_jnt else 0.0
    damping = float(model.dof_damping[dof]) + float(model.actuator_damping[i]) * gear**2
    axis = Axis(
        name=name,
        unit=unit,
        travel=travel if limited else (-math.inf, math.inf),
        scale=scale,
        inertia=float(inertia[dof, dof]) / (gear * per_si),
        viscous=damping / (gear * per_si),
        coulomb=drive.coulomb,
        motor_constant=drive.motor_constant,
        resistance=drive.resistance,
        lag=drive.lag,
        bus_voltage=drive.bus_voltage,
        peak_torque=drive.peak_torque,
        declared_speed=declared if declared > 0 else math.inf,
        resolution=_encoder(model, name, i, scale, source),
    )
    current = int(model.actuator_actadr[i] + model.actuator_actnum[i] - 1) if drive.lag > 0 else -1
    return axis, AxisAddress(
        int(model.jnt_qposadr[joint]), int(model.actuator_ctrladr[i]), int(model.actuator_outadr[i]), current
    )


@dataclass(frozen=True)
class _Drive:
    motor_constant: float
    resistance: float
    lag: float
    bus_voltage: float
    peak_torque: float
    coulomb: float


def _drive(model: mujoco.MjModel, i: int, name: str, source: Path) -> _Drive:
    peak = math.inf
    for limited, (low, high) in (
        (model.actuator_forcelimited[i], model.actuator_forcerange[i]),
        (model.actuator_ctrllimited[i], np.ravel(model.actuator_ctrlrange[model.actuator_ctrladr[i]])),
    ):
        if limited and not low < 0 < high:
            raise InputError(f"model {source}: range of {name!r} = {low:g} to {high:g} N·m: must hold zero within it")
        if limited:
            peak = min(peak, float(-low), float(high))
    gain = model.actuator_gainprm[i]
    if model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        resistance, constant, voltage = float(gain[0]), float(gain[1]), float(gain[7])
        if model.actuator_ctrlspec[i] != mujoco.mjtCtrlInput.mjINPUT_FF or voltage <= 0:
            raise InputError(
                f'model {source}: dcmotor {name!r} must have input="ff" '
                "and a bus voltage, the last number of its controller"
            )
        return _Drive(
            constant,
            resistance,
            float(model.actuator_dynprm[i, 0]),
            voltage,
            min(peak, constant * voltage / resistance),
            float(model.actuator_biasprm[i, 3]),
        )
    fixed = model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED and gain[0] == 1
    if (
        not fixed
        or model.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_NONE
        or model.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_NONE
    ):
        raise InputError(f'model {source}: actuator {name!r} must be a dcmotor with input="ff", or a motor')
    return _Drive(math.nan, math.nan, 0.0, math.inf, peak, 0.0)


def _encoder(model: mujoco.MjModel, name: str, actuator: int, scale: float, source: Path) -> float:
    sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    if sensor < 0 or not model.nuser_sensor:
        return 0.0
    if model.sensor_type[sensor] != mujoco.mjtSensor.mjSENS_ACTUATORPOS or model.sensor_objid[sensor] != actuator:
        raise InputError(f"model {source}: sensor {name!r} must be an actuatorpos of the actuator {name!r}")
    counts = float(model.sensor_user[sensor, 0])
    return 2 * math.pi * scale / counts if counts > 0 else 0.0
