"""A machine: one compiled MJCF with its axes, drives, encoders, nozzle and work frame.

MuJoCo speaks SI; everything else in gantrysim speaks mm, s and deg. The conversion stands here.
"""

from __future__ import annotations

import copy
import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gantrysim.controllers.path import Floats
from gantrysim.errors import InputError, positive, unknown
from gantrysim.tick import MAX_AXES, ROW

__all__ = ["Axis", "Machine", "builtin_models"]

NOZZLE = "nozzle"  # site at the tip
WORK = "work"  # body in whose frame the bead lies

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_MM = 1e3


@dataclass(frozen=True)
class Axis:
    """One driven axis, in mm (deg on a rotary axis), s, N·m at the motor, A and V.

    Attributes:
        name: shared by joint, actuator and encoder.
        travel: lowest and highest position [mm].
        scale: axis travel per radian of the motor, lead / 2 pi [mm/rad].
        inertia: motor torque per acceleration, with rotor, screw and everything the axis carries [N·m·s²/mm].
        viscous: motor torque per speed [N·m·s/mm].
        coulomb: Coulomb friction at the motor [N·m].
        motor_constant: torque constant and back-EMF constant K [N·m/A]; nan for an ideal torque source.
        resistance: of the winding [ohm]; nan for an ideal torque source.
        lag: time constant of the winding, L/R [s].
        bus_voltage: the drive's limit [V]; inf where it has none.
        peak_torque: the drive's limit [N·m].
        speed_limit: declared limit, at most the no-load speed at bus voltage [mm/s].
        resolution: axis travel per encoder count, 0 for an exact measurement [mm].
    """

    name: str
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
    speed_limit: float
    resolution: float

    @property
    def no_load_speed(self) -> float:
        """Speed at which the back-EMF is the bus voltage [mm/s]."""
        return self.bus_voltage / self.motor_constant * self.scale if self.motor_constant > 0 else math.inf


@dataclass(frozen=True)
class AxisAddress:
    """Where an axis lies in MuJoCo's arrays."""

    joint: int  # qpos
    control: int  # ctrl
    output: int  # actuator_length
    current: int  # act, -1 where the winding has no inductance


def builtin_models() -> list[str]:
    """Return the names of the machines that come with gantrysim."""
    return sorted(Path(item.name).stem for item in files("gantrysim.models").iterdir() if item.name.endswith(".xml"))


class Machine:
    """A compiled MJCF machine.

    The MJCF needs, for every axis, an actuator and a joint (slide or hinge) of one name: a `dcmotor` with
    input="ff" and a bus voltage (its torque comes through the winding), or a `motor` as an ideal torque
    source. It needs a site `nozzle` and a body `work`. Optional: the joint's first user value is the speed
    limit [m/s or rad/s]; an `actuatorpos` sensor of the axis' name with counts per revolution as its first
    user value is the encoder.

    Args:
        model: name of a built-in machine, or path of an MJCF file.

    Raises:
        InputError: no such model, MJCF that MuJoCo rejects, or a needed name that is missing.
    """

    def __init__(self, model: str | Path) -> None:
        self.source = _find(model)
        self.name = self.source.stem
        try:
            self.spec = mujoco.MjSpec.from_file(str(self.source))
            self.spec.nuserdata = max(int(self.spec.nuserdata), ROW.itemsize // 8)
            self.model = self.spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(f"model {self.source}: {' '.join(str(error).split())}") from None
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.nozzle = _named(self.model, mujoco.mjtObj.mjOBJ_SITE, NOZZLE, self.source)
        self.work = _named(self.model, mujoco.mjtObj.mjOBJ_BODY, WORK, self.source)
        if self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise InputError(
                f"model {self.source}: integrator RK4 calls the servo four times a step; "
                "use Euler, implicit or implicitfast"
            )
        if not 1 <= self.model.nactuator <= MAX_AXES:
            raise InputError(f"model {self.source}: has {self.model.nactuator} actuators, must have 1 to {MAX_AXES}")
        self._stepping: dict[float, mujoco.MjModel] = {}
        home = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, home)
        read = [_axis(self.model, home, actuator, self.source) for actuator in range(self.model.nactuator)]
        self.axes: tuple[Axis, ...] = tuple(axis for axis, _ in read)
        self.addresses: tuple[AxisAddress, ...] = tuple(address for _, address in read)

    def __repr__(self) -> str:
        return f"Machine({str(self.source)!r})"

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes in the order of the actuators."""
        return tuple(axis.name for axis in self.axes)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the compiled model, includes and assets and all."""
        buffer = np.empty(mujoco.mj_sizeModel(self.model), np.uint8)
        mujoco.mj_saveModel(self.model, None, buffer)
        return hashlib.sha256(buffer.tobytes()).hexdigest()

    def stepping(self, timestep: float) -> mujoco.MjModel:
        """Return the compiled model with another physics step [s]; the same one at every call, to be left unchanged."""
        if timestep not in self._stepping:
            model = copy.copy(self.model)
            model.opt.timestep = positive("physics step", timestep, "s")
            self._stepping[timestep] = model
        return self._stepping[timestep]

    def to_qpos(self, position: ArrayLike) -> Floats:
        """Return the joint positions for axis positions, every other joint at its reference, (nq,) [SI].

        Args:
            position: (axes,) [mm or deg].
        """
        qpos: Floats = self.model.qpos0.copy()
        for value, axis, address in zip(np.asarray(position, float), self.axes, self.addresses, strict=True):
            qpos[address.joint] = value / axis.scale * self._joint_per_radian(address)
        return qpos

    def _joint_per_radian(self, address: AxisAddress) -> float:
        return 1.0 / float(self.model.actuator_gear[address.output, 0])

    @cached_property
    def _tip(self) -> tuple[Floats, Floats]:
        """Nozzle in the work frame as offset (3,) + matrix (3, axes) @ position [mm]."""
        columns = []
        zero = np.zeros(len(self.axes))
        offset = self._tip_at(zero)
        for a in range(len(self.axes)):
            unit = zero.copy()
            unit[a] = 1.0
            columns.append(self._tip_at(unit) - offset)
        return offset, np.stack(columns, axis=1)

    def _tip_at(self, position: Floats) -> Floats:
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.to_qpos(position)
        mujoco.mj_kinematics(self.model, data)
        frame = data.xmat[self.work].reshape(3, 3)
        tip: Floats = _MM * frame.T @ (data.site_xpos[self.nozzle] - data.xpos[self.work])
        return tip

    def tip(self, position: ArrayLike) -> Floats:
        """Return where the nozzle would be in the work frame on a rigid machine, (n, 3) [mm].

        Args:
            position: axis positions, (n, axes) [mm].
        """
        offset, matrix = self._tip
        points: Floats = offset + np.asarray(position, float) @ matrix.T
        return points


