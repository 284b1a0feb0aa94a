"""Studies: many runs of a job, what they say, and a report of it."""

from gantrysim.study.cases import OK, Case, Row, figures_row, measure, simulated
from gantrysim.study.ledger import Ledger
from gantrysim.study.runner import run_cases
from gantrysim.study.study import Outcome, Plot, Rounds, Study, StudyInterrupted, run_study

__all__ = [
    "OK",
    "Case",
    "Ledger",
    "Outcome",
    "Plot",
    "Rounds",
    "Row",
    "Study",
    "StudyInterrupted",
    "figures_row",
    "measure",
    "run_cases",
    "run_study",
    "simulated",
]
