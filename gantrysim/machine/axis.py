"""An axis of a machine: its drive, encoder, friction and motion, in mm or deg, as the compiled MJCF states them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.display import table_html
from gantrysim.base.errors import InputError, between
from gantrysim.base.quantity import number_text
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.model_arrays import ModelArrays, compiled_of
from gantrysim.machine.motors import (
    BRISTLE_STIFFNESS,
    BUS_VOLTAGE,
    COULOMB,
    MOTOR_CONSTANT,
    RESISTANCE,
    STATIC,
    STRIBECK,
    TIME_CONSTANT,
)
from gantrysim.servo.axis_dynamics import Friction
from gantrysim.servo.stability.motion import MODES, Motion

# custom numerics, with a value per actuator
EFFICIENCY = "efficiency"
CONSTANT_TORQUE = "constant_torque"  # at the motor, positive forwards [N·m]
VISCOUS_DIFFERENCE = "viscous_difference"  # at the axis, half of forwards less back [N·s/m or N·m·s/rad]
_PARALLEL = 1 - 1e-6  # cosine of the angle between an axis and the spring of its load
_GEARS = 1e-6, 1e9  # from a lead of 6,000 km to one of 6 nm
_UM = 1e-3  # mm per um
_UNITS = {mujoco.mjtJoint.mjJNT_SLIDE: "mm", mujoco.mjtJoint.mjJNT_HINGE: "deg"}

PER_SI = {"mm": 1e3, "deg": 180 / math.pi}  # millimetres per metre, degrees per radian


def element_index(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Return the index of a named element, or raise InputError that lists the names in the model."""
    index = mujoco.mj_name2id(model, kind, name)
    if index >= 0:
        return int(index)
    label, count = {
        mujoco.mjtObj.mjOBJ_SITE: ("site", model.nsite),
        mujoco.mjtObj.mjOBJ_BODY: ("body", model.nbody),
        mujoco.mjtObj.mjOBJ_JOINT: ("joint", model.njnt),
    }[kind]
    names = [mujoco.mj_id2name(model, kind, i) for i in range(count)]
    present = [present_name for present_name in names if present_name]
    if not present:
        raise InputError(f'has no {label} named {name!r}, nor any other: add <{label} name="{name}"/> to its body')
    example = f'x = "{name}"' if label == "joint" else f'{name} = "..."'
    raise InputError(
        f"has no {label} named {name!r}; it has: {', '.join(present)}; rename one, or map its name in "
        f"the job: names = {{ {example} }}"
    )


def read_axes(model: mujoco.MjModel) -> tuple[tuple[Axis, ...], tuple[AxisAddress, ...]]:
    """Return the axes in the order of the actuators, without inertia and motion, and their addresses."""
    pairs = [_read_axis(model, actuator) for actuator in range(model.nactuator)]
    return tuple(axis for axis, _ in pairs), tuple(address for _, address in pairs)


