"""What a dispenser's parameters predict of each measurement, by the laws that a run is simulated with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead.section import Section
from gantrysim.glue.dispenser.dispenser import JET, PISTON, VOLUMETRIC
from gantrysim.glue.dispenser.lag import Lag, NeedleLaw, driven_volumes, lagged_volumes
from gantrysim.glue.dispenser.needle import PASCAL, Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.glue.dispenser.pressurised import Line, flowed
from gantrysim.glue.dispenser.volumetric import Pump
from gantrysim.identify.dispenser.measurements import BEAD, DOTS, DROPS, RECORD, WEIGHING, Experiment, Measurements

# names of the parameters are the keys of a job's tables [dispenser] and [bead]
CONSISTENCY = "needle.consistency"
INDEX = "needle.index"
YIELD = "needle.yield_stress"
FLOW = "flow"
DEAD_TIME = "dead_time"
CLOSING_DEAD_TIME = "closing_dead_time"
OPENING = "opening"
CLOSING = "closing"
DISPLACEMENT = "pump.displacement"
LEAK = "pump.leak"
PUMP_COMPLIANCE = "pump.compliance"
PLUNGER = "piston.plunger"
COMPLIANCE = "piston.compliance"
DROP = "jet.drop"
CONTACT_ANGLE = "contact_angle"
# when the command of a record has changed, after the middle between two rows; no value of the dispenser
RISING = "record.rising"
FALLING = "record.falling"

RHEOLOGY = (CONSISTENCY, INDEX, YIELD)
TIMES = (DEAD_TIME, CLOSING_DEAD_TIME, OPENING, CLOSING)
EDGES = (RISING, FALLING)

_SETTLED_CONSTANTS = 40.0  # time constants after which a lag has settled
_CELLS = 1500  # of the record of a driven dispenser, least number
_MOST_CELLS = 20_000
_HALVINGS = 50
_INSTANT = 0.05  # over which a flow meter's reading is the mean, of the sample interval
_LARGEST_EXPONENT = 300.0
_LEAST_AREA = 1e-12  # of a bead [mm²]


class Parameter(NamedTuple):
    """A parameter and the weak assumption that holds where no measurement shows it.

    Attributes:
        name: key of the job's table [dispenser] or, the contact angle, [bead].
        unit: of its value.
        usual: value from which the search begins.
        spread: standard deviation of the weak assumption: of the logarithm, or of the value.
        is_log: whether the logarithm is searched, of a value above zero.
        low, high: bounds of the value.
        label: in words.
    """

    name: str
    unit: str
    usual: float
    spread: float
    is_log: bool
    low: float
    high: float
    label: str

    def variable(self, value: float) -> float:
        """Return the variable of the search: in units of the assumption's spread, from the usual value."""
        return (np.log(value / self.usual) if self.is_log else value - self.usual) / self.spread

    def value(self, variable: float) -> float:
        """Return the value of a variable."""
        moved = self.spread * variable
        return float(self.usual * np.exp(min(moved, _LARGEST_EXPONENT)) if self.is_log else self.usual + moved)


def _positive(name: str, unit: str, usual: float, label: str, low: float = 1e-9, high: float = 1e9) -> Parameter:
    return Parameter(name, unit, usual, 2.5, True, low, high, label)


_INDEX = Parameter(INDEX, "", 1.0, 0.7, True, 0.1, 2.5, "flow index")
_TIMES = (
    Parameter(DEAD_TIME, "s", 0.0, 1.0, False, 0.0, 100.0, "dead time of the opening"),
    Parameter(CLOSING_DEAD_TIME, "s", 0.0, 1.0, False, 0.0, 100.0, "dead time of the closing"),
    Parameter(OPENING, "s", 0.0, 1.0, False, 0.0, 100.0, "time constant of the opening"),
    Parameter(CLOSING, "s", 0.0, 1.0, False, 0.0, 100.0, "time constant of the closing"),
)
_ANGLE = Parameter(CONTACT_ANGLE, "deg", 60.0, 60.0, False, 1.0, 90.0, "contact angle")


