"""What stands on the plots of runs, studies, comparisons and tables of the command, and what is drawn there."""

import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from pinned.runs import JOBS, digits, results_of
from pinned.studies import STUDIES

from gantrysim import Job
from gantrysim.cli.info import encoders_table, gains_table, glue_table, margins_table
from gantrysim.report.answer import Answer
from gantrysim.report.card import HEIGHT, WIDTH, draw_card
from gantrysim.report.plots.pictures import run_plots
from gantrysim.report.plots.style import sheet
from gantrysim.study.circle.study import CircleStudy
from gantrysim.study.machine.study import MachineStudy
from gantrysim.study.run import run_study
from gantrysim.study.speed.study import SpeedStudy

from support.blank_pictures import save_blank
from support.remedies import AREA, SIDES, lines_job

MOST_LINES = 12  # of a panel of which each is pinned


def line_of(line):
    """Label, colour and dashes of a line, and the means of its points."""
    x, y = (np.asarray(values, float) for values in line.get_data())
    label = line.get_label()
    known = np.isfinite(x) & np.isfinite(y)
    means = [float(values[known].mean()) if known.any() else 0.0 for values in (x, y)]
    return ["" if label.startswith("_") else label, to_hex(line.get_color()), line.get_linestyle(), *means]


def panel_of(axes):
    legend = axes.get_legend()
    titles = [axes.get_title(loc=place) for place in ("left", "center", "right")]
    content = {
        "titles": [title for title in titles if title],
        "labels": [axes.get_xlabel(), axes.get_ylabel()],
        "limits": [*axes.get_xlim(), *axes.get_ylim()],
        "scales": [axes.get_xscale(), axes.get_yscale()],
        "legend": [] if legend is None else [text.get_text() for text in legend.get_texts()],
        "remarks": [text.get_text() for text in axes.texts if text.get_visible() and text.get_text()],
        "lines": [line_of(line) for line in axes.lines[:MOST_LINES]],
        "drawn": [len(axes.lines), len(axes.patches), len(axes.collections), len(axes.images)],
    }
    return {key: value for key, value in content.items() if value}


def figure_of(figure: Figure):
    return {
        "size": figure.get_size_inches().tolist(),
        "texts": [text.get_text() for text in figure.texts if text.get_text()],
        "panels": [panel_of(axes) for axes in figure.axes],
    }


def run_answer(job):
    results = results_of(job)
    plots = run_plots(results.budget, results.bead, results.verdict.placed_check)
    return digits({plot.name: figure_of(plot.figure()) for plot in plots}, 3)


def card_answer(job):
    results = results_of(job)
    with sheet(WIDTH / 100, HEIGHT / 100) as figure:
        figure.set_layout_engine("none")
        draw_card(figure, results, Answer.of(results))
        texts = [[*text.get_position(), text.get_fontsize(), text.get_text()] for text in figure.texts]
    # the date stands last
    return digits(texts[:-1], 3)


def study_answer(study):
    blank = patch("matplotlib.figure.Figure.savefig", save_blank)
    with blank, tempfile.TemporaryDirectory() as folder:
        report = run_study(study, Path(folder) / "study", workers=1).report
    plots = {plot.name: {"title": plot.title, "text": plot.text, **figure_of(plot.figure)} for plot in report.plots}
    return digits({"question": report.question, "answer": report.answer, **plots}, 3)


def cells_of(table):
    return [[str(cell) for cell in column.cells] for column in table.columns]


def square(**tables):
    return lines_job(SIDES, dispenser={"area": AREA}, **tables)


CASES = {f"run, {name}": lambda name=name: run_answer(JOBS[name]()) for name in ("fixed flow", "spiral", "geometry")}
CASES |= {f"card, {name}": lambda name=name: card_answer(JOBS[name]()) for name in ("fixed flow", "dots")}
CASES |= {
    "run, rotary": lambda: run_answer(Job.load("stage-outline")),
    "study, speed": lambda: study_answer(SpeedStudy(square(), resolution=0.3)),
    "study, machine": lambda: study_answer(MachineStudy(square(), samples=12)),
    "study, circle": lambda: study_answer(CircleStudy("xy", radius=10.0, speed=60.0)),
}
CASES |= {f"study, {name}": lambda name=name: study_answer(STUDIES[name]()) for name in ("laws", "loop", "repeat")}
TABLES = {"gains": gains_table, "margins": margins_table, "encoders": encoders_table, "glue": glue_table}
CASES |= {f"table, {name}": lambda table=table: cells_of(table()) for name, table in TABLES.items()}
