"""Which two more measurements would narrow the intervals most, from the fit's own covariance."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.dispenser.dispenser import JET, VALVE
from gantrysim.identify.dispenser.fit import READING_ERROR, DispenserFit, inverse_root, values_of
from gantrysim.identify.dispenser.measurements import BEAD, DOTS, DROPS, RECORD, WEIGHING, Experiment
from gantrysim.identify.dispenser.model import FLOW, LEAK, Model, needle_sizes

_SETTING_FACTORS = (0.5, 1.0, 2.0)  # of the settings measured so far
_RECORD_TIME = 2.0  # of a candidate record [s]
_RECORD_ROWS = 200
_OPEN_TIMES = (0.05, 0.1, 0.5)  # where no dots were laid [s]
_VARIABLE_STEP = 1e-4  # of a variable
_CONFIDENCE = 2.0  # standard deviations of an interval
_LONGEST_WEIGHING = 60.0  # [s]
_NARROWED_INTERVAL = 0.9  # of the interval, from which a measurement narrows it


class Candidate(NamedTuple):
    """A measurement that could be made.

    Attributes:
        words: what it is, in a sentence.
        information: that it would add, J'J over the errors' variance, (p, p).
    """

    words: str
    information: Floats


class Advice(NamedTuple):
    """Two measurements that narrow the intervals most.

    Attributes:
        words: of each; the same twice where a repetition is best.
        name: value whose interval narrows most.
        share: width of its interval after them, over that before.
    """

    words: tuple[str, str]
    name: str
    share: float


def advice_for(fit: DispenserFit, bounds: Mapping[str, float]) -> Advice | None:
    """Return the pair of measurements with the largest gain.

    The gain is the sum over the values of log(1 + interval over bound), as what is known needs no more. All terms are
    free in it, as a measurement may show one that these do not.

    Args:
        fit: of the measurements so far.
        bounds: half interval below which a value is identified, of the value, by name.
    """
    information = np.asarray(sum((J.T @ J for _, J in fit.full.blocks), np.eye(fit.x.size)))
    candidates = _candidates(fit)
    if not candidates:
        return None
    scales = _scales(fit, bounds)
    before = _ratios(information, scales)

    def total(pair: tuple[Candidate, Candidate]) -> float:
        added = information + pair[0].information + pair[1].information
        return float(np.log1p(_ratios(added, scales)).sum())

    best = min(combinations_with_replacement(candidates, 2), key=total)
    after = _ratios(information + best[0].information + best[1].information, scales)
    gains = np.log1p(before) - np.log1p(after)
    k = int(gains.argmax())
    if after[k] > _NARROWED_INTERVAL * before[k]:
        return None
    name = fit.parameters[k].name
    words = (best[0].words, best[1].words)
    return Advice(words, name, float(after[k] / before[k]))


def _scales(fit: DispenserFit, bounds: Mapping[str, float]) -> Floats:
    """Return the change of each variable that is its bound, (p,)."""
    scales = []
    for parameter, variable in zip(fit.parameters, fit.x, strict=True):
        bound = bounds[parameter.name]
        value = abs(parameter.value(float(variable)))
        # of a time, or a term that is absent, a part of the usual scale
        size = bound if parameter.is_log else bound * max(value, 0.02 * parameter.spread)
        scales.append(size / parameter.spread)
    return np.array(scales)


def _ratios(information: Floats, scales: Floats) -> Floats:
    """Return half intervals over their bounds, (p,)."""
    deviation = np.linalg.norm(inverse_root(information), axis=1)
    return np.asarray(_CONFIDENCE * deviation / scales)


def _candidates(fit: DispenserFit) -> list[Candidate]:
    """Return measurements that could be made next: beside those so far, or of a kind that is missing."""
    measured = fit.measured
    experiments = _weighings(fit)
    if measured.kind == JET:
        most = max(float(x.columns["drops"].max()) for x in measured.of_kind(DROPS))
        experiments = [
            (f"the mass of {factor * most:.0f} drops", _one(fit, DROPS, drops=factor * most))
            for factor in _SETTING_FACTORS
        ]
    if measured.kind == VALVE and "dead_time" in fit.values:
        experiments += _dots(fit)
    if measured.kind != JET:
        experiments += _records(fit)
    if measured.of_kind(BEAD):
        bead = measured.of_kind(BEAD)[0]
        for factor in _SETTING_FACTORS:
            row = {name: float(np.median(x)) for name, x in bead.columns.items()}
            row["speed"] *= factor
            experiments.append((f"a bead at {row['speed']:.3g} mm/s", _one(fit, BEAD, **row)))
    return [Candidate(words, _information(fit, experiment)) for words, experiment in experiments]


def _one(fit: DispenserFit, kind: str, **columns: float) -> Experiment:
    """Return an experiment of one row."""
    return Experiment(kind, "next", {name: np.full(1, x) for name, x in columns.items()}, np.ones(1))


def _needle(fit: DispenserFit) -> dict[str, float]:
    bore, length = needle_sizes(fit.measured.experiments[0])
    return {"bore": float(bore[0]), "length": float(length[0])}


def _settings(fit: DispenserFit) -> Floats:
    """Return pressures or speeds of the motor so far, and somewhat beyond."""
    driver = fit.measured.driver
    values = np.concatenate([x.columns[driver] for x in fit.measured.experiments if x.has(driver)])
    low = float(values[values > 0].min())
    high = float(values.max())
    return np.unique([0.7 * low, low, np.sqrt(low * high), high, 1.5 * high])


def _weighings(fit: DispenserFit) -> list[tuple[str, Experiment]]:
    measured = fit.measured
    if measured.kind == JET:
        return []
    time = _LONGEST_WEIGHING
    if not measured.driver:
        return [(f"a mass over {time:g} s", _one(fit, WEIGHING, time=time))] if FLOW in fit.values else []
    units = {"pressure": ("kPa", 1.0), "pump speed": ("rpm", 60.0), "plunger speed": ("mm/s", 1.0)}
    unit, per_unit = units[measured.driver]
    gauge = "" if measured.driver == "pressure" else ", with its pressure"
    weighings = []
    lengths = {"": 1.0}
    if LEAK in fit.values:
        # slip goes with the pressure, which another needle changes at the same speed
        lengths[" through a needle of half the length"] = 0.5
    for setting in _settings(fit).tolist():
        for words, factor in lengths.items():
            row = {measured.driver: setting, "time": time, **_needle(fit)}
            row["length"] *= factor
            if gauge:
                row["pressure"] = 1.0
            text = f"a mass at {setting * per_unit:.3g} {unit}{words} over {time:g} s{gauge}"
            weighings.append((text, _one(fit, WEIGHING, **row)))
    return weighings


def _dots(fit: DispenserFit) -> list[tuple[str, Experiment]]:
    dots = fit.measured.of_kind(DOTS)
    times = np.array(_OPEN_TIMES)
    pressure = {}
    if fit.measured.driver:
        settings = _settings(fit)
        pressure = {"pressure": float(settings[-2])}
    if dots:
        known = dots[0].columns["open time"]
        times = np.array([0.5 * known.min(), known.min(), known.max(), 2 * known.max()])
    return [
        (
            f"dots of {1e3 * time:.3g} ms open time",
            _one(fit, DOTS, **{"open time": time, "dots": 20.0, **pressure, **_needle(fit)}),
        )
        for time in times.tolist()
    ]


def _records(fit: DispenserFit) -> list[tuple[str, Experiment]]:
    """Return a record of flow over time, of one switching on and off."""
    if "dead_time" not in fit.values and not fit.measured.of_kind(RECORD):
        return []
    time = np.linspace(0, _RECORD_TIME, _RECORD_ROWS)
    on = ((time > 0.25 * _RECORD_TIME) & (time < 0.6 * _RECORD_TIME)).astype(float)
    columns = {"time": time, "command": on, "flow": np.zeros(time.size)}
    columns |= {name: np.full(time.size, x) for name, x in _needle(fit).items()}
    driver = fit.measured.driver
    if driver:
        level = float(_settings(fit)[-2])
        columns[driver] = np.full(time.size, level) if driver == "pressure" else level * on
    words = "a record of the flow over 2 s, one row each 10 ms, in which the dispenser is switched on and off"
    return [(words, Experiment(RECORD, "next", columns, np.arange(time.size, dtype=float)))]


def _information(fit: DispenserFit, experiment: Experiment) -> Floats:
    """Return what a measurement adds: its derivatives over its usual error."""
    model = Model(fit.measured)
    names = {WEIGHING: ["mass"], DOTS: ["mass"], DROPS: ["mass"], BEAD: ["width"], RECORD: ["flow"]}[experiment.kind]
    if fit.measured.kind not in (VALVE, JET) and experiment.kind == WEIGHING:
        names = [*names, "pressure"]

    def predicted(x: Floats) -> Floats:
        prediction = model.predict(values_of(fit.parameters, x), experiment)
        return np.concatenate([prediction[name] for name in names])

    middle = predicted(fit.full.x)
    J = np.empty((middle.size, fit.x.size))
    for k in range(fit.x.size):
        moved = fit.full.x.copy()
        moved[k] += _VARIABLE_STEP
        J[:, k] = (predicted(moved) - middle) / _VARIABLE_STEP
    if experiment.kind == RECORD:
        size = np.full(middle.size, READING_ERROR * max(float(np.ptp(middle)), 1e-12))
    else:
        size = READING_ERROR * np.maximum(np.abs(middle), 1e-12)
    size = size * _usual_error(fit, experiment.kind)
    scaled = J / size[:, None]
    return np.asarray(scaled.T @ scaled)


def _usual_error(fit: DispenserFit, kind: str) -> float:
    """Return the size of the errors of a kind of measurement so far, over the usual ones."""
    sizes = []
    for reading, error in zip(fit.readings, fit.errors, strict=True):
        if reading.experiment.kind == kind:
            scale = np.ptp(reading.values) if reading.is_even else np.abs(reading.values)
            sizes.append(float(np.median(error.size / np.maximum(READING_ERROR * scale, 1e-12))))
    return max(float(np.median(sizes)), 0.1) if sizes else 1.0