def parameters_of(measured: Measurements) -> tuple[Parameter, ...]:
    """Return the parameters that such measurements can bear on."""
    chosen: list[Parameter] = []
    has_record = bool(measured.of_kind(RECORD))
    if measured.kind == JET:
        chosen.append(_positive(DROP, "mm³", 0.02, "volume of a drop", 1e-6))
    elif measured.driver:
        chosen += _rheology(measured)
    else:
        chosen.append(_positive(FLOW, "mm³/s", 1.0, "flow"))
    if measured.kind == VOLUMETRIC:
        chosen.append(_positive(DISPLACEMENT, "mm³/rev", 50.0, "volume of a revolution"))
        largest = max(float(x.columns["pump speed"].max()) for x in measured.experiments if x.has("pump speed"))
        # slip of all that is displaced at the largest pressure is the most that can be
        scale = 50.0 * largest / _largest_pressure(measured)
        chosen.append(Parameter(LEAK, "mm³/(s·kPa)", 0.0, scale, False, 0.0, 1e9, "slip"))
        if has_record:
            chosen.append(_positive(PUMP_COMPLIANCE, "mm³/kPa", 0.005, "compliance"))
    if measured.kind == PISTON:
        chosen.append(_positive(PLUNGER, "mm", 16.0, "effective diameter of the plunger"))
        if has_record:
            chosen.append(_positive(COMPLIANCE, "mm³/kPa", 0.05, "compliance"))
    if measured.kind not in (JET, VOLUMETRIC, PISTON) and (has_record or measured.of_kind(DOTS)):
        chosen += _TIMES
    if measured.of_kind(BEAD):
        chosen.append(_ANGLE)
    if has_record:
        # anywhere between the two rows
        half = 0.5 * sample_interval(measured)
        chosen += [Parameter(name, "s", 0.0, half / math.sqrt(3), False, -half, half, name) for name in EDGES]
    return tuple(chosen)


def sample_interval(measured: Measurements) -> float:
    """Return the interval between the rows of the records, 0 without [s]."""
    intervals = [float(np.median(np.diff(record.columns["time"]))) for record in measured.of_kind(RECORD)]
    return max(intervals, default=0.0)


def _largest_pressure(measured: Measurements) -> float:
    pressures = [float(x.columns["pressure"].max()) for x in measured.experiments if x.has("pressure")]
    return max([*pressures, 1.0])


def wall_stress(experiment: Experiment) -> Floats:
    """Return the stress at the needle's wall for the pressures of an experiment, tau = p R / (2 L), (n,) [Pa]."""
    bore, length = needle_sizes(experiment)
    return PASCAL * experiment.columns["pressure"] * bore / (4 * length)


def needle_sizes(experiment: Experiment) -> tuple[Floats, Floats]:
    """Return bore and length of the needle, those of a default needle where they are not given, (n,) each [mm]."""
    usual = Needle()
    count = len(experiment)
    bore = experiment.columns.get("bore", np.full(count, usual.inner))
    length = experiment.columns.get("length", np.full(count, usual.length))
    return bore, length


def _rheology(measured: Measurements) -> list[Parameter]:
    stresses = [wall_stress(x) for x in measured.experiments if x.has("pressure")]
    largest = max((float(stress.max()) for stress in stresses), default=1000.0)
    return [
        _positive(CONSISTENCY, "Pa·s^n", 10.0, "consistency", 1e-5, 1e7),
        _INDEX,
        Parameter(YIELD, "Pa", 0.0, largest, False, 0.0, 0.999 * largest, "yield stress"),
    ]


