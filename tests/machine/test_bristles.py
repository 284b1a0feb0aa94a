"""A motor that stands on the bristles of its friction, against the exact spring and damper."""

import mujoco
import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.machine.motors import damp_bristles

INERTIA, STIFFNESS, DAMPING = 5e-5, 6.6, 0.008
MOTOR = f"""<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="motor"/>
<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body></worldbody>
<actuator><dcmotor joint="motor" motorconst="0.05" resistance="1e9" lugre="{STIFFNESS} {DAMPING} 0.017 0.021 3.1"/>
</actuator></mujoco>"""


def pole(step, damped=True):
    """The upper one of the two poles of a small swing, fitted to MuJoCo's speeds [1/s]."""
    model = mujoco.MjModel.from_xml_string(MOTOR)
    model.actuator_actearly[:] = False
    model.opt.timestep = step
    if damped:
        damp_bristles(model)
    data = mujoco.MjData(model)
    data.qvel[0], speeds = 1e-4, []
    for _ in range(round(0.02 / step)):
        mujoco.mj_step(model, data)
        speeds.append(data.qvel[0])
    speeds = np.array(speeds)
    once, twice = np.linalg.lstsq(np.stack([speeds[1:-1], speeds[:-2]], axis=1), speeds[2:], rcond=None)[0]
    return max(np.log(np.roots([1, -once, -twice]).astype(complex)) / step, key=lambda root: root.imag)


EXACT = max(np.roots([INERTIA, DAMPING, STIFFNESS]), key=lambda root: root.imag)


@pytest.mark.validates(
    "a motor standing on the bristles of its friction",
    "spring and damper",
    "3 % of the damping, 2 % of the frequency",
)
@pytest.mark.parametrize("step", [2.5e-4, 1.25e-4, 2.5e-5])
def test_a_standing_motor_swings_on_its_bristles_as_a_spring_and_damper(step):
    assert pole(step).real == pytest.approx(EXACT.real, rel=0.03 * step / 2.5e-4)
    assert pole(step).imag == pytest.approx(EXACT.imag, rel=0.02 * step / 2.5e-4)
    lost = STIFFNESS * step / DAMPING  # without it: the share of the damping that steps take
    assert 1 - pole(step, damped=False).real / EXACT.real == pytest.approx(lost, rel=0.1)


def test_what_is_stepped_has_it_at_every_step_and_the_machine_not():
    machine = Machine("xy")
    written = machine.model.actuator_dynprm[:, 6]
    assert machine.physics.actuator_dynprm[:, 6].tolist() == written.tolist()
    for step in (2.5e-4, 1e-5):
        added = machine.stepping(step).actuator_dynprm[:, 6] - written
        assert added == pytest.approx(step * machine.model.actuator_dynprm[:, 5], rel=1e-9)
    assert machine.physics.actuator_dynprm[:, 6].tolist() == written.tolist()
