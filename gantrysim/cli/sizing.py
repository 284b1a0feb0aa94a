"""The table of what drives can do; apart from the command, whose help imports no simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from rich.table import Table

from gantrysim.base.quantity import number_text
from gantrysim.machine.machine import Machine
from gantrysim.machine.sizing import AxisSizing, Mode, Sizing

_Row = tuple[str, Callable[[AxisSizing], float]]


def _positive(value: float) -> float:
    """Return a value, NaN for 0: an axis without encoder or without an accuracy class, which is not an exact one."""
    return value if value > 0 else math.nan


_MACHINE: tuple[_Row, ...] = (
    ("no-load speed [{u}/s]", lambda sizing: sizing.axis.no_load_speed),
    ("speed limit [{u}/s]", lambda sizing: sizing.axis.speed_limit),
    ("peak force at rest [{f}]", lambda sizing: sizing.peak_force),
    ("continuous force [{f}]", lambda sizing: sizing.continuous_force),
    ("torque left at the speed limit [N·m]", lambda sizing: sizing.torque_at_speed),
    ("friction there [N·m]", lambda sizing: sizing.friction_at_speed),
    ("acceleration from rest [{u}/s²]", lambda sizing: sizing.acceleration),
    ("inertia ratio, load to rotor", lambda sizing: sizing.inertia_ratio),
    ("encoder count [{m}]", lambda sizing: _positive(1e3 * sizing.axis.resolution)),
    ("error of the travel, plus or minus [µm]", lambda sizing: _positive(sizing.travel_error)),
    ("natural frequency of the loop [Hz]", lambda sizing: sizing.frequency),
    ("gain margin", lambda sizing: sizing.gain_margin),
)
_JOB: tuple[_Row, ...] = (
    ("rms torque of the job [N·m]", lambda sizing: sizing.rms),
    ("largest torque of the job [N·m]", lambda sizing: sizing.peak),
    ("continuous torque [N·m]", lambda sizing: sizing.continuous_torque),
    ("thermal load, rms to continuous [%]", lambda sizing: 100 * sizing.load),
)


def sizing_table(machine: Machine, sizing: Sizing, period: float) -> Table:
    """Return a row per quantity, a column per axis; quantities of a job where it ran."""
    table = Table(title=f"drives of {machine.name}", title_justify="left", caption_justify="left")
    table.add_column("quantity")
    for axis_sizing in sizing.axes:
        table.add_column(axis_sizing.axis.name, justify="right", no_wrap=True)
    job = any(not math.isnan(axis_sizing.rms) for axis_sizing in sizing.axes)
    travels = (" to ".join(number_text(end, ".4g") for end in axis_sizing.axis.travel) for axis_sizing in sizing.axes)
    units = "/".join(dict.fromkeys(axis_sizing.axis.unit for axis_sizing in sizing.axes))
    symbols = {
        "u": units,
        "m": units.replace("mm", "µm").replace("deg", "mdeg"),
        "f": units.replace("mm", "N").replace("deg", "N·m"),
    }
    table.add_row(f"travel \\[{units}]", *travels)
    for name, value in (*_MACHINE, *(_JOB if job else ())):
        text = name.format(**symbols).replace("[", "\\[")
        table.add_row(text, *(_number(value(axis_sizing)) for axis_sizing in sizing.axes))
    table.caption = (
        f"modes, motors locked: {_modes(sizing.locked)}; free: {_modes(sizing.free)}; forces with the transmission's "
        f"efficiency; loop derived at a servo period of {1e3 * period:g} ms"
    )
    return table


def _number(value: float) -> str:
    return number_text(value if math.isfinite(value) else None, ".4g")


def _modes(modes: Iterable[Mode]) -> str:
    return ", ".join(f"{mode.frequency:.0f} Hz ({mode.joint})" for mode in modes) or "none"
