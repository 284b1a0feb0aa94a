"""Machines with one imperfection removed: friction, winding or compliance.

Each is compiled from the machine's MJCF without the elements that cause the imperfection, all else equal. A machine
without such elements is returned unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from gantrysim.machine.axis import EFFICIENCY
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import (
    BRISTLE_DAMPING,
    BRISTLE_STIFFNESS,
    COULOMB,
    CURRENT_RATE,
    STATIC,
    TIME_CONSTANT,
)
from gantrysim.machine.perturbation import Perturbation

_RIGID_IMPEDANCE = [0.9999, 0.9999, 0.001, 0.5, 2.0]  # solimp of a tendon of constant length


def without_friction(machine: Machine) -> Machine:
    """Return the machine without LuGre friction, frictionloss and losses of transmissions.

    Viscous friction and cogging stay.
    """

    def rubbing(spec: mujoco.MjSpec) -> list[Any]:
        rubbing_elements = [element for element in (*spec.joints, *spec.tendons) if element.frictionloss]
        transmissions = [numeric for numeric in spec.numerics if numeric.name == EFFICIENCY]
        lossy = [numeric for numeric in transmissions if min(numeric.data, default=1.0) < 1]
        return _motors_with(spec, BRISTLE_STIFFNESS) + rubbing_elements + lossy

    def smooth(_: mujoco.MjSpec, element: Any) -> None:
        if isinstance(element, mujoco.MjsNumeric):
            element.data = np.ones(len(element.data))
            return
        if not isinstance(element, mujoco.MjsActuator):
            element.frictionloss = 0.0
            return
        for parameter in (BRISTLE_STIFFNESS, BRISTLE_DAMPING):
            element.dynprm[parameter] = 0.0
        for parameter in (COULOMB, STATIC):
            element.biasprm[parameter] = 0.0
        # its activations lose the bristle's deflection
        element.actdim -= 1

    return _without(machine, rubbing, smooth)


_VISCOUS = 1e-9  # factor on viscous friction, which must not be zero


def frictionless_machine(machine: Machine) -> Machine:
    """Return the machine with neither dry nor viscous friction of its axes: a wrong one, to compare with."""
    return without_friction(machine).perturbed(Perturbation(viscous=_VISCOUS))


def without_winding(machine: Machine) -> Machine:
    """Return the machine whose motors have no inductance: the current follows the demand at once.

    Current and bus voltage keep their limits.
    """

    def remove(_: mujoco.MjSpec, motor: mujoco.MjsActuator) -> None:
        for parameter in (TIME_CONSTANT, CURRENT_RATE):
            motor.dynprm[parameter] = 0.0
        # its activations lose the current
        motor.actdim -= 1

    return _without(machine, lambda spec: _motors_with(spec, TIME_CONSTANT), remove)


def without_compliance(machine: Machine) -> Machine:
    """Return the machine without the spring joints that no axis drives; the bodies behind them are welded.

    Tendons that are springs, such as belts, keep their length at rest. Joints that follow the axes through a closed
    chain stay.

    Raises:
        InputError: another element of the MJCF refers to such a joint.
    """
    followers = [machine.physics.joint(joint).name for joint in machine.kinematics.followers]
    moving = {*machine.axis_names, *followers}

    def springs(spec: mujoco.MjSpec) -> list[Any]:
        joints = [joint for joint in spec.joints if joint.name not in moving and joint.stiffness[0] > 0]
        return joints + [tendon for tendon in spec.tendons if tendon.stiffness[0] > 0]

    def stiffen(spec: mujoco.MjSpec, spring: Any) -> None:
        if not isinstance(spring, mujoco.MjsTendon):
            spec.delete(spring)
            return
        physics = machine.physics
        tendon = physics.tendon(spring.name).id
        elongation = float(physics.tendon_lengthspring[tendon].mean() - physics.tendon_length0[tendon])
        spring.stiffness = np.zeros(3)
        spring.damping = np.zeros(3)
        constraint = spec.add_equality(type=mujoco.mjtEq.mjEQ_TENDON, name1=spring.name)
        constraint.data[0] = elongation
        # the shortest time constant that MuJoCo advises
        constraint.solref = [2 * spec.option.timestep, 1.0]
        constraint.solimp = _RIGID_IMPEDANCE

    return _without(machine, springs, stiffen)


def _without(
    machine: Machine,
    imperfect: Callable[[mujoco.MjSpec], list[Any]],
    remove: Callable[[mujoco.MjSpec, Any], None],
) -> Machine:
    """Return the machine with every imperfect element changed or removed, or itself where there is none."""
    if not imperfect(machine.spec):
        return machine

    def edit(spec: mujoco.MjSpec) -> None:
        for element in imperfect(spec):
            remove(spec, element)
        # a keyframe has as many states as the machine had; a run uses none
        for key in spec.keys:
            spec.delete(key)

    return machine.edited(edit)


def _motors_with(spec: mujoco.MjSpec, parameter: int) -> list[Any]:
    """Return the DC motors of which a parameter of their dynamics is not zero."""
    motors = [actuator for actuator in spec.actuators if actuator.dyntype == mujoco.mjtDyn.mjDYN_DCMOTOR]
    return [motor for motor in motors if motor.dynprm[parameter]]
