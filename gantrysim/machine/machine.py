"""A machine: one compiled MJCF with its axes, drives, encoders, nozzle and work frame.

MuJoCo uses SI units; the rest of gantrysim uses mm, s and deg. This module and axis.py convert. The position of an
axis is in mm for a slide, in deg for a hinge.
"""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.display import table_html
from gantrysim.base.errors import InputError, expanded, positive, unknown
from gantrysim.base.input_files import check_regular
from gantrysim.machine.axis import (
    PER_SI,
    Axis,
    element_index,
    fact,
    motion_of,
    perturbed_axes,
    read_axes,
    with_dynamics,
)
from gantrysim.machine.chain import Chain
from gantrysim.machine.compiling import compile_mjcf, without_visuals
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.height import height_above
from gantrysim.machine.kinematic_errors import KinematicErrors, Levers
from gantrysim.machine.kinematics import kinematics_of
from gantrysim.machine.kinematics.frame import check_work_frame
from gantrysim.machine.motors import damp_bristles, dcmotors
from gantrysim.machine.perturbation import Perturbation, perturbed_model, spring_of, springs_have_axes
from gantrysim.native.quiet import quiet
from gantrysim.native.row import MAX_AXES
from gantrysim.stability.motion import Motion

NOZZLE = "nozzle"  # site at the tip
NEEDLE = "needle"  # geom that draws the needle
WORK = "work"  # body in whose frame the bead lies

GUIDE_ARM = "guide_arm"  # custom numeric, see `Geometry` [mm]
OF_WAYS = ("travel_error", "periodic_error")  # custom numerics [um per 300 mm, um]
_MM = 1e3
_DEFAULT_GAP = 0.5  # without a work piece [mm]
_ROUND = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))
_SMALL = 1e-3  # difference of positions for slopes [mm or deg]


def builtin_models() -> list[str]:
    """Return the names of the machines included in gantrysim."""
    return sorted(Path(item.name).stem for item in files("gantrysim.models").iterdir() if item.name.endswith(".xml"))


