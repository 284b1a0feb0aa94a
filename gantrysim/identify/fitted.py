"""The fitted machine as an MJCF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.base.files import replaced
from gantrysim.identify.identification import Identification
from gantrysim.identify.model import AxisModel, model_of
from gantrysim.identify.result import AxisFit
from gantrysim.machine.axis import PER_SI
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB, STATIC
from gantrysim.machine.springs import spring_of

_ROUNDS = 4  # of the correction of inertias, which depend on those of the axes that an axis carries
_LEAST = 1e-12  # inertia of a body [kg·m²]
_ROUNDING = 1e-9  # by which moments of inertia keep from the limits of a body, relative


def fitted_machine(identification: Identification) -> Machine:
    """Return the machine with the identified values in its MJCF; all other values stay.

    Friction goes to motor and joint, inertia to the load's body and the motor's armature, the mode to the spring's
    joint. Torques are those of the log: a motor constant other than the nominal is part of all values. Delay, offset
    and gap are no part of the MJCF; what the log does not show stays.

    Raises:
        InputError: the fitted inertia leaves a body or a motor none.
    """
    machine = identification.machine
    for attempt in range(_ROUNDS):
        machine = machine.edited(_edit(machine, identification.accepted, first=attempt == 0))
    return machine


def write_machine(machine: Machine, file: str | Path) -> None:
    """Write the MJCF of a machine, with all that it includes, to one file.

    Raises:
        InputError: the file cannot be written.
    """
    with replaced(file) as partial:
        partial.write_text(machine.spec.to_xml(), encoding="utf-8")


def _edit(machine: Machine, fits: Sequence[AxisFit], *, first: bool) -> Callable[[mujoco.MjSpec], None]:
    def edit(spec: mujoco.MjSpec) -> None:
        for fit in fits:
            index = machine.axis_names.index(fit.axis)
            now = model_of(machine, index)
            if first:
                _set_friction(spec.actuators[index], spec.joint(fit.axis), fit)
            armature = fit.model.inertia - now.inertia
            spring = spring_of(machine.layout, index)
            if fit.shows_mode and spring is not None:
                load = fit.model.inertia * fit.model.share - now.inertia * now.share
                armature -= load
                _set_mode(spec.joint(spring), fit, now, load)
            motor = spec.actuators[index]
            motor.armature += armature * fit.model.scale
            if not motor.armature > 0:
                raise InputError(
                    f"axis {fit.axis}: the fitted inertia leaves the motor {motor.armature:.3g} kg·m²; the masses of "
                    "the MJCF are too large"
                )

    return edit


def _set_mode(spring: mujoco.MjsJoint, fit: AxisFit, present: AxisModel, load: float) -> None:
    body = spring.parent
    added = load * PER_SI[fit.unit] ** 2 / fit.model.scale
    if spring.type == mujoco.mjtJoint.mjJNT_SLIDE:
        body.mass += added
        if not body.mass > 0:
            raise InputError(f"axis {fit.axis}: the fitted load leaves the body {body.name!r} no mass")
    else:
        inertia = np.array(body.inertia)
        along = int(np.argmax(np.abs(spring.axis)))
        inertia[along] = max(inertia[along] + added, _LEAST)
        # of a body's moments of inertia none exceeds the sum of the others; those across the hinge are not fitted
        first, second = (axis for axis in range(3) if axis != along)
        half = 0.5 * inertia[along]
        mean = max(0.5 * (inertia[first] + inertia[second]), half * (1 + _ROUNDING))
        most = half * (1 - _ROUNDING)
        apart = np.clip(0.5 * (inertia[first] - inertia[second]), -most, most)
        inertia[first] = mean + apart
        inertia[second] = mean - apart
        body.inertia = inertia
    spring.stiffness = np.array([spring.stiffness[0] * fit.model.stiffness / present.stiffness, 0, 0])
    spring.damping = np.array([spring.damping[0] * fit.model.damping / present.damping, 0, 0])


def _set_friction(motor: mujoco.MjsActuator, joint: mujoco.MjsJoint, fit: AxisFit) -> None:
    model = fit.model
    nominal = fit.nominal
    to_axis = PER_SI[fit.unit] ** 2 / model.scale
    if motor.gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR and motor.dynprm[BRISTLE_STIFFNESS] > 0:
        joint.frictionloss = 0.0  # it is part of what is fitted
        factor = model.coulomb / motor.biasprm[COULOMB]
        motor.biasprm[COULOMB] = model.coulomb
        motor.biasprm[STATIC] = model.static
        motor.dynprm[[BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= factor
    else:
        joint.frictionloss = model.coulomb * PER_SI[fit.unit] / model.scale
    if nominal.viscous > 0:
        joint.damping = np.asarray(joint.damping) * model.viscous / nominal.viscous
        motor.damping = np.asarray(motor.damping) * model.viscous / nominal.viscous
    else:
        joint.damping = np.array([model.viscous * to_axis, 0, 0])
