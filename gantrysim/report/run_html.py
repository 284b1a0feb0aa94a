"""A run for a notebook: the bead, coloured by what spoils it, beside the verdict."""

from __future__ import annotations

import base64
import io

from gantrysim.base import memory
from gantrysim.base.display import picture_html
from gantrysim.glue.bead import Bead
from gantrysim.record.run import Run
from gantrysim.report.plots.bead import draw_laid
from gantrysim.report.plots.style import common_style, sheet
from gantrysim.results.run_results import RunResults

_WIDE_FIGURE = 4.6  # [inch]
_HIGH = 3.2
_DPI = 100


def run_html(run: Run, table: str) -> str:
    """Return a run in HTML: a picture and its verdict; of a run that is not judged within moments its facts.

    Args:
        run: the run.
        table: of its facts, in HTML.
    """
    # a long run, or one that states no progress, takes seconds to minutes
    is_quick = "verdict" in vars(run) or (len(run) <= memory.LONG_RUN and run.progress is not None)
    verdict = run.known_verdict if is_quick else None
    if verdict is None or run.basis is None:
        return table
    text = verdict._repr_html_()
    if verdict.unjudged:
        return text
    basis = run.basis
    bead = Bead(run, basis.bead, run.budget.analysis)
    return picture_html(_picture(RunResults(basis, basis.built_machine, run.budget, bead)), text)


def _picture(results: RunResults) -> str:
    """Return the bead as an element with a JPEG picture in it."""
    file = io.BytesIO()
    with sheet(_WIDE_FIGURE, _HIGH) as figure, common_style():
        draw_laid(figure, results, text_size=8.0)
        figure.savefig(file, format="jpeg", dpi=_DPI, pil_kwargs={"quality": 80})
    data = base64.b64encode(file.getvalue()).decode("ascii")
    size = f'width="{_DPI * _WIDE_FIGURE:.0f}" height="{_DPI * _HIGH:.0f}"'
    return f'<img src="data:image/jpeg;base64,{data}" alt="the bead in plan view" {size}/>'
