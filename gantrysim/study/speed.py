"""`gantrysim study speed`: the fastest path speed at which a job stays within a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.budget import LINKS
from gantrysim.errors import at_least
from gantrysim.job import Job
from gantrysim.study.cases import OK, Case, Row, measure
from gantrysim.study.criterion import Criterion
from gantrysim.study.drawing import logarithmic
from gantrysim.study.pace import programmed_speed, speed_overrides
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SpeedAnswer", "SpeedStudy", "answer", "next_speeds"]

_SWEEP = 9  # speeds of the first round, half an octave apart, the program's own in the middle
_OCTAVES = 2  # to both sides of the program's own
_FURTHER = 3  # more octaves to either side, one after the other, where the answer lies beyond
_INSIDE = 3  # speeds tried at a time inside the bracket
_DIGITS = 4  # of a speed
_SATURATED = 1.02  # times the least duration: as short as the limits let it be
_LOGARITHMIC_FROM = 5.0  # times the least value


@dataclass(frozen=True)
class SpeedAnswer:
    """What a search has found.

    Attributes:
        fastest: the fastest speed tried at which, and below which at all that were tried, the run is within the
            tolerance; None where there is none [mm/s].
        above: the next faster speed tried, which is not within; None where there is none [mm/s].
        islands: speeds beyond that which are within again, ascending [mm/s].
    """

    fastest: float | None
    above: float | None
    islands: tuple[float, ...] = ()


def answer(tried: dict[float, bool]) -> SpeedAnswer:
    """Return the answer from what has been tried: whether each speed [mm/s] is within the tolerance."""
    speeds = sorted(tried)
    first = next((k for k, speed in enumerate(speeds) if not tried[speed]), len(speeds))
    islands = tuple(speed for speed in speeds[first:] if tried[speed])
    return SpeedAnswer(speeds[first - 1] if first else None, speeds[first] if first < len(speeds) else None, islands)


def next_speeds(tried: dict[float, bool], own: float, resolution: float) -> list[float]:
    """Return the speeds to be tried next, ascending; none where the search has come to its end [mm/s].

    At first a sweep two octaves to both sides of the program's own speed; beyond its end, an octave at a time, while
    everything tried is within the tolerance or nothing is; then speeds evenly, on a logarithmic scale, inside the
    bracket of the fastest one that is within and the next, until that is narrow enough.

    Args:
        tried: whether each speed is within the tolerance.
        own: the program's speed [mm/s].
        resolution: width of the bracket, relative.
    """
    if not tried:
        return _rounded(own * np.geomspace(2.0**-_OCTAVES, 2.0**_OCTAVES, _SWEEP))
    found, speeds = answer(tried), sorted(tried)
    furthest = 2.0 ** (_OCTAVES + _FURTHER) * (1 - 1e-3)
    if found.fastest is None:
        if speeds[0] * furthest <= own:
            return []
        return _rounded(np.array([0.5, math.sqrt(0.5)]) * speeds[0])
    if found.above is None:
        if speeds[-1] >= own * furthest:
            return []
        return _rounded(np.array([math.sqrt(2.0), 2.0]) * speeds[-1])
    if found.above <= found.fastest * (1 + resolution):
        return []
    inside = _rounded(np.geomspace(found.fastest, found.above, _INSIDE + 2)[1:-1])
    return [speed for speed in inside if speed not in tried]


def _rounded(speeds: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    """Numbers that a program can hold, each once."""
    return sorted({float(f"{speed:.{_DIGITS}g}") for speed in speeds})


@dataclass(frozen=True)
class SpeedStudy:
    """The fastest path speed within a tolerance: a sweep, then rounds inside the bracket.

    A figure need not grow with the speed. The answer is therefore the fastest speed below which every speed that was
    tried is within the tolerance; a run that a fault ends, or that is refused, is not.

    Args:
        job: whose speed is changed; see `gantrysim.study.pace` for what that is.
        tolerance: of the figure, in its unit.
        figure: of a case's row, as contour_max.
        resolution: how closely the answer is looked for, relative.
        measure: from a case to its row.
    """

    job: Job
    tolerance: float
    figure: str = "contour_max"
    resolution: float = 0.01
    measure: Measure = measure

    name = "speed"
    plots = ("speed", "links")

    def __post_init__(self) -> None:
        _ = self.criterion, self.own
        at_least("resolution", self.resolution, 10.0 ** (1 - _DIGITS))  # or the bracket could not be that narrow

    @cached_property
    def criterion(self) -> Criterion:
        """The figure with its tolerance."""
        return Criterion(self.figure, self.tolerance)

    @cached_property
    def own(self) -> float:
        """The program's own speed [mm/s]."""
        return programmed_speed(self.job)

    @property
    def title(self) -> str:
        """Heads the report."""
        return f"How fast may {self.job.name} be?"

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does with the job."""
        return {"tolerance": self.tolerance, "figure": self.figure, "resolution": self.resolution}

    def rounds(self) -> Rounds:
        """Yield the speeds of one round after the other."""
        tried: dict[float, bool] = {}
        number = 0
        while speeds := next_speeds(tried, self.own, self.resolution):
            number += 1
            rows = yield [
                Case.of(self.job, speed_overrides(self.job, speed), round=number, speed_mm_s=speed) for speed in speeds
            ]
            if number == 1 and (good := next((row for row in rows if row["status"] == OK), None)) is not None:
                self.criterion.key(good)  # raises where there is no such figure
            tried |= {_speed(row): self.criterion.within(row) for row in rows}

    def findings(self, rows: list[Row]) -> list[str]:
        """Return the answer, what sets the limit there, and what happens beyond."""
        good = [row for row in rows if row["status"] == OK]
        if not good:
            return [f"None of the {len(rows)} speeds tried gives a run with figures: {rows[0]['status']}"]
        criterion, found = self.criterion, answer({_speed(row): self.criterion.within(row) for row in rows})
        unit = criterion.unit(good[0])
        limit = f"{criterion.label} of {criterion.tolerance:g} {unit}".rstrip()
        by_speed = {_speed(row): row for row in rows}
        slow, fast = min(by_speed), max(by_speed)
        if found.fastest is None:
            first = by_speed[slow]
            return [
                f"No speed tried, from {slow:g} to {fast:g} mm/s, keeps to a {limit}: at {slow:g} mm/s "
                f"{_outcome(first, criterion)}. {_mostly(first)}".rstrip(),
                *self._what_speed_is(),
            ]
        row = by_speed[found.fastest]
        if found.above is None:
            text = f"Every speed tried, from {slow:g} to {fast:g} mm/s, keeps to a {limit}"
        else:
            text = (
                f"Up to {found.fastest:g} mm/s, {found.fastest / self.own:.3g} times the program's own "
                f"{self.own:g} mm/s, the job keeps to a {limit}; at {found.above:g} mm/s "
                f"{_outcome(by_speed[found.above], criterion)}"
            )
        paragraphs = [f"{text}. At {found.fastest:g} mm/s {_outcome(row, criterion)}. {_mostly(row)}".rstrip()]
        mean = row["speed_mean_mm_s"]
        if isinstance(mean, float):
            paragraphs[0] += f" The nozzle's mean speed is then {mean:.4g} mm/s."
        if found.islands:
            several = ", ".join(f"{speed:g}" for speed in found.islands)
            paragraphs.append(
                f"The error does not grow with the speed all the way: {several} mm/s, beyond the first speed that is "
                "not within the tolerance, is within it again."
            )
        return [*paragraphs, *_saturation(good), *self._what_speed_is()]

    def _what_speed_is(self) -> list[str]:
        controller = self.job.program["controller"]
        what = {
            "softmc.Program": "the group's velocity and every command's own Vtran, changed in one proportion",
            "fanuc.Program": "the feeds F of the program, changed in one proportion; rapid moves and clamps stay",
        }.get(controller, "the program's speed")
        return [f"Speed here is {what}. Ramps and limits of the controller and of the axes are the job's."]

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the figure over the speed with the tolerance, and the links' parts over the speed."""
        good = sorted((row for row in rows if row["status"] == OK), key=_speed)
        if not good:
            return []
        return [
            Plot(
                "speed",
                "The figure over the speed",
                "Every run of the search. The search goes on inside the bracket of the fastest speed within the "
                "tolerance and the next faster one.",
                self._draw_figure(rows, good),
            ),
            Plot(
                "links",
                "Which link grows with the speed",
                "Root mean square of the parts of the error normal to the requested path, each from one link of the "
                "chain; lag along the path is in none of them.",
                _draw_links(good),
            ),
        ]

    def _draw_figure(self, rows: list[Row], good: list[Row]) -> Figure:
        from gantrysim.plots.style import COLOURS, INK, sheet

        criterion = self.criterion
        found = answer({_speed(row): criterion.within(row) for row in rows})
        with sheet(9.0, 4.8) as figure:
            axes = figure.add_subplot()
            speeds, values = [_speed(row) for row in good], [criterion.value(row) for row in good]
            axes.plot(speeds, values, color=INK, lw=1.0, alpha=0.5)
            kinds = (("within the tolerance", True, COLOURS["structure"]), ("not within", False, COLOURS["fault"]))
            for label, within, colour in kinds:
                chosen = [k for k, row in enumerate(good) if criterion.within(row) is within]
                if chosen:
                    at = [speeds[k] for k in chosen], [values[k] for k in chosen]
                    axes.plot(*at, "o", ms=5, color=colour, label=label, zorder=3)
            axes.axhline(criterion.tolerance, color=COLOURS["fault"], lw=1.2, ls="--", label="tolerance")
            none = sorted(_speed(row) for row in rows if row["status"] != OK)
            if none:
                top = [0.97] * len(none)
                blended = axes.get_xaxis_transform()
                axes.plot(none, top, "x", ms=7, color=COLOURS["fault"], transform=blended, label="fault or refused")
            axes.axvline(self.own, color=COLOURS["requested"], lw=1.0, ls=":", label="the program's own speed")
            if found.fastest is not None:
                axes.axvspan(min(speeds + none), found.fastest, color=COLOURS["structure"], alpha=0.08, lw=0)
                axes.set_title(f"within the tolerance up to {found.fastest:g} mm/s", loc="right")
            logarithmic(axes, "x", [*speeds, *none])
            if max(values) > _LOGARITHMIC_FROM * min(values):
                logarithmic(axes, "y", [*values, criterion.tolerance])
            else:
                axes.set_ylim(0, 1.1 * max(*values, criterion.tolerance))
            unit = criterion.unit(good[0])
            axes.set(xlabel="path speed of the program [mm/s]", ylabel=f"{criterion.label} [{unit}]" if unit else "")
            figure.legend(loc="outside lower center", ncols=5)
        return figure


