"""What a run must keep to be good enough: the limits, and the table [tolerance] of a job file that gives some."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Annotated, Any, NamedTuple, get_type_hints

from pydantic import Field, create_model

from gantrysim.job.programs import described_fields
from gantrysim.job.settings import STRICT

GIVEN = "given"
DEFAULT = "default"

_PATH_SHARE = 0.1  # largest contour error, of the needle's outer diameter
_COUNTS = 2.0  # least default of it, in encoder counts: a servo holds its position within a count to either side
_P95_SHARE = 0.5  # of the largest contour error

# limits whose key in a job file differs from their name, as the last part of a key must be unique there
_KEYS = {"gain_margin": "least_gain_margin", "sensitivity": "largest_sensitivity"}

_AboveZero = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]
_AboveOne = Annotated[float, Field(gt=1)]
_Percentage = Annotated[float, Field(ge=0, lt=100)]


class Bound(NamedTuple):
    """Bound of a value.

    Attributes:
        name: of the limit, an attribute of `Tolerance`.
        limit: in the API's unit.
        source: "given" for a limit of the job, "default" for any other.
        at_least: whether the value must be at least the limit, else at most.
    """

    name: str
    limit: float
    source: str
    at_least: bool = False


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Limits that a good run keeps, each given by the job or by default.

    The least default of path_max is two counts of the coarsest linear encoder. Where two turns lie side by side,
    bead_width and path_max allow a deviation of bead_width * width + 2 path_max: both turns as wide as allowed, and
    each displaced by path_max. A needle that passes through laid glue smears it and carries some away. The round ends
    of a bead are half its width long; start_length is also the limit of the glue that is missing at a start, and
    stop_length that of the excess at a stop, as lengths of nominal bead. A peak M of |S| guarantees a gain margin of
    M / (M - 1), so the default of sensitivity is gain_margin / (gain_margin - 1).

    Attributes:
        path_max: largest contour error, by default a tenth of the needle's outer diameter [mm].
        path_p95: 95th percentile of the contour error, by default half of `path_max` [mm].
        bead_width: deviation of the bead's width from the nominal one, by default 10 [%].
        turn_clearance: deviation of the gap or overlap between neighbouring turns from the requested value, by default
            what `bead_width` and `path_max` allow together [mm].
        bead_ploughed: length of bead that the needle later ploughs through, by default none [mm].
        start_length: length at a start of the bead over which any width is allowed, by default the bead's width [mm].
        stop_length: length at a stop of the bead over which any width is allowed, by default the bead's width [mm].
        dot_volume: deviation of a dot's volume from the requested one, by default 10 [%].
        dot_place: distance of a dot from its commanded place in plan view, by default `path_max` [mm].
        dot_string: glue of a dot that flows while the needle is away, as it lifts before the valve has closed, by
            default 5 [%].
        gain_margin: smallest gain margin of an axis, by default 1.5.
        sensitivity: largest peak of |S| of an axis, by default 3, which guarantees a gain margin of 1.5.
        torque_reserve: percentage of an axis' torque limit that must remain unused, by default 10 [%].
        speed_reserve: percentage of an axis' speed limit that must remain unused, by default 10 [%].
        given: names of the limits that the job gives; all others are defaults.
    """

    path_max: _AboveZero
    path_p95: _AboveZero
    bead_width: _AboveZero = 10.0
    turn_clearance: _AboveZero
    bead_ploughed: _NotNegative = 0.0
    start_length: _AboveZero
    stop_length: _AboveZero
    dot_volume: _AboveZero = 10.0
    dot_place: _AboveZero
    dot_string: _AboveZero = 5.0
    gain_margin: _AboveOne = 1.5
    sensitivity: _AboveOne
    torque_reserve: _Percentage = 10.0
    speed_reserve: _Percentage = 10.0
    given: frozenset[str] = frozenset()

    @classmethod
    def of(
        cls, settings: ToleranceSettings, needle: float, counts: Iterable[float] = (), width: float = math.nan
    ) -> Tolerance:
        """Return the tolerance of a table [tolerance].

        Args:
            settings: the table.
            needle: outer diameter of the needle [mm].
            counts: encoder counts of the linear axes [mm].
            width: nominal width of the bead, nan where none is requested [mm].
        """
        table = {key: float(value) for key, value in settings if value is not None}
        given = {name: table[key] for name, key in _KEY_OF_LIMIT.items() if key in table}
        path_max = given.get("path_max", max(_PATH_SHARE * needle, _COUNTS * max(counts, default=0.0)))
        bead_width = given.get("bead_width", cls.bead_width)
        gain_margin = given.get("gain_margin", cls.gain_margin)
        derived = {
            "path_max": path_max,
            "path_p95": _P95_SHARE * path_max,
            "turn_clearance": bead_width / 100 * width + 2 * path_max,
            "start_length": width,
            "stop_length": width,
            "dot_place": path_max,
            "sensitivity": gain_margin / (gain_margin - 1),
        }
        return cls(**{**derived, **given}, given=frozenset(given))

    def source(self, name: str) -> str:
        """Return "given" for a limit that the job gives, "default" for any other."""
        return GIVEN if name in self.given else DEFAULT

    def bound(self, name: str, at_least: bool = False) -> Bound:
        """Return the bound of a value, by the name of its limit."""
        return Bound(name, getattr(self, name), self.source(name), at_least)


_KEY_OF_LIMIT = {field.name: _KEYS.get(field.name, field.name) for field in fields(Tolerance) if field.name != "given"}


def _keys() -> dict[str, Any]:
    """Return type, default and meaning of the keys of the table, from the limits."""
    hints = get_type_hints(Tolerance, include_extras=True)
    meanings = described_fields(Tolerance)
    return {
        key: (hints[name] | None, Field(default=None, description=meanings[name].removesuffix(".")))
        for name, key in _KEY_OF_LIMIT.items()
    }


_ToleranceSettings: Any = create_model("_ToleranceSettings", __config__=STRICT, **_keys())


class ToleranceSettings(_ToleranceSettings):  # type: ignore[misc]
    """What a run must keep to be good enough; what is not given follows from machine, needle and bead."""
