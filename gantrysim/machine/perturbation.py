"""Deviations of a machine from its MJCF: payload, friction, stiffness, motor constants and home offsets.

They are written to the compiled model's arrays, none of which changes its size: `mujoco.batch` can then vary the fields
between simulations.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, finite, positive, unknown_text, wrong_type
from gantrysim.machine.axis import PER_SI, VISCOUS_DIFFERENCE, Axis, facts
from gantrysim.machine.compiling import scratch_data
from gantrysim.machine.model_arrays import ModelArrays, compiled_of
from gantrysim.machine.motors import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    COULOMB,
    MOTOR_CONSTANT,
    STATIC,
    axes_of_tendon,
    axis_above,
    dcmotors,
    driven_joints,
    elastic_tendons,
    spring_joints,
    springs_have_axes,
    wraps_of,
)
from gantrysim.machine.quiet import quiet
from gantrysim.servo.axis_dynamics import Friction

# one value for all axes, one per axis, or those of some axes by their names; these are kept as pairs
PerAxis = float | tuple[float, ...] | Mapping[str, float] | tuple[tuple[str, float], ...]
VARIED_FACTORS = ("friction", "viscous", "stiffness", "motor_constant")


@dataclass(frozen=True)
class Perturbation:
    """Deviations of a machine from its MJCF; none by default.

    A factor or offset is one number for all axes, one per axis in their order, or those of some axes by their names, as
    in `Perturbation(payload=0.3, friction={"x": 1.5})`; an axis that is not named has none.

    Attributes:
        payload: mass added at the centre of mass of the body that carries the nozzle, or of the work if the nozzle is
            fixed. Gravity compensation (`gravcomp`) keeps its force [kg].
        friction: factor on the motors' LuGre friction and the axis joints' frictionloss. All of
            F = sigma0 z + sigma1 dz/dt, dz/dt = v - sigma0 |v| z / g(v) is scaled, that is sigma0, sigma1 and g: the
            same motion meets the scaled force.
        viscous: factor on the damping of axis joints and motors.
        stiffness: factor on the springs of joints that no axis drives, and on tendons that are springs. A joint takes
            the factor of the next axis above it, a tendon that of the axis that pulls it.
        motor_constant: factor on K of the motors. The drive converts torque demand to current by the nominal K, so the
            torque is the demand times the factor. Current and voltage limits stay, so the peak torque scales too.
        geometry: factors on errors of the machine's geometry, as (column, factor) with the names of
            `KinematicErrors.columns` and "warming"; nothing on a machine with an ideal geometry.
        home_offset: true axis position minus the position according to the encoder [mm or deg].

    Raises:
        InputError: a value that is not finite, or a factor that is not above 0.
    """

    payload: float = 0.0
    friction: PerAxis = 1.0
    viscous: PerAxis = 1.0
    stiffness: PerAxis = 1.0
    motor_constant: PerAxis = 1.0
    home_offset: PerAxis = 0.0
    geometry: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "payload", finite("payload", self.payload, "kg"))
        for name in VARIED_FACTORS:
            self._check(name, f"factor of {name}", positive)
        self._check("home_offset", "home_offset", finite)
        try:
            given = [(name, factor) for name, factor in self.geometry]
        except (TypeError, ValueError):
            raise wrong_type("geometry", self.geometry, "pairs", 'write geometry=(("warming", 2.0),)') from None
        pairs = tuple((name, finite(f"factor of {name}", factor)) for name, factor in given)
        object.__setattr__(self, "geometry", pairs)

    def _check(self, name: str, label: str, check: Callable[[str, float], float]) -> None:
        value = getattr(self, name)
        checked: PerAxis
        if _is_by_name(value):
            checked = tuple((axis, check(f"{label} of {axis}", item)) for axis, item in sorted(dict(value).items()))
        elif isinstance(value, Iterable) and not isinstance(value, str):
            checked = tuple(check(label, item) for item in value)
        else:
            checked = check(label, value)
        object.__setattr__(self, name, checked)

    def per_axis(self, name: str, axes: Sequence[str]) -> Floats:
        """Return the attribute `name` for each of the named axes, (axes,).

        Raises:
            InputError: it has one value per axis, for another number of axes, or that of an axis that is not there.
        """
        value = getattr(self, name)
        if isinstance(value, float):
            return np.full(len(axes), value)
        if _is_by_name(value):
            for axis, number in value:
                if axis not in axes:
                    raise InputError(f"{name} of {axis} = {number:g}: {unknown_text('axis', axis, axes)}")
            nominal = 0.0 if name == "home_offset" else 1.0
            return np.array([dict(value).get(axis, nominal) for axis in axes])
        if len(value) != len(axes):
            raise InputError(
                f"{name} has {len(value)} values: must be one or {len(axes)}, of the axes {', '.join(axes)}"
            )
        return np.array(value)


def _is_by_name(value: Any) -> bool:
    """Return whether values belong to axes by their names, as they are given or as they are kept."""
    return isinstance(value, Mapping) or (
        isinstance(value, tuple) and bool(value) and all(isinstance(item, tuple) for item in value)
    )


def is_plain(model: mujoco.MjModel, perturbations: Sequence[Perturbation]) -> bool:
    """Return whether a machine can have perturbations, the last of which is new, without a look at its arrays.

    Args:
        model: of the machine, perturbed or not.
        perturbations: of it.

    Returns:
        False where the payload, or a factor of one axis, may be one that the machine cannot have.
    """
    if sum(perturbation.payload for perturbation in perturbations) < 0:
        return False
    new = perturbations[-1]
    of_axes = [value for name in (*VARIED_FACTORS, "home_offset") if isinstance(value := getattr(new, name), tuple)]
    if any(_is_by_name(value) or len(value) != model.nactuator for value in of_axes):
        return False
    return isinstance(new.stiffness, float) or springs_have_axes(model)


def perturbed_axes(axes: Sequence[Axis], perturbation: Perturbation) -> tuple[Axis, ...]:
    """Return the axes of a perturbed machine; inertia and motion are those of before.

    The current is limited, so the peak torque scales with the motor constant; all of LuGre friction scales but the
    Stribeck speed, see `Perturbation`.
    """
    names = [axis.name for axis in axes]
    of_axes = [perturbation.per_axis(name, names).tolist() for name in ("friction", "viscous", "motor_constant")]
    perturbed = []
    for axis, friction, viscous, constant in zip(axes, *of_axes, strict=True):
        coulomb, static, stribeck, stiffness = axis.friction
        perturbed.append(
            replace(
                axis,
                motor_constant=constant * axis.motor_constant,
                peak_torque=constant * axis.peak_torque,
                coulomb=friction * axis.coulomb,
                viscous=viscous * axis.viscous,
                viscous_difference=viscous * axis.viscous_difference,
                friction=Friction(friction * coulomb, friction * static, stribeck, friction * stiffness),
            )
        )
    return tuple(perturbed)


def geometry_factors(perturbations: Iterable[Perturbation]) -> dict[str, float]:
    """Return the product of the factors on each error of the geometry, by column name."""
    factors: dict[str, float] = {}
    for perturbation in perturbations:
        for name, factor in perturbation.geometry:
            factors[name] = factors.get(name, 1.0) * factor
    return factors


def perturbed_model(
    model: mujoco.MjModel, perturbation: Perturbation, axes: Sequence[Axis], nozzle: int, work: int
) -> mujoco.MjModel:
    """Return a copy of a compiled model with a perturbation in its arrays.

    Args:
        model: the compiled model; it is not changed.
        perturbation: the deviations.
        axes: axes of the machine, in the order of the actuators.
        nozzle: index of the site.
        work: index of the body.

    Raises:
        InputError: a payload that leaves the body no mass, or factors for another number of axes.
    """
    changed = copy.copy(model)
    _scale(changed, perturbation, axes)
    if perturbation.payload:
        _add_payload(changed, perturbation.payload, nozzle, work)
        with quiet():
            mujoco.mj_setConst(changed, scratch_data(model))
    _offset_home(changed, perturbation, axes)
    return changed


def perturbed_arrays(
    model: mujoco.MjModel | ModelArrays, perturbation: Perturbation, axes: Sequence[Axis], nozzle: int, work: int
) -> ModelArrays:
    """Return the arrays of `perturbed_model`, but for those that MuJoCo derives from the masses; arguments as there."""
    arrays = ModelArrays(model)
    _scale(arrays, perturbation, axes)
    if perturbation.payload:
        _add_payload(arrays, perturbation.payload, nozzle, work)
    _offset_home(arrays, perturbation, axes)
    return arrays


def _scale(model: mujoco.MjModel | ModelArrays, perturbation: Perturbation, axes: Sequence[Axis]) -> None:
    """Multiply by the factors of a perturbation."""
    names = [axis.name for axis in axes]
    friction, viscous, stiffness, constant = (perturbation.per_axis(name, names) for name in VARIED_FACTORS)
    # most perturbations after the first one change a single quantity
    if (friction != 1).any() or (viscous != 1).any():
        _scale_friction(model, friction, viscous)
    if (stiffness != 1).any():
        _scale_stiffness(model, stiffness)
    if (constant != 1).any():
        model.actuator_gainprm[:, [MOTOR_CONSTANT]] *= constant[:, None] ** dcmotors(model)
        model.actuator_forcerange[:] *= constant[:, None]  # current limits
        model.actuator_ctrlrange[:] *= constant[:, None]


def _scale_friction(model: mujoco.MjModel | ModelArrays, friction: Floats, viscous: Floats) -> None:
    dofs = model.jnt_dofadr[driven_joints(model)]
    # parameters of an ideal torque source have other meanings
    motors = dcmotors(model)
    model.actuator_biasprm[:, [COULOMB, STATIC]] *= friction[:, None] ** motors
    model.actuator_dynprm[:, [BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= friction[:, None] ** motors
    model.dof_frictionloss[dofs] *= friction
    model.dof_damping[dofs] *= viscous
    model.dof_dampingpoly[dofs] *= viscous[:, None]
    model.actuator_damping[:] *= viscous
    model.actuator_dampingpoly[:] *= viscous[:, None]
    difference = facts(model, VISCOUS_DIFFERENCE)
    if difference is not None:
        difference *= viscous


def _scale_stiffness(model: mujoco.MjModel | ModelArrays, stiffness: Floats) -> None:
    differ = bool(np.ptp(stiffness))
    for joint in spring_joints(model):
        axis = axis_above(model, joint)
        if axis is None and differ:
            name = mujoco.mj_id2name(compiled_of(model), mujoco.mjtObj.mjOBJ_JOINT, joint)
            raise InputError(f"factors of stiffness per axis: no axis carries the spring {name!r}; give one for all")
        model.jnt_stiffness[joint] *= stiffness[axis or 0]
        model.jnt_stiffnesspoly[joint] *= stiffness[axis or 0]
    for tendon in elastic_tendons(model):
        pulling = axes_of_tendon(model, tendon)
        if len(pulling) != 1 and differ:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon)
            raise InputError(
                f"factors of stiffness per axis: {len(pulling)} axes pull tendon {name!r}; give one for all"
            )
        factor = stiffness[min(pulling, default=0)]
        model.tendon_stiffness[tendon] *= factor
        model.tendon_stiffnesspoly[tendon] *= factor


def _offset_home(model: mujoco.MjModel | ModelArrays, perturbation: Perturbation, axes: Sequence[Axis]) -> None:
    """Offset the joints' references: a displacement is qpos - qpos0, the encoder reads qpos."""
    offset = perturbation.per_axis("home_offset", [axis.name for axis in axes]) / [PER_SI[axis.unit] for axis in axes]
    if not offset.any():
        return
    driven = driven_joints(model)
    model.qpos0[model.jnt_qposadr[driven]] -= offset
    # the length of a fixed tendon is the sum over its joints' qpos
    for tendon in range(model.ntendon):
        for wrap in wraps_of(model, tendon):
            joint = int(model.wrap_objid[wrap])
            if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT and joint in driven:
                elongation = model.wrap_prm[wrap] * offset[driven.index(joint)]
                model.tendon_lengthspring[tendon] -= elongation
                model.tendon_length0[tendon] -= elongation


def _add_payload(model: mujoco.MjModel | ModelArrays, payload: float, nozzle: int, work: int) -> None:
    body = int(model.site_bodyid[nozzle])
    # the nozzle is fixed: the work moves
    if not model.body_weldid[body]:
        body = work
    mass = float(model.body_mass[body])
    if payload < 0 and not mass + payload > 0:
        name = mujoco.mj_id2name(compiled_of(model), mujoco.mjtObj.mjOBJ_BODY, body)
        raise InputError(f"payload = {payload:g} kg: must leave the body {name!r} a mass, which is {mass:g} kg")
    model.body_mass[body] += payload
    # gravcomp is a share of the weight: scaled, so that the compensating force does not follow the payload
    model.body_gravcomp[body] *= mass / (mass + payload)
