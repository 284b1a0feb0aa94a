"""Pressure advance of a driven dispenser: its motor runs ahead by what the glue under pressure stores."""

from __future__ import annotations

from gantrysim.base.errors import InputError
from gantrysim.remedy.lever import Lever, Setting, State
from gantrysim.remedy.levers.numbers import milliseconds, rounded_number
from gantrysim.results.verdict import GLUE

_TICK = 1e-4  # times are set to a tenth of a millisecond [s]


def _settings(state: State) -> list[Setting] | str:
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
    times = {rounded_number(round(lag / _TICK) * _TICK) for lag in (small, 0.5 * (small + whole), whole)}
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
    settings=_settings,
)
