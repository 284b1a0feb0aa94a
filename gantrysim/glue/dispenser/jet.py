"""A jet: a valve that shoots drops of one volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive
from gantrysim.base.jit import jit

LARGEST_VALUE = 1e6
_SMALLEST_DROP = 1e-6  # a picolitre, as of an ink jet [mm³]
_LOST_SHARE = 1e-6  # share of the volume from which lost drops are noted


@dataclass(frozen=True)
class Jet:
    """A jet valve, as with a piezo-driven tappet: each shot is a drop, however fast the path.

    The controller adds up the flow that is commanded and shoots where half a drop more is due, so that a flow
    proportional to the speed spaces drops evenly along the path, `drop` over the bead's section. A drop leaves the
    nozzle at once, `dead_time` after the command. A shot that comes due before the valve is ready again waits; a second
    one is lost. This is what data sheets of jet valves state: volume of a drop and largest frequency. That the volume
    depends on frequency and temperature, satellites, and the flight of a drop are not simulated.

    Attributes:
        drop: volume of a drop [mm³].
        top_rate: largest number of drops in a second [Hz].

    Raises:
        InputError: a value out of bounds.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    drop: float = 0.02
    top_rate: float = 200.0

    def __post_init__(self) -> None:
        for name, unit in (("drop", "mm³"), ("top_rate", "Hz")):
            positive(f"{name} of the jet", getattr(self, name), unit, LARGEST_VALUE)
        if self.drop < _SMALLEST_DROP:
            raise InputError(f"drop of the jet = {self.drop:g} mm³: must be at least {_SMALLEST_DROP:g} mm³")


class Shots(NamedTuple):
    """What a jet shoots.

    Attributes:
        flow: mean over the period after each tick, (n,) [mm³/s].
        lost: number of drops that came due while the valve was not ready.
    """

    flow: Floats
    lost: int


def shots(jet: Jet, command: Floats, period: float, dead_time: float) -> Shots:
    """Return what a jet shoots.

    Args:
        jet: the jet.
        command: flow that is commanded over the period after each tick, (n,) [mm³/s].
        period: servo period [s].
        dead_time: from the command to the drop [s].
    """
    flow = np.zeros(command.size)
    lost = _shoot(np.maximum(command, 0.0), flow, period, dead_time, jet.drop, 1.0 / jet.top_rate)
    return Shots(flow, lost)


@jit
def _shoot(command: Floats, flow: Floats, period: float, dead_time: float, drop: float, pause: float) -> int:
    """Fill in the flow, and return the number of drops that are lost."""
    due = 0.5 * drop
    volume = 0.0
    ready = 0.0
    lost = 0
    for k in range(command.size):
        step = command[k] * period
        while step > 0.0 and volume + step >= due:
            time = period * (k + (due - volume) / step)
            if ready - time > pause:
                # one waits already: what comes due meanwhile in this tick is lost at once
                until = min((ready - pause) / period - k, 1.0)
                count = max(1, int((volume + until * step - due) / drop))
                lost += count
                due += count * drop
                continue
            due += drop
            shot = max(time, ready)
            ready = shot + pause
            tick = int((shot + dead_time) / period)
            if tick < command.size:
                flow[tick] += drop / period
        volume += step
    return lost


def jet_notes(jet: Jet, result: Shots, volume: float) -> tuple[str, ...]:
    """Return a note on drops that are lost of a commanded volume [mm³]."""
    if result.lost * jet.drop <= _LOST_SHARE * volume:
        return ()
    return (
        f"The jet loses {result.lost} drops of {jet.drop:g} mm³, {100 * result.lost * jet.drop / volume:.3g} % of the "
        f"volume: its largest flow is {jet.drop * jet.top_rate:.4g} mm³/s, at {jet.top_rate:g} Hz.",
    )
