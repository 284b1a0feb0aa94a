"""A dispenser whose motor the program drives: from a commanded displacement to the flow."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.dispenser.lag import NeedleLaw
from gantrysim.glue.dispenser.motor import Displaced, Motor, displaced, motor_notes
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.glue.dispenser.pressurised import Flowed, flowed
from gantrysim.glue.dispenser.volumetric import Pump

_STEP = 1e-3  # relative, of the flow of a difference
_LOST = 1e-6  # share of the volume from which a stall is noted
# a stepper keeps its step through a shorter peak of speed, half a swing of its rotor in the field [s]
_FOLLOWED = 0.01
_ROUNDING = 1e-6  # relative


class Drive(NamedTuple):
    """A driven dispenser.

    Attributes:
        body: pump or piston.
        motor: that drives it.
        needle: at its end.
    """

    body: Pump | Piston
    motor: Motor
    needle: Needle

    def lags(self, flow: float) -> tuple[float, float]:
        """Return the time constant of small changes of a flow, and the mean of its rise from rest [s].

        With the stored volume x = C p, these are dx / d(g p + Q) and x / (g p + Q): equal for a Newtonian glue.
        """
        line = self.body.line(self.needle.conductance)
        compliance = line.compliance + line.glue / line.modulus
        low, pressure, high = self.needle.pressure(flow * np.array([1 - _STEP, 1.0, 1 + _STEP])).tolist()
        change = 2 * _STEP * flow + line.leak * (high - low)
        return compliance * (high - low) / change, compliance * pressure / (flow + line.leak * pressure)


class Driven(NamedTuple):
    """What a driven dispenser does with a command.

    Attributes:
        moved: by the motor.
        out: of the needle.
        asked: pressure that the commanded flow needs, whatever the motor holds, at the end of each period, (n,) [kPa].
        end: time at which the plunger reaches its end, None where it does not [s].
    """

    moved: Displaced
    out: Flowed
    asked: Floats
    end: float | None


class Load(NamedTuple):
    """What a program asks of a dispenser's motor at most.

    Attributes:
        name: "force", "torque" or "speed".
        value: the largest.
        limit: that the motor has.
        unit: of both.
        tick: at which it first exceeds the limit, or else is largest.
        event: what then happens, in words.
    """

    name: str
    value: float
    limit: float
    unit: str
    tick: int
    event: str

    @property
    def exceeds(self) -> bool:
        """Whether it exceeds the limit."""
        return self.value > self.limit * (1 + _ROUNDING)


def driven_flow(drive: Drive, command: Floats, period: float, *, by_position: bool) -> Driven:
    """Return what a driven dispenser does.

    Args:
        drive: the dispenser.
        command: rate that is commanded over the period after each tick, (n,) [mm³/s].
        period: servo period [s].
        by_position: whether positions are commanded, as by E, instead of speeds.
    """
    body, motor, needle = drive
    moved = displaced(motor, command, period, body.unit, by_position=by_position)
    rate = moved.rate
    end = None
    if isinstance(body, Piston):
        place = np.cumsum(rate) * period
        beyond = np.flatnonzero(place > body.glue)
        if beyond.size:
            end = float(beyond[0]) * period
            rate = np.diff(np.minimum(place, body.glue), prepend=0.0) / period
    law = NeedleLaw(needle.conductance, needle.yield_pressure, 1 / needle.index, *needle.shape)
    line = body.line(needle.conductance)
    out = flowed(rate, period, line, law)
    asked = flowed(rate, period, line._replace(limit=math.inf), law).pressure if out.lost.any() else out.pressure
    return Driven(moved, out, asked, end)


def loads(drive: Drive, result: Driven, period: float, *, by_position: bool) -> tuple[Load, ...]:
    """Return what is asked of a motor with limits; arguments as of `driven_flow`.

    A motor that is sent to positions must keep up with them: one that steps loses them, one with an encoder trips. One
    that is sent speeds turns as fast as it can, and lays what that gives.
    """
    body, motor, _ = drive
    of_motor = []
    if body.limit < math.inf:
        of_motor.append(_load(body.load, body.effort(result.asked), body.strength_limit, body.load_unit, "stalls"))
    if by_position and motor.top_speed < math.inf:
        speed = np.abs(_mean(result.moved.asked, max(round(_FOLLOWED / period), 1))) / body.unit
        of_motor.append(_load("speed", speed, motor.top_speed, body.speed_unit, "cannot follow its command"))
    return tuple(of_motor)


def _load(name: str, values: Floats, limit: float, unit: str, event: str) -> Load:
    exceeds = values > limit * (1 + _ROUNDING)
    tick = int(exceeds.argmax()) if exceeds.any() else int(values.argmax())
    return Load(name, float(values.max()), limit, unit, tick, event)


def _mean(values: Floats, count: int) -> Floats:
    """Return the mean of each value and those that follow it, `count` in all, with zeros after the last."""
    total = np.concatenate([[0.0], np.cumsum(values), np.full(count - 1, values.sum())])
    return (total[count:] - total[: values.size]) / count


def driven_notes(drive: Drive, result: Driven, volume: float, period: float) -> tuple[str, ...]:
    """Return notes on a stall, on the plunger's end and on what the motor's limits cost of a commanded volume [mm³]."""
    notes = list(motor_notes(drive.motor, result.moved, volume))
    lost = result.out.lost
    total = float(lost.sum())
    if total > _LOST * volume:
        ticks = np.flatnonzero(lost)
        notes.append(
            f"FAULT of the dispenser: its motor stalls at t = {ticks[0] * period:.4g} s, for "
            f"{ticks.size * period:.3g} s in all: the flow needs up to {result.asked.max():.4g} kPa, and "
            f"{drive.body.limit:.4g} kPa is all that {drive.body.strength} to. {total:.3g} mm³ of its stroke are lost, "
            "more where a stepper does not start again by itself. A wider or shorter needle, less flow, or a stronger "
            "motor."
        )
    if result.end is not None:
        notes.append(f"the dispenser's plunger reaches its end at t = {result.end:.4g} s")
    return tuple(notes)
