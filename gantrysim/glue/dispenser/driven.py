"""A dispenser whose motor the program drives: from a commanded displacement to the flow."""

from __future__ import annotations

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
        end: time at which the plunger reaches its end, None where it does not [s].
    """

    moved: Displaced
    out: Flowed
    end: float | None


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
    return Driven(moved, flowed(rate, period, body.line(needle.conductance), law), end)


def driven_notes(drive: Drive, result: Driven, volume: float, period: float) -> tuple[str, ...]:
    """Return notes on a stall, on the plunger's end and on what the motor's limits cost of a commanded volume [mm³]."""
    notes = list(motor_notes(drive.motor, result.moved, volume))
    lost = result.out.lost
    total = float(lost.sum())
    if total > _LOST * volume:
        ticks = np.flatnonzero(lost)
        notes.append(
            f"FAULT of the dispenser: its motor stalls at t = {ticks[0] * period:.4g} s, for "
            f"{ticks.size * period:.3g} s in all: the glue reaches {drive.body.limit:.4g} kPa, which is all that "
            f"{drive.body.strength} to; {total:.3g} mm³ of its stroke are lost. A wider or shorter needle, less flow, "
            "or a stronger motor."
        )
    if result.end is not None:
        notes.append(f"the dispenser's plunger reaches its end at t = {result.end:.4g} s")
    return tuple(notes)
