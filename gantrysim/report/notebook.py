"""The viewer of a run's page as a widget of a notebook, in Jupyter, VS Code and marimo."""

from __future__ import annotations

import base64
import io
from importlib.resources import files

from gantrysim.base import memory
from gantrysim.base.display import picture_html
from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.glue.bead import Bead
from gantrysim.record.run import Run
from gantrysim.report.page import viewer_page
from gantrysim.report.plots.laid import draw_laid
from gantrysim.report.plots.style import common_style, sheet
from gantrysim.results.run_results import RunResults

_WIDE = 4.6  # [inch]
_HIGH = 3.2
_DPI = 100


with extra("notebook", "run.view"):
    import anywidget
    import traitlets


class RunView(anywidget.AnyWidget):
    """A run's verdict with its viewer: bead, path, strips and program on one cursor.

    Attributes:
        page: the page in HTML, self-contained.
        title: of the page.
    """

    _esm = (files("gantrysim.report") / "web" / "widget.mjs").read_text(encoding="utf-8")
    page = traitlets.Unicode().tag(sync=True)
    title = traitlets.Unicode().tag(sync=True)


def run_view(run: Run) -> RunView:
    """Return the widget of a run.

    Raises:
        InputError: the run has neither a job nor a rig, or its dispenser is never on.
    """
    basis = run.known_basis("view")
    if not run.dispense.any():
        raise InputError("run.view: the dispenser is never on: there is no bead to be viewed")
    bead = Bead(run, basis.bead, run.budget.analysis)
    page = viewer_page(RunResults(basis, basis.built_machine, run.budget, bead))
    return RunView(page=page.html(), title=page.title)


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
    with sheet(_WIDE, _HIGH) as figure, common_style():
        draw_laid(figure, results, text_size=8.0)
        figure.savefig(file, format="jpeg", dpi=_DPI, pil_kwargs={"quality": 80})
    data = base64.b64encode(file.getvalue()).decode("ascii")
    size = f'width="{_DPI * _WIDE:.0f}" height="{_DPI * _HIGH:.0f}"'
    return f'<img src="data:image/jpeg;base64,{data}" alt="the bead in plan view" {size}/>'
