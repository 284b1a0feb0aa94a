"""A dispenser whose motor the program drives: from a commanded displacement over its shaft or plunger to the flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.base.jit import jit
from gantrysim.glue.dispenser.lag import NeedleLaw
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.glue.dispenser.pressurised import Flowed, flowed
from gantrysim.glue.dispenser.volumetric import Pump

_FLOW_STEP = 1e-3  # relative, of the flow of a difference
_LOST_SHARE = 1e-6  # share of the volume from which a stall is noted
# a stepper keeps its step through a shorter peak of speed, half a swing of its rotor in the field [s]
_FOLLOWED = 0.01
_ROUNDING = 1e-6  # relative

_LATE_SHARE = 1e-3  # share of the commanded volume by which a motor that falls behind is noted


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
        low, pressure, high = self.needle.pressure(flow * np.array([1 - _FLOW_STEP, 1.0, 1 + _FLOW_STEP])).tolist()
        change = 2 * _FLOW_STEP * flow + line.leak * (high - low)
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
    if total > _LOST_SHARE * volume:
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


@dataclass(frozen=True)
class Motor:
    """Motor of a driven dispenser; in revolutions of a pump's shaft, or millimetres of a plunger's stroke.

    A motor that follows E is sent to positions, and makes up for what its limits have kept it behind. One that follows
    a flow, as an analogue output states it, is sent speeds, and does not. What its load does to it belongs to the kind
    of dispenser: it stalls where the pressure needs more than its torque or force, and the stroke commanded meanwhile
    is lost.

    Attributes:
        top_speed: largest speed; inf for none [rev/s or mm/s].
        top_acceleration: largest acceleration; inf for none [rev/s² or mm/s²].
        step: smallest step of the position, as of a microstep; 0 for none [rev or mm].
        reverses: whether it can turn, or pull, back; without, a demand below zero is a standstill.

    Raises:
        InputError: a value out of bounds.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": True}

    top_speed: float = math.inf
    top_acceleration: float = math.inf
    step: float = 0.0
    reverses: bool = True

    def __post_init__(self) -> None:
        for name in ("top_speed", "top_acceleration"):
            if getattr(self, name) != math.inf:
                positive(f"{name} of the dispenser's motor", getattr(self, name))
        at_least("step of the dispenser's motor", self.step, 0)
        if self.step == math.inf:
            raise InputError("step of the dispenser's motor = inf: must be finite")


class Displaced(NamedTuple):
    """What a motor displaces.

    Attributes:
        asked: rate that is commanded over the period after each tick, less what a motor that cannot reverse refuses,
            (n,) [mm³/s].
        rate: over the period after each tick, (n,) [mm³/s].
        refused: volume that was commanded backwards of a motor that cannot [mm³].
        behind: largest distance behind the command [mm³].
        late: time of that [s].
    """

    asked: Floats
    rate: Floats
    refused: float
    behind: float
    late: float


def displaced(motor: Motor, command: Floats, period: float, unit: float, *, by_position: bool) -> Displaced:
    """Return what a motor displaces.

    Args:
        motor: the motor.
        command: rate that is commanded over the period after each tick, (n,) [mm³/s].
        period: servo period [s].
        unit: volume of a revolution or a millimetre [mm³].
        by_position: whether positions are commanded, as by E, instead of speeds.
    """
    wanted = command
    if not motor.reverses:
        if by_position:
            # the shaft waits until it is commanded beyond where it stands
            place = np.concatenate([[0.0], np.maximum.accumulate(np.maximum(np.cumsum(command) * period, 0.0))])
            wanted = np.diff(place) / period
        else:
            wanted = np.maximum(command, 0.0)
    refused = float(np.maximum(-command, 0.0).sum() * period) if not motor.reverses else 0.0
    rate = wanted
    if motor.top_speed < math.inf or motor.top_acceleration < math.inf:
        rate = np.empty_like(wanted)
        _follow(wanted, rate, period, (unit * motor.top_speed, unit * motor.top_acceleration), by_position)
    if motor.step:
        step = unit * motor.step
        place = step * np.round(np.cumsum(rate) * period / step)
        rate = np.diff(place, prepend=0.0) / period
    behind = (np.cumsum(wanted) - np.cumsum(rate)) * period
    tick = int(np.argmax(np.abs(behind))) if behind.size else 0
    return Displaced(wanted, rate, refused, float(abs(behind[tick])) if behind.size else 0.0, tick * period)


@jit
def _follow(wanted: Floats, rate: Floats, period: float, limits: tuple[float, float], by_position: bool) -> None:
    """Fill in the rates of a motor within its limits.

    Args:
        wanted: rates that are commanded, (n,) [mm³/s].
        rate: to be filled in, (n,) [mm³/s].
        period: servo period [s].
        limits: largest rate and its largest change [mm³/s, mm³/s²].
        by_position: whether it makes up for what it is behind.
    """
    fastest, change = limits
    speed = 0.0
    behind = 0.0
    for k in range(wanted.size):
        target = wanted[k]
        if by_position:
            # as fast as it can still brake from within what it is behind
            catch = abs(behind) / period
            if change < math.inf:
                catch = min(catch, math.sqrt((0.5 * change * period) ** 2 + 2.0 * change * abs(behind)))
                catch = max(catch - 0.5 * change * period, 0.0)
            target += math.copysign(catch, behind)
        target = min(max(target, -fastest), fastest)
        speed = min(max(target, speed - change * period), speed + change * period)
        rate[k] = speed
        behind += (wanted[k] - speed) * period


def motor_notes(motor: Motor, moved: Displaced, volume: float) -> tuple[str, ...]:
    """Return notes on what the motor's limits have cost of a commanded volume [mm³]."""
    notes = []
    if moved.refused > _LATE_SHARE * volume:
        notes.append(
            f"The dispenser's motor cannot reverse: {moved.refused:.3g} mm³ that the program, or its advance, pulls "
            f"back are not, {100 * moved.refused / volume:.3g} % of the volume."
        )
    is_limited = motor.top_speed < math.inf or motor.top_acceleration < math.inf
    if is_limited and moved.behind > _LATE_SHARE * volume:
        notes.append(
            f"The dispenser's motor falls behind its command by up to {moved.behind:.3g} mm³, at t = {moved.late:.4g} "
            f"s: its top_speed ({motor.top_speed:g}) or top_acceleration ({motor.top_acceleration:g}) does not reach."
        )
    return tuple(notes)
