"""The content of the viewer of a comparison: the columns of all runs at the places that any of them shows.

A row is a place on the common abscissa. Each run is thinned so that the extremes of each of its columns remain
(`gantrysim.report.encoding`); at the rows of another run its values are interpolated between its samples.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM
from gantrysim.compare.runs.common_path import Track
from gantrysim.compare.runs.compared_run import RUN_DASHES, ComparedRun
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.compare.runs.overlays import drawn_links, shared_magnification
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import path_speed
from gantrysim.metrics.budget import DESCRIPTIONS
from gantrysim.report.encoding import MOST_ROWS, encoded_numbers, shown_rows
from gantrysim.report.viewer_data import BEAD, ERROR, MOTION, bead_height
from gantrysim.results.colours import INK, RUNS

_DIGITS = 4  # significant, of a quantity's largest value
_LEVEL_HEIGHT = 1e-6  # [mm], height above which a run leaves its plane
_PLACE_COLUMNS = ("x", "y", "z", "dx", "dy", "height", "time")  # columns without a strip

# quantities of the strips: label, unit, group, meaning
Strip = tuple[str, str, str, str]


class OverlayData:
    """The columns of a comparison for its page.

    Args:
        comparison: of runs.
        most: about the largest number of rows.
        in_space: whether there is a 3-D view, which needs heights.
    """

    def __init__(self, comparison: ComparedRuns, most: int = MOST_ROWS, *, in_space: bool = False) -> None:
        self.comparison = comparison
        self._most = most // len(comparison.runs)
        self._in_space = in_space

    @property
    def strips(self) -> dict[str, Strip]:
        """The quantities that are drawn, by name."""
        strips: dict[str, Strip] = {
            name: (name, "µm", ERROR, DESCRIPTIONS[name]) for name in ("contour", *drawn_links(self.comparison))
        }
        if any(_bead(run) is not None for run in self.comparison.runs):
            strips["width"] = ("bead width", "mm", BEAD, "of the bead laid")
        strips["speed"] = ("path speed", "mm/s", MOTION, "of the nozzle")
        return strips

    def _columns(self, run: ComparedRun) -> Iterator[tuple[str, Floats]]:
        """Yield the columns of a run while its dispenser is on, (m,) each."""
        analysis = run.analysis
        ticks = analysis.ticks
        budget = run.results.budget
        for axis, name in enumerate("xy"):
            yield name, analysis.run.nozzle[ticks, axis]
            yield f"d{name}", analysis.nozzle.offset[:, axis]
        yield "time", analysis.run.time[ticks]
        for name, part in {"contour": budget.contour, **budget.parts}.items():
            yield name, UM * part.lateral
        if budget.corner is not None:
            yield "corner", UM * budget.corner.lateral
        bead = _bead(run)
        if bead is not None:
            yield "width", np.interp(bead.length[ticks], bead.place, bead.width)
            if self._in_space:
                yield "height", bead_height(bead, ticks)
        if self._in_space and np.ptp(analysis.run.nozzle[ticks, 2]) > _LEVEL_HEIGHT:
            yield "z", analysis.run.nozzle[ticks, 2]
        yield "speed", path_speed(analysis.run)[ticks]

    def columns(self) -> tuple[Floats, list[dict[str, Floats]]]:
        """Return the places of the rows, ascending, (p,), and the columns of each run there, NaN where it has none."""
        tables = [dict(self._columns(run)) for run in self.comparison.runs]
        tracks = self.comparison.tracks
        shown = [_shown_samples(track, table, self._most) for track, table in zip(tracks, tables, strict=True)]
        places = np.concatenate([track.place[rows] for track, rows in zip(tracks, shown, strict=True)])
        source = np.concatenate([np.full(rows.size, number) for number, rows in enumerate(shown)])
        samples = np.concatenate(shown)
        order = np.argsort(places, kind="stable")
        # a place that several runs have, as where they are the same, is one row
        if self._are_alike(shown):
            order = order[source[order] == 0]
        columns = []
        for number, (track, table) in enumerate(zip(tracks, tables, strict=True)):
            exact = np.flatnonzero(source[order] == number)
            at_rows = partial(_at_rows, track, places[order], exact, samples[order][exact])
            columns.append({name: at_rows(values) for name, values in table.items()})
        return places[order], columns

    def _are_alike(self, shown: list[NDArray[np.intp]]) -> bool:
        """Return whether all runs show the same places, each once."""
        places = [track.place[rows] for track, rows in zip(self.comparison.tracks, shown, strict=True)]
        return all(np.array_equal(places[0], other) for other in places[1:]) and bool(np.all(np.diff(places[0]) > 0))

    def _worst_row(self, places: Floats) -> int | None:
        """Return the row where the first run is worst by its verdict; None where it passes, or no place is known."""
        verdict = self.comparison.verdicts[0]
        place = verdict.worst_place
        if verdict.worst_row is None or place is None or place.time is None:
            return None
        track = self.comparison.tracks[0]
        times = self.comparison.runs[0].analysis.run.time[track.ticks]
        return int(np.abs(places - track.place[np.abs(times - place.time).argmin()]).argmin())

    def content(self) -> dict[str, Any]:
        """Return what the viewer reads: columns, runs, quantities, nominal values and tolerances."""
        comparison = self.comparison
        places, columns = self.columns()
        strips = self.strips
        coded = {"place": encoded_numbers(places)}
        for number, table in enumerate(columns):
            for name, values in table.items():
                if name in strips or name in _PLACE_COLUMNS:
                    coded[f"{name}.{number}"] = encoded_numbers(values)
        return {
            "rows": int(places.size),
            "gaps": self._gaps(),
            "worst": self._worst_row(places),
            "by_path": comparison.by_path,
            "columns": coded,
            "runs": [
                {"name": name, "colour": None if colour == INK else colour, "dash": dash}
                for name, colour, dash in zip(comparison.names, RUNS, RUN_DASHES, strict=False)
            ],
            "quantities": [
                {
                    "name": name,
                    "label": label,
                    "unit": unit,
                    "group": group,
                    "meaning": meaning,
                    "decimals": _decimals([table[name] for table in columns if name in table]),
                }
                for name, (label, unit, group, meaning) in strips.items()
            ],
            "magnification": shared_magnification(comparison),
            "path_tolerance": _shared_value(
                [None if v.tolerance is None else UM * v.tolerance.path_max for v in comparison.verdicts]
            ),
            "width": _shared_value([_nominal_width(run) for run in comparison.runs]),
            "width_tolerance": _shared_value(
                [None if v.tolerance is None else v.tolerance.bead_width for v in comparison.verdicts]
            ),
        }

    def _gaps(self) -> list[float] | None:
        """Return the gap between nozzle and surface of each run [mm]; None without a 3-D view."""
        if not self._in_space:
            return None
        beads = [(run, _bead(run)) for run in self.comparison.runs]
        return [run.analysis.run.gap if bead is None else bead.gap for run, bead in beads]

    def text(self) -> str:
        """Return the content as JSON that may stand in an HTML script element."""
        return json.dumps(self.content(), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _bead(run: ComparedRun) -> Bead | None:
    bead = run.results.bead
    return bead if bead is not None and bead.nominal > 0 else None


def _nominal_width(run: ComparedRun) -> float | None:
    bead = _bead(run)
    return None if bead is None else float(bead.nominal_section.width[0])


def _shared_value(values: list[float | None]) -> float | None:
    """Return a value that all runs have; None where they differ."""
    first = values[0]
    return first if all(value == first for value in values) else None


def _shown_samples(track: Track, table: dict[str, Floats], most: int) -> NDArray[np.intp]:
    """Return the samples of a run that are shown: the extremes of every column, and both sides of every gap."""
    gap = np.concatenate([[0], np.cumsum(np.diff(track.ticks) > 1)])
    return shown_rows(track.ticks.size, ((None, values) for values in table.values()), len(table), [gap], most)


def _at_rows(
    track: Track, places: Floats, exact: NDArray[np.intp], samples: NDArray[np.intp], values: Floats
) -> Floats:
    """Return values of a run at the rows: its own samples as they are, between them interpolated."""
    rows = track.at(places, values)
    rows[exact] = values[samples]
    return rows


def _decimals(columns: list[Floats]) -> int:
    largest = max((float(np.nanmax(np.abs(values), initial=0.0)) for values in columns), default=0.0)
    whole = 0 if largest < 1e-9 else int(np.floor(np.log10(largest))) + 1
    return int(np.clip(_DIGITS - whole, 1, 3))
