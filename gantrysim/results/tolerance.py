"""What a run must keep to be good enough."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gantrysim.job.job import Job
from gantrysim.job.settings import ToleranceSettings
from gantrysim.results.checks import Bound

GIVEN = "given"
DEFAULT = "default"

_PATH_SHARE = 0.1  # largest contour error, of the needle's outer diameter
_COUNTS = 2.0  # least default of it, in encoder counts: a servo holds its position within a count to either side
_P95_SHARE = 0.5  # of the largest contour error
_BEAD_WIDTH = 10.0  # [%]
_BEAD_PLOUGHED = 0.0  # [mm]
_GAIN_MARGIN = 1.5
_RESERVE = 10.0  # [%], of torque and speed


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Limits that a good run keeps, each given by the job or by default.

    The default of

        path_max is a tenth of the needle's outer diameter, but at least two counts of the coarsest linear encoder;
        path_p95 is half of path_max;
        bead_width is 10 %;
        turn_clearance is what bead_width and path_max allow together: both turns as wide as allowed, and each
            displaced by path_max, bead_width * width + 2 path_max;
        bead_ploughed is 0: a needle that passes through laid glue smears it and carries some away;
        start_length and stop_length are the nominal width of the bead, whose round ends are half as long;
        gain_margin is 1.5; a peak M of |S| guarantees a gain margin of M / (M - 1), so
        sensitivity is gain_margin / (gain_margin - 1), 3;
        torque_reserve and speed_reserve are 10 %.

    Attributes:
        path_max: largest contour error [mm].
        path_p95: 95th percentile of the contour error [mm].
        bead_width: deviation of the bead's width from the nominal one, to either side [%].
        turn_clearance: deviation of the distance between neighbouring turns' edges from the requested one [mm].
        bead_ploughed: length of bead that the needle later ploughs through, see `bead.ploughing` [mm].
        start_length: length at a start over which any width is allowed; also the limit of the glue missing there, as
            length of nominal bead [mm]; nan where no bead is requested.
        stop_length: length at a stop over which any width is allowed; also the limit of the excess glue there, as
            length of nominal bead [mm].
        gain_margin: smallest gain margin of an axis.
        sensitivity: largest peak of |S| of an axis.
        torque_reserve: percentage of an axis' torque limit that must remain unused [%].
        speed_reserve: percentage of an axis' speed limit that must remain unused [%].
        given: names of the limits that the job gives; all others are defaults.
    """

    path_max: float
    path_p95: float
    bead_width: float = _BEAD_WIDTH
    turn_clearance: float
    bead_ploughed: float = _BEAD_PLOUGHED
    start_length: float
    stop_length: float
    gain_margin: float = _GAIN_MARGIN
    sensitivity: float
    torque_reserve: float = _RESERVE
    speed_reserve: float = _RESERVE
    given: frozenset[str] = frozenset()

    @classmethod
    def of(cls, job: Job, needle: float, width: float = math.nan) -> Tolerance:
        """Return the tolerance of a job.

        Args:
            job: the job, with its machine and its table [tolerance].
            needle: outer diameter of the needle [mm].
            width: nominal width of the bead, nan where none is requested [mm].
        """
        counts = [axis.resolution for axis in job.built_machine.axes if axis.unit == "mm"]
        return cls.from_settings(job.tolerance or ToleranceSettings(), needle, counts, width)

    @classmethod
    def from_settings(
        cls, settings: ToleranceSettings, needle: float, counts: Iterable[float] = (), width: float = math.nan
    ) -> Tolerance:
        """Return the tolerance of a table [tolerance].

        Args:
            settings: the table.
            needle: outer diameter of the needle [mm].
            counts: encoder counts of the linear axes [mm].
            width: nominal width of the bead, nan where none is requested [mm].
        """
        given = {name: float(value) for name, value in settings if value is not None}
        path_max = given.get("path_max", max(_PATH_SHARE * needle, _COUNTS * max(counts, default=0.0)))
        bead_width = given.get("bead_width", _BEAD_WIDTH)
        gain_margin = given.get("least_gain_margin", _GAIN_MARGIN)
        return cls(
            path_max=path_max,
            path_p95=given.get("path_p95", _P95_SHARE * path_max),
            bead_width=bead_width,
            turn_clearance=given.get("turn_clearance", bead_width / 100 * width + 2 * path_max),
            bead_ploughed=given.get("bead_ploughed", _BEAD_PLOUGHED),
            start_length=given.get("start_length", width),
            stop_length=given.get("stop_length", width),
            gain_margin=gain_margin,
            sensitivity=given.get("largest_sensitivity", gain_margin / (gain_margin - 1)),
            torque_reserve=given.get("torque_reserve", _RESERVE),
            speed_reserve=given.get("speed_reserve", _RESERVE),
            given=frozenset(_OF_KEY.get(name, name) for name in given),
        )

    def source(self, name: str) -> str:
        """Return "given" for a limit that the job gives, "default" for any other."""
        return GIVEN if name in self.given else DEFAULT

    def bound(self, name: str, at_least: bool = False) -> Bound:
        """Return the bound of a value, by the name of its limit."""
        return Bound(name, getattr(self, name), self.source(name), at_least)


# attributes whose key in a job file differs from them, as the last part of a key must be unique there
_OF_KEY = {"least_gain_margin": "gain_margin", "largest_sensitivity": "sensitivity"}
