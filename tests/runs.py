"""Runs, machines and curves that several test files ask for."""

import math

import numpy as np

from gantrysim import Servo
from gantrysim.controllers.arcs import ArcChain
from gantrysim.controllers.chain import Chain, Coil
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


def archimedean(radius, pitch, turns, start=(0.0, 0.0), heading_start=0.5 * np.pi, clockwise=True):
    """Archimedes' spiral given as the involute is; its centre lies square to the heading."""
    turn = -1.0 if clockwise else 1.0
    inward = complex(-math.sin(heading_start), math.cos(heading_start)) * turn
    centre = complex(*start) + radius * inward
    point = (centre.real, centre.imag, 0.0)
    angle = 2 * np.pi * turns
    path = Chain([Coil(point, (radius, radius - pitch * turns), float(np.angle(-inward)), turn * angle)])
    path.centre, path.pitch, path.angle, path.a, path.clockwise = (
        np.array(point),
        pitch,
        angle,
        pitch / 2 / np.pi,
        clockwise,
    )
    return path
