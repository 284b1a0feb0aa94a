"""Values from which the search for a dispenser's parameters begins."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.dispenser.measurements import BEAD, DOTS, DROPS, RECORD, WEIGHING, Experiment, Measurements
from gantrysim.identify.dispenser.model import (
    CLOSING,
    CLOSING_DEAD_TIME,
    COMPLIANCE,
    CONSISTENCY,
    DEAD_TIME,
    DISPLACEMENT,
    DROP,
    FLOW,
    INDEX,
    OPENING,
    PLUNGER,
    PUMP_COMPLIANCE,
    YIELD,
    needle_sizes,
    needle_with,
    wall_stress,
)

_INDICES = (1.0, 0.5)
_YIELDS = (0.0, 0.5)  # of the least stress at which glue flowed
_START_TIMES = (0.02, 0.1, 0.3)  # of the span of a record's stretch, or of an open time
_COMPLIANCES = (0.001, 0.01, 0.1, 1.0)  # [mm³/kPa]
_SECTION_SHAPE = 0.6  # section of a bead over width times height
_FLOWING_SHARE = 1e-2  # of the largest flow, from which glue flows


def starts(measured: Measurements) -> list[dict[str, float]]:
    """Return values to begin with, by name, the parameters of other kinds among them."""
    density = measured.density or 1.0
    common = _amounts(measured, density)
    span = _span(measured)
    lags = [
        {DEAD_TIME: a * span, CLOSING_DEAD_TIME: a * span, OPENING: b * span, CLOSING: b * span}
        for a, b in product(_START_TIMES, _START_TIMES)
    ]
    compliances = [{COMPLIANCE: size, PUMP_COMPLIANCE: size} for size in _COMPLIANCES]
    dynamics = lags if measured.kind == "valve" else compliances
    if not (measured.of_kind(RECORD) or measured.of_kind(DOTS)):
        dynamics = dynamics[:1]
    rheologies = _rheologies(measured, density)
    return [{**common, **rheology, **dynamic} for rheology in rheologies for dynamic in dynamics]


def _span(measured: Measurements) -> float:
    spans = [float(x.columns["open time"].min()) for x in measured.of_kind(DOTS)]
    for record in measured.of_kind(RECORD):
        time = record.columns["time"]
        spans.append(0.25 * float(time[-1] - time[0]))
    return min(spans, default=0.1)


def _amounts(measured: Measurements, density: float) -> dict[str, float]:
    """Return flow, displacement, plunger and drop by the totals of the measurements."""
    rates: list[float] = []
    per_driver: list[float] = []
    drops: list[float] = []
    for x in measured.experiments:
        if x.kind == DROPS:
            drops.append(float(np.median(x.columns["mass"] / x.columns["drops"])) / density)
            continue
        flow = _flow(x, density)
        driver = measured.driver
        if driver in ("pump speed", "plunger speed") and x.has(driver):
            speed = x.columns[driver]
            moving = speed > 0
            mean = speed[moving] if x.kind != RECORD else np.full(1, _mean_speed(x, speed))
            per_driver.append(float(np.median(flow / mean) if flow.size == 1 else np.median(flow[moving] / mean)))
        rates.append(float(np.median(flow)))
    per_unit = max(np.median(per_driver), 1e-9) if per_driver else 1.0
    return {
        FLOW: max(float(np.median(rates)), 1e-9) if rates else 1.0,
        DISPLACEMENT: float(per_unit),
        PLUNGER: 2 * math.sqrt(float(per_unit) / math.pi),
        DROP: max(float(np.median(drops)), 1e-6) if drops else 0.02,
    }


def _mean_speed(record: Experiment, speed: Floats) -> float:
    time = record.columns["time"]
    return max(float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time)) / (time[-1] - time[0])), 1e-12)


def _flow(x: Experiment, density: float) -> Floats:
    """Return flows of the rows, or one of a record [mm³/s]."""
    if x.kind == WEIGHING:
        return x.columns["mass"] / x.columns["time"] / density
    if x.kind == DOTS:
        time = x.columns["open time"]
        mass = x.columns["mass"] / x.columns.get("dots", 1.0)
        return mass / time / density
    if x.kind == BEAD:
        width = x.columns["width" if x.has("width") else "height"]
        height = x.columns.get("height", x.columns.get("gap", width))
        return np.asarray(_SECTION_SHAPE * x.columns["speed"] * width * np.minimum(height, width))
    time = x.columns["time"]
    command = x.columns.get("command", np.ones(time.size))
    on = command > 0.5 * float(command.max())
    if x.has("flow"):
        return np.full(1, float(np.quantile(x.columns["flow"], 0.9 if on.all() else 1 - 0.5 * float(np.mean(on)))))
    rise = float(x.columns["mass"][-1] - x.columns["mass"][0]) / density
    return np.full(1, rise / max(float(time[-1] - time[0]) * float(np.mean(on)), 1e-12))


def _rheologies(measured: Measurements, density: float) -> list[dict[str, float]]:
    """Return consistency, index and yield stress that have the middle one of the flows at its pressure."""
    rows = [x for x in measured.experiments if x.has("pressure") and x.kind in (WEIGHING, DOTS, RECORD)]
    if not rows:
        return [{CONSISTENCY: 50.0, INDEX: index, YIELD: 0.0} for index in _INDICES]
    x = rows[0]
    flow = np.broadcast_to(_flow(x, density), len(x))
    flows = flow > _FLOWING_SHARE * float(flow.max())
    stress = wall_stress(x)
    least = float(stress[flows].min())
    order = np.flatnonzero(flows)[np.argsort(stress[flows])]
    middle = int(order[order.size // 2])
    bore, length = needle_sizes(x)
    pressure = float(x.columns["pressure"][middle])
    guesses = []
    for index, share in product(_INDICES, _YIELDS):
        values = {CONSISTENCY: 1.0, INDEX: index, YIELD: share * least}
        unit = float(needle_with(values, float(bore[middle]), float(length[middle])).flow(pressure))
        # Q goes with K^(-1/n)
        values[CONSISTENCY] = (unit / max(float(flow[middle]), 1e-12)) ** index
        guesses.append(values)
    return guesses
