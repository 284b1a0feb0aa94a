"""Checks of measurements before they are believed: each names the defect in a sentence."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from gantrysim.base.arrays import Floats
from gantrysim.glue.dispenser.dispenser import JET, VALVE
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.dispenser.measurements import BEAD, DOTS, DROPS, RECORD, WEIGHING, Experiment, Measurements
from gantrysim.identify.dispenser.model import digit, needle_sizes, switches

_FEWEST_READINGS = {WEIGHING: 4, DOTS: 3, DROPS: 2, BEAD: 3, RECORD: 12}
_VARIED_SETTING = 1.2  # largest over smallest setting, from which it has changed
_OPPOSED_RANKS = -0.5  # rank correlation from which a quantity falls where it must rise
_EQUAL_READINGS = 3  # equal largest readings of a scale that is at its limit
_NOISE = 6.0  # standard deviations beyond which a change is none of the noise
_READINGS_BEFORE = 5  # readings before the first switching that show a drift
_DRIFT = 0.02  # of the mass, over the record
_FASTEST_FLOW = 5e3  # mean speed in a needle [mm/s]: at some metres per second glue leaves as a jet
_SLOWEST_FLOW = 0.05  # the same: some hundredths of a millimetre per second are hours for a dot
_HIGHEST_PRESSURE = 2e4  # [kPa]
_DENSITIES = (0.5, 10.0)  # [g/cm³]: of light foams to solder paste and silver glue
_LARGEST_BEAD = 100.0  # width over gap
_TARE_SHARE = 0.05  # of the usual mass, from which a constant one is a tare
_KILO = 1000.0


def check_measurements(measured: Measurements) -> None:
    """Raise NotIdentifiedError for measurements that cannot be what they are said to be, with the likely defect."""
    density = measured.density
    if density is not None and not _DENSITIES[0] <= density <= _DENSITIES[1]:
        hint = "; kg/m³ read as g/cm³?" if _in_range(density / _KILO, _DENSITIES) else ""
        hint = "; a value in kg/l or g/cm³ read as kg/m³?" if _in_range(density * _KILO, _DENSITIES) else hint
        raise NotIdentifiedError(
            f"density = {density:g} g/cm³: must be {_DENSITIES[0]:g} to {_DENSITIES[1]:g} g/cm³{hint}"
        )
    for experiment in measured.experiments:
        _check_kind(measured, experiment)
        _check_rows(experiment)
        _check_signs(experiment)
        _CHECKS[experiment.kind](measured, experiment)


def _in_range(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= value <= bounds[1]


def _check_kind(measured: Measurements, experiment: Experiment) -> None:
    """Refuse an experiment that the kind of dispenser cannot have."""
    if (measured.kind == JET) != (experiment.kind == DROPS):
        raise NotIdentifiedError(f"{experiment.label}: of a jet: must be drops and mass, which give the drop's volume")
    if measured.kind != VALVE and experiment.kind == DOTS:
        raise NotIdentifiedError(f"{experiment.label}: of a {measured.kind} dispenser: only a valve has an open time")


def _check_rows(experiment: Experiment) -> None:
    fewest = _FEWEST_READINGS[experiment.kind]
    if len(experiment) < fewest:
        raise NotIdentifiedError(
            f"{experiment.label}: has {len(experiment)} rows: must have at least {fewest}, as fewer leave no error to "
            "judge by"
        )
    columns = np.column_stack(list(experiment.columns.values()))
    if experiment.kind != RECORD and len(np.unique(columns, axis=0)) == 1:
        raise NotIdentifiedError(f"{experiment.label}: all its {len(experiment)} rows are the same")


def _check_signs(experiment: Experiment) -> None:
    """Refuse values that cannot be zero or below."""
    may_be_zero = {"pump speed", "plunger speed", "command", "flow", "mass", "time"}
    for name, values in experiment.columns.items():
        is_record = experiment.kind == RECORD
        low = float(values.min())
        if low > 0 or (low == 0 and (name == "mass" or (is_record and name in may_be_zero))):
            continue
        if is_record and name in ("mass", "flow", "time", "command"):
            continue
        row = int(experiment.rows[int(values.argmin())])
        hint = ""
        if name == "mass":
            hint = ": the scale was tared with glue on it, or a cup was taken off"
        elif name == "time":
            hint = ": a time span was subtracted the wrong way round"
        raise NotIdentifiedError(f"{experiment.label}: {name} = {low:g} in row {row}: must be greater than 0{hint}")


def _check_rise(experiment: Experiment, setting: str, rate: Floats, what: str) -> None:
    """Refuse a quantity that falls as its setting rises."""
    values = experiment.columns[setting]
    if _correlation(values, rate) >= _OPPOSED_RANKS:
        return
    low = int(values.argmin())
    high = int(values.argmax())
    raise NotIdentifiedError(
        f"{experiment.label}: {what} falls from {rate[low]:.3g} to {rate[high]:.3g} as {setting} rises from "
        f"{values[low]:.4g} to {values[high]:.4g}: it must rise; two columns are swapped, or the cells of one are in "
        "another order"
    )


def _correlation(x: Floats, y: Floats) -> float:
    """Return the correlation of the ranks, 0 where one is constant."""
    return float(spearmanr(x, y).statistic) if np.ptp(x) and np.ptp(y) else 0.0


def _check_varied(experiment: Experiment, setting: str, what: str) -> None:
    values = experiment.columns[setting]
    if float(values.max()) >= _VARIED_SETTING * float(values.min()):
        return
    raise NotIdentifiedError(
        f"{experiment.label}: {setting} never changed, {values.min():.4g} to {values.max():.4g} in all "
        f"{len(experiment)} rows: must differ by at least a factor of {_VARIED_SETTING:g}, {what}"
    )


def _check_saturated(experiment: Experiment, amount: Floats) -> None:
    """Refuse masses whose largest one repeats while what was dispensed still rises."""
    mass = experiment.columns["mass"]
    at_top = np.flatnonzero(mass >= float(mass.max()))
    if at_top.size < _EQUAL_READINGS or float(np.ptp(amount[at_top])) <= 0.1 * float(amount[at_top].min()):
        return
    first, last = experiment.rows[at_top[[0, -1]]].astype(int).tolist()
    raise NotIdentifiedError(
        f"{experiment.label}: the mass stays at exactly {mass.max():.6g} mg in rows {first} to {last}, while more is "
        "dispensed: the scale is at its limit"
    )


def _check_weighing(measured: Measurements, experiment: Experiment) -> None:
    time = experiment.columns["time"]
    mass = experiment.columns["mass"]
    driver = measured.driver
    if not driver:
        _check_rise(experiment, "time", mass, "the mass [mg]")
        _check_tare(experiment, np.zeros(len(experiment)))
        return
    if not experiment.has(driver):
        raise NotIdentifiedError(f"{experiment.label}: has no column {driver}, which sets the flow elsewhere")
    if (
        len(experiment) >= _EQUAL_READINGS
        and np.ptp(mass) == 0
        and float(time.max()) >= _VARIED_SETTING * float(time.min())
    ):
        raise NotIdentifiedError(
            f"{experiment.label}: the mass is {mass[0]:.6g} mg in all rows, while time and {driver} differ: columns "
            "mass and time are swapped, or the scale is at its limit"
        )
    setting = experiment.columns[driver]
    _check_varied(experiment, driver, "for a flow law")
    _check_saturated(experiment, time * setting)
    _check_rise(experiment, driver, mass / time, "the mass per second [mg/s]")
    _check_tare(experiment, setting)
    if driver != "pressure" and experiment.has("pressure"):
        _check_rise(experiment, driver, experiment.columns["pressure"], "the pressure [kPa]")
    _check_pressure(experiment)
    _check_speed_in_needle(measured, experiment)


def _check_pressure(experiment: Experiment) -> None:
    if not experiment.has("pressure"):
        return
    largest = float(experiment.columns["pressure"].max())
    if largest > _HIGHEST_PRESSURE:
        raise NotIdentifiedError(
            f"{experiment.label}: pressure = {largest:g} kPa: must be at most {_HIGHEST_PRESSURE:g} kPa; a pressure in "
            "Pa read as kPa, or in mbar read as bar?"
        )


def _check_speed_in_needle(measured: Measurements, experiment: Experiment) -> None:
    """Refuse masses of a unit that makes the glue fly or stand in the needle."""
    if not (measured.has_needle and measured.density):
        return
    bore, _ = needle_sizes(experiment)
    flow = experiment.columns["mass"] / experiment.columns["time"] / measured.density
    speed = float(np.median(flow / (0.25 * np.pi * bore**2)))
    if _SLOWEST_FLOW <= speed <= _FASTEST_FLOW:
        return
    meant = speed * _KILO if speed < _SLOWEST_FLOW else speed / _KILO
    units = "g read as mg" if speed < _SLOWEST_FLOW else "mg read as g"
    other = "s read as ms" if speed > _FASTEST_FLOW else "ms read as s"
    hint = f"; {units}, or {other}?" if _SLOWEST_FLOW <= meant <= _FASTEST_FLOW else ""
    raise NotIdentifiedError(
        f"{experiment.label}: the masses are a flow of {np.median(flow):.3g} mm³/s, {speed:.3g} mm/s in the needle: "
        f"must be {_SLOWEST_FLOW:g} to {_FASTEST_FLOW:g} mm/s; check the units of mass, time and bore{hint}"
    )


def _check_tare(experiment: Experiment, setting: Floats) -> None:
    """Refuse masses with a constant part, where one setting was held for different times."""
    time = experiment.columns["time"]
    mass = experiment.columns["mass"]
    sizes = np.column_stack([setting, *needle_sizes(experiment)])
    _, group = np.unique(sizes, axis=0, return_inverse=True)
    group = np.ravel(group)
    count = int(group.max()) + 1
    matrix = np.column_stack([np.eye(count)[group] * time[:, None], np.ones(time.size)])
    scale = np.maximum(np.abs(mass), digit(mass))
    weighted = matrix / scale[:, None]
    if np.linalg.matrix_rank(weighted) < count + 1 or time.size < count + _EQUAL_READINGS:
        return
    solution, *_ = np.linalg.lstsq(weighted, mass / scale, rcond=None)
    residual = mass / scale - weighted @ solution
    free = time.size - count - 1
    variance = np.linalg.inv(weighted.T @ weighted)[-1, -1] * float(residual @ residual) / free
    offset = float(solution[-1])
    if abs(offset) > _NOISE * np.sqrt(variance) and abs(offset) > _TARE_SHARE * float(np.median(mass)):
        raise NotIdentifiedError(
            f"{experiment.label}: {offset:.3g} mg of the masses do not grow with the time: the scale was not tared, or "
            "the cup was weighed too"
        )


def _check_dots(measured: Measurements, experiment: Experiment) -> None:
    amount = experiment.columns.get("dots", 1.0)
    mass = experiment.columns["mass"] / amount
    time = experiment.columns["open time"]
    _check_varied(experiment, "open time", "as the slope is the flow")
    _check_saturated(experiment, time * amount)
    if measured.driver == "pressure":
        if not experiment.has("pressure"):
            raise NotIdentifiedError(f"{experiment.label}: has no column pressure, which sets the flow elsewhere")
        return
    _check_rise(experiment, "open time", mass, "the mass of a dot [mg]")


def _check_drops(_: Measurements, experiment: Experiment) -> None:
    if np.ptp(experiment.columns["drops"]):
        _check_saturated(experiment, experiment.columns["drops"])
        _check_rise(experiment, "drops", experiment.columns["mass"], "the mass [mg]")
        _check_tare_of_drops(experiment)


def _check_tare_of_drops(experiment: Experiment) -> None:
    columns = {**experiment.columns, "time": experiment.columns["drops"]}
    try:
        _check_tare(Experiment(WEIGHING, experiment.label, columns, experiment.rows), np.zeros(len(experiment)))
    except NotIdentifiedError as error:
        raise NotIdentifiedError(str(error).replace("the time:", "the number of drops:")) from None


def _check_bead(measured: Measurements, experiment: Experiment) -> None:
    if measured.driver and not experiment.has(measured.driver):
        raise NotIdentifiedError(f"{experiment.label}: has no column {measured.driver}, which sets the flow elsewhere")
    if not (experiment.has("bore") or experiment.has("outer")):
        raise NotIdentifiedError(
            f"{experiment.label}: the needle is missing, whose face presses the bead: add a column outer [mm] or bore "
            "[mm], or --needle"
        )
    _check_varied(experiment, "speed", "one speed shows no law")
    speed = experiment.columns["speed"]
    is_alone = not measured.driver or np.ptp(experiment.columns[measured.driver]) == 0
    for name in ("width", "height"):
        if not experiment.has(name):
            continue
        values = experiment.columns[name]
        if is_alone and _correlation(speed, values) > -_OPPOSED_RANKS:
            raise NotIdentifiedError(
                f"{experiment.label}: the {name} grows with the speed at one flow: must fall; the columns speed and "
                f"{name} are swapped, or in another order"
            )
    if experiment.has("width") and experiment.has("gap"):
        ratio = experiment.columns["width"] / experiment.columns["gap"]
        if not 1 / _LARGEST_BEAD <= float(np.median(ratio)) <= _LARGEST_BEAD:
            raise NotIdentifiedError(
                f"{experiment.label}: the width is {np.median(ratio):.3g} times the gap: must be {1 / _LARGEST_BEAD:g} "
                f"to {_LARGEST_BEAD:g} times; µm read as mm?"
            )


def _check_record(measured: Measurements, experiment: Experiment) -> None:
    time = experiment.columns["time"]
    steps = np.diff(time)
    back = np.flatnonzero(steps <= 0)
    if back.size == steps.size:
        raise NotIdentifiedError(f"{experiment.label}: its time runs backwards: the rows are in reverse order")
    if back.size:
        row = int(experiment.rows[back[0] + 1])
        raise NotIdentifiedError(
            f"{experiment.label}: its time goes back from {time[back[0]]:.6g} to {time[back[0] + 1]:.6g} s in row "
            f"{row}: must rise; several records in a table need a column experiment"
        )
    if measured.kind != VALVE and not experiment.has(measured.driver):
        raise NotIdentifiedError(f"{experiment.label}: has no column {measured.driver} or command, nothing switches")
    _check_switching(measured, experiment)
    if experiment.has("mass"):
        _check_scale(measured, experiment)


def _check_switching(measured: Measurements, experiment: Experiment) -> None:
    if measured.kind == VALVE:
        if measured.driver and not experiment.has(measured.driver):
            raise NotIdentifiedError(f"{experiment.label}: has no column pressure, which sets the flow elsewhere")
        if not experiment.has("command"):
            raise NotIdentifiedError(f"{experiment.label}: has no column command, which shows when the valve switches")
        if not switches(experiment)[0].size:
            raise NotIdentifiedError(f"{experiment.label}: its command never changed: must switch the valve on or off")
    elif not np.ptp(experiment.columns[measured.driver]):
        raise NotIdentifiedError(f"{experiment.label}: its {measured.driver} never changed: must step")


def _check_scale(measured: Measurements, experiment: Experiment) -> None:
    """Refuse the masses of a record that fall, drift before the begin, or stay at their largest value."""
    mass = experiment.columns["mass"]
    steps = np.diff(mass)
    noise = 1.4826 * float(np.median(np.abs(steps - np.median(steps)))) + digit(mass)
    rise = float(np.ptp(mass))
    fallen = np.maximum.accumulate(mass) - mass
    if float(fallen.max()) > max(_NOISE * noise, _DRIFT * rise):
        k = int(fallen.argmax())
        raise NotIdentifiedError(
            f"{experiment.label}: the mass falls by {fallen[k]:.3g} mg up to row {int(experiment.rows[k])}: glue was "
            "taken off, the cup was touched, or the record holds two"
        )
    active = _active(measured, experiment)
    first = int(np.argmax(active))
    at_top = mass >= float(mass.max())
    top = np.flatnonzero(at_top)
    busy = top[active[top]]
    if busy.size >= max(_EQUAL_READINGS, 0.1 * active.sum()) and np.all(at_top[top[0] :]):
        raise NotIdentifiedError(
            f"{experiment.label}: the mass stays at exactly {mass.max():.6g} mg from row "
            f"{int(experiment.rows[top[0]])} while the dispenser is on: the scale is at its limit"
        )
    if first < _READINGS_BEFORE:
        return
    time = experiment.columns["time"]
    slope, deviation = _slope(time[:first], mass[:first])
    span = float(time[-1] - time[0])
    if abs(slope) > _NOISE / 2 * deviation and abs(slope) * span > _DRIFT * rise:
        raise NotIdentifiedError(
            f"{experiment.label}: the mass changes by {slope:.3g} mg/s before the dispenser is on, "
            f"{100 * abs(slope) * span / rise:.2g} % of what is dispensed over the record: the scale drifts, or glue "
            "drips"
        )


def _active(measured: Measurements, experiment: Experiment) -> NDArray[np.bool_]:
    """Return whether the dispenser is on, (n,)."""
    if measured.kind == VALVE:
        command = experiment.columns["command"]
        return np.asarray(command > 0.5 * float(command.max()))
    return np.asarray(experiment.columns[measured.driver] > 0)


def _slope(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of a line through points, and its standard deviation."""
    from_middle = x - x.mean()
    size = float(from_middle @ from_middle)
    slope = float(from_middle @ y) / size
    residual = y - y.mean() - slope * from_middle
    return slope, float(np.sqrt(residual @ residual / max(x.size - 2, 1) / size)) + digit(y) / (x[-1] - x[0])


_CHECKS: dict[str, Callable[[Measurements, Experiment], None]] = {
    WEIGHING: _check_weighing,
    DOTS: _check_dots,
    DROPS: _check_drops,
    BEAD: _check_bead,
    RECORD: _check_record,
}