class Reading(NamedTuple):
    """One measured quantity of an experiment.

    Attributes:
        experiment: whose it is.
        quantity: its name.
        values: measured, (n,).
        least: smallest step of the instrument's digits.
        is_even: whether its error has one size, as over time; else it grows with the value.
        has_offset: whether a constant is taken off, as the scale need not be at zero.
    """

    experiment: Experiment
    quantity: str
    values: Floats
    least: float
    is_even: bool
    has_offset: bool


def readings_of(measured: Measurements) -> tuple[Reading, ...]:
    """Return what was measured, by experiment; what was set is no reading."""
    readings = []
    for experiment in measured.experiments:
        for name in _outputs(measured, experiment):
            values = experiment.columns[name]
            is_record = experiment.kind == RECORD
            readings.append(Reading(experiment, name, values, digit(values), is_record, is_record and name == "mass"))
    return tuple(readings)


def _outputs(measured: Measurements, experiment: Experiment) -> list[str]:
    names = {
        WEIGHING: ["mass"], DOTS: ["mass"], DROPS: ["mass"], BEAD: ["width", "height"], RECORD: ["mass", "flow"],
    }[experiment.kind]  # fmt: skip
    # a pressure is set with a valve, and measured with a driven dispenser
    if measured.kind in (VOLUMETRIC, PISTON) and experiment.kind == WEIGHING:
        names = [*names, "pressure"]
    return [name for name in names if experiment.has(name)]


def digit(values: Floats) -> float:
    """Return the power of ten of which all values are multiples: the last digit that was written down."""
    largest = float(np.abs(values).max(initial=0.0))
    if not largest:
        return 1.0
    for power in range(int(np.floor(np.log10(largest))), -12, -1):
        steps = values / 10.0**power
        if np.abs(steps - np.round(steps)).max() < 1e-6:
            return 10.0**power
    return 1e-12


def needle_with(values: Mapping[str, float], bore: float, length: float) -> Needle:
    """Return a needle of a size with the glue of some parameters, by default that of the class."""
    glue = {name.partition(".")[2]: values[name] for name in RHEOLOGY if name in values}
    return Needle(bore=bore, length=length, **glue)


