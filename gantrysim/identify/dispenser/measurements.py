"""Measurements of a dispenser, read from tables: weighings, dots, drops, beads, and records of switching."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive, unknown
from gantrysim.glue.dispenser.dispenser import JET, PISTON, VALVE, VOLUMETRIC
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.tables.column_table import ColumnTable, Source
from gantrysim.tables.reading import read_table
from gantrysim.tables.units import (
    DENSITY,
    FLOW,
    KINDS,
    LENGTH,
    MASS,
    NUMBER_OF,
    PRESSURE,
    SPEED,
    TIME,
    TURNING,
    spaced_name,
)

# kinds of experiment
WEIGHING = "weighing"
DOTS = "dots"
DROPS = "drops"
BEAD = "bead"
RECORD = "record"

_DEGREES = 360.0  # of a revolution
_EXPERIMENT = "experiment"  # column that names the experiment of a row


class Quantity(NamedTuple):
    """A quantity of a measurement.

    Attributes:
        unit: one of `KINDS`.
        heads: under which tables have it, in lower case.
    """

    unit: str
    heads: tuple[str, ...]


QUANTITIES = {
    "time": Quantity(TIME, ("t", "duration", "dispense time", "dispensing time")),
    "mass": Quantity(MASS, ("m", "weight", "dot mass", "net mass", "scale", "reading")),
    "pressure": Quantity(PRESSURE, ("p", "air pressure", "set pressure", "supply pressure")),
    "pump speed": Quantity(TURNING, ("shaft speed", "screw speed", "auger speed", "rotor speed")),
    "plunger speed": Quantity(SPEED, ("piston speed", "stroke speed", "plunger feed")),
    "open time": Quantity(TIME, ("pulse", "pulse width", "pulse time", "on time", "valve time", "opening time")),
    "dots": Quantity(NUMBER_OF, ("number of dots", "dot count")),
    "drops": Quantity(NUMBER_OF, ("shots", "number of shots", "number of drops", "shot count")),
    "speed": Quantity(SPEED, ("v", "path speed", "feed", "feed rate", "travel speed", "robot speed")),
    "gap": Quantity(LENGTH, ("needle gap", "nozzle gap", "z gap", "dispense gap")),
    "width": Quantity(LENGTH, ("bead width", "line width", "w")),
    "height": Quantity(LENGTH, ("bead height", "line height", "h")),
    "flow": Quantity(FLOW, ("flow rate", "flow meter", "q")),
    "command": Quantity(NUMBER_OF, ("valve", "valve command", "on", "trigger", "output")),
    "bore": Quantity(LENGTH, ("needle bore", "inner diameter", "needle id", "id")),
    "length": Quantity(LENGTH, ("needle length",)),
    "outer": Quantity(LENGTH, ("needle outer", "outer diameter", "needle od", "od")),
    "density": Quantity(DENSITY, ("glue density", "material density", "rho")),
}
_CONSTANTS = ("bore", "length", "outer", "density")
_DRIVERS = {"pump speed": VOLUMETRIC, "plunger speed": PISTON, "drops": JET}
_PER_KIND = {  # what an experiment must have beside what shows its kind
    WEIGHING: ("time", "mass"),
    DOTS: ("open time", "mass"),
    DROPS: ("drops", "mass"),
    BEAD: ("speed",),
    RECORD: ("time",),
}


@dataclass(frozen=True, eq=False)
class Experiment:
    """Rows of one kind of measurement.

    Attributes:
        kind: one of `WEIGHING`, `DOTS`, `DROPS`, `BEAD` and `RECORD`.
        label: names it in sentences.
        columns: by quantity, (n,) each, in the units of the package; pump speeds in revolutions per second.
        rows: numbers of the rows in their table, from 1, (n,).
    """

    kind: str
    label: str
    columns: Mapping[str, Floats]
    rows: Floats

    def __len__(self) -> int:
        return self.rows.size

    def has(self, name: str) -> bool:
        """Whether a quantity was measured or set."""
        return name in self.columns


@dataclass(frozen=True, eq=False)
class Measurements:
    """What was measured of a dispenser.

    Attributes:
        experiments: in the order of their tables.
        kind: of the dispenser, by the columns: `pump speed` is volumetric, `plunger speed` a piston, `drops` a jet.
        density: of the glue; None where only a flow meter or beads were read [g/cm³].
        has_needle: whether bore and length of the needle are given.
    """

    experiments: tuple[Experiment, ...]
    kind: str
    density: float | None
    has_needle: bool

    def of_kind(self, kind: str) -> list[Experiment]:
        """Return the experiments of a kind."""
        return [experiment for experiment in self.experiments if experiment.kind == kind]

    @property
    def driver(self) -> str:
        """Quantity that sets the flow: pressure, pump speed, plunger speed or drops; "" for a fixed flow."""
        for name, kind in _DRIVERS.items():
            if kind == self.kind:
                return name
        return "pressure" if any(experiment.has("pressure") for experiment in self.experiments) else ""


def needle_of(text: str) -> tuple[float, float]:
    """Return bore and length of a needle written as "0.41x12.7" or "21Gx12.7" [mm].

    Raises:
        InputError: another text, an unknown gauge, or a size that is not above zero.
    """
    bore, sign, length = re.sub(r"\s|mm", "", text.replace("×", "x")).partition("x")
    try:
        if not sign:
            raise ValueError
        inner = bore if bore.upper().endswith("G") else float(bore)
        needle = Needle(bore=inner.upper() if isinstance(inner, str) else inner, length=float(length))
    except InputError:
        raise
    except ValueError:
        raise InputError(f"--needle {text}: must be BORExLENGTH in mm, as in 0.41x12.7 or 22Gx12.7") from None
    return needle.inner, needle.length


def read_measurements(
    files: Sequence[str | Path],
    columns: Mapping[str, str] | None = None,
    density: float | None = None,
    needle: tuple[float, float] | None = None,
) -> Measurements:
    """Read measurements from tables of any format that `read_table` reads.

    The filled cells of a row show what it is: an open time, of dots; drops, of a jet; a width or height, of a bead; a
    command or a flow, of a record over time; else a weighing of a mass over a time. A column `experiment` separates
    several of one kind.

    Args:
        files: the tables.
        columns: sources of quantities by name, as in {"mass": "Balance [g]"}.
        density: of the glue, where no column gives it [g/cm³].
        needle: bore and length, where no columns give them [mm].

    Raises:
        InputError: no such file, a missing column or unit, or a row that is no known measurement.
        NotIdentifiedError: columns of two kinds of dispenser, or masses without a density.
    """
    experiments = [experiment for file in files for experiment in _experiments(read_table(file), columns or {})]
    given = {name: kind for name, kind in _DRIVERS.items() if any(experiment.has(name) for experiment in experiments)}
    if len(given) > 1:
        names = " and ".join(given)
        raise NotIdentifiedError(f"columns {names}: of different kinds of dispenser; each is identified by itself")
    kind = next(iter(given.values()), VALVE)
    densities = {float(x) for experiment in experiments for x in experiment.columns.get("density", ())}
    if len(densities) > 1:
        raise InputError(f"density = {min(densities):g} and {max(densities):g} g/cm³: must be one value")
    if densities:
        density = densities.pop()
    if density is not None:
        positive("density", density, DENSITY)
    if density is None and any(experiment.has("mass") for experiment in experiments):
        raise NotIdentifiedError(
            "the density of the glue is missing: a mass gives no volume without; add a column density [g/cm³], or "
            "--density"
        )
    if needle is not None:
        experiments = [_with_needle(experiment, needle) for experiment in experiments]
    has_needle = all(experiment.has("bore") and experiment.has("length") for experiment in experiments)
    return Measurements(tuple(experiments), kind, density, has_needle)


def _with_needle(experiment: Experiment, needle: tuple[float, float]) -> Experiment:
    sizes = {name: np.full(len(experiment), size) for name, size in zip(("bore", "length"), needle, strict=True)}
    return replace(experiment, columns={**sizes, **experiment.columns})


def _experiments(table: ColumnTable, given: Mapping[str, str]) -> list[Experiment]:
    """Return the experiments of a table."""
    sources = _sources(table, given)
    names = [name for name in QUANTITIES if name in sources]
    values = {name: _values(table, sources[name], name) for name in names}
    for name in _CONSTANTS:
        if name in values:
            values[name] = _filled_column(values[name])
    labels = _labels(table, sources.get(_EXPERIMENT))
    kinds = _kinds(table.label, values, labels)
    experiments = []
    for label, kind in dict.fromkeys(zip(labels, kinds, strict=True)):
        if not kind:
            continue
        rows = np.flatnonzero([pair == (label, kind) for pair in zip(labels, kinds, strict=True)])
        name = f"{label} ({kind})" if label else kind
        cells = {key: x[rows] for key, x in values.items()}
        experiments.append(_experiment(table.label, kind, name, cells, np.asarray(rows + 1, float)))
    if not experiments:
        raise InputError(f"{table.label}: has no rows with values")
    return experiments


def _experiment(label: str, kind: str, name: str, columns: dict[str, Floats], rows: Floats) -> Experiment:
    """Return an experiment with the columns that are filled in all its rows.

    Raises:
        InputError: a column that it must have, or that is filled in a part of its rows.
    """
    filled = {key: np.isfinite(x) for key, x in columns.items()}
    used = {key: columns[key] for key, is_filled in filled.items() if is_filled.all()}
    for key in _PER_KIND[kind]:
        if key not in used:
            state = "is empty in some of its rows" if key in filled and filled[key].any() else "is missing"
            raise InputError(f"{label}: {name}: {key} {state}; it needs {' and '.join(_PER_KIND[kind])}")
    partly = [key for key, is_filled in filled.items() if is_filled.any() and not is_filled.all()]
    if partly:
        row = int(rows[np.flatnonzero(~filled[partly[0]])[0]])
        raise InputError(
            f"{label}: {name}: {partly[0]} is empty in row {row}: must be filled in all of its rows or none"
        )
    if kind == RECORD and not ("mass" in used or "flow" in used):
        raise InputError(f"{label}: {name}: has neither mass nor flow over its time")
    return Experiment(kind, name, used, rows)


def _kinds(label: str, values: Mapping[str, Floats], labels: Sequence[str]) -> list[str]:
    """Return the kind of experiment of each row, "" of an empty one."""
    count = len(labels)
    filled = {name: np.isfinite(x) for name, x in values.items()}
    none = np.zeros(count, bool)

    def has(*names: str) -> NDArray[np.bool_]:
        return np.asarray(np.any([filled.get(name, none) for name in names], axis=0))

    rests = none.copy()
    for name in ("pump speed", "plunger speed"):
        for key in set(labels):
            rows = np.array([text == key for text in labels]) & filled.get(name, none) & filled.get("mass", none)
            rows &= ~has("command", "flow", "open time", "width", "height")
            # a driven dispenser at rest is weighed by nobody: the rows are a record
            if rows.any() and np.any(values[name][rows] == 0):
                rests |= rows
    conditions = [
        (DROPS, has("drops")),
        (DOTS, has("open time")),
        (BEAD, has("width", "height")),
        (RECORD, has("command", "flow") | rests),
        (WEIGHING, has("time", "mass", "pressure", "pump speed", "plunger speed")),
    ]
    kinds = [next((kind for kind, holds in conditions if holds[k]), "") for k in range(count)]
    measured = has(*(name for name in QUANTITIES if name not in _CONSTANTS))
    for k in np.flatnonzero(measured):
        if not kinds[k]:
            filled_names = ", ".join(name for name, cells in filled.items() if cells[k])
            raise InputError(
                f"{label}: row {k + 1} has {filled_names}, which is no measurement: must be time and mass, open time "
                "and mass, drops and mass, speed and width or height, or time with command and mass or flow"
            )
    return kinds


def _labels(table: ColumnTable, source: Source | None) -> list[str]:
    if source is None:
        return [""] * table.rows
    if source.column in table.texts:
        return [text.strip() for text in table.texts[source.column]]
    return [f"experiment {value:g}" if np.isfinite(value) else "" for value in table.columns[source.column]]


def _filled_column(values: Floats) -> Floats:
    """Return a column whose empty cells have the value above, or the first one."""
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return values
    above = np.maximum(np.searchsorted(known, np.arange(values.size), "right") - 1, 0)
    return values[known[above]]


def _values(table: ColumnTable, source: Source, name: str) -> Floats:
    """Return a quantity in the unit of the package.

    Raises:
        InputError: no unit, or one of another kind.
    """
    kind = QUANTITIES[name].unit
    unit = source.unit or table.unit_of(source.column)
    if kind and not unit:
        raise InputError(
            f"{table.label}: column {source.column} has no unit: must be one of {', '.join(KINDS[kind])}, as in "
            f"{source.column} [{_usual(kind)}]"
        )
    # a command may be in volts, as it only switches
    values = table.values(source, kind, {unit: 1.0} if name == "command" else None)
    return values / _DEGREES if kind == TURNING else values


def _usual(kind: str) -> str:
    return "rpm" if kind == TURNING else kind


def _sources(table: ColumnTable, given: Mapping[str, str]) -> dict[str, Source]:
    """Return where the quantities stand: as given, else by the heads of the columns."""
    known = [*QUANTITIES, _EXPERIMENT]
    sources = {}
    for name, text in given.items():
        if name not in known:
            raise InputError(f"{table.label}: {unknown('column', name, known)}")
        sources[name] = Source.parse(name, text)
    heads = {head: name for name, quantity in QUANTITIES.items() for head in (name, *quantity.heads)}
    heads |= dict.fromkeys((_EXPERIMENT, "test", "series", "measurement"), _EXPERIMENT)
    taken = {source.column for source in sources.values()}
    for head in table.order:
        unit = table.units.get(head, "")
        name = spaced_name(head).lower()
        if unit:
            name = name.removesuffix(f" {unit.lower()}")
        quantity = heads.get(name, "")
        if quantity and quantity not in sources and head not in taken:
            sources[quantity] = Source(head)
    if not any(name in sources for name in ("mass", "width", "height", "flow")):
        raise InputError(
            f"{table.label}: has no column mass, width, height or flow; it has: {', '.join(table.order)}; --column "
            "names others, as in 'mass=Balance [g]'"
        )
    return sources
