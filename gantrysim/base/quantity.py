"""A value that people see, described once: name, label, unit, format and meaning, and where it is read.

Terminal tables, summary.json, pages, columns of studies, data frames and docs/values.md derive from these descriptions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar

NOTHING = "–"  # a value that is missing
MINUS = "−"
NO_BREAK_SPACE = "\u00a0"

PER_CENT = 100.0  # in a share of 1
UM = 1e3  # micrometres in a millimetre

_UNITS = (
    "µm/s|µm|mm/s³|mm/s²|mm/s|mm/min|mm²|mm³/s|mm³|mm|ms|µs|s|Hz|kHz|deg/s²|deg/s|deg|%|N·m|N|V|A|W|bar|rad|rms|kB|MB|"
    "kg|g|ppm|ticks?|counts?"
)
_NUMBER = r"[+−-]?\d"
_NO_BREAK = re.compile(
    rf"(?<=[\d∞]) (?=(?:{_UNITS})(?![\w/]))|(?<=[×±→]) (?={_NUMBER})|(?<=\w) (?== {_NUMBER})|(?<= =) (?={_NUMBER})"
    r"|(?<=\bline) (?=\d)"
)

_LARGEST_PLAIN = 1e7  # from which on a number is shown with a power of ten
AXIS = "{axis}"  # stands for the name of an axis in a template

_ASCII = str.maketrans({"µ": "u", "²": "2", "³": "3", "·": "", "/": "_"})
_WORDS = {"%": "percent"}  # units that have no letters

Subject = TypeVar("Subject")


class Item(NamedTuple):
    """An item of a mapping or a sequence on the way to a value.

    Attributes:
        key: of the mapping, or place in the sequence.
    """

    key: str | int


Path = tuple[str | Item, ...]  # attributes and items, in their order


@dataclass(frozen=True)
class Statistic:
    """A statistic of a value that has several.

    Attributes:
        name: attribute that holds it, and ending of the value's name.
        label: in words.
        meaning: what it is of the value.
        adjective: as it stands before a label in a sentence.
        unit: of its own; None for that of the value.
        factor: likewise, from the API's unit.
        form: likewise, its format.
    """

    name: str
    label: str
    meaning: str
    adjective: str
    unit: str | None = None
    factor: float = 1.0
    form: str = ""


RMS = Statistic("rms", "rms", "root mean square", "rms")
P95 = Statistic("p95", "95 %", "95th percentile of the magnitude", "95 %")
MAX = Statistic("max", "max", "largest magnitude", "largest")
SHARE = Statistic("share", "share", "share of the mean square contour error", "share of", "%", 100.0, ".1f")
MEAN = Statistic("mean", "mean", "mean", "mean")
STD = Statistic("std", "std", "standard deviation", "standard deviation of")
MIN = Statistic("min", "min", "smallest", "smallest")
LARGEST_VALUE = Statistic("max", "max", "largest", "largest")

SIZES = (RMS, MAX)  # of an error
PARTS = (RMS, P95, MAX, SHARE)  # of a part of the error budget
RANGE = (MEAN, STD, MIN, LARGEST_VALUE)


@dataclass(frozen=True)
class Quantity(Generic[Subject]):
    """A value that people see.

    Attributes:
        name: stem of its key, as "contour"; may contain `AXIS`.
        label: in words, as in tables.
        unit: as people see it; empty for a ratio.
        form: format of its number in this unit.
        meaning: what it is and between which two things, a sentence without its full stop.
        path: attributes and items that lead from the subject to the value, in the API's unit.
        factor: from the API's unit to `unit`.
        statistics: that the value has; empty for a number.
    """

    name: str
    _: KW_ONLY
    label: str
    unit: str
    form: str
    meaning: str
    path: Path
    factor: float = 1.0
    statistics: tuple[Statistic, ...] = ()

    @property
    def key(self) -> str:
        """Name with the unit in ASCII, as "contour_rms_um"."""
        return "_".join(part for part in (self.name, ascii_unit(self.unit)) if part)

    @property
    def head(self) -> str:
        """Label with the unit in brackets, as the head of a column."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def get(self, subject: Subject | None) -> Any:
        """Return the value in the API's unit; None where the subject, or anything on the way, is None."""
        value: Any = subject
        for part in self.path:
            if value is None:
                return None
            if not isinstance(part, Item):
                value = getattr(value, part)
            elif isinstance(value, Mapping):
                value = value.get(part.key)
            else:
                value = value[part.key]
        return value

    def in_unit(self, value: float | None) -> float | None:
        """Return a value in `unit`."""
        return None if value is None else self.factor * value

    def number(self, value: float | None) -> str:
        """Return a value without its unit, see `number_text`."""
        return number_text(self.in_unit(value), self.form)

    def text(self, value: float | None) -> str:
        """Return a value with its unit; a missing one has none."""
        number = self.number(value)
        return f"{number} {self.unit}" if self.unit and number != NOTHING else number

    def content(self, value: float | None) -> float | None:
        """Return a value in `unit` for JSON and tables; None for one that is missing or not finite."""
        return None if value is None or not math.isfinite(value) else self.factor * value

    def statistic(self, statistic: Statistic) -> Quantity[Subject]:
        """Return one of the statistics as a quantity of its own."""
        label = ", ".join(part for part in (self.label, statistic.label) if part)
        single = replace(
            self,
            name="_".join(part for part in (self.name, statistic.name) if part),
            label=label,
            meaning=f"{self.meaning}: {statistic.meaning}",
            path=(*self.path, statistic.name),
            statistics=(),
        )
        if statistic.unit is None:
            return single
        return replace(single, unit=statistic.unit, factor=statistic.factor, form=statistic.form)

    def phrase(self, statistic: Statistic) -> str:
        """Return one of the statistics in words, as "largest contour error"."""
        return f"{statistic.adjective} {self.label}"

    @property
    def numbers(self) -> tuple[Quantity[Subject], ...]:
        """The quantities that are numbers: one for each statistic, or the quantity itself."""
        return tuple(map(self.statistic, self.statistics)) or (self,)

    def by_axis(self, path: Path) -> Quantity[Any]:
        """Return the template of the quantities of all axes.

        Args:
            path: from another subject to that of this quantity, with `Item(AXIS)`.
        """
        return replace(self, name=f"{self.name}_{AXIS}", label=f"{self.label} {AXIS}", path=(*path, *self.path))

    def of_axis(self, axis: str, unit: str | None = None) -> Quantity[Subject]:
        """Return the quantity of one axis from the template of all.

        Args:
            axis: name of the axis.
            unit: of the axis' value as people see it; None for that of the template.
        """
        path = tuple(Item(axis) if part == Item(AXIS) else part for part in self.path)
        return replace(
            self,
            name=self.name.replace(AXIS, axis),
            label=self.label.replace(AXIS, axis),
            unit=self.unit if unit is None else unit,
            path=path,
        )

    def code(self, subject: str) -> str:
        """Return Python code that reads the value from a subject."""
        parts = (f"[{part.key!r}]" if isinstance(part, Item) else f".{part}" for part in self.path)
        return subject + "".join(parts).replace("'", '"')