class Model(NamedTuple):
    """A kind of dispenser with its glue.

    Attributes:
        measured: what is to be predicted.
    """

    measured: Measurements

    def predict(self, values: Mapping[str, float], experiment: Experiment) -> dict[str, Floats]:
        """Return the predicted quantities of an experiment by name, (n,) each.

        Args:
            values: of the parameters by name.
            experiment: with what was set.
        """
        if experiment.kind == RECORD:
            return self._record(values, experiment)
        if experiment.kind == DOTS:
            return {"mass": self._density * self._dots(values, experiment) * experiment.columns.get("dots", 1.0)}
        if experiment.kind == DROPS:
            return {"mass": self._density * values[DROP] * experiment.columns["drops"]}
        flow, pressure = self.steady(values, experiment)
        if experiment.kind == BEAD:
            return _bead(values, experiment, flow)
        return {"mass": self._density * flow * experiment.columns["time"], "pressure": pressure}

    @property
    def _density(self) -> float:
        return self.measured.density or 1.0

    def steady(self, values: Mapping[str, float], experiment: Experiment) -> tuple[Floats, Floats]:
        """Return settled flows [mm³/s] and pressures [kPa] of the rows of an experiment, (n,) each."""
        count = len(experiment)
        if self.measured.kind == JET or FLOW in values:
            return np.full(count, values.get(FLOW, 0.0)), np.zeros(count)
        flow = np.empty(count)
        pressure = np.empty(count)
        bore, length = needle_sizes(experiment)
        for size in {*zip(bore.tolist(), length.tolist(), strict=True)}:
            rows = (bore == size[0]) & (length == size[1])
            needle = needle_with(values, *size)
            if self.measured.driver == "pressure":
                pressure[rows] = experiment.columns["pressure"][rows]
                flow[rows] = needle.flow(pressure[rows])
            else:
                flow[rows], pressure[rows] = _settled_flow(
                    needle, self._displaced_rates(values, experiment)[rows], values
                )
        return flow, pressure

    def _displaced_rates(self, values: Mapping[str, float], experiment: Experiment) -> Floats:
        """Return the rates that pump or plunger displace, (n,) [mm³/s]."""
        speed = experiment.columns[self.measured.driver]
        if self.measured.kind == VOLUMETRIC:
            return values[DISPLACEMENT] * speed
        return Piston(plunger=values[PLUNGER]).unit * speed

    def _dots(self, values: Mapping[str, float], experiment: Experiment) -> Floats:
        """Return the volumes of dots, (n,) [mm³]."""
        open_for = experiment.columns["open time"].tolist()
        return np.array([self.dot(values, experiment, row, time) for row, time in enumerate(open_for)])

    def dot(self, values: Mapping[str, float], experiment: Experiment, row: int, open_time: float) -> float:
        """Return the volume of a dot [mm³].

        Args:
            values: of the parameters by name.
            experiment: with the pressure and the needle.
            row: of the experiment.
            open_time: time between the commands on and off [s].
        """
        flows_for = max(open_time + values[CLOSING_DEAD_TIME] - values[DEAD_TIME], 0.0)
        durations = np.array([flows_for, _SETTLED_CONSTANTS * values[CLOSING] + 1e-9])
        return float(self._volumes(values, experiment, row, durations, np.array([1.0, 0.0])).sum())

    def _volumes(
        self, values: Mapping[str, float], experiment: Experiment, row: int, durations: Floats, is_open: Floats
    ) -> Floats:
        """Return the volumes over pieces in which a valve is open or closed, from rest, (k,) [mm³]."""
        lag = Lag(values[OPENING], values[CLOSING])
        if FLOW in values:
            return lagged_volumes(durations, values[FLOW] * is_open, lag, np.zeros(1))
        bore, length = needle_sizes(experiment)
        needle = needle_with(values, float(bore[row]), float(length[row]))
        request = float(experiment.columns["pressure"][row]) * is_open
        return needle.conductance * driven_volumes(durations, request, lag, _law(needle), np.zeros(1))

    def _record(self, values: Mapping[str, float], experiment: Experiment) -> dict[str, Floats]:
        """Return mass [mg] and flow [mm³/s] at the times of a record, (n,) each."""
        time = experiment.columns["time"]
        instant = _INSTANT * float(np.median(np.diff(time)))
        marks = np.unique(np.concatenate([time - instant, time, time + instant]))
        volume = (
            self._driven_volumes(values, experiment, marks)
            if self._is_driven
            else self._valve(values, experiment, marks)
        )

        def passed(instants: Floats) -> Floats:
            return volume[np.searchsorted(marks, instants)]

        flow = (passed(time + instant) - passed(time - instant)) / (2 * instant)
        return {"mass": self._density * passed(time), "flow": flow}

    @property
    def _is_driven(self) -> bool:
        return self.measured.kind in (VOLUMETRIC, PISTON)

    def _valve(self, values: Mapping[str, float], experiment: Experiment, marks: Floats) -> Floats:
        """Return the volume that a valve has let out at some instants, (k,) [mm³]."""
        switched, is_open = switches(experiment)
        rising = values[DEAD_TIME] + values.get(RISING, 0.0)
        falling = values[CLOSING_DEAD_TIME] + values.get(FALLING, 0.0)
        delays = np.where(is_open[1:], rising, falling)
        # an edge that another one overtakes has no effect
        moved = np.maximum.accumulate(switched + delays)
        inside = moved[(moved > marks[0]) & (moved < marks[-1])]
        edges = np.unique(np.concatenate([marks, inside]))
        state = is_open[np.searchsorted(moved, edges[:-1], "right")].astype(float)
        volume = self._volumes(values, experiment, 0, np.diff(edges), state)
        return np.concatenate([[0.0], np.cumsum(volume)])[np.searchsorted(edges, marks)]

    def _driven_volumes(self, values: Mapping[str, float], experiment: Experiment, marks: Floats) -> Floats:
        """Return the volume that a driven dispenser has laid at some instants, (k,) [mm³]."""
        time = experiment.columns["time"]
        spacing = float(np.median(np.diff(time)))
        cells = int(np.clip(4 * (marks[-1] - marks[0]) / spacing, _CELLS, _MOST_CELLS))
        grid = np.linspace(marks[0], marks[-1], cells + 1)
        period = float(grid[1] - grid[0])
        rate = self._displaced_rates(values, experiment)
        # the speed changed somewhere between two rows
        middles = 0.5 * (time[1:] + time[:-1]) + values.get(RISING, 0.0)
        edges = np.concatenate([[min(grid[0], middles[0])], middles, [max(grid[-1], middles[-1])]])
        moved = np.interp(grid, edges, np.concatenate([[0.0], np.cumsum(rate * np.diff(edges))]))
        bore, length = needle_sizes(experiment)
        needle = needle_with(values, float(bore[0]), float(length[0]))
        law = _law(needle)
        out = flowed(np.diff(moved) / period, period, _line(values, needle), law)
        return np.interp(marks, grid, np.concatenate([[0.0], np.cumsum(out.flow) * period]))


