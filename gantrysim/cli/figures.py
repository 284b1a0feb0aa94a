"""The figures of a run's page and its plots, drawn on two cores."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from gantrysim.base import memory
from gantrysim.base.beside import beside
from gantrysim.cli.terminal import share_bar
from gantrysim.report.figures import Figures, figures_ahead
from gantrysim.results.run_results import RunResults

FiguresByTitle = dict[str, Figures]


def figures_beside(results: RunResults, folder: Path) -> AbstractContextManager[Callable[[], FiguresByTitle | None]]:
    """Draw figures and plots in a copy of this process, beside the block.

    Gives a function that waits for the figures; it returns None where they remain to be drawn.

    Args:
        results: of the run, with all that has figures.
        folder: for the plots.
    """

    def draw() -> FiguresByTitle:
        from gantrysim.report.page import sections_with_figures  # imports what only the copy needs

        return figures_ahead(sections_with_figures(results), folder)

    return nullcontext(lambda: None) if _is_long(results) else beside(draw)


def draw_figures(results: RunResults, folder: Path, go_on: Callable[[], None]) -> FiguresByTitle:
    """Draw figures and plots, every other section's in a copy of this process.

    Args:
        results: of the run.
        folder: for the plots.
        go_on: raises an interrupt that has come.
    """
    is_long = _is_long(results)
    with nullcontext() if is_long else memory.starting():  # which would keep what a long run leaves behind
        import matplotlib.figure  # noqa: F401  # slow: once for both processes

        from gantrysim.report.page import sections_with_figures

    sections = sections_with_figures(results)
    here, there = (sections, []) if is_long else (sections[::2], sections[1::2])
    with (
        beside(partial(figures_ahead, there, folder)) if there else nullcontext(lambda: None) as others,
        share_bar("plots", go_on) as advance,
    ):
        figures = figures_ahead(here, folder, advance)
        return figures | (others() or figures_ahead(there, folder))


def _is_long(results: RunResults) -> bool:
    """Return whether figures of a run take so much memory that there is none for a copy."""
    return len(results.budget.analysis.run.time) > memory.LONG
