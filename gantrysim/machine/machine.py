"""A machine: one compiled MJCF with its axes, drives, encoders, nozzle and work frame.

MuJoCo speaks SI; everything else in gantrysim speaks mm, s and deg. The conversion stands here and in axis.py.
The position of an axis is in its own unit, mm for a slide and deg for a hinge.
"""

from __future__ import annotations

import copy
import hashlib
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, positive, unknown
from gantrysim.machine.axis import PER_SI, Axis, AxisAddress, named, read_axis
from gantrysim.machine.kinematics import Kinematics
from gantrysim.machine.perturbation import Perturbation, perturbed_model, springs_have_axes
from gantrysim.native.row import MAX_AXES, ROW_NUMBERS

NOZZLE = "nozzle"  # site at the tip
WORK = "work"  # body in whose frame the bead lies

_MM = 1e3
_FRAME_TOLERANCE = 1e-3  # [mm], and of a direction
_DEFAULT_GAP = 0.5  # of a machine without a work piece [mm]
_PROBE = 100.0  # how far each slide is moved to see what a rotary axis does to it [mm]


def builtin_models() -> list[str]:
    """Return the names of the machines that come with gantrysim."""
    return sorted(Path(item.name).stem for item in files("gantrysim.models").iterdir() if item.name.endswith(".xml"))


class Machine:
    """A compiled MJCF machine.

    The MJCF needs, for every axis, an actuator and a slide or hinge joint of one name: a `dcmotor` with input="ff"
    and a bus voltage (its torque comes through the winding), or a `motor` as an ideal torque source; both with
    gear = 2 pi / lead of a slide [rad/m], the turns of the motor per turn of a hinge. It needs a site `nozzle` and a
    body `work`. Where no hinge turns the work, its frame must have its origin at the nozzle when all axes are at
    zero, the axes x, y and z must move the nozzle along x, y and z of it, and every hinge must turn the nozzle about
    its own tip. Where one does, the machine's geometry is free: programs for it speak of its axes. Optional:
    the joint's first user value is the speed limit [m/s or rad/s]; an `actuatorpos` sensor of the axis' name with
    counts per revolution of the motor as its first user value is the encoder. The MJCF's timestep is the longest a
    run may take.

    Args:
        model: name of a built-in machine, or path of an MJCF file.

    Attributes:
        physics: the compiled model without what is only seen, the one that is stepped.
        axes: what drives and measures each axis, in the order of the actuators.
        addresses: where each lies in MuJoCo's arrays.
        drive_gain: torque that a drive gives per torque that the servo demands, 1 unless `perturbed`, (axes,).

    Raises:
        InputError: no such model, MJCF that MuJoCo rejects, or a needed name that is missing.
    """

    def __init__(self, model: str | Path) -> None:
        self.source = _find(model)
        self.name = self.source.stem
        try:
            self.spec = mujoco.MjSpec.from_file(str(self.source))
            self.spec.nuserdata = max(int(self.spec.nuserdata), ROW_NUMBERS)
            self._compiled = self.spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(f"model {self.source}: {' '.join(str(error).split())}") from None
        compiled = self._compiled
        if compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION or compiled.opt.disableactuator:
            raise InputError(f"model {self.source}: disables its actuators; the servo needs them")
        compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.physics = _physics(self.spec, compiled)
        self._perturbations: tuple[Perturbation, ...] = ()
        self.nozzle = named(self.physics, mujoco.mjtObj.mjOBJ_SITE, NOZZLE, self.source)
        self.work = named(self.physics, mujoco.mjtObj.mjOBJ_BODY, WORK, self.source)
        if compiled.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise InputError(
                f"model {self.source}: integrator RK4 calls the servo four times a step; "
                "use Euler, implicit or implicitfast"
            )
        if not 1 <= compiled.nactuator <= MAX_AXES:
            raise InputError(f"model {self.source}: has {compiled.nactuator} actuators, must have 1 to {MAX_AXES}")
        self._stepping: dict[float, mujoco.MjModel] = {}
        self.axes, self.addresses = _read_axes(self.physics, self.source)
        self.drive_gain: Floats = np.ones(len(self.axes))
        self._per_si = np.array([PER_SI[axis.unit] for axis in self.axes])
        joints = [address.joint for address in self.addresses]
        self._kinematics = Kinematics(self.physics, self.nozzle, self.work, joints)
        if not self.turns_work:
            self._check_work_frame()

    def __repr__(self) -> str:
        return f"Machine({str(self.source)!r})"

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes in the order of the actuators."""
        return tuple(axis.name for axis in self.axes)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model with all that is seen of it; to be left unchanged."""
        model = self._compiled
        for perturbation in self._perturbations:
            model = self._perturbed_model(model, perturbation)
        return model

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the compiled model that is stepped, includes and assets and all; its looks are no part of it."""
        buffer = np.empty(mujoco.mj_sizeModel(self.physics), np.uint8)
        mujoco.mj_saveModel(self.physics, None, buffer)
        return hashlib.sha256(buffer.tobytes()).hexdigest()

    @cached_property
    def gap(self) -> float:
        """Height of the nozzle above the work where its z is 0: by a ray from the work's origin down its z [mm]."""
        data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        body = int(self.model.site_bodyid[self.nozzle])
        geom = np.full(1, -1, np.int32)
        down = -data.xmat[self.work].reshape(3, 3)[:, 2]
        distance = mujoco.mj_ray(self.model, data, data.xpos[self.work], down, None, 1, body, geom, None)
        on_work = geom[0] >= 0 and self.model.geom_bodyid[geom[0]] == self.work
        return _MM * float(distance) if on_work else _DEFAULT_GAP

    @cached_property
    def springs_have_axes(self) -> bool:
        """Whether each axis can have a factor of stiffness of its own."""
        return springs_have_axes(self.physics, self._joints)

    @property
    def turns_work(self) -> bool:
        """Whether a hinge turns the work, so that programs speak of the machine's axes, not of the work's frame."""
        return bool(self._kinematics.turns_body)

    @property
    def _joints(self) -> list[int]:
        """Index of each axis' joint."""
        return [int(joint) for joint in self.physics.actuator_trnid[:, 0]]

    def perturbed(self, perturbation: Perturbation) -> Machine:
        """Return the machine as it is with a perturbation; its name and source stay, this one is left as it is.

        Raises:
            InputError: a payload that leaves the body no mass, or factors for another number of axes.
        """
        machine = copy.copy(self)
        for cached in ("model", "digest"):
            machine.__dict__.pop(cached, None)
        machine.physics = self._perturbed_model(self.physics, perturbation)
        machine._perturbations = (*self._perturbations, perturbation)
        machine._stepping = {}
        machine.axes, machine.addresses = _read_axes(machine.physics, self.source)
        machine.drive_gain = self.drive_gain * perturbation.per_axis("motor_constant", self.axis_names)
        return machine

    def stepping(self, timestep: float) -> mujoco.MjModel:
        """Return `physics` with another physics step [s]; the same one at every call, to be left unchanged."""
        if timestep == self.physics.opt.timestep:
            return self.physics
        if timestep not in self._stepping:
            model = copy.copy(self.physics)
            model.opt.timestep = positive("physics step", timestep, "s")
            self._stepping[timestep] = model
        return self._stepping[timestep]

    def to_qpos(self, position: ArrayLike) -> Floats:
        """Return the joint positions for axis positions, every other joint at its reference, (nq,) [SI].

        Args:
            position: (axes,) [mm or deg].
        """
        qpos: Floats = self.physics.qpos0.copy()
        qpos[[address.joint for address in self.addresses]] = np.asarray(position, float) / self._per_si
        return qpos

    def tip(self, position: ArrayLike) -> Floats:
        """Return where the nozzle would be in the work frame on a rigid machine, (n, 3) [mm].

        Args:
            position: axis positions, (n, axes) [mm or deg].
        """
        q = np.asarray(position, float) / self._per_si
        points: Floats = _MM * self._kinematics(np.atleast_2d(q))
        return points.reshape(*q.shape[:-1], 3)

    def _perturbed_model(self, model: mujoco.MjModel, perturbation: Perturbation) -> mujoco.MjModel:
        return perturbed_model(
            model, perturbation, axes=self.axes, joints=self._joints, nozzle=self.nozzle, work=self.work
        )

    def _check_work_frame(self) -> None:
        """The program's positions are the work frame's: see that the machine agrees, to a micrometre."""
        offset = self.tip(np.zeros(len(self.axes)))
        if np.abs(offset).max() > _FRAME_TOLERANCE:
            at = ", ".join(f"{value:g}" for value in offset.round(6))
            raise InputError(
                f"model {self.source}: with all axes at zero the nozzle is at ({at}) mm of body {WORK!r}: "
                "must be its origin"
            )
        slides = [a for a, axis in enumerate(self.axes) if axis.unit == "mm"]
        probes = np.concatenate([np.zeros((1, len(self.axes))), _PROBE * np.eye(len(self.axes))[slides]])
        units = self.tip(np.eye(len(self.axes))) - offset
        for a, axis in enumerate(self.axes):
            if axis.unit == "deg":
                for turn in (90.0, 180.0):
                    turned = probes.copy()
                    turned[:, a] = turn
                    moved = np.linalg.norm(self.tip(turned) - self.tip(probes), axis=1).max()
                    if moved > _FRAME_TOLERANCE:
                        raise InputError(
                            f"model {self.source}: rotary axis {axis.name!r} moves the nozzle by {moved:.4g} mm "
                            f"in {turn:g} deg: must turn it about its own tip"
                        )
            if axis.name in "xyz" and np.abs(units[a] - np.eye(3)["xyz".index(axis.name)]).max() > _FRAME_TOLERANCE:
                along = ", ".join(f"{value:g}" for value in units[a].round(6))
                raise InputError(
                    f"model {self.source}: axis {axis.name!r} moves the nozzle along ({along}) of body {WORK!r}: "
                    f"must be along its {axis.name}"
                )


