"""The viewer of a run's page as a widget of a notebook, in Jupyter, VS Code and marimo."""

from __future__ import annotations

from importlib.resources import files

from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.glue.bead import Bead
from gantrysim.record.run import Run
from gantrysim.report.page import viewer_page
from gantrysim.results.run_results import RunResults

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
