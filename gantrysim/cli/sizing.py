"""The table of what a machine's drives can do."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from rich.table import Table

from gantrysim.machine.machine import Machine
from gantrysim.machine.sizing import AxisSizing, Mode, Sizing

_Row = tuple[str, Callable[[AxisSizing], float]]

_MACHINE: tuple[_Row, ...] = (
    ("no-load speed [{u}/s]", lambda one: one.axis.no_load_speed),
    ("speed limit [{u}/s]", lambda one: one.axis.speed_limit),
    ("peak force at rest [{f}]", lambda one: one.peak_force),
    ("continuous force [{f}]", lambda one: one.continuous_force),
    ("torque left at the speed limit [N·m]", lambda one: one.torque_at_speed),
    ("friction there [N·m]", lambda one: one.friction_at_speed),
    ("acceleration from rest [{u}/s²]", lambda one: one.acceleration),
    ("inertia ratio, load to rotor", lambda one: one.inertia_ratio),
    ("encoder count [{m}]", lambda one: 1e3 * one.axis.resolution),
    ("error of the travel, plus or minus [µm]", lambda one: one.travel_error),
    ("natural frequency of the loop [Hz]", lambda one: one.frequency),
    ("gain margin", lambda one: one.gain_margin),
)
_JOB: tuple[_Row, ...] = (
    ("rms torque of the job [N·m]", lambda one: one.rms),
    ("largest torque of the job [N·m]", lambda one: one.peak),
    ("continuous torque [N·m]", lambda one: one.continuous_torque),
    ("thermal load, rms to continuous [%]", lambda one: 100 * one.load),
)


def sizing_table(machine: Machine, sizing: Sizing, period: float) -> Table:
    """Return a row per quantity, a column per axis; quantities of a job where it ran."""
    table = Table(title=f"drives of {machine.name}", title_justify="left", caption_justify="left")
    table.add_column("quantity")
    for one in sizing.axes:
        table.add_column(one.axis.name, justify="right", no_wrap=True)
    job = any(not math.isnan(one.rms) for one in sizing.axes)
    travels = ("{:.4g} to {:.4g}".format(*one.axis.travel) for one in sizing.axes)
    units = "/".join(dict.fromkeys(one.axis.unit for one in sizing.axes))
    symbols = {
        "u": units,
        "m": units.replace("mm", "µm").replace("deg", "mdeg"),
        "f": units.replace("mm", "N").replace("deg", "N·m"),
    }
    table.add_row(f"travel \\[{units}]", *travels)
    for name, value in (*_MACHINE, *(_JOB if job else ())):
        text = name.format(**symbols).replace("[", "\\[")
        table.add_row(text, *(_number(value(one)) for one in sizing.axes))
    table.caption = (
        f"modes, motors locked: {_modes(sizing.locked)}; free: {_modes(sizing.free)}; forces with the transmission's "
        f"efficiency; loop derived at a servo period of {1e3 * period:g} ms"
    )
    return table


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "–"


def _modes(found: Iterable[Mode]) -> str:
    return ", ".join(f"{one.frequency:.0f} Hz ({one.joint})" for one in found) or "none"