def _line(values: Mapping[str, float], needle: Needle) -> Line:
    if DISPLACEMENT in values:
        pump = Pump(values[DISPLACEMENT], values.get(LEAK, 0.0), values[PUMP_COMPLIANCE])
        return pump.line(needle.conductance)
    return Piston(values[PLUNGER], np.inf, values[COMPLIANCE]).line(needle.conductance)


def _law(needle: Needle) -> NeedleLaw:
    return NeedleLaw(needle.conductance, needle.yield_pressure, 1 / needle.index, *needle.shape)


def switches(experiment: Experiment) -> tuple[Floats, Floats]:
    """Return when the command of a record changes, (k,) [s], and whether it is on before, between and after, (k + 1,).

    A change is in the middle between two rows.
    """
    command = experiment.columns.get("command", np.ones(len(experiment)))
    on = command > 0.5 * float(command.max())
    changes = np.flatnonzero(on[1:] != on[:-1])
    time = experiment.columns["time"]
    states = np.concatenate([on[:1], on[changes + 1]])
    return 0.5 * (time[changes] + time[changes + 1]), states


def _settled_flow(needle: Needle, displaced: Floats, values: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Return the flow Q and pressure p with Q + g p(Q) = D n, (n,) each."""
    leak = values.get(LEAK, 0.0)
    if not leak:
        return displaced, needle.pressure(displaced)
    low = np.zeros_like(displaced)
    high = needle.pressure(displaced)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_above = needle.flow(middle) + leak * middle > displaced
        high = np.where(is_above, middle, high)
        low = np.where(is_above, low, middle)
    pressure = 0.5 * (low + high)
    return displaced - leak * pressure, pressure


def _bead(values: Mapping[str, float], experiment: Experiment, flow: Floats) -> dict[str, Floats]:
    """Return width and height of the beads that a flow lays, (n,) each [mm]."""
    bore, length = needle_sizes(experiment)
    outer = experiment.columns.get("outer")
    area = np.maximum(flow / experiment.columns["speed"], _LEAST_AREA)
    gap = experiment.columns.get("gap", np.full(len(experiment), np.inf))
    width = np.empty_like(area)
    height = np.empty_like(area)
    for k in range(area.size):
        face = float(outer[k]) if outer is not None else Needle(bore=float(bore[k]), length=float(length[k])).face
        section = Section(area[k : k + 1], gap[k : k + 1], values[CONTACT_ANGLE], face)
        width[k] = section.width[0]
        height[k] = section.height[0]
    return {"width": width, "height": height}
