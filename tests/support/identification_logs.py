"""Random logs of an axis whose friction follows some law, with the truth, and with or without an error of the log."""

import math
from typing import NamedTuple

import numpy as np

from gantrysim import Machine, Servo
from gantrysim.controllers.trio import Basic
from gantrysim.identify.identification import Identification
from gantrysim.identify.log import Log
from gantrysim.identify.model import model_of
from gantrysim.identify.plan import excitation

from support.friction_plants import ALL_LAWS, LAWS, FrictionPlant, drive

MACHINE = Machine("xy")
AXIS = 1
STEP = 3.125e-6  # of the integration, whose torque leads by about one: a hundredth of the shortest period [s]
SLIPS = (
    "torque in mN·m",
    "torque in kgf·m",
    "gear",
    "frozen",
    "repeated samples",
    "saturated",
    "clock drift",
    "wrong axis",
    "too few samples",
    "inches",
    "wrong period",
)
_COMMANDS = {}


class TrueLog(NamedTuple):
    """A log and what made it.

    Attributes:
        log: of the axis y.
        truth: values by name, in the units of `Identification.values`.
        law: of the friction.
        slip: error of the log, "" for none.
    """

    log: Log
    truth: dict[str, float]
    law: str
    slip: str


def commands(period):
    """The moves of the axis that gantrysim plans, from 0.1 s before the first to 0.2 s after the last [m]."""
    if period not in _COMMANDS:
        position = Basic(excitation(MACHINE, "trio")[0]).setpoints(period).position[:, AXIS]
        moving = np.flatnonzero(np.abs(position) > 1e-6)
        ticks = slice(max(moving[0] - int(0.1 / period), 0), moving[-1] + int(0.2 / period))
        _COMMANDS[period] = 1e-3 * position[ticks]
    return _COMMANDS[period]


def random_log(seed, law=None, slip=None, noise=None, period=None, *, by_direction=False, in_motion=False, uneven=None):
    """Return a log of a random axis; what is None is drawn, slip "" is a log without an error.

    Args:
        seed: of the axis.
        law: of the friction.
        slip: error of the log.
        noise: of the torque [N·m].
        period: of the samples [s].
        by_direction: viscous friction is up to 30 % higher in one direction and as much lower in the other.
        uneven: share by which it is higher forwards and lower back, instead.
        in_motion: the log begins at a speed, up to 4 s after the first move.
    """
    random = np.random.default_rng(seed)
    axis, table = MACHINE.axes[AXIS], model_of(MACHINE, AXIS)
    si = 1e6 / axis.scale
    law = law or LAWS[random.integers(len(LAWS))]
    drawn_slip = random.choice([""] * 8 + list(SLIPS))
    slip = drawn_slip if slip is None else slip
    drawn_period = float(random.choice([5e-4, 1e-3, 1e-3, 1e-3, 2e-3]))
    period = period or drawn_period

    def factor(tolerance):
        return (1 + tolerance) ** random.uniform(-1, 1)

    mass = table.inertia * si * factor(0.4)
    share = table.share * factor(0.2)
    coulomb = table.coulomb * factor(0.5)
    strength = {
        "asymmetric": random.uniform(0.02, 0.4),
        "position": random.uniform(0.05, 0.5),
        "load": random.uniform(0.01, 0.15),
        "quadratic": random.uniform(0.05, 0.8),
    }.get(law, 0.0)
    plant = FrictionPlant(
        motor=mass * (1 - share),
        load=mass * share,
        k=table.stiffness * si * factor(0.4),
        c=table.damping * si * factor(0.5),
        b=table.viscous * si * factor(0.6),
        fc=coulomb,
        fs=coulomb * random.uniform(1, 1.6) if law in ("stribeck", "lugre") else coulomb,
        gear=1e3 / axis.scale,
        law=ALL_LAWS.index(law),
        ws=3.1 * factor(3),
        s0=7.2 * factor(2),
        s1=0.01 * factor(1),
        strength=strength,
        length=random.uniform(0.004, 0.06),
        weight=float(random.choice([0.0, 0.005])),
    )
    delay = float(random.choice([0.0, 0.25, 0.5])) * period
    drawn_noise = float(random.choice([0.0, 1e-3, 2e-3, 1e-2]))
    noise = drawn_noise if noise is None else noise
    count = float(random.choice([1e-7, 1e-6, 1e-6, 5e-6]))
    limit = 0.12 if slip == "saturated" else 0.906
    # drawn last, so that the axes of the other laws stay as they are
    if law == "cogging":
        pitch = (
            2e-3 * math.pi * axis.scale / float(random.choice([1, 2, 4, 8]))
        )  # of the screw, or of the motor's slots
        plant = plant._replace(strength=random.uniform(0.05, 0.6), length=pitch)
    if law == "backlash":
        plant = plant._replace(gap=random.uniform(1e-5, 2e-5))
    if by_direction:
        plant = plant._replace(uneven=random.uniform(-0.3, 0.3))
    if uneven is not None:
        plant = plant._replace(uneven=uneven)
    servo = Servo.derive(MACHINE.axes, period)
    gains = tuple(
        1e3 * gain[AXIS]
        for gain in (
            servo.per_axis("kp"),
            servo.per_axis("ki"),
            servo.per_axis("kd"),
            servo.per_axis("acceleration_ff"),
        )
    )
    rows = drive(plant, gains, commands(period), period, delay, count, limit, round(period / STEP))
    if in_motion:
        rows = rows[_moving_sample(rows[:, 0], period, random) :]
    torque = rows[:, 1] + noise * random.standard_normal(len(rows))
    period, position, torque = _with(slip, random, period, 1e3 * rows[:, 0], torque)
    bias = -plant.fc * plant.strength if law == "asymmetric" else 0.0
    truth = {
        "inertia": mass,
        "viscous": plant.b,
        "viscous_forward": plant.b * (1 + plant.uneven),
        "viscous_back": plant.b * (1 - plant.uneven),
        "coulomb": plant.fc,
        "static": plant.fs,
        "offset": plant.weight + bias,
        "delay": delay,
        "share": share,
        "stiffness": plant.k,
        "damping": plant.c,
        "gap": 1e3 * plant.gap,
    }
    return TrueLog(Log(("y",), period, position[:, None], torque[:, None], held=True), truth, law, slip)


