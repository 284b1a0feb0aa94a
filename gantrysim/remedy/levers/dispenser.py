"""The dispenser: compensation of its lag, leads of its valve, a faster valve; flow by speed, and pressure advance.

With a flow proportional to the path speed, it falls where the program slows down, so that the section stays. A
dispenser that lags is late with every change of the speed, where a fixed flow has nothing to be late with. Both alone
may therefore be worse than the job as it is, so that they are also tried together. Pressure advance is for a driven
dispenser: its motor runs ahead by what the glue under pressure stores.
"""

from __future__ import annotations

from gantrysim.base.errors import InputError
from gantrysim.glue.dispenser.dispenser import DEMANDS, Dispenser
from gantrysim.remedy.lever import FREE, Effort, Lever, Setting, State, factor_text, milliseconds, rounded_number
from gantrysim.results.verdict import GLUE

_TICK = 1e-4  # times are set to a tenth of a millisecond [s]
_FASTER_VALVES = (0.5, 0.25)
_VALVE_TIMES = ("dead_time", "closing_dead_time", "opening", "closing")
_FITTED_LEADS = ("start_lead", "stop_lead", "advance")  # fitted to those times


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
    if not any(getattr(dispenser, name) for name in _VALVE_TIMES):
        return "the dispenser follows its command at once"
    times = {name: getattr(dispenser, name) for name in (*_VALVE_TIMES, *_FITTED_LEADS)}
    return [
        Setting(
            factor_text(factor),
            {f"dispenser.{name}": rounded_number(factor * time) for name, time in times.items() if time},
        )
        for factor in _FASTER_VALVES
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


_AREA_DIGITS = 3  # of the area


def _proportional_flow(state: State) -> list[Setting] | str:
    dispenser = state.job.dispenser
    if dispenser.area:
        return "the flow is proportional to the path speed"
    if dispenser.per_e:
        return "E states the flow, which is proportional to the path speed"
    outcome = state.outcome
    if not outcome.nominal:
        return "the job lays no bead"
    if outcome.dots:
        return "dots are laid while the nozzle rests, where a flow proportional to the speed is zero"
    area = float(f"{outcome.nominal:.{_AREA_DIGITS}g}")
    fixed = {f"dispenser.{name}": 0.0 for name in DEMANDS if getattr(dispenser, name)}
    changes = {**fixed, "dispenser.area": area}
    return [
        Setting(f"area {area:g} mm²", changes),
        *(
            Setting(f"area {area:g} mm², {milliseconds(value)} compensated", {**changes, "dispenser.advance": value})
            for value in compensations(dispenser)
        ),
    ]


PROPORTIONAL_FLOW = Lever(
    name="flow by speed",
    meaning="flow proportional to the path speed",
    cost="an analogue output for the pump",
    rows=(GLUE,),
    settings=_proportional_flow,
)


def _pressure_advances(state: State) -> list[Setting] | str:
    job = state.job
    drive = job.dispenser.drive
    if drive is None:
        return "the dispenser is a valve, which no motor drives"
    if not state.outcome.nominal:
        return "the job lays no bead"
    try:
        flow = state.outcome.nominal * job.controller.programmed_speed
    except InputError:
        return "the program states no path speed, from which the flow would follow"
    # between small changes and the rise from rest a glue that is not Newtonian has other lags
    small, whole = drive.lags(flow)
    times = {_ticks(lag) for lag in (small, 0.5 * (small + whole), whole)}
    settings = []
    for time in sorted(times - {0.0}):
        changes = {"dispenser.advance": time}
        if job.dispenser.per_e:
            arguments = job.controller.with_advance(time)
            if arguments is None:
                return "the program sets its pressure advance itself"
            changes = {f"program.{name}": value for name, value in arguments.items()}
        settings.append(Setting(milliseconds(time), changes))
    return settings or "the dispenser follows its motor at once"


PRESSURE_ADVANCE = Lever(
    name="pressure advance",
    meaning="the dispenser's motor runs ahead by its speed times the lag of the glue under pressure",
    cost="peaks of the motor's speed",
    rows=(GLUE,),
    settings=_pressure_advances,
)
