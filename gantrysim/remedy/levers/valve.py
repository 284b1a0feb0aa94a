"""The dispenser's lag: its compensation in the controller, the leads of the valve, and a faster valve."""

from __future__ import annotations

from gantrysim.base.errors import InputError
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.remedy.lever import FREE, Effort, Lever, Setting, State
from gantrysim.remedy.levers.numbers import factor_text, milliseconds, rounded_number
from gantrysim.results.verdict import GLUE

_TICK = 1e-4  # times are set to a tenth of a millisecond [s]
_FASTER = (0.5, 0.25)
_TIMES = ("dead_time", "closing_dead_time", "opening", "closing")
_FITTED = ("start_lead", "stop_lead", "advance")  # fitted to those times


def _ticks(seconds: float) -> float:
    return rounded_number(round(max(seconds, 0.0) / _TICK) * _TICK)


def compensations(dispenser: Dispenser) -> list[float]:
    """Return the times of the compensation to try, ascending, without the present one [s].

    A first-order lag T is late by T on a ramp, and the dead time comes on top. Rising and falling flow may have
    different lags, of which the compensation can only have one: both time constants, the longer one with the dead time,
    and the mean of the shortest and the longest are tried.
    """
    shortest = min(dispenser.opening, dispenser.closing)
    longest = max(dispenser.opening, dispenser.closing) + dispenser.dead_time
    lags = (dispenser.opening, dispenser.closing, longest, 0.5 * (shortest + longest))
    times = {_ticks(lag) for lag in lags}
    return sorted(times - {0.0, _ticks(dispenser.advance)})


def _compensation(state: State) -> list[Setting] | str:
    dispenser = state.job.dispenser
    values = compensations(dispenser)
    if not values:
        return "the dispenser has no lag, or it is compensated"
    return [Setting(milliseconds(value), {"dispenser.advance": value}) for value in values]


def _leads(state: State) -> list[Setting] | str:
    dispenser = state.job.dispenser
    outcome = state.outcome
    if not outcome.nominal:
        return "the job lays no bead"
    try:
        speed = state.job.controller.programmed_speed
    except InputError:
        return "the program states no path speed, from which times would follow"
    dead = (_ticks(dispenser.dead_time), _ticks(dispenser.closing_delay))
    start = _ticks(dispenser.start_lead + outcome.missing / speed)
    stop = _ticks(dispenser.stop_lead + outcome.excess / speed)
    present = (_ticks(dispenser.start_lead), _ticks(dispenser.stop_lead))
    leads = {"of the dead time": dead, "of the measured ends": (start, stop)}
    settings = [
        Setting(label, {"dispenser.start_lead": values[0], "dispenser.stop_lead": values[1]})
        for label, values in leads.items()
        if values != present
    ]
    return settings or "the leads fit the dead time and the measured starts and stops"


def _faster(state: State) -> list[Setting] | str:
    dispenser = state.job.dispenser
    if not any(getattr(dispenser, name) for name in _TIMES):
        return "the dispenser follows its command at once"
    times = {name: getattr(dispenser, name) for name in (*_TIMES, *_FITTED)}
    return [
        Setting(
            factor_text(factor),
            {f"dispenser.{name}": rounded_number(factor * time) for name, time in times.items() if time},
        )
        for factor in _FASTER
    ]


LAG_COMPENSATION = Lever(
    name="lag compensation",
    meaning="the controller adds the change of the flow's demand times the dispenser's lag",
    cost="peaks of the flow",
    rows=(GLUE,),
    settings=_compensation,
)
LEADS = Lever(
    name="leads",
    meaning="times by which the valve opens and closes before the program's on and off",
    cost=FREE,
    rows=(GLUE,),
    settings=_leads,
)
FASTER_VALVE = Lever(
    name="faster valve",
    meaning="dead time, opening and closing of the dispenser, and the leads and compensation fitted to them",
    cost="another valve",
    rows=(GLUE,),
    settings=_faster,
    effort=Effort.HARDWARE,
)