class Machine:
    """A compiled MJCF machine.

    Each axis needs an actuator and a slide or hinge joint of the same name. The actuator is a `dcmotor` with input="ff"
    and a bus voltage (torque passes through the winding) or a `motor` (ideal torque source), with
    gear = 2 pi / lead for a slide [rad/m], motor turns per axis turn for a hinge. The joint's first user value is the
    speed limit [m/s or rad/s], 0 for none. An `actuatorpos` sensor of the same name is the encoder; its first user
    value is the counts per motor revolution. The MJCF's timestep is the longest physics step of a run.

    A cylinder or capsule `needle` on the nozzle's body, from the tip upwards, is the needle of runs whose dispenser
    names none. It is drawn in the size of the run's needle.

    The model needs a site `nozzle` and a body `work`. A custom text `kinematics` names the machine's kinematics, see
    `gantrysim.machine.kinematics`: "serial", the default, "coupled" or "delta". They turn a program's coordinates into
    positions of the axes. If no driven hinge turns the work, the coordinates x, y and z are the nozzle in the work
    frame, zero where there is no such coordinate, and every other one turns the nozzle about its own tip. If one does,
    the geometry is free, and programs give axis positions.

    Args:
        model: name of a built-in machine, or path of an MJCF file or of a machine's table in TOML.
        names: from a name that is needed to the one in the MJCF: "nozzle" of a site, "work" of a body, "needle" of a
            geom, any other of an axis, as in {"nozzle": "tip", "x": "motor_x"}.

    Attributes:
        source: path of the MJCF.
        name: its file name without the suffix.
        spec: the MJCF before compilation.
        physics: the compiled model that is stepped, without visual-only elements.
        plain_axes: the axes in the order of the actuators, without inertia and motion.
        addresses: their indices in MuJoCo's arrays.
        drive_gain: delivered torque per torque demand; 1 unless a perturbation changes the motor constant, (axes,).
        nozzle, work: index of the site and of the body.
        kinematics: from a program's coordinates to the positions of the axes, and back.
        geometry: errors of its geometry, at first those of the transmissions that the MJCF states; None for an ideal
            one.

    Raises:
        InputError: an unknown model, an MJCF that MuJoCo rejects, or one that does not meet these requirements.
    """

    def __init__(self, model: str | Path, names: Mapping[str, str] | None = None) -> None:
        self._names = dict(names or {})
        self.source = _find(model)
        self.name = self.source.stem
        self.geometry: Geometry | None = None
        try:
            with quiet() as said:
                self._build(self.source)
        except InputError as error:
            raise InputError(f"model {self.source}: {error}") from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:  # numbers that are finite, but not their products
            raise InputError(f"model {self.source}: has numbers too large or too small: {error}") from None
        self.geometry = self._stated_geometry()
        if said:  # of a number that is none, or of a file that is not right
            raise InputError(f"model {self.source}: MuJoCo warns: {said[0]}")

    def _build(self, source: Path | mujoco.MjSpec) -> None:
        self.spec, self._compiled = compile_mjcf(source, self._names if isinstance(source, Path) else None)
        physics = without_visuals(self.spec, self._compiled)
        self.nozzle = element_index(physics, mujoco.mjtObj.mjOBJ_SITE, NOZZLE)
        self.work = element_index(physics, mujoco.mjtObj.mjOBJ_BODY, WORK)
        if not 1 <= physics.nactuator <= MAX_AXES:
            raise InputError(f"has {physics.nactuator} actuators, must have 1 to {MAX_AXES}")
        self._perturbations: tuple[Perturbation, ...] = ()
        axes, self.addresses = read_axes(physics)
        self.drive_gain: Floats = np.ones(len(axes))
        self._per_si = np.array([PER_SI[axis.unit] for axis in axes])
        joints = [int(joint) for joint in physics.actuator_trnid[:, 0]]
        self.kinematics = kinematics_of(physics, joints, self.nozzle, self.work)
        self._followers = physics.jnt_qposadr[np.array(self.kinematics.followers, int)].tolist()
        self._reference: Floats = physics.qpos0.copy()
        moving = [*(axis.joint for axis in self.addresses), *self._followers]
        per_si = np.concatenate([self._per_si, np.ones(len(self._followers))])
        self._chain = Chain(physics, self.nozzle, self.work, moving, per_si)
        self.plain_axes = axes
        self._use(physics)
        _ = self.axes  # checks the motion
        if not self.turns_work:
            check_work_frame(self.kinematics, self.home, self.tip)

    def _stated_geometry(self) -> Geometry | None:
        """Return the errors of transmissions that custom numerics of the MJCF state, None where there are none."""
        count = range(len(self.plain_axes))
        travel, periodic = (tuple(1e-3 * fact(self.physics, name, a, 0.0) for a in count) for name in OF_WAYS)
        return Geometry(travel_error=travel, periodic_error=periodic) if any((*travel, *periodic)) else None

    def _use(self, physics: mujoco.MjModel) -> None:
        """Set the model that is stepped, and forget what is derived of it."""
        self.physics = physics
        self._axes: tuple[Axis, ...] | None = None
        self._model: mujoco.MjModel | None = None
        self._stepping: dict[tuple[float, bool], mujoco.MjModel] = {}

    def __repr__(self) -> str:
        return f"Machine({str(self.source)!r})"

    def _repr_html_(self) -> str:
        heads = ("axis", "unit", "travel", "peak torque [N·m]", "encoder count", "inertia [N·m·s²/u]")
        rows = [
            [
                axis.name,
                axis.unit,
                f"{axis.travel[0]:g} to {axis.travel[1]:g}",
                f"{axis.peak_torque:.4g}",
                f"{axis.resolution:.4g}",
                f"{axis.inertia:.4g}",
            ]
            for axis in self.axes
        ]
        return table_html(f"machine {self.name}", heads, rows)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes in the order of the actuators; their inertia and motion are derived when they are first asked for.

        Raises:
            InputError: accelerations about rest that are no finite numbers.
        """
        if self._axes is None:
            at = self.to_qpos(np.zeros(len(self.plain_axes)))
            with quiet():
                self._axes = with_dynamics(self.physics, self.plain_axes, self.addresses, at, self._moved())
        return self._axes

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes in the order of the actuators."""
        return tuple(axis.name for axis in self.plain_axes)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model with its visual elements; not to be changed."""
        if self._model is None:
            self._model = self._compiled
            for perturbation in self._perturbations:
                self._model = self._perturbed_model(self._model, perturbation)
        return self._model

    @property
    def digest(self) -> str:
        """SHA-256 of `physics`; it covers included files and assets, not the visual elements."""
        buffer = np.empty(mujoco.mj_sizeModel(self.physics), np.uint8)
        mujoco.mj_saveModel(self.physics, None, buffer)
        return hashlib.sha256(buffer.tobytes()).hexdigest()

    @property
    def gap(self) -> float:
        """Height of the nozzle above the work piece with all axes at zero; perturbations leave it as it is [mm]."""
        return _DEFAULT_GAP if self._height is None else self._height

    @property
    def over_work(self) -> bool:
        """Whether a geom of the work lies below the nozzle with all axes at zero."""
        return self._height is not None

    @cached_property
    def _height(self) -> float | None:
        """Height of the nozzle above the work with all axes at zero, None if none of it lies below [mm]."""
        return height_above(self._compiled, self.nozzle, self.work)

    @cached_property
    def needle(self) -> tuple[float, float] | None:
        """Outer diameter and length of the needle that the model draws, None without a round geom `needle` [mm]."""
        model = self._compiled
        geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, NEEDLE)
        if geom < 0 or model.geom_bodyid[geom] != model.site_bodyid[self.nozzle] or model.geom_type[geom] not in _ROUND:
            return None
        radius, half_length, _ = model.geom_size[geom]
        return 2 * _MM * float(radius), 2 * _MM * float(half_length)

    @property
    def springs_have_axes(self) -> bool:
        """Whether each axis can have its own stiffness factor."""
        return springs_have_axes(self.physics, self._joints)

    def spring_of(self, axis: int) -> str | None:
        """Return the name of the spring joint between the motor of an axis and its load, None where it has none."""
        return spring_of(self.physics, self._joints, axis)

    @property
    def home(self) -> Floats:
        """The program's coordinates with all axes at zero, (coordinates,) [mm or deg]."""
        return self.kinematics.forward(np.zeros((1, len(self.plain_axes))))[0]

    @property
    def turns_work(self) -> bool:
        """Whether a driven hinge turns the work: programs then give axis positions, not positions in the work frame."""
        return self._chain.turns_body

    @property
    def _joints(self) -> list[int]:
        """Index of each axis' joint."""
        return [int(joint) for joint in self.physics.actuator_trnid[:, 0]]

    def perturbed(self, perturbation: Perturbation) -> Machine:
        """Return a copy with a perturbation added; name and source stay the same.

        Raises:
            InputError: a payload that leaves the body no mass, or factors for another number of axes.
        """
        machine = copy.copy(self)
        machine._perturbations = (*self._perturbations, perturbation)
        with quiet():
            machine._use(self._perturbed_model(self.physics, perturbation))
        machine.plain_axes = perturbed_axes(machine.physics, self.plain_axes)
        machine.drive_gain = self.drive_gain * perturbation.per_axis("motor_constant", self.axis_names)
        return machine

    def with_geometry(self, geometry: Geometry | None) -> Machine:
        """Return a copy with errors of its geometry, or with an ideal one; dynamics, name and source stay the same.

        Raises:
            InputError: an error that the machine cannot have, or a list with another number of axes.
        """
        machine = copy.copy(self)
        machine.geometry = geometry
        _ = machine.kinematic_errors
        return machine

    @property
    def kinematic_errors(self) -> KinematicErrors | None:
        """The errors of its geometry with the factors of its perturbations, None for an ideal one."""
        if self.geometry is None:
            return None
        factors: dict[str, float] = {}
        for perturbation in self._perturbations:
            for name, factor in perturbation.geometry:
                factors[name] = factors.get(name, 1.0) * factor
        placed_by_axes = self.kinematics.axes_are_coordinates and not self.turns_work
        levers = self._levers if placed_by_axes else None
        return KinematicErrors(self, self.geometry, levers, factors)

    @property
    def _levers(self) -> Levers:
        """The chain of the axes, for the levers of yaws."""
        parents = self.physics.body_parentid
        bodies = self.physics.jnt_bodyid[self._joints].tolist()
        below_work = [self.work]
        while below_work[-1]:
            below_work.append(int(parents[below_work[-1]]))
        movers = [name for name, body in zip(self.axis_names, bodies, strict=True) if body in below_work]
        arms = [fact(self.physics, GUIDE_ARM, a, 0.0) for a in range(len(self.plain_axes))]
        return Levers(self._carried, movers, arms)

    @property
    def _carried(self) -> dict[str, list[str]]:
        """Names of the axes that each axis carries, being above them in the tree of bodies."""
        parents = self.physics.body_parentid
        bodies = self.physics.jnt_bodyid[self._joints].tolist()
        names: dict[str, list[str]] = {name: [] for name in self.axis_names}
        for name, body in zip(self.axis_names, bodies, strict=True):
            above = int(parents[body])
            while above:
                if above in bodies:
                    names[self.axis_names[bodies.index(above)]].append(name)
                above = int(parents[above])
        return names

    def edited(self, edit: Callable[[mujoco.MjSpec], None]) -> Machine:
        """Return a copy whose MJCF is edited before compilation; perturbations, name and source stay the same.

        It may have other joints and states, and then cannot share a batch with this machine.

        Args:
            edit: changes a copy of `spec`.

        Raises:
            InputError: the edited MJCF does not compile, or is no machine.
        """
        spec = self.spec.copy()
        machine = copy.copy(self)
        edit(spec)
        try:
            machine._build(spec)
        except InputError as error:
            raise InputError(f"model {self.source}, edited: {error}") from None
        for perturbation in self._perturbations:
            machine = machine.perturbed(perturbation)
        return machine

    def stepping(self, timestep: float, voltage: bool = False) -> mujoco.MjModel:
        """Return `physics` for steps of a length; the same object at every call, not to be changed.

        Args:
            timestep: length of a step [s].
            voltage: whether the bus voltage is the only limit of a dcmotor's control, as a current loop needs.
        """
        key = timestep, voltage
        if key not in self._stepping:
            model = copy.copy(self.physics)
            model.opt.timestep = positive("physics step", timestep, "s")
            damp_bristles(model)
            if voltage:
                model.actuator_ctrllimited[dcmotors(model)[:, 0] > 0] = False
            self._stepping[key] = model
        return self._stepping[key]

    def to_qpos(self, position: ArrayLike) -> Floats:
        """Return qpos for a position of the axes, (axes,) [mm or deg].

        The joints of a closed chain follow the axes; all others are at their reference.
        """
        qpos = self.physics.qpos0.copy()
        at = np.asarray(position, float)
        joints = [address.joint for address in self.addresses]
        qpos[joints] = at / self._per_si
        offset = (self._reference - self.physics.qpos0)[joints] * self._per_si
        qpos[self._followers] = self.kinematics.follow((at + offset)[None])[0]
        return qpos

    def _moved(self) -> Floats:
        """Return the velocity of every degree of freedom per velocity of an axis at zero [SI], (nv, axes)."""
        physics = self.physics
        steps = _SMALL * np.eye(len(self._per_si))
        moved = np.zeros((physics.nv, len(steps)))
        joints = [int(joint) for joint in physics.actuator_trnid[:, 0]]
        moved[physics.jnt_dofadr[joints], np.arange(len(steps))] = 1.0
        slopes = (self.kinematics.follow(steps) - self.kinematics.follow(-steps)) / (2 * _SMALL)
        moved[physics.jnt_dofadr[np.array(self.kinematics.followers, int)]] = slopes.T * self._per_si
        return moved

    def motion(self, position: ArrayLike | None = None) -> Motion:
        """Return the linear motion of all axes about rest, torque demands in and motor positions out.

        Args:
            position: of the axes, by default zero, (axes,) [mm or deg].

        Raises:
            UnknownLoopError: an actuator has a delay in the MJCF.
            InputError: a position that is not one finite number per axis.
        """
        at = np.zeros(len(self.plain_axes)) if position is None else self._checked_position(position)
        motion = motion_of(self.physics, self.plain_axes, self.addresses, self.to_qpos(at))
        return replace(motion, B=motion.B * self.drive_gain)

    def _checked_position(self, position: ArrayLike) -> Floats:
        """Return the position as an array, or raise InputError unless it is one finite number per axis."""
        try:
            at = np.asarray(position, float)
        except (TypeError, ValueError):
            at = np.array(np.nan)
        if at.shape != (len(self.plain_axes),) or not np.isfinite(at).all():
            units = ", ".join(f"{axis.name} [{axis.unit}]" for axis in self.plain_axes)
            text = " ".join(str(position).split())  # an array's text has line breaks
            raise InputError(f"position = {text}: must be {len(self.plain_axes)} finite numbers, one per axis: {units}")
        return at

    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame of the rigid, unperturbed machine, (n, 3) [mm].

        Args:
            position: axis positions, (n, axes) [mm or deg].
        """
        at = np.asarray(position, float)
        rows = np.atleast_2d(at)
        if self._followers:
            rows = np.concatenate([rows, self.kinematics.follow(rows)], axis=1)
        return self._chain(rows).reshape(*at.shape[:-1], 3)

    def _perturbed_model(self, model: mujoco.MjModel, perturbation: Perturbation) -> mujoco.MjModel:
        return perturbed_model(
            model, perturbation, axes=self.plain_axes, joints=self._joints, nozzle=self.nozzle, work=self.work
        )


def _find(model: str | Path) -> Path:
    text = str(model)
    builtin = builtin_models()
    if text in builtin:
        return Path(str(files("gantrysim.models") / f"{text}.xml"))
    path = expanded(text)
    check_regular(path, f"model {text}")
    if path.is_file():
        return path.resolve()
    if path.suffix or path.parent != Path():
        raise InputError(f"model {text}: no such file; built-in models: {', '.join(builtin)}")
    raise unknown("model", text, builtin)
