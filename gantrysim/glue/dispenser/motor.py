"""The motor of a driven dispenser: how far its shaft, or plunger, follows what is commanded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.base.jit import jit

_BEHIND = 1e-3  # share of the commanded volume by which a motor that falls behind is noted


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
        if by_position and behind != 0.0:
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
    if moved.refused > _BEHIND * volume:
        notes.append(
            f"The dispenser's motor cannot reverse: {moved.refused:.3g} mm³ that the program, or its advance, pulls "
            f"back are not, {100 * moved.refused / volume:.3g} % of the volume."
        )
    is_limited = motor.top_speed < math.inf or motor.top_acceleration < math.inf
    if is_limited and moved.behind > _BEHIND * volume:
        notes.append(
            f"The dispenser's motor falls behind its command by up to {moved.behind:.3g} mm³, at t = {moved.late:.4g} "
            f"s: its top_speed ({motor.top_speed:g}) or top_acceleration ({motor.top_acceleration:g}) does not reach."
        )
    return tuple(notes)