def contents(quantities: Iterable[Quantity[Any]], subject: Any) -> dict[str, float | None]:
    """Return the numbers of some quantities by their keys, in the units of the keys; None for what is missing."""
    return {number.key: number.content(number.get(subject)) for number in numbers_of(quantities)}


def numbers_of(quantities: Iterable[Quantity[Any]]) -> Iterator[Quantity[Any]]:
    """Yield the quantities that are numbers, see `Quantity.numbers`."""
    for quantity in quantities:
        yield from quantity.numbers


def number_text(value: float | None, form: str) -> str:
    """Return a number in a format; what rounds to zero is 0, what is missing or not a number a dash.

    An infinite number is shown by its symbol, one below ten million without a power of ten. This is the one rule for
    signs: whatever is read, in a terminal, on a page or in a notebook, has a minus sign; what is pasted or read by a
    program, and input that an error quotes, a hyphen.
    """
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else f"{MINUS}∞"
    text = format(value, form)
    if "e+" in text and abs(value) < _LARGEST_PLAIN:
        text = f"{float(text):.0f}"
    return with_minus(text) if float(text.replace(",", "")) else "0"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, as in "1 corner" and "no corners"; of "arc of X" the first word is counted."""
    head, of, whole = noun.partition(" of ")
    return f"{number or 'no'} {head}{'' if number == 1 else 's'}{of}{whole}"


def text_beside(value: float, bound: float, digits: int) -> str:
    """Return a value with as many significant digits as tell it from its bound, up to nine."""
    texts = (f"{value:.{count}g}" for count in range(digits, 10))
    return next((text for text in texts if float(text) != float(f"{bound:g}")), f"{value:g}")


def with_minus(text: str) -> str:
    """Return a number as text with a minus sign in the place of a hyphen."""
    return f"{MINUS}{text[1:]}" if text.startswith("-") else text


def joined(text: str, joint: str = NO_BREAK_SPACE) -> str:
    """Return a text in which no line ends between a number and its unit, or within an equation such as "x = 3.8".

    Args:
        text: as it is read.
        joint: stands for a space at which no line may end.
    """
    return _NO_BREAK.sub(joint, text)


def ascii_unit(unit: str) -> str:
    """Return a unit as it ends a key: "um" for "µm", "mm_s" for "mm/s", "percent" for "%"."""
    return _WORDS.get(unit, unit.translate(_ASCII))
