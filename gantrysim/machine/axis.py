"""An axis of a machine, read from its joint, actuator and encoder in the compiled MJCF."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, between
from gantrysim.machine.linear_motion import linear_motion
from gantrysim.servo.laws.friction import Friction
from gantrysim.stability.motion import MODES, Motion, UnknownLoopError

EFFICIENCY = "efficiency"  # custom numeric
_PARALLEL = 1 - 1e-6  # cosine of the angle between an axis and the spring of its load
_GEARS = 1e-6, 1e9  # from a lead of 6,000 km to one of 6 nm
_HEAVY = 1e6  # inertia of a motor that does not move [kg or kg·m²]
PER_SI = {"mm": 1e3, "deg": 180 / math.pi}  # millimetres per metre, degrees per radian


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
        name: name of its joint, actuator and encoder.
        unit: "mm" for a slide, "deg" for a hinge.
        travel: lowest and highest position [u].
        scale: axis travel per motor angle: lead / 2 pi, or 1 / gear ratio in degrees [u/rad].
        inertia: motor torque per acceleration: rotor, transmission and load with all axes at their reference
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
        motion: linear motion with all axes at their reference and the motors of the others held; None if an actuator
            has a delay of its own.
        friction: model of its friction; all zero without one.
        chain: that of all axes, where a closed chain couples them; else None.
        coupled: that of all axes that move each other, this one among them, in their order; None for an axis that
            moves no other. In a closed chain it is that of all axes.
        efficiency: share of the work that its transmission passes on.
        mode: what its drive is made to be told, see `gantrysim.Servo`.
        phases: of a motor whose custom numerics state them, else None.
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
    mode: str = "torque"
    phases: Phases | None = None

    @property
    def no_load_speed(self) -> float:
        """Speed at which the back-EMF equals the bus voltage [u/s]."""
        return self.bus_voltage / self.motor_constant * self.scale if self.motor_constant > 0 else math.inf

    @property
    def speed_limit(self) -> float:
        """The lower of declared speed and no-load speed [u/s]."""
        return min(self.declared_speed, self.no_load_speed)

    @property
    def electrical_period(self) -> float:
        """Travel per electrical period, of a stepper four full steps; 0 where the phases are not known [u]."""
        return 2 * math.pi * self.scale / self.phases.pole_pairs if self.phases else 0.0


@dataclass(frozen=True)
class AxisAddress:
    """Indices of an axis in MuJoCo's arrays."""

    joint: int  # qpos
    control: int  # ctrl
    output: int  # actuator_length
    current: int  # act, -1 where the winding has no inductance
    load: int  # joint of the load on the axis' compliance, -1 where there is none