def _speed(row: Row) -> float:
    speed = row["speed_mm_s"]
    assert isinstance(speed, float)
    return speed


def _saturation(good: list[Row]) -> list[str]:
    """Say from where on a faster program does not make the job shorter, where that was tried."""
    durations = {_speed(row): value for row in good if isinstance(value := row["duration_s"], float)}
    least = min(durations.values())
    enough = min(speed for speed, duration in durations.items() if duration <= _SATURATED * least)
    if enough == max(durations):
        return []
    return [
        f"From {enough:g} mm/s on a faster program does not make the job shorter than {least:.4g} s: ramps, clamps and "
        "the axes' limits set its speed."
    ]


def _outcome(row: Row, criterion: Criterion) -> str:
    """What came of a run, as a clause."""
    if row["status"] != OK:
        return f"the run ends ({row['status']})"
    return f"it is {criterion.value(row):.4g} {criterion.unit(row)}".rstrip()


def _mostly(row: Row) -> str:
    """Which link makes most of the error, as a sentence; nothing of a run without figures."""
    if row["status"] != OK:
        return ""
    sizes = {link: size for link in LINKS if isinstance(size := row[f"{link}_rms_um"], float)}
    most = max(sizes, key=lambda link: sizes[link])
    return f"Most of the error there is the {most} part, {sizes[most]:.3g} µm rms."


def _draw_links(good: list[Row]) -> Figure:
    from gantrysim.plots.style import COLOURS, sheet

    speeds = [_speed(row) for row in good]
    with sheet(9.0, 4.8) as figure:
        axes = figure.add_subplot()
        drawn: list[float] = []
        for link in (*LINKS, "contour"):
            values = np.array([row[f"{link}_rms_um"] for row in good], float)
            if values.max() < 1e-3:  # a link that does nothing has no place on a logarithmic scale
                continue
            values = np.maximum(values, 1e-3)
            drawn += values.tolist()
            if link == "contour":  # a broad band that the link which makes most of it is drawn on
                axes.plot(speeds, values, lw=7, alpha=0.25, color=COLOURS[link], label=link, zorder=1)
            else:
                axes.plot(speeds, values, "o-", ms=3.5, lw=1.4, color=COLOURS[link], label=link)
        logarithmic(axes, "x", speeds)
        logarithmic(axes, "y", drawn)
        axes.set(xlabel="path speed of the program [mm/s]", ylabel="error normal to the path, rms [µm]")
        figure.legend(loc="outside lower center", ncols=5)
    return figure
