"""The page of a run: its sections, its viewer's data, and where titles, legends and panels of its figures lie."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from pinned.runs import JOBS, RUNS, digits

from gantrysim.base.quantity import Quantity
from gantrysim.job.scatter import Figure as ScatterFigure
from gantrysim.job.scatter import Scatter
from gantrysim.remedy.levers import LEVERS
from gantrysim.report.answer import Answer, Remedy
from gantrysim.report.card import HEIGHT, WIDTH, draw_card
from gantrysim.report.document import Changes, Column, Section, Table, lead_of
from gantrysim.report.encoding import encoded_ascending, encoded_numbers, encoded_runs, packed, shown_rows
from gantrysim.report.figures import description, inline_svg, section_name
from gantrysim.report.page import in_order, run_sections, viewer_page
from gantrysim.report.plots.bead import draw_laid
from gantrysim.report.plots.pictures import HALF_HEIGHT, PLOT_WIDTH, Plot, run_plots
from gantrysim.report.plots.plan import magnification, overview
from gantrysim.report.plots.style import draw_limit, sheet, thinned_line, turn_colours, view_height
from gantrysim.report.scatter import rows_of, scatter_section, scatter_summary
from gantrysim.report.viewer_data import ViewerData, pose_ticks
from gantrysim.report.writing import results_of

from support.remedies import SIDES, lines_job, spiral_job
from support.viewer_jobs import climbing_job, viewer_job

LEFT_OUT = ("Job", "Versions")  # paths and versions
# further sections that are left out: one run's servo is enough, and what lies under a nozzle at rest is no bead
UNLIKE = {"turns": (), "faulted": ("Servo", "Bead")}
NOTHING = {"text": [], "facts": [], "tables": [], "code": None}

REMEDY = Remedy(
    "feed × 0.84, advance 30 ms",
    "pass, 12.3 s (+1.2 s)",
    'feed = 84\ntext = """\nG1 X1\nG1 X2\nG1 X3\nG1 X4\nG1 Y5 F10\nG4 P1\nM2"""\n[dispenser]\nadvance = 0.03\n',
    former="G1 X1\nG1 X2\nG1 X3\nG1 X4\nG1 Y5\nG1 Y6\nM2\n",
    sentence="Then every value keeps its limit.",
)
SHORT = replace(REMEDY, lines='text = """\nG1 X1\nG1 X2\nG1 X9\nG1 X4\n"""\n')


@cache
def results_in(name):
    """Results of a small job; those of the first two with their causes."""
    job = {
        **JOBS,
        "clogged": lambda: lines_job(SIDES, **RUNS["clogged"]),
        "faulted": lambda: lines_job(SIDES, **RUNS["too much torque"]),
        "turns": lambda: spiral_job(turns=3, diameter=40.0, thickness=4.0, loop_period=0.02),
        "viewed": viewer_job,
        "climbing": climbing_job,
    }[name]()
    return results_of(job, job.run(), causes=name in ("fixed flow", "soft"))


def drawings_of(section):
    """Size of each figure of a section, and whether the viewer replaces it [inch]."""
    sizes = []
    for content, still in ((section.figure, False), (section.still, True)):
        for drawing in content if isinstance(content, list | tuple) else [content] if content is not None else []:
            if isinstance(drawing, Plot):
                sizes.append([drawing.name, drawing.width, drawing.height, drawing.columns, drawing.resolution, still])
            else:
                sizes.append([*drawing().get_size_inches().tolist(), still])
    return sizes


def page_answer(name):
    results = results_in(name)
    changes = Changes(REMEDY, Section("What to change", "Slower.")) if name == "soft" else None
    sections = in_order(run_sections(results, changes=changes))
    page = viewer_page(results)
    content = {}
    for section in sections:
        found = {key: value for key, value in section.content().items() if NOTHING.get(key, value) != value}
        is_out = section.title in (*LEFT_OUT, *UNLIKE.get(name, ("Servo",)))
        kept = {} if is_out else {key: value for key, value in found.items() if key != "title"}
        content[section.title] = {"folded": section.folded, "drawings": drawings_of(section), **kept}
    return digits({"title": page.title, "subtitle": page.subtitle, "warning": page.warning or "", **content}, 3)


def answer_of(name, remedy=None):
    answer = Answer.of(results_in(name), remedy)
    return {
        "reply": answer.reply,
        "title": answer.title,
        "rows": [" | ".join(filter(None, vars(row).values())) for row in answer.rows],
        "spoilt": answer.spoilt,
        "also": answer.also_spoilt,
    }


def remedy_answer(remedy):
    return {
        "marked": [f"{line.text} <{line.change}> {line.is_changed}" for line in remedy.marked_lines],
        "groups": [[stays, len(lines)] for stays, lines in remedy.groups],
        "content": remedy.content(),
    }


# where things lie on figures that are laid out, but not rendered


def box_of(artist, figure):
    """Place of an artist, from the lower left corner of its figure [inch]."""
    box = artist.get_window_extent()
    return [float(edge) / figure.dpi for edge in (box.x0, box.y0, box.x1, box.y1)]


def layout_of(figure):
    figure.draw_without_rendering()
    panels = []
    for axes in figure.axes:
        legend = axes.get_legend()
        places = {
            "panel": box_of(axes, figure),
            "legend": [] if legend is None else box_of(legend, figure),
            "titles": [box_of(title, figure) for title in axes.findobj(is_title(axes))],
            "remarks": [[text.get_text(), *box_of(text, figure)] for text in axes.texts if text.get_text()],
            "ticks": [len(axes.get_xticks()), len(axes.get_yticks())],
        }
        panels.append({name: place for name, place in places.items() if place})
    legends = [box_of(legend, figure) for legend in figure.legends]
    return digits({"panels": panels, "legends": legends, "texts": [box_of(text, figure) for text in figure.texts]}, 3)


def is_title(axes):
    """What finds the titles of a panel that are not empty."""
    titles = {axes.get_title(loc=place) for place in ("left", "center", "right")} - {""}
    return lambda artist: getattr(artist, "get_text", str)() in titles


def layouts_answer(name, wanted):
    results = results_in(name)
    plots = run_plots(results.budget, results.bead, results.verdict.placed_check)
    return {plot.name: layout_of(plot.figure()) for plot in plots if plot.name in wanted}


def sections_answer(name):
    """Figures that the page alone has."""
    sections = run_sections(results_in(name))
    drawn = {section.title: section.figure for section in sections if section.title not in LEFT_OUT}
    figures = {title: figure if isinstance(figure, list) else [figure] for title, figure in drawn.items()}
    return {
        title: [layout_of(draw()) for draw in draws if callable(draw)]
        for title, draws in figures.items()
        if any(map(callable, draws))
    }


def laid_answer(name):
    with sheet(6.6, 5.2) as figure:
        draw_laid(figure, results_in(name))
    return layout_of(figure)


def overview_answer(name):
    figure = overview(results_in(name).budget)
    return {"size": figure.get_size_inches(), **layout_of(figure)}


def card_answer(words):
    """A card whose texts are so long: size and place of each line, and of the shapes."""
    results = results_in("fixed flow")
    answer = Answer.of(results, replace(REMEDY, change=" ".join(["slower"] * words)))
    with sheet(WIDTH / 100, HEIGHT / 100) as figure:
        figure.set_layout_engine("none")
        draw_card(figure, results, answer)
    lines = [[*text.get_position(), text.get_fontsize(), text.get_weight(), text.get_color()] for text in figure.texts]
    shapes = [
        [*np.ravel(line.get_data()), line.get_marker(), line.get_markersize()]
        for line in figure.artists
        if isinstance(line, Line2D)
    ]
    bars = [
        [*patch.get_xy(), patch.get_width(), patch.get_height()]
        for patch in figure.artists
        if isinstance(patch, Rectangle)
    ]
    panels = [axes.get_position().bounds for axes in figure.axes]
    return digits(
        {"count": len(lines), "first": lines[:3], "last": lines[-3:], "shapes": shapes, "bars": bars, "panels": panels},
        4,
    )


def limits_answer():
    """Axis of errors from -10 to 40 with limits on and beyond its scale."""
    answer = []
    for limit in (3.0, 45.0, 160.0, 161.0):
        for signed in (True, False):
            with sheet(4.0, 3.0) as figure:
                axes = figure.add_subplot()
                axes.set_ylim(-10.0, 40.0)
                draw_limit(axes, limit, signed)
            texts = [[*text.get_position(), text.get_text()] for text in axes.texts]
            answer.append([[*axes.get_ylim()], [[line.get_label(), line.get_ydata()[0]] for line in axes.lines], texts])
    return answer


def small_figure():
    with sheet(4.0, 2.5) as figure:
        left, right = figure.subplots(1, 2)
        left.plot([0.0, 1.0, 2.0], [0.0, 1.5, -0.25], label="a line")
        left.plot([0.0, 2.0], [1.0, 1.0], label="_")
        left.set(xlabel="x [mm]", ylabel="y [µm]", title="Title")
        right.set_title("Right", loc="right")
    return figure


def svg_answer():
    figure = small_figure()
    svg = inline_svg(figure, "part", 'a "small" figure')
    return {
        "head": svg[: svg.index("</title>")],
        "size": [svg.count("<path"), svg.count("<use"), svg.count("<text"), svg.count("currentColor"), len(svg)],
        "path": [part.split('"')[0] for part in svg.split(' d="')[1:4]],
        "description": description(figure),
    }


def numbers_answer():
    wave = np.sin(np.linspace(0.0, 3.0, 40))
    jumps = np.where(np.arange(40) % 3 == 0, wave, -wave)
    gaps = np.where(np.arange(40) % 7 == 0, np.nan, wave)
    return {
        "wave": encoded_numbers(wave),
        "coarse wave": encoded_numbers(wave, 0.01),
        "jumps": encoded_numbers(jumps),
        "coarse jumps": encoded_numbers(jumps, 0.02),
        "gaps": encoded_numbers(gaps, 0.05),
        "constant": encoded_numbers(np.full(3, 2.5), 0.1),
        "none": encoded_numbers(np.full(3, np.nan)),
        "rows": [encoded_ascending(np.array(rows)) for rows in ([0, 1, 2, 5], [0, 300, 301, 70_000])],
        "runs": encoded_runs(np.array([0, 0, 3, 3, 3, 1])),
        "packed": packed("text " * 20),
    }


def shown_answer():
    """Rows that are shown of a long column with a peak and a pit, beside a state that changes."""
    values = np.cos(np.linspace(0.0, 40.0, 5000))
    values[1234] = 9.0
    values[4321] = -9.0
    state = np.arange(5000) > 2500
    answer = []
    for count, most in ((1, 400), (2, 400), (1, 5000), (1, 40)):
        rows = shown_rows(5000, [(None, values)], count, [state], most)
        answer.append([int(rows.size), rows[:4], rows[-4:], [bool(np.isin(k, rows)) for k in (1234, 2500, 2501, 4321)]])
    places = np.arange(0, 5000, 2)
    rows = shown_rows(5000, [(places, values[::2])], 1, [], 400)
    return [*answer, [int(rows.size), float(rows.mean())], pose_ticks(SimpleNamespace(time=np.arange(50)), 7)]


def scatter_answer():
    def figure(name, unit, nominal, mean, std, low=None, high=None):
        quantity = Quantity(name, label=name, unit=unit, form=".2f", meaning="", path=())
        ends = (mean - 2 * std if low is None else low, mean + 2 * std if high is None else high)
        return ScatterFigure(quantity, nominal, mean, std, *ends, 16)

    figures = {
        "coarse": figure("coarse", "µm", 123.4, 130.2, 60.0),
        "fine": figure("fine", "µm", 1.234, 1.3, 0.02),
        "finer": figure("finer", "mm", 0.0013, 0.00129, 1e-6),
        "finest": figure("finest", "mm", 1.3e-5, 1.29e-5, 0.0),
        "one": figure("one", "µm", 1.0, 1.0, 0.4),
        "none": figure("none", "µm", 0.0, 0.0, 0.0),
        "below": figure("below", "µm", -0.5, -0.6, 0.1),
    }
    scatter = Scatter(figures, 16, 3, {"x": 0.0012345, "y": 0.0}, 2)
    return {
        "rows": [" | ".join(row) for row in rows_of(scatter)],
        "section": scatter_section(scatter).content()["text"],
        "summary": scatter_summary(scatter)["figures"]["fine"],
    }


def words_answer():
    texts = [
        "One sentence. Another one.",
        " ".join(["word"] * 31),
        f"{' '.join(['word'] * 12)}, and then: {' '.join(['word'] * 25)}.",
        f"Short; {' '.join(['word'] * 20)}, {' '.join(['word'] * 20)}.",
        f"{' '.join(['word'] * 9)} (a, b; c) {' '.join(['word'] * 9)}, {' '.join(['word'] * 20)}.",
    ]
    table = Table(
        ["", "text", Column("number", ".2f"), Column("count")],
        [["a", "1", -1.234, -3], ["b", None, None, 4], ["c", True, float("nan"), 1e-7]],
        colours={"a": "#123456"},
    )
    return {
        "leads": [lead_of(text) for text in texts],
        "names": [section_name(title) for title in ("Bead and path", "x, y [µm]", "…")],
        "cells": table.cells,
        "numeric": table.numeric,
        "marks": [table.mark("a"), table.mark("b")],
    }


def levers_answer():
    return {
        lever.name: [lever.meaning, lever.cost, lever.cost_above, lever.rows, lever.causes, lever.effort]
        for lever in LEVERS
    }


def style_answer():
    x = np.arange(5000.0)
    y = np.where(np.arange(5000) % 999 == 7, np.nan, np.sin(0.01 * x))
    thin = [thinned_line(x, y, columns) for columns in (2000, 1000, 50)]
    return {
        "heights": [view_height(*size, 7.6) for size in ((100, 100), (100, 5), (10, 100), (100, 60), (0, 1))],
        "thinned": [[int(a.size), int(np.isnan(b).sum()), float(a.sum())] for a, b in thin],
        "turns": turn_colours(3),
        "widths": [PLOT_WIDTH, HALF_HEIGHT],
        "magnifications": [
            magnification(results_in(name).budget.analysis) for name in ("fixed flow", "soft", "spiral")
        ],
    }


# the viewer


def column_size(column):
    return {key: len(value) if isinstance(value, str) and key != "kind" else value for key, value in column.items()}


def viewer_answer(name, **options):
    content = ViewerData(results_in(name), **options).content()
    columns = {key: column_size(column) for key, column in content.pop("columns").items()}
    space = content.pop("space")
    solids = content.pop("solids")
    if space is not None:
        parts = [
            [part["name"], [column_size(c) if isinstance(c, dict) else c for c in part["pose"]]]
            for part in space["parts"]
        ]
        space = {"gap": space["gap"], "poses": space["poses"], "first": parts[:1], "last": parts[-1:]}
        solids = [[len(part), part[0]] for part in solids]
    return digits({**content, "columns": columns, "space": space, "solids": solids}, 3)


CASES = {
    f"page, {name}": lambda name=name: page_answer(name) for name in ("soft", "turns", "dots", "clogged", "faulted")
}
CASES |= {
    f"answer, {name}": lambda name=name: answer_of(name) for name in ("fixed flow", "soft", "geometry", "faulted")
}
CASES |= {"answer, remedy known": lambda: answer_of("fixed flow", REMEDY)}
CASES |= {"remedy": lambda: remedy_answer(REMEDY), "remedy, short": lambda: remedy_answer(SHORT)}
CASES |= {
    "layout, fixed flow": lambda: layouts_answer("fixed flow", ("plan", "error", "budget", "bead")),
    "layout, turns": lambda: layouts_answer("turns", ("spacing", "budget")),
    "layout, sections of turns": lambda: sections_answer("turns"),
    "layout, dots laid": lambda: laid_answer("dots"),
    "layout, overview": lambda: overview_answer("soft"),
}
CASES |= {f"card, {words} words": lambda words=words: card_answer(words) for words in (5, 60, 90, 150, 250, 400)}
CASES |= {
    "limits": limits_answer,
    "svg": svg_answer,
    "numbers": numbers_answer,
    "rows": shown_answer,
    "scatter": scatter_answer,
    "words": words_answer,
    "levers": levers_answer,
    "style": style_answer,
}
CASES |= {f"viewer, {name}": lambda name=name: viewer_answer(name) for name in ("viewed", "climbing", "dots")}
CASES |= {"viewer, coarse": lambda: viewer_answer("viewed", most=60)}
