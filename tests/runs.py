"""Runs and machines that several test files ask for."""

from gantrysim import Servo
from gantrysim.controllers.path import ArcChain
from gantrysim.controllers.setpoints import Setpoints

PERIOD = 1e-3
STEP = 2.5e-4


def plain(machine, period=PERIOD, **gains):
    """A servo without encoder quantisation, whose gains the test gives."""
    gains = {"resolution": 0.0, "following_error_limit": 1e3, **gains}
    return Servo.derive(machine.axes, period, **gains)


def ramp(speed, length=140.0):
    return Setpoints.along(ArcChain((-70.0, 0.0), 0.0, [0.0], [length]), speed, PERIOD)


def ideal_motors(source):
    """Write plain motors into a rigid machine's file instead of its dcmotors, and return the file."""
    content = source.read_text()
    for name in "xy":
        dcmotor = f'<dcmotor name="{name}" joint="{name}"/>'
        assert dcmotor in content
        content = content.replace(dcmotor, f'<motor name="{name}" joint="{name}" gear="628.3185307179587"/>')
    source.write_text(content)
    return source