def _find(model: str | Path) -> Path:
    text = str(model)
    builtin = builtin_models()
    if text in builtin:
        return Path(str(files("gantrysim.models") / f"{text}.xml"))
    path = Path(text).expanduser()
    if path.is_file():
        return path.resolve()
    if path.suffix or path.parent != Path():
        raise InputError(f"model {text}: no such file; built-in models: {', '.join(builtin)}")
    raise unknown("model", text, builtin)


def _named(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, source: Path) -> int:
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


def _axis(model: mujoco.MjModel, data: mujoco.MjData, i: int, source: Path) -> tuple[Axis, AxisAddress]:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i)
    if not name:
        raise InputError(f"model {source}: actuator {i} has no name; it must bear the name of its axis' joint")
    joint = _named(model, mujoco.mjtObj.mjOBJ_JOINT, name, source)
    if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[i, 0] != joint:
        raise InputError(f"model {source}: actuator {name!r} must drive the joint {name!r}")
    if model.jnt_type[joint] not in (_SLIDE, _HINGE):
        raise InputError(f"model {source}: joint {name!r} must be a slide or a hinge")
    gear = float(model.actuator_gear[i, 0])
    if not gear > 0:
        raise InputError(f"model {source}: gear of {name!r} = {gear:g}: must be greater than 0 (2 pi / lead in rad/m)")
    unit = _MM if model.jnt_type[joint] == _SLIDE else math.degrees(1)
    scale = unit / gear
    dof = int(model.jnt_dofadr[joint])
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)

    drive = _drive(model, i, name, source)
    limited = bool(model.jnt_limited[joint])
    travel = (float(model.jnt_range[joint, 0]) * unit, float(model.jnt_range[joint, 1]) * unit)
    declared = float(model.jnt_user[joint, 0]) * unit if model.nuser_jnt else 0.0
    no_load = drive.bus_voltage / drive.motor_constant * scale if drive.motor_constant > 0 else math.inf
    damping = float(model.dof_damping[dof]) + float(model.actuator_damping[i]) * gear**2
    axis = Axis(
        name=name,
        travel=travel if limited else (-math.inf, math.inf),
        scale=scale,
        inertia=float(inertia[dof, dof]) / (gear * unit),
        viscous=damping / (gear * unit),
        coulomb=drive.coulomb,
        motor_constant=drive.motor_constant,
        resistance=drive.resistance,
        lag=drive.lag,
        bus_voltage=drive.bus_voltage,
        peak_torque=drive.peak_torque,
        speed_limit=min(declared, no_load) if declared > 0 else no_load,
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
    force = model.actuator_forcerange[i] if model.actuator_forcelimited[i] else (-math.inf, math.inf)
    peak = float(min(-force[0], force[1]))
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
