"""Disturbance observer: torque implied by the measured motion minus the torque commanded, low-pass filtered."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws.law import DEMAND, DISTURBANCE, Law, LawDesign, Timing
from gantrysim.servo.notch import Coefficients, filtered_output
from gantrysim.servo.stability.linear_system import Compensator

CUT_OFF_SHARE = 0.5  # of the natural frequency, the observer's cut-off
TAPS = 3  # sampled torque demands that act between three samples of the position
MOST_SHIFT = 32  # ticks by which the torque may be late in the model
DEMANDS = MOST_SHIFT + TAPS + 1  # torque demands that are remembered


def low_pass(bandwidth: float, period: float) -> tuple[float, float, float, float, float]:
    """Return a Butterworth filter of second order, by the bilinear transform, in the order of `notch.Coefficients`.

    Args:
        bandwidth: cut-off, below half the servo's frequency [Hz].
        period: servo period [s].
    """
    k = math.tan(math.pi * bandwidth * period)
    whole = 1 + math.sqrt(2) * k + k**2
    b = k**2 / whole
    return b, 2 * b, b, 2 * (k**2 - 1) / whole, (1 - math.sqrt(2) * k + k**2) / whole


def torque_taps(lag: float) -> tuple[int, tuple[float, float, float]]:
    """Return the delay in whole ticks and the weights of the demands from there on, by which a held torque moves.

    A torque u, held from tick to tick and f periods late, moves an inertia J by

        y[k] - 2 y[k-1] + y[k-2] = T^2/J ((1-f)^2/2 u[k-1] + (1/2 + f - f^2) u[k-2] + f^2/2 u[k-3])

    Args:
        lag: of the torque, in periods, at most `MOST_SHIFT`.
    """
    shift = int(min(lag, MOST_SHIFT))
    f = min(lag, MOST_SHIFT) - shift
    return shift, ((1 - f) ** 2 / 2, 0.5 + f - f**2, f**2 / 2)


def observed_disturbance(
    acceleration: float, velocity: float, commanded: float, inertia: float, viscous: float
) -> float:
    """Return the disturbance torque of one axis before the filter Q [N·m].

        d = J ddMPOS/T^2 + b dMPOS/T - u_n

    Args:
        acceleration: ddMPOS/T^2 [u/s²].
        velocity: dMPOS/T [u/s].
        commanded: u_n, the torque demands that acted, by `torque_taps` [N·m].
        inertia: J [N·m·s²/u].
        viscous: b [N·m·s/u].
    """
    return inertia * acceleration + viscous * velocity - commanded


def observing(
    law: Compensator,
    bandwidth: float,
    inertia: float,
    viscous: float,
    lag: float,
    period: float,
) -> Compensator:
    """Return a law with a disturbance observer, u = law(e) - Q d, as it answers to a position alone.

    Args:
        law: with its notch.
        bandwidth: of Q [Hz].
        inertia: J [N·m·s²/u].
        viscous: b [N·m·s/u].
        lag: of the torque, from the sample of the position on [s].
        period: servo period T [s].
    """
    q = low_pass(bandwidth, period)
    speed = viscous / period
    rate = inertia / period**2
    inverse = Compensator.fir(np.array([rate + speed, -2 * rate - speed, rate])).then(q)
    shift, weights = torque_taps(lag / period)
    commanded = Compensator.fir(np.concatenate([np.zeros(1 + shift), weights])).then(q)
    return law.beside(inverse).around(commanded)


def observe(row: Any, laws: Any) -> None:
    """Subtract the disturbance of every axis from the feed-forward [N·m]."""
    for axis in range(row.axes):
        law = laws[axis]
        velocity = row.measured_velocity[axis]
        acceleration = (velocity - law.observer_velocity) / row.period
        law.observer_velocity = velocity
        if law.observer_inertia == 0.0:
            continue
        commanded = 0.0
        for k in range(TAPS):
            before = row.tick - 1 - law.observer_shift - k
            if before >= 0:
                commanded += law.observer_taps[k] * law.observer_demands[before % DEMANDS]
        raw = observed_disturbance(acceleration, velocity, commanded, law.observer_inertia, law.observer_viscous)
        torque, law.observer_first, law.observer_second = filtered_output(
            raw, law.observer_filter, law.observer_first, law.observer_second
        )
        row.feedforward[axis] -= torque


def remember(row: Any, laws: Any) -> None:
    """Remember the torque demands, without what compensates friction, which is not in the observer's model."""
    for axis in range(row.axes):
        limit = row.torque_limit[axis]
        demand = min(max(row.torque[axis], -limit), limit)
        laws[axis].observer_demands[row.tick % DEMANDS] = demand - row.compensation[axis]


class DisturbanceObserver(Law):
    """The law as one of the ladder. Its linear model is exact, see `observing`."""

    name = "observer"
    meaning = "disturbance observer: torque implied by the measured motion minus the torque commanded"
    parameters = (
        Parameter("observer_bandwidth", "Hz", "cut-off frequency of the disturbance observer"),
        Parameter("observer_inertia", "N·m·s²/u", "inertia in the observer's model, torque per acceleration"),
        Parameter("observer_viscous", "N·m·s/u", "viscous friction in the observer's model, torque per speed"),
        Parameter("observer_lag", "s", "time constant of the torque in the observer's model"),
    )
    state = (
        ("observer_shift", int),  # see `torque_taps`
        ("observer_taps", float, (TAPS,)),
        ("observer_filter", float, (len(Coefficients._fields),)),
        ("observer_velocity", float),  # measured at the last tick [u/s]
        ("observer_first", float),  # states of the filter
        ("observer_second", float),
        ("observer_demands", float, (DEMANDS,)),  # by tick modulo their number [N·m]
    )
    stages = (
        (DISTURBANCE, observe),
        (DEMAND, remember),
    )
    answers_to_position = True

    def derived(self, design: LawDesign) -> dict[str, float]:
        return {
            "observer_bandwidth": CUT_OFF_SHARE * design.frequency,
            "observer_inertia": design.axis.inertia,
            "observer_viscous": design.axis.viscous,
            "observer_lag": design.lag,
        }

    def start(self, values: Mapping[str, float], timing: Timing) -> dict[str, Any]:
        shift, taps = torque_taps(_lag(values, timing) / timing.period)
        return {
            **super().start(values, timing),
            "observer_shift": shift,
            "observer_taps": taps,
            "observer_filter": low_pass(values["observer_bandwidth"], timing.period),
        }

    def closed_around(self, law: Compensator, values: Mapping[str, float], timing: Timing) -> Compensator:
        return observing(
            law,
            values["observer_bandwidth"],
            values["observer_inertia"],
            values["observer_viscous"],
            _lag(values, timing),
            timing.period,
        )


def _lag(values: Mapping[str, float], timing: Timing) -> float:
    """Return the time from a sample of the position to the torque that follows from it [s]."""
    return timing.delay + timing.feedback_delay * timing.period + values["observer_lag"]


OBSERVER = DisturbanceObserver()
