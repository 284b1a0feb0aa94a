"""Runs, machines and curves that several test files ask for."""

import itertools
import math

import numpy as np

from gantrysim import Machine, Servo, simulate
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil
from gantrysim.record.setpoints import Setpoints

PERIOD = 1e-3
STEP = 2.5e-4


def ends_of_travel(machine):
    """Positions of the axes at all corners of the travel of a machine's coordinates, and round its rotary ones."""
    coordinates = machine.kinematics.coordinates
    ends = [np.linspace(0, 330, 12) if along.unit == "deg" else along.travel for along in coordinates]
    return machine.kinematics.inverse(np.array(list(itertools.product(*ends))))


def plain(machine, period=PERIOD, **gains):
    """A servo without encoder quantisation, whose gains the test gives."""
    gains = {"resolution": 0.0, "following_error_limit": 1e3, **gains}
    return Servo.derive(machine.axes, period, **gains)


def ramp(speed, length=140.0):
    return Setpoints.along(ArcChain((-70.0, 0.0), 0.0, [0.0], [length]), speed, PERIOD)


TURNTABLE = """
<mujoco>
  <size nuser_jnt="1" nuser_sensor="1"/>
  <compiler angle="degree" autolimits="true"/>
  <option timestep="0.0005" integrator="Euler" gravity="0 0 0"/>
  <worldbody>
    <body name="table">
      <joint name="th" range="-400 400" user="6.283185307179586" damping="0.5"/>
      <geom type="cylinder" size="0.1 0.01" mass="2"/>
      <body name="work">
        <joint name="x" type="slide" axis="1 0 0" range="-0.4 0.4" user="1" damping="10"/>
        <geom size="0.01" mass="1"/>
      </body>
    </body>
    <site name="nozzle" pos="0.2 0 0"/>
  </worldbody>
  <actuator>
    <motor name="th" joint="th" gear="36" ctrlrange="-1 1"/>
    <motor name="x" joint="x" gear="628" ctrlrange="-1 1"/>
  </actuator>
  <sensor>
    <actuatorpos name="th" actuator="th" user="10000"/>
  </sensor>
</mujoco>
"""


def turntable(folder):
    """A rigid table that turns about the origin, a slide on it that carries the work, a nozzle at (200, 0) mm."""
    file = folder / "turntable.xml"
    file.write_text(TURNTABLE)
    return Machine(file)


def turned(speed, ticks=1001):
    """Setpoints of the table alone, at a constant speed [deg/s]; the path is any."""
    th = speed * PERIOD * np.arange(ticks)
    return Setpoints(PERIOD, ("th",), th[:, None], np.ones(ticks, bool), ramp(50.0).requested)


def turn(machine, speed, ticks=1001, law=None, **servo):
    """A run of the table at a constant speed [deg/s]."""
    return simulate(machine, Servo.derive(machine.axes, PERIOD, **servo), turned(speed, ticks), law=law)


def smooth(duration):
    """A way from 0 to 1 without a jump in acceleration, at every servo tick."""
    u = np.arange(round(duration / PERIOD) + 1) * PERIOD / duration
    return u - np.sin(2 * np.pi * u) / (2 * np.pi)


def round_the_piece(duration):
    """Setpoints of the stage once clockwise round an ellipse of 100 x 60 mm, its normal kept towards the column.

    S = -[R(-TH) K - u] with the needle at K = (-200, 0), TH = 180 deg - angle(n).
    """
    phi = np.pi - 2 * np.pi * smooth(duration)
    u = np.stack([50 * np.cos(phi), 30 * np.sin(phi)], axis=1)
    th = np.pi - np.unwrap(np.arctan2(np.sin(phi) / 30, np.cos(phi) / 50))
    slides = u - -200 * np.stack([np.cos(th), -np.sin(th)], axis=1)
    position = np.column_stack([np.degrees(th), slides])
    return Setpoints(PERIOD, ("th", "x", "y"), position, np.ones(len(th), bool), ramp(50.0).requested), u


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