def _physics(spec: mujoco.MjSpec, compiled: mujoco.MjModel) -> mujoco.MjModel:
    """Return a compiled model without what is only seen; its dynamics are the same to the last bit.

    That saves the placing of geoms that touch nothing, of cameras and lights, at every step, and textures, in every
    copy. Where they are needed to tell a body's inertia, MuJoCo does not leave them out; where a sensor looks through a
    camera, the model is the compiled one.
    """
    bare = spec.copy()
    bare.compiler.discardvisual = True
    bare.visual = mujoco.MjSpec().visual
    bare.stat.center, bare.stat.extent, bare.stat.meansize = [np.nan] * 3, np.nan, np.nan
    for seen in (*bare.cameras, *bare.lights):
        bare.delete(seen)
    try:
        physics = bare.compile()
    except (ValueError, mujoco.FatalError):
        return compiled
    physics.opt.disableflags = compiled.opt.disableflags
    return physics


def _read_axes(model: mujoco.MjModel, source: Path) -> tuple[tuple[Axis, ...], tuple[AxisAddress, ...]]:
    home = mujoco.MjData(model)
    mujoco.mj_forward(model, home)
    read = [read_axis(model, home, actuator, source) for actuator in range(model.nactuator)]
    return tuple(axis for axis, _ in read), tuple(address for _, address in read)


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