def _moving_sample(position, period, random):
    """Return a sample in the first 4 s of motion at which an axis is at half its highest speed or more."""
    speed = np.abs(np.gradient(position, period))
    first = int(np.argmax(speed > 0.01 * speed.max()))
    window = np.arange(first, min(first + int(4 / period), len(position)))
    return int(random.choice(window[speed[window] > 0.5 * speed[window].max()]))


def _with(slip, random, period, position, torque):
    """Return period, position and torque of a log with an error."""
    n = len(position)
    if slip == "torque in mN·m":
        torque = 1e3 * torque
    if slip == "torque in kgf·m":
        torque = torque / 9.81
    if slip == "gear":
        torque = float(random.choice([0.1, 0.2, 5.0, 10.0])) * torque
    if slip == "frozen":
        length = int(n * random.uniform(0.05, 0.5))
        position[n // 5 : n // 5 + length] = position[n // 5]
    if slip == "repeated samples":
        for _ in range(20):
            first = random.integers(n - 100)
            position[first : first + int(random.integers(5, 60))] = position[first]
    if slip == "clock drift":
        time = period * np.arange(n)
        torque = np.interp(time - random.uniform(1, 4) * period * time / time[-1], time, torque)
    if slip == "wrong axis":
        torque = np.roll(torque[::-1], int(random.integers(200)))
    if slip == "too few samples":
        every = int(random.choice([3, 5, 10]))
        position, torque, period = position[::every], torque[::every], every * period
    if slip == "inches":
        position = position / 25.4
    if slip == "wrong period":
        period = period * float(random.choice([0.5, 2.0]))
    return period, position, torque


def confidently_wrong(found: Identification, truth) -> dict[str, float]:
    """Return the identified values whose interval does not hold the truth, with its distance in half intervals."""
    wrong = {}
    for value in found.values:
        if value.identified and value.name in truth and not value.low <= truth[value.name] <= value.high:
            half = 0.5 * (value.high - value.low)
            wrong[value.name] = abs(truth[value.name] - value.value) / max(half, 1e-300)
    return wrong
