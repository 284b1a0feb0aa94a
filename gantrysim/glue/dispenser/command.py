"""What a program commands a dispenser to do: when its valve opens and closes, material fed by E, the set point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

_EDGE = 1e-9  # distance from a tick within which an edge is at the tick [servo periods]


class ValveTimes(NamedTuple):
    """Times at which the valve opens and closes, ascending, in servo periods.

    Attributes:
        opens: (k,).
        closes: (k,).
    """

    opens: Floats
    closes: Floats

    @classmethod
    def of(cls, on: NDArray[np.bool_], period: float, start_lead: float, stop_lead: float) -> ValveTimes:
        """Return the times for a dispenser command.

        Args:
            on: command from each tick to the next, (n,).
            period: servo period [s].
            start_lead: time by which the valve opens before the program's on [s].
            stop_lead: time by which the valve closes before the program's off [s].

        Raises:
            InputError: a start lead longer than the time before the first dispensing.
        """
        changes = np.flatnonzero(on[1:] != on[:-1]) + 1
        first = [0] if on.size and on[0] else []
        last = [on.size] if on.size and on[-1] else []
        edges = np.concatenate([first, changes, last]).astype(np.float64)
        opens = edges[::2] - start_lead / period
        closes = edges[1::2] - stop_lead / period
        if opens.size and opens[0] < -_EDGE:
            before = period * (opens[0] + start_lead / period)
            raise InputError(
                f"start_lead = {start_lead:g} s: must be at most {before:g} s, the time before the first "
                "dispensing; Setpoints.wait holds the motion back"
            )
        opens = on_ticks(opens)
        closes = on_ticks(closes)
        if on.size and on[-1]:
            # the program has not closed the valve by the end of the record
            closes[-1] = on.size
        return cls(opens, closes)

    def is_open(self, time: Floats) -> NDArray[np.bool_]:
        """Return whether the valve is open just after a time in servo periods, of the same shape.

        Leads may merge two stretches, or put an end before its beginning: openings and closings are counted.
        """
        return np.searchsorted(self.opens, time, "right") > np.searchsorted(self.closes, time, "right")


def on_ticks(time: Floats) -> Floats:
    """Return times in periods, snapped to a tick where they are off it by rounding alone."""
    near = np.round(time)
    return np.where(np.abs(time - near) < _EDGE * np.maximum(1.0, np.abs(near) * 1e-3), near, time)


def cuts(edges: Floats, first: int, last: int) -> Floats:
    """Return what cuts the time between two ticks: the ticks and the edges between, ascending, (k,) [periods]."""
    ticks = np.arange(first, last + 1, dtype=np.float64)
    # what NumPy has for sets takes several times as long as all else that a flow takes
    between = np.sort(edges[(edges > first) & (edges < last) & (edges != np.floor(edges))], kind="stable")
    between = between[np.diff(between, prepend=-np.inf) > 0]
    return np.insert(ticks, np.floor(between).astype(np.intp) + 1 - first, between)


class Material(NamedTuple):
    """Positions of the extruder at the ticks, as in `Setpoints`; None for a program without E.

    Attributes:
        extrusion: fed by E, (n,) [mm].
        extruder: that of the motor under pressure advance, (n,) [mm]; None where it is `extrusion`.
        analogue: set point of the flow by an output, (n,); None without.
    """

    extrusion: Floats | None = None
    extruder: Floats | None = None
    analogue: Floats | None = None

    def laid(self) -> Floats:
        """Return the material that leaves an ideal nozzle over the period after each tick, (n,) [mm].

        What is pulled back leaves no more of it, and what is fed again up to where it was leaves nothing.
        """
        if self.extrusion is None:
            raise without_e()
        furthest = np.maximum.accumulate(self.extrusion)
        return np.diff(furthest, append=furthest[-1:])

    def stroke(self) -> Floats:
        """Return how far the extruder's motor is sent over the period after each tick, (n,) [mm]."""
        motor = self.extrusion if self.extruder is None else self.extruder
        if motor is None:
            raise without_e()
        return np.diff(motor, append=motor[-1:])

    def set_point(self) -> Floats:
        """Return the set point of the flow, at least 0, (n,)."""
        if self.analogue is None:
            raise without_output()
        return np.maximum(self.analogue, 0.0)


NOTHING = Material()


def output_note(output: str, per_output: float) -> str:
    """Return what an output that a job names as the set point of the flow does, in a sentence."""
    if not per_output:
        return f"{output} is flow_output, but without effect: dispenser.per_output, the flow for each unit of it, is 0."
    return f"{output} sets the flow: {per_output:g} mm³/s for each unit of its value, while glue is laid."


def without_e() -> InputError:
    """Return the error of a dispenser that follows E, for a program without."""
    return InputError(
        "dispenser: filament and e_volume multiply what a program feeds by E, and this one feeds nothing: the amount "
        "must be given by flow, area or pressure"
    )


def without_output() -> InputError:
    """Return the error of a dispenser that follows an output, for a program that states none."""
    return InputError(
        "dispenser: per_output multiplies the program's flow_output, which is not stated: must be an output, as "
        'flow_output = "M67 E0" or "S" of G-code, "#1132" of FANUC, "AOUT(0)" of Trio BASIC'
    )
