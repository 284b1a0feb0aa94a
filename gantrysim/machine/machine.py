"""A machine: one compiled MJCF with its axes, drives, encoders, nozzle and work frame."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.display import picture_html
from gantrysim.base.errors import InputError, check_type, expanded_path, unknown, wrong_type
from gantrysim.base.input_files import check_regular
from gantrysim.machine.axis import Axis, axis_table, element_index, read_axes, stated_geometry
from gantrysim.machine.axis_dynamics import motion_of, with_dynamics
from gantrysim.machine.compiling import PhysicsModels, compile_mjcf, digest_of, without_visuals
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.kinematic_errors import KinematicErrors, Levers
from gantrysim.machine.kinematics import kinematics_of
from gantrysim.machine.kinematics.base import check_work_frame
from gantrysim.machine.model_arrays import ModelArrays
from gantrysim.machine.motors import driven_joints
from gantrysim.machine.perturbation import (
    Perturbation,
    geometry_factors,
    is_plain,
    perturbed_arrays,
    perturbed_axes,
    perturbed_model,
)
from gantrysim.machine.posing import Posing, checked_position
from gantrysim.machine.quiet import quiet
from gantrysim.machine.row import MAX_AXES
from gantrysim.machine.scheme import scheme
from gantrysim.servo.stability.motion import Motion

# The file of a machine: built-in, MJCF or table.


def builtin_models() -> list[str]:
    """Return the names of the machines included in gantrysim."""
    names = [item.name for item in files("gantrysim.models").iterdir()]
    return sorted(Path(name).stem for name in names if name.endswith(".xml"))


def model_file(model: str | Path) -> Path:
    """Return the file of a machine.

    Args:
        model: name of a built-in machine, or path of an MJCF file or of a machine's table in TOML.

    Raises:
        InputError: an unknown name, or a path without a regular file.
    """
    if not isinstance(model, str | Path):
        raise wrong_type("model", model, "the name of a built-in machine, or a path")
    text = str(model)
    builtin = builtin_models()
    if text in builtin:
        return Path(str(files("gantrysim.models") / f"{text}.xml"))
    if not text:
        raise unknown("model", text, builtin)
    path = expanded_path(text)
    check_regular(path, f"model {text}")
    if path.is_file():
        return path.resolve()
    if path.suffix or path.parent != Path():
        raise InputError(f"model {text}: no such file; built-in models: {', '.join(builtin)}")
    raise unknown("model", text, builtin)


# The nozzle as the model shows it: height above the work, size of the needle.

_MM = 1e3
_CLEAR_OF_NOZZLE = 1e-6  # below the nozzle, where the ray upwards begins [m]
_ROUND_GEOMS = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))


def height_above(model: mujoco.MjModel, nozzle: int, work: int) -> float | None:
    """Return the height of the nozzle above the work at the model's reference, None if none of it lies below [mm].

    It is 0 or less for a nozzle that touches a geom of the work or is inside of it.

    Args:
        model: the compiled model, with its visual elements.
        nozzle: index of the site.
        work: index of the body.
    """
    data = mujoco.MjData(model)
    with quiet():
        mujoco.mj_forward(model, data)
    up = data.xmat[work].reshape(3, 3)[:, 2]
    above = data.xpos[work] + up * (up @ (data.site_xpos[nozzle] - data.xpos[work]))

    def hit(begin: Floats, direction: Floats) -> tuple[int, float]:
        """Return the first geom along a ray, -1 for none, and its distance [m]."""
        geom = np.full(1, -1, np.int32)
        distance = mujoco.mj_ray(model, data, begin, direction, None, 1, int(model.site_bodyid[nozzle]), geom, None)
        return int(geom[0]), float(distance)

    below, distance = hit(above, -up)
    if below < 0:
        return None
    body = int(model.geom_bodyid[below])
    weld = model.body_weldid
    # a work that is a mere frame has the geoms of the body that it is part of
    if body != work and (model.body_geomnum[work] > 0 or weld[body] != weld[work]):
        return None
    # A geom on both sides has the nozzle inside. One that stands on a surface may miss it.
    over, depth = hit(above - _CLEAR_OF_NOZZLE * up, up)
    return _MM * (_CLEAR_OF_NOZZLE - depth) if over == below else _MM * distance


def needle_size(model: mujoco.MjModel, nozzle: int, name: str) -> tuple[float, float] | None:
    """Return outer diameter and length of the needle that the model draws, None without a round geom [mm].

    Args:
        model: the compiled model, with its visual elements.
        nozzle: index of the site, on whose body the needle is.
        name: of the geom.
    """
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if geom < 0 or model.geom_bodyid[geom] != model.site_bodyid[nozzle] or model.geom_type[geom] not in _ROUND_GEOMS:
        return None
    radius, half_length, _ = model.geom_size[geom]
    return 2 * _MM * float(radius), 2 * _MM * float(half_length)


NOZZLE = "nozzle"  # site at the tip
NEEDLE = "needle"  # geom that draws the needle
WORK = "work"  # body in whose frame the bead lies

_DEFAULT_GAP = 0.5  # without a work piece [mm]


class Machine:
    """A compiled MJCF machine. Axis positions are in mm for a slide and in deg for a hinge.

    Each axis needs an actuator and a slide or hinge joint of the same name. The actuator is a `dcmotor` with input="ff"
    and a bus voltage (torque passes through the winding) or a `motor` (ideal torque source), with
    gear = 2 pi / lead for a slide [rad/m], motor turns per axis turn for a hinge. The joint's first user value is the
    speed limit [m/s or rad/s], 0 for none. An `actuatorpos` sensor of the same name is the encoder; its first user
    value is the counts per motor revolution. The MJCF's timestep is the longest physics step of a run.

    A cylinder or capsule `needle` on the nozzle's body, from the tip upwards, is the needle of runs whose dispenser has
    none. It is drawn in the size of the run's needle.

    The model needs a site `nozzle` and a body `work`. A custom text `kinematics` names the machine's kinematics, see
    `gantrysim.machine.kinematics`: "serial", the default, "coupled" or "delta". They convert a program's coordinates to
    axis positions. If no driven hinge turns the work, the coordinates x, y and z are the nozzle's position in the work
    frame, zero for a missing coordinate, and every other coordinate turns the nozzle about its own tip. If a hinge
    turns the work, any geometry is allowed, and programs give axis positions.

    Args:
        model: name of a built-in machine, or path of an MJCF file or of a machine table in TOML.
        names: mapping from a required name to the name in the MJCF: "nozzle" of a site, "work" of a body, "needle" of a
            geom, any other of an axis, as in {"nozzle": "tip", "x": "motor_x"}.

    Attributes:
        source: path of the MJCF.
        name: name of the MJCF file without the suffix.
        spec: the MJCF before compilation.
        plain_axes: axes in the order of the actuators, without inertia and motion.
        addresses: indices of the axes in MuJoCo's arrays.
        drive_gain: delivered torque per torque demand; 1 unless a perturbation changes the motor constant, (axes,).
        nozzle, work: index of the site and index of the body.
        kinematics: conversion between a program's coordinates and axis positions.
        geometry: geometric errors; at first those of the transmissions that the MJCF states; None for an ideal
            geometry.

    Raises:
        InputError: an unknown model, an MJCF that MuJoCo rejects, or one that does not meet these requirements.
    """

    def __init__(self, model: str | Path, names: Mapping[str, str] | None = None) -> None:
        self._names = dict(names or {})
        self.source = model_file(model)
        self.name = self.source.stem
        self.geometry: Geometry | None = None
        try:
            with quiet() as warnings:
                self._build(self.source)
        except InputError as error:
            text = str(error)
            # of a table, which names its file
            raise InputError(
                text if text.startswith(f"machine {self.source}") else f"model {self.source}: {text}"
            ) from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:  # finite numbers whose products are not
            raise InputError(f"model {self.source}: has numbers too large or too small: {error}") from None
        self.geometry = stated_geometry(self.physics)
        # such as of an attribute that is not a number, or of a damaged mesh file
        if warnings:
            raise InputError(f"model {self.source}: MuJoCo warns: {warnings[0]}")

    def _build(self, source: Path | mujoco.MjSpec) -> None:
        self.spec, self._compiled = compile_mjcf(source, self._names if isinstance(source, Path) else None)
        physics = without_visuals(self.spec, self._compiled)
        self.nozzle = element_index(physics, mujoco.mjtObj.mjOBJ_SITE, NOZZLE)
        self.work = element_index(physics, mujoco.mjtObj.mjOBJ_BODY, WORK)
        if not 1 <= physics.nactuator <= MAX_AXES:
            raise InputError(f"has {physics.nactuator} actuators, must have 1 to {MAX_AXES}")
        self._perturbations: tuple[Perturbation, ...] = ()
        self._nominal: Machine | None = None
        axes, self.addresses = read_axes(physics)
        self.drive_gain: Floats = np.ones(len(axes))
        self.plain_axes = axes
        self._use(PhysicsModels(physics))
        self.kinematics = kinematics_of(physics, driven_joints(physics), self.nozzle, self.work)
        self._posing = Posing(physics, axes, self.addresses, self.kinematics, self.nozzle, self.work)
        _ = self.axes  # checks the motion
        if not self.turns_work:
            check_work_frame(self.kinematics, self.home, self.tip)

    def _use(self, models: PhysicsModels) -> None:
        """Set the models of the physics, and drop everything derived from the ones before."""
        self._models = models
        self._axes: tuple[Axis, ...] | None = None
        self._model: mujoco.MjModel | None = None

    def __repr__(self) -> str:
        return f"Machine({str(self.source)!r})"

    def _repr_html_(self) -> str:
        title = f"machine {self.name}"
        home = self.to_qpos(np.zeros(len(self.plain_axes)))
        return picture_html(scheme(self.model, home, title), axis_table(title, self.axes))

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes in the order of the actuators; their inertia and motion are computed on first access.

        Raises:
            InputError: accelerations about rest that are not finite.
        """
        if self._axes is None:
            qpos = self.to_qpos(np.zeros(len(self.plain_axes)))
            rates = self._posing.rates(self.physics)
            with quiet():
                self._axes = with_dynamics(self.physics, self.plain_axes, self.addresses, qpos, rates)
        return self._axes

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes in the order of the actuators."""
        return tuple(axis.name for axis in self.nominal.plain_axes)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model with its visual elements; do not modify it."""
        if self._model is None:
            self._model = self._compiled
            for perturbation in self._perturbations:
                self._model = perturbed_model(self._model, perturbation, self.plain_axes, self.nozzle, self.work)
        return self._model

    @property
    def physics(self) -> mujoco.MjModel:
        """The compiled model used for stepping, without visual-only elements."""
        return self._models.physics

    @property
    def layout(self) -> mujoco.MjModel:
        """A model with the joints, stops and options of `physics`, which perturbations do not change."""
        return self._models.layout

    @property
    def arrays(self) -> mujoco.MjModel | ModelArrays:
        """The arrays of `physics`, without those that MuJoCo derives from the masses; no model is made for them."""
        return self._models.arrays

    @property
    def perturbations(self) -> tuple[Perturbation, ...]:
        """The perturbations, in the order in which they were added."""
        return self._perturbations

    @property
    def nominal(self) -> Machine:
        """The machine without its perturbations."""
        return self if self._nominal is None else self._nominal

    @property
    def digest(self) -> str:
        """SHA-256 of the physics, see `digest_of`; it covers included files, not the visual elements."""
        return digest_of(self.physics)

    @property
    def gap(self) -> float:
        """Height of the nozzle above the work piece with all axes at zero, without perturbations [mm]."""
        return self._height if self._height is not None and self.depth_in_work is None else _DEFAULT_GAP

    @property
    def over_work(self) -> bool:
        """Whether a geom of the work lies below the nozzle, with all axes at zero."""
        return self._height is not None

    @property
    def depth_in_work(self) -> float | None:
        """Depth of the nozzle in the geom of the work that it touches with all axes at zero; None above it [mm]."""
        height = self._height
        return max(-height, 0.0) if height is not None and height <= _MM * _CLEAR_OF_NOZZLE else None

    @cached_property
    def _height(self) -> float | None:
        """Height of the nozzle above the work with all axes at zero, None if none of it lies below [mm]."""
        return height_above(self._compiled, self.nozzle, self.work)

    @cached_property
    def needle(self) -> tuple[float, float] | None:
        """Outer diameter and length of the needle that the model draws, None without a round geom `needle` [mm]."""
        return needle_size(self._compiled, self.nozzle, NEEDLE)

    @property
    def home(self) -> Floats:
        """The program's coordinates with all axes at zero, (coordinates,) [mm or deg]."""
        return self.kinematics.forward(np.zeros((1, len(self.plain_axes))))[0]

    @property
    def turns_work(self) -> bool:
        """Whether a driven hinge turns the work: programs then give axis positions, not positions in the work frame."""
        return self._posing.turns_work

    def perturbed(self, perturbation: Perturbation) -> Machine:
        """Return a copy with a perturbation added; name and source stay the same.

        Raises:
            InputError: a payload that leaves the body no mass, or factors for another number of axes.
        """
        check_type("perturbation", perturbation, Perturbation, "a Perturbation", "write Perturbation(payload=0.3)")
        machine = copy.copy(self)
        machine._perturbations = (*self._perturbations, perturbation)
        machine._nominal = self.nominal
        models = self._models

        def changed_model() -> mujoco.MjModel:
            return perturbed_model(models.physics, perturbation, self.nominal.plain_axes, self.nozzle, self.work)

        def changed_arrays() -> ModelArrays:
            return perturbed_arrays(models.arrays, perturbation, self.nominal.plain_axes, self.nozzle, self.work)

        machine.plain_axes = perturbed_axes(self.plain_axes, perturbation)
        machine._use(models.perturbed(changed_model, changed_arrays))
        machine.drive_gain = self.drive_gain * perturbation.per_axis("motor_constant", self.axis_names)
        if not is_plain(self.nominal.layout, machine._perturbations):
            # which checks it
            _ = machine.arrays
        return machine

    def with_geometry(self, geometry: Geometry | None) -> Machine:
        """Return a copy with geometric errors, or with an ideal geometry; dynamics, name and source stay the same.

        Raises:
            InputError: an error that the machine cannot have, or a list with another number of axes.
        """
        if geometry is not None:
            check_type("geometry", geometry, Geometry, "a Geometry", "write Geometry(accuracy=...) with its values")
        machine = copy.copy(self)
        machine.geometry = geometry
        _ = machine.kinematic_errors
        return machine

    @property
    def kinematic_errors(self) -> KinematicErrors | None:
        """The geometric errors, scaled by the perturbations of the machine; None for an ideal geometry."""
        if self.geometry is None:
            return None
        factors = geometry_factors(self._perturbations)
        placed_by_axes = self.kinematics.axes_are_coordinates and not self.turns_work
        levers = Levers.of(self.physics, self.axis_names, self.work) if placed_by_axes else None
        return KinematicErrors(self, self.geometry, levers, factors)

    def edited(self, edit: Callable[[mujoco.MjSpec], None]) -> Machine:
        """Return a copy whose MJCF is edited before compilation; perturbations, name and source stay the same.

        A copy with different joints or states cannot share a batch with this machine.

        Args:
            edit: function that modifies a copy of `spec`.

        Raises:
            InputError: the edited MJCF does not compile, or does not meet the requirements of a machine.
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

    def stepping(self, timestep: float, voltage: bool = False, stops: bool = True) -> mujoco.MjModel:
        """Return `physics` for a given step length; always the same object, do not modify it.

        Args:
            timestep: length of a step [s].
            voltage: whether the bus voltage is the only limit on a dcmotor's control, as a current loop requires.
            stops: whether to include the stops of the axes and all other constraints, see `gantrysim.machine.travel`.
        """
        return self._models.stepping(timestep, voltage, stops)

    def to_qpos(self, position: ArrayLike) -> Floats:
        """Return MuJoCo's qpos, (..., nq), for positions of the axes, (..., axes) [mm or deg].

        The joints of a closed chain follow the axes; all other joints are at their reference.
        """
        moves_home = any(perturbation.home_offset != 0.0 for perturbation in self._perturbations)
        return self._posing.qpos((self if moves_home else self.nominal).arrays.qpos0, position)

    def motion(self, position: ArrayLike | None = None) -> Motion:
        """Return the linear dynamics of all axes about rest, from torque demands to motor positions.

        Args:
            position: axis positions, by default zero, (axes,) [mm or deg].

        Raises:
            UnknownLoopError: an actuator has a delay in the MJCF.
            InputError: a position that is not one finite number per axis.
        """
        qpos = self.to_qpos(checked_position(self.plain_axes, position))
        motion = motion_of(self.physics, self.plain_axes, self.addresses, qpos)
        return replace(motion, B=motion.B * self.drive_gain)

    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle position of the rigid, unperturbed machine in the work frame, (n, 3) [mm].

        Args:
            position: axis positions, (n, axes) [mm or deg].
        """
        return self._posing.tip(position)