def _read_axis(model: mujoco.MjModel, actuator: int) -> tuple[Axis, AxisAddress]:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
    if not name:
        raise InputError(f"actuator {actuator} has no name; it must bear the name of its axis' joint")
    joint = element_index(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    drives_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
    if not drives_joint or model.actuator_trnid[actuator, 0] != joint:
        raise InputError(
            f'actuator {name!r} must drive the joint {name!r}, as in <motor name="{name}" joint="{name}"/>'
        )
    unit = _UNITS.get(mujoco.mjtJoint(int(model.jnt_type[joint])))
    if unit is None:
        raise InputError(f"joint {name!r} must be a slide or a hinge")
    gear = float(model.actuator_gear[actuator, 0])
    if not gear > 0:
        meaning = {"mm": "2 pi / lead in rad/m", "deg": "turns of the motor per turn of the axis"}[unit]
        raise InputError(f"gear of {name!r} = {gear:g}: must be greater than 0 ({meaning})")
    between(f"gear of {name!r}", gear, *_GEARS)
    scale = PER_SI[unit] / gear
    axis = Axis(
        name=name,
        unit=unit,
        travel=_travel(model, joint, unit),
        scale=scale,
        inertia=math.nan,
        declared_speed=_declared_speed(model, joint, unit),
        resolution=_resolution(model, name, actuator, scale),
        efficiency=_efficiency(model, actuator),
        constant_torque=_finite(model, CONSTANT_TORQUE, actuator),
        mode=MODES[int(fact(model, "drive_mode", actuator, 0.0)) % len(MODES)],
        phases=_phases(model, actuator),
        **_drive_and_friction(model, actuator, name, unit, scale),
    )
    current = -1
    # the winding's current is the last activation of a dcmotor
    if axis.lag > 0:
        current = int(model.actuator_actadr[actuator] + model.actuator_actnum[actuator] - 1)
    address = AxisAddress(
        joint=int(model.jnt_qposadr[joint]),
        control=int(model.actuator_ctrladr[actuator]),
        output=int(model.actuator_outadr[actuator]),
        current=current,
        load=load_of(model, joint),
    )
    return axis, address


def _travel(model: mujoco.MjModel, joint: int, unit: str) -> tuple[float, float]:
    if not model.jnt_limited[joint]:
        return -math.inf, math.inf
    low, high = (float(end) * PER_SI[unit] for end in model.jnt_range[joint])
    return low, high


def _declared_speed(model: mujoco.MjModel, joint: int, unit: str) -> float:
    """Return the speed limit in the joint's first user value, inf where it states none [u/s]."""
    if not model.nuser_jnt:
        return math.inf
    declared = float(model.jnt_user[joint, 0]) * PER_SI[unit]
    return declared if declared > 0 else math.inf


def _drive_and_friction(
    model: mujoco.MjModel | ModelArrays, actuator: int, name: str, unit: str, scale: float
) -> dict[str, Any]:
    """Return the attributes of `Axis` that a perturbation may change."""
    drive = _drive(model, actuator, name)
    gear = float(model.actuator_gear[actuator, 0])
    static = float(model.actuator_biasprm[actuator, STATIC])
    # at the motor shaft [rad/s]
    stribeck_speed = float(model.actuator_biasprm[actuator, STRIBECK])
    bristle_stiffness = float(model.actuator_dynprm[actuator, BRISTLE_STIFFNESS])  # [N·m/rad]
    dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
    # an actuator's damping acts on the motor shaft, the joint's on the load
    damping = float(model.dof_damping[dof]) + float(model.actuator_damping[actuator]) * gear**2
    return {
        **drive,
        "viscous": damping / (gear * PER_SI[unit]),
        "viscous_difference": _finite(model, VISCOUS_DIFFERENCE, actuator) / (gear * PER_SI[unit]),
        "friction": Friction(drive["coulomb"], static, stribeck_speed * scale, bristle_stiffness / scale),
    }


def load_of(model: mujoco.MjModel, joint: int) -> int:
    """Return the joint by which an axis carries its load on a spring, -1 where there is none or more than one.

    It is a spring of the axis' kind and direction that nothing drives, on the axis' body or on one that it carries.
    """
    driven = set(model.actuator_trnid[: model.nactuator, 0].tolist())
    direction = _direction(model, joint)
    springs = []
    for spring in range(model.njnt):
        if spring in driven or not model.jnt_stiffness[spring] > 0:
            continue
        same_kind = model.jnt_type[spring] == model.jnt_type[joint] and _carries(model, joint, spring)
        if same_kind and direction @ _direction(model, spring) > _PARALLEL:
            springs.append(spring)
    return springs[0] if len(springs) == 1 else -1


def _carries(model: mujoco.MjModel, joint: int, spring: int) -> bool:
    """Whether a spring is on the body that a joint moves, after the joint, or on a child of that body."""
    body = model.jnt_bodyid[joint]
    body_of_spring = model.jnt_bodyid[spring]
    if body_of_spring == body:
        return spring > joint
    return bool(model.body_parentid[body_of_spring] == body)


def _direction(model: mujoco.MjModel, joint: int) -> Floats:
    """Return the direction of a joint in the model's frame, all joints at their reference, (3,)."""
    direction = model.jnt_axis[joint].copy()
    body = int(model.jnt_bodyid[joint])
    while body:
        in_parent = np.zeros(3)
        mujoco.mju_rotVecQuat(in_parent, direction, model.body_quat[body])
        direction = in_parent
        body = int(model.body_parentid[body])
    return np.asarray(direction)


def _drive(model: mujoco.MjModel | ModelArrays, actuator: int, name: str) -> dict[str, Any]:
    """Return the attributes of `Axis` that belong to the motor and its drive."""
    torque_limit = _torque_limit(model, actuator, name)
    gain = model.actuator_gainprm[actuator]
    # a torque drive: input "ff" passes the demand through winding and bus voltage, without MuJoCo's own controller
    if model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        resistance = float(gain[RESISTANCE])
        constant = float(gain[MOTOR_CONSTANT])
        voltage = float(gain[BUS_VOLTAGE])
        if model.actuator_ctrlspec[actuator] != mujoco.mjtCtrlInput.mjINPUT_FF or voltage <= 0:
            raise InputError(
                f'dcmotor {name!r} must have input="ff" and a bus voltage, the last number of its controller: '
                f'controller="0 0 0 0 0 48" for 48 V'
            )
        return {
            "motor_constant": constant,
            "resistance": resistance,
            "lag": float(model.actuator_dynprm[actuator, TIME_CONSTANT]),
            "bus_voltage": voltage,
            "peak_torque": min(torque_limit, constant * voltage / resistance),
            "coulomb": float(model.actuator_biasprm[actuator, COULOMB]),
        }
    if (
        model.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_FIXED
        or gain[0] != 1
        or model.actuator_biastype[actuator] != mujoco.mjtBias.mjBIAS_NONE
        or model.actuator_dyntype[actuator] != mujoco.mjtDyn.mjDYN_NONE
    ):
        raise InputError(
            f'actuator {name!r} must be a dcmotor with input="ff", or a motor: the servo here closes the loops; a '
            f"position or velocity actuator becomes <motor> without kp, kv and ctrlrange"
        )
    return {
        "motor_constant": math.nan,
        "resistance": math.nan,
        "lag": 0.0,
        "bus_voltage": math.inf,
        "peak_torque": torque_limit,
        "coulomb": 0.0,
    }


def _torque_limit(model: mujoco.MjModel | ModelArrays, actuator: int, name: str) -> float:
    """Return the largest torque that the ranges of force and control leave in both directions [N·m]."""
    limit = math.inf
    control = np.ravel(model.actuator_ctrlrange[model.actuator_ctrladr[actuator]])
    for limited, (low, high) in (
        (model.actuator_forcelimited[actuator], model.actuator_forcerange[actuator]),
        (model.actuator_ctrllimited[actuator], control),
    ):
        if not limited:
            continue
        if not low < 0 < high:
            raise InputError(f"range of {name!r} = {low:g} to {high:g} N·m: must include zero")
        limit = min(limit, float(-low), float(high))
    return limit


def facts(model: mujoco.MjModel | ModelArrays, name: str) -> Floats | None:
    """Return a custom numeric of the MJCF that has a value per actuator, as a view of the model's; None without one."""
    index = mujoco.mj_name2id(compiled_of(model), mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0 or model.numeric_size[index] != model.nactuator:
        return None
    first = int(model.numeric_adr[index])
    return np.asarray(model.numeric_data[first : first + model.nactuator])


def fact(model: mujoco.MjModel | ModelArrays, name: str, actuator: int, default: float = math.nan) -> float:
    """Return a value of a custom numeric of the MJCF that has one per actuator."""
    values = facts(model, name)
    return default if values is None else float(values[actuator])


def stated_geometry(model: mujoco.MjModel) -> Geometry | None:
    """Return the errors of transmissions that custom numerics of the MJCF state [um], None where there are none."""
    actuators = range(model.nactuator)
    travel = tuple(_UM * fact(model, "travel_error", actuator, 0.0) for actuator in actuators)
    periodic = tuple(_UM * fact(model, "periodic_error", actuator, 0.0) for actuator in actuators)
    if not any((*travel, *periodic)):
        return None
    return Geometry(travel_error=travel, periodic_error=periodic)


def _efficiency(model: mujoco.MjModel, actuator: int) -> float:
    value = fact(model, EFFICIENCY, actuator, 1.0)
    if not 0 < value <= 1:
        raise InputError(f"custom numeric {EFFICIENCY} = {value:g}: must be above 0 and at most 1")
    return value


def _finite(model: mujoco.MjModel | ModelArrays, name: str, actuator: int) -> float:
    value = fact(model, name, actuator, 0.0)
    if not math.isfinite(value):
        raise InputError(f"custom numeric {name} = {value:g}: must be finite")
    return value


def _phases(model: mujoco.MjModel, actuator: int) -> Phases | None:
    if model.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_DCMOTOR:
        return None
    phases = Phases(
        pole_pairs=fact(model, "pole_pairs", actuator, 0.0),
        inductance=fact(model, "inductance", actuator, 0.0),
        microsteps=fact(model, "microsteps", actuator, 0.0),
    )
    return phases if phases.pole_pairs >= 1 else None


def _resolution(model: mujoco.MjModel, name: str, actuator: int, scale: float) -> float:
    """Return the axis travel per count of the encoder; 0 where the axis has none."""
    sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    # without an encoder, or one whose counts are not stated
    if sensor < 0 or not model.nuser_sensor:
        return 0.0
    if model.sensor_type[sensor] != mujoco.mjtSensor.mjSENS_ACTUATORPOS or model.sensor_objid[sensor] != actuator:
        raise InputError(f"sensor {name!r} must be an actuatorpos of the actuator {name!r}")
    counts = float(model.sensor_user[sensor, 0])
    return 2 * math.pi * scale / counts if counts > 0 else 0.0


@dataclass(frozen=True)
class Phases:
    """The phases of a motor with poles.

    Attributes:
        pole_pairs: p, electrical periods per turn; of a stepper each is four full steps.
        inductance: of a phase [H].
        microsteps: per full step of a stepper in open loop, else 0.
    """

    pole_pairs: float
    inductance: float
    microsteps: float


@dataclass(frozen=True)
class Axis:
    """A driven axis; u is its unit of travel, torques are at the motor shaft.

    Attributes:
        name: name of the axis, and of its joint, actuator and encoder.
        unit: "mm" for a slide, "deg" for a hinge.
        travel: lowest and highest position; infinite for a joint without a range [u].
        scale: axis travel per motor angle: lead / 2 pi, or 1 / gear ratio in degrees [u/rad].
        inertia: motor torque per acceleration: rotor, transmission and load, with all axes at their reference
            [N·m·s²/u].
        viscous: motor torque per speed [N·m·s/u].
        coulomb: Coulomb friction [N·m].
        motor_constant: torque and back-EMF constant K; nan for an ideal torque source [N·m/A].
        resistance: winding resistance; nan for an ideal torque source [ohm].
        lag: electrical time constant, L/R [s].
        bus_voltage: voltage limit of the drive; inf for an ideal torque source [V].
        peak_torque: torque limit of the drive [N·m].
        declared_speed: speed limit stated in the MJCF; inf if none [u/s].
        resolution: axis travel per encoder count; 0 for an exact measurement [u].
        motion: linear dynamics with all axes at their reference and the other motors held; None if an actuator has a
            delay of its own.
        friction: LuGre friction of the motor; all zero without friction.
        chain: linear dynamics of all axes if a closed chain couples them, otherwise None.
        coupled: linear dynamics of this axis and the axes coupled with it, in their order; None for an uncoupled axis.
            In a closed chain these are all axes.
        efficiency: fraction of the work that the transmission passes on.
        constant_torque: that acts on the motor besides, such as a weight, positive forwards [N·m].
        viscous_difference: half the difference of viscous friction, forwards less back; `viscous` is the mean
            [N·m·s/u].
        mode: command mode of the drive, see `gantrysim.Servo`.
        phases: phases of a motor whose custom numerics state them, otherwise None.
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
    friction: Friction = field(repr=False)
    motion: Motion | None = field(default=None, repr=False)
    chain: Motion | None = field(default=None, repr=False)
    coupled: Motion | None = field(default=None, repr=False)
    efficiency: float = 1.0
    constant_torque: float = 0.0
    viscous_difference: float = 0.0
    mode: str = "torque"
    phases: Phases | None = None

    @property
    def no_load_speed(self) -> float:
        """Speed at which the back-EMF equals the bus voltage [u/s]."""
        # an ideal torque source has no back-EMF: nan
        if not self.motor_constant > 0:
            return math.inf
        return self.bus_voltage / self.motor_constant * self.scale

    @property
    def speed_limit(self) -> float:
        """The lower of declared speed and no-load speed [u/s]."""
        return min(self.declared_speed, self.no_load_speed)

    @property
    def electrical_period(self) -> float:
        """Travel per electrical period, four full steps of a stepper; 0 if the phases are unknown [u]."""
        if self.phases is None:
            return 0.0
        return 2 * math.pi * self.scale / self.phases.pole_pairs


@dataclass(frozen=True)
class AxisAddress:
    """Indices of an axis in MuJoCo's arrays."""

    joint: int  # qpos
    control: int  # ctrl
    output: int  # actuator_length
    current: int  # act, -1 where the winding has no inductance
    load: int  # joint of the load on the axis' compliance, -1 where there is none


def axis_table(title: str, axes: Sequence[Axis]) -> str:
    """Return the main values of axes as an HTML table."""
    heads = ("axis", "unit", "travel", "peak torque [N·m]", "encoder count", "inertia [N·m·s²/u]")
    rows = [
        [
            axis.name,
            axis.unit,
            " to ".join(number_text(end, "g") for end in axis.travel),
            f"{axis.peak_torque:.4g}",
            f"{axis.resolution:.4g}",
            f"{axis.inertia:.4g}",
        ]
        for axis in axes
    ]
    return table_html(title, heads, rows)