def element_index(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Return the index of a named element, or raise InputError that lists the names in the model."""
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        label, count = {
            mujoco.mjtObj.mjOBJ_SITE: ("site", model.nsite),
            mujoco.mjtObj.mjOBJ_BODY: ("body", model.nbody),
            mujoco.mjtObj.mjOBJ_JOINT: ("joint", model.njnt),
        }[kind]
        present = [*filter(None, (mujoco.mj_id2name(model, kind, i) for i in range(count)))]
        if not present:
            raise InputError(f'has no {label} named {name!r}, nor any other: add <{label} name="{name}"/> to its body')
        given = f'x = "{name}"' if label == "joint" else f'{name} = "..."'
        raise InputError(
            f"has no {label} named {name!r}; it has: {', '.join(present)}; rename one, or map its name in "
            f"the job: names = {{ {given} }}"
        )
    return int(index)


def read_axes(model: mujoco.MjModel) -> tuple[tuple[Axis, ...], tuple[AxisAddress, ...]]:
    """Return the axes in the order of the actuators, without inertia and motion, and their addresses."""
    axes, addresses = zip(*(_read_axis(model, i) for i in range(model.nactuator)), strict=True)
    return axes, addresses


def with_dynamics(
    model: mujoco.MjModel, axes: Sequence[Axis], addresses: Sequence[AxisAddress], qpos: Floats, moved: Floats
) -> tuple[Axis, ...]:
    """Return the axes with their inertia and motion about a position.

    An axis moves all joints of a closed chain, at the rates N of the rigid machine. Its inertia is then that of
    N^T M N, with M the mass matrix, and its motion is that with very heavy motors on the others, which MuJoCo solves.

    Args:
        model: the compiled model.
        axes: the axes.
        addresses: their indices.
        qpos: the position.
        moved: N, velocity of every degree of freedom per velocity of an axis [SI], (nv, axes).
    """
    data = mujoco.MjData(model)
    mass = np.zeros((model.nv, model.nv))
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    inertia = np.einsum("ia,ij,ja->a", moved, mass, moved)
    gears = model.actuator_gear[: len(axes), 0]
    known = [
        replace(axis, inertia=float(of_axis) / (float(gear) * PER_SI[axis.unit]))
        for axis, of_axis, gear in zip(axes, inertia, gears, strict=True)
    ]
    closed = np.count_nonzero(moved) > len(axes)
    try:
        whole = motion_of(model, axes, addresses, qpos)
    except UnknownLoopError:
        return tuple(known)
    if not closed:
        coupled = _coupled_motions(whole)
        return tuple(replace(axis, motion=whole.of_axis(a), coupled=coupled.get(a)) for a, axis in enumerate(known))
    alone = [_alone(model, axes, addresses, qpos, a).of_axis(a) for a in range(len(axes))]
    return tuple(
        replace(axis, motion=motion, chain=whole, coupled=whole) for axis, motion in zip(known, alone, strict=True)
    )


def _coupled_motions(whole: Motion) -> dict[int, Motion]:
    """Return the motion of the group of each axis that moves others, by the number of the axis."""
    coupled: dict[int, Motion] = {}
    for states, members in whole.groups():
        if len(members) > 1:
            coupled |= dict.fromkeys(members, whole.of_group(states, members))
    return coupled


def _alone(
    model: mujoco.MjModel, axes: Sequence[Axis], addresses: Sequence[AxisAddress], qpos: Floats, axis: int
) -> Motion:
    """Return the motion of all axes when the motors of all but one are too heavy to move."""
    held = copy.copy(model)
    dofs = model.jnt_dofadr[model.actuator_trnid[: len(axes), 0]]
    held.dof_armature[np.delete(dofs, axis)] += _HEAVY
    return motion_of(held, axes, addresses, qpos)


def motion_of(model: mujoco.MjModel, axes: Sequence[Axis], addresses: Sequence[AxisAddress], qpos: Floats) -> Motion:
    """Return the linear motion of all axes about a point of rest, see `linear_motion`."""
    return linear_motion(
        model,
        qpos,
        [address.current for address in addresses],
        [address.control for address in addresses],
        [address.load for address in addresses],
        np.array([PER_SI[axis.unit] for axis in axes]),
    )


def _read_axis(model: mujoco.MjModel, i: int) -> tuple[Axis, AxisAddress]:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i)
    if not name:
        raise InputError(f"actuator {i} has no name; it must bear the name of its axis' joint")
    joint = element_index(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[i, 0] != joint:
        raise InputError(
            f'actuator {name!r} must drive the joint {name!r}, as in <motor name="{name}" joint="{name}"/>'
        )
    unit = {mujoco.mjtJoint.mjJNT_SLIDE: "mm", mujoco.mjtJoint.mjJNT_HINGE: "deg"}.get(
        mujoco.mjtJoint(int(model.jnt_type[joint]))
    )
    if unit is None:
        raise InputError(f"joint {name!r} must be a slide or a hinge")
    gear = float(model.actuator_gear[i, 0])
    if not gear > 0:
        meaning = {"mm": "2 pi / lead in rad/m", "deg": "turns of the motor per turn of the axis"}[unit]
        raise InputError(f"gear of {name!r} = {gear:g}: must be greater than 0 ({meaning})")
    between(f"gear of {name!r}", gear, *_GEARS)
    per_si = PER_SI[unit]
    scale = per_si / gear
    low, high = (float(end) * per_si for end in model.jnt_range[joint])
    declared = float(model.jnt_user[joint, 0]) * per_si if model.nuser_jnt else 0.0
    axis = Axis(
        name=name,
        unit=unit,
        travel=(low, high) if model.jnt_limited[joint] else (-math.inf, math.inf),
        scale=scale,
        inertia=math.nan,
        declared_speed=declared if declared > 0 else math.inf,
        resolution=_resolution(model, name, i, scale),
        efficiency=_efficiency(model, i),
        mode=MODES[int(fact(model, "drive_mode", i, 0.0)) % len(MODES)],
        phases=_phases(model, i),
        **_strengths(model, i, name, unit, scale),
    )
    current = int(model.actuator_actadr[i] + model.actuator_actnum[i] - 1) if axis.lag > 0 else -1
    where = (
        model.jnt_qposadr[joint],
        model.actuator_ctrladr[i],
        model.actuator_outadr[i],
        current,
        load_of(model, joint),
    )
    return axis, AxisAddress(*map(int, where))


def perturbed_axes(model: mujoco.MjModel, axes: Sequence[Axis]) -> tuple[Axis, ...]:
    """Return axes that a perturbation of their model has left where they are, without inertia and motion."""
    return tuple(replace(a, **_strengths(model, i, a.name, a.unit, a.scale)) for i, a in enumerate(axes))


def _strengths(model: mujoco.MjModel, i: int, name: str, unit: str, scale: float) -> dict[str, Any]:
    """Return the attributes of `Axis` that a perturbation changes: drive and friction."""
    drive = _drive(model, i, name)
    gear = float(model.actuator_gear[i, 0])
    static, stribeck = (float(value) for value in model.actuator_biasprm[i, 4:6])
    dof = model.jnt_dofadr[model.actuator_trnid[i, 0]]
    damping = float(model.dof_damping[dof]) + float(model.actuator_damping[i]) * gear**2
    return {
        **drive,
        "viscous": damping / (gear * PER_SI[unit]),
        "friction": Friction(drive["coulomb"], static, stribeck * scale, float(model.actuator_dynprm[i, 5]) / scale),
    }


def load_of(model: mujoco.MjModel, joint: int) -> int:
    """Return the joint by which an axis carries its load on a spring, -1 where there is none or more than one.

    It is a spring of the axis' kind and direction that nothing drives, on the axis' body or on one that it carries.
    """
    driven = set(model.actuator_trnid[: model.nactuator, 0].tolist())
    body = model.jnt_bodyid[joint]
    found = [
        other
        for other in range(model.njnt)
        if other not in driven
        and model.jnt_stiffness[other] > 0
        and model.jnt_type[other] == model.jnt_type[joint]
        and _carries(model, body, joint, other)
        and _direction(model, joint) @ _direction(model, other) > _PARALLEL
    ]
    return found[0] if len(found) == 1 else -1


def _carries(model: mujoco.MjModel, body: int, joint: int, other: int) -> bool:
    own = model.jnt_bodyid[other]
    return bool(model.body_parentid[own] == body or (own == body and other > joint))


def _direction(model: mujoco.MjModel, joint: int) -> Floats:
    """Return the direction of a joint in the model's frame, all joints at their reference, (3,)."""
    turned = np.zeros(3)
    direction = model.jnt_axis[joint].copy()
    body = int(model.jnt_bodyid[joint])
    while body:
        mujoco.mju_rotVecQuat(turned, direction, model.body_quat[body])
        direction = turned.copy()
        body = int(model.body_parentid[body])
    return np.asarray(direction)


def _drive(model: mujoco.MjModel, i: int, name: str) -> dict[str, Any]:
    """Return the attributes of `Axis` that belong to the motor and its drive."""
    peak = math.inf
    for limited, (low, high) in (
        (model.actuator_forcelimited[i], model.actuator_forcerange[i]),
        (model.actuator_ctrllimited[i], np.ravel(model.actuator_ctrlrange[model.actuator_ctrladr[i]])),
    ):
        if limited and not low < 0 < high:
            raise InputError(f"range of {name!r} = {low:g} to {high:g} N·m: must hold zero within it")
        if limited:
            peak = min(peak, float(-low), float(high))
    gain = model.actuator_gainprm[i]
    if model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        resistance = float(gain[0])
        constant = float(gain[1])
        voltage = float(gain[7])
        if model.actuator_ctrlspec[i] != mujoco.mjtCtrlInput.mjINPUT_FF or voltage <= 0:
            raise InputError(
                f'dcmotor {name!r} must have input="ff" and a bus voltage, the last number of its controller'
            )
        return {
            "motor_constant": constant,
            "resistance": resistance,
            "lag": float(model.actuator_dynprm[i, 0]),
            "bus_voltage": voltage,
            "peak_torque": min(peak, constant * voltage / resistance),
            "coulomb": float(model.actuator_biasprm[i, 3]),
        }
    if (
        model.actuator_gaintype[i] != mujoco.mjtGain.mjGAIN_FIXED
        or gain[0] != 1
        or model.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_NONE
        or model.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_NONE
    ):
        raise InputError(
            f'actuator {name!r} must be a dcmotor with input="ff", or a motor: the servo here closes the loops; a '
            f"position or velocity actuator becomes <motor> without kp, kv and ctrlrange"
        )
    ideal = {"motor_constant": math.nan, "resistance": math.nan, "lag": 0.0, "bus_voltage": math.inf, "coulomb": 0.0}
    return {**ideal, "peak_torque": peak}


def fact(model: mujoco.MjModel, name: str, actuator: int, default: float = math.nan) -> float:
    """Return a value of a custom numeric of the MJCF that has one per actuator."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0 or model.numeric_size[index] != model.nactuator:
        return default
    return float(model.numeric_data[model.numeric_adr[index] + actuator])


def _efficiency(model: mujoco.MjModel, actuator: int) -> float:
    value = fact(model, EFFICIENCY, actuator, 1.0)
    if not 0 < value <= 1:
        raise InputError(f"custom numeric {EFFICIENCY} = {value:g}: must be above 0 and at most 1")
    return value


def _phases(model: mujoco.MjModel, actuator: int) -> Phases | None:
    found = Phases(*(fact(model, name, actuator, 0.0) for name in ("pole_pairs", "inductance", "microsteps")))
    dcmotor = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_DCMOTOR
    return found if dcmotor and found.pole_pairs >= 1 else None


def _resolution(model: mujoco.MjModel, name: str, actuator: int, scale: float) -> float:
    """Return the axis travel per count of the encoder; 0 where the axis has none."""
    sensor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    if sensor < 0 or not model.nuser_sensor:
        return 0.0
    if model.sensor_type[sensor] != mujoco.mjtSensor.mjSENS_ACTUATORPOS or model.sensor_objid[sensor] != actuator:
        raise InputError(f"sensor {name!r} must be an actuatorpos of the actuator {name!r}")
    counts = float(model.sensor_user[sensor, 0])
    return 2 * math.pi * scale / counts if counts > 0 else 0.0
