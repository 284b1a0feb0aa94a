"""What the answer of a run, its headline and its card say of records whose errors are made."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from gantrysim import Job
from gantrysim.faults import EncoderSlip
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis, Range
from gantrysim.metrics.budget import Budget
from gantrysim.report.answer import Answer, Remedy
from gantrysim.report.card import HEIGHT, WIDTH, draw_card
from gantrysim.report.headline import contour_sentence, headline
from gantrysim.report.plots.style import sheet
from gantrysim.report.rows import gap_or_overlap
from gantrysim.report.summary import summary
from gantrysim.results.checks import Check, Row
from gantrysim.results.colours import STATES
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import Verdict

# one straight line from x = -80 to 80 mm
LINE = "G21 G17 G90 G94 G64\nG0 X-80 Y0\nM62 P0\nG1 X80 F6000\nM63 P0\nM2\n"
LIMIT = 0.1  # largest contour error [mm]


@pytest.fixture(scope="module")
def job():
    content = {
        "name": "line",
        "machine": "xyz",
        "program": {"controller": "linuxcnc.Program", "text": LINE},
        "dispenser": {"area": 2.0},
        "bead": {"squashed": False},
        "tolerance": {"path_max": LIMIT, "path_p95": LIMIT},
    }
    return Job.of_content(content, "job line")


@pytest.fixture(scope="module")
def follower(job):
    return job.follow()


def results_of(job, run):
    analysis = Analysis(run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis))


def moved(run, along=0.0, aside=0.0):
    """A run whose nozzle is off its command on the middle of the line [mm]."""
    nozzle = np.array(run.nozzle)
    middle = run.dispense & (np.abs(run.commanded_tip[:, 0]) < 40)
    nozzle[middle] += (along, aside, 0.0)
    return run.replaced(nozzle=nozzle)


@pytest.mark.parametrize(
    ("value", "at_least", "state", "also"),
    [
        (9.0, False, "warn", "90 % of its limit: warns above 80 %"),
        (12.0, True, "warn", "120 % of its limit: warns below 125 %"),
        (7.9, False, "pass", ""),
        (12.6, True, "pass", ""),
    ],
)
def test_a_row_that_warns_says_from_where_on(job, follower, value, at_least, state, also):
    """A value of at least 10 warns below 12.5, one of at most 10 above 8."""
    check = Check(name="a", quantity="a", value=value, limit=10.0, unit="%", source="given", at_least=at_least)
    results = results_of(job, follower)
    vars(results)["verdict"] = Verdict((Row.of("machine", [check]),))
    (row,) = Answer.of(results).rows
    assert (row.state, row.also) == (state, also)


def test_a_row_that_fails_names_what_else_does(job, follower):
    checks = [
        Check(name=name, quantity=name, value=value, limit=1.0, unit="mm", source="given", form=".2f")
        for name, value in (("a", 3.0), ("b", 2.0), ("c", 0.5))
    ]
    results = results_of(job, follower)
    vars(results)["verdict"] = Verdict((Row.of("glue", checks),))
    (row,) = Answer.of(results).rows
    assert (row.text, row.also) == ("a 3.00 mm, at most 1.00 mm", "also b 2.00 mm, at most 1.00 mm")


def test_an_error_along_the_path_is_told_where_it_is_larger_than_the_one_across(job, follower):
    for along, is_told in ((0.05, False), (0.2, True)):
        text = contour_sentence(results_of(job, moved(follower, along, 0.1)).budget)
        assert ("Along the path it is up to 200.0 µm from its command" in text) == is_told
        assert ("Along the path" in text) == is_told


@pytest.mark.parametrize(("share", "state"), [(0.5, "pass"), (0.9, "warn"), (1.5, "fail")])
def test_nothing_is_to_be_changed_of_a_pass_alone(job, follower, share, state):
    answer = Answer.of(results_of(job, moved(follower, aside=share * LIMIT)))
    assert answer.state == state
    assert (answer.remedy is not None) == (state == "pass")
    # that is the loop's stability, at half of the path's limit
    nearest = "Nothing. Nearest to its limit: stability, peak of |S| 1.65, 55 % of the limit."
    assert (answer.spoilt == nearest) == (state == "pass")
    assert answer.reply.partition(" ")[0] == {"pass": "Yes", "warn": "Barely", "fail": "No"}[state]


def test_the_headline_of_a_bead_that_is_too_wide_is_its_worst_value_alone(job, follower):
    """Shares, blobs and gaps stand in the verdict."""
    results = results_of(job, follower.replaced(flow=1.44 * follower.flow))
    check = results.verdict["glue"].checks[0]
    assert check.name == "bead_width"
    assert headline(results) == f"Glue: {check.brief}, {check.place.brief}."


def test_the_card_has_time_and_line_of_what_fails(job, follower):
    results = results_of(job, moved(follower, aside=1.5 * LIMIT))
    answer = Answer.of(results)
    with sheet(WIDTH / 100, HEIGHT / 100) as figure:
        figure.set_layout_engine("none")
        draw_card(figure, results, answer)
        texts = [text.get_text() for text in figure.texts]
        (bar,) = [
            artist for artist in figure.findobj(Rectangle) if artist.get_width() == 1 and artist.get_height() < 0.1
        ]
    # across the upper edge, in the colour of the state
    assert (bar.get_x(), bar.get_width(), bar.get_y() + bar.get_height()) == pytest.approx((0.0, 1.0, 1.0))
    assert 2 < bar.get_height() * HEIGHT < 20
    assert bar.get_facecolor() == to_rgba(STATES["fail"])
    # a number keeps its unit, and shapes of states stand between the lines
    words = " ".join(text for text in texts if len(text) > 1).replace("\xa0", " ")
    for row in answer.rows:
        text = f"{row.name}: {row.text}"
        assert text in words
        # a row that passes has no place that matters
        assert (f"{text}, {row.place}" in words) == bool(row.place and row.state != "pass")
    assert answer.rows[0].place.endswith("line 4")


def test_what_spoils_a_run_with_a_deliberate_fault_is_told_as_what_happened(job, follower):
    slip = EncoderSlip(time=1.0, axis="x", counts=500)
    results = results_of(job, moved(follower, aside=1.5 * LIMIT).replaced(injected=(slip,)))
    spoilt = Answer.of(results).spoilt
    assert spoilt == headline(results)
    assert "encoder slip" in spoilt.lower()


def test_turns_that_overlap_in_the_mean_are_said_to_overlap_though_they_do_not_everywhere():
    """Beside the name stands the size of the mean."""
    for mean, name in ((-0.2, "overlap between turns"), (0.2, "gap between turns")):
        values = Range(mean=mean, min=mean - 0.5, max=mean + 0.5, std=0.1)
        assert gap_or_overlap(values) == name


def test_the_summary_names_the_axes_whose_loops_are_unstable(job, follower):
    first, second, third = job.margins
    shaky = job.model_copy(update={"margins": (first, replace(second, stable=False), third)})
    assert summary(results_of(job, follower))["unstable_axes"] == []
    assert summary(results_of(shaky, follower))["unstable_axes"] == ["y"]
    unknown = job.model_copy(update={"margins": None})
    assert summary(results_of(unknown, follower))["unstable_axes"] is None


def test_lines_of_a_changed_program_are_told_from_those_that_stay():
    former = "G21\nG0 X0 Y0\nG1 X10 F600\nM2\n"
    text = "G21\nG0 X0 Y0 Z3\nG0 Z0\nG1 X10 F600\nM2\n"
    lines = f'[program]\ntext = """\n{text}"""\n\n[dispenser]\nadvance = 0.02\n'
    marked = Remedy("lift", lines=lines, former=former).marked_lines
    assert [line.text for line in marked] == lines.rstrip().split("\n")
    changes = [(line.text, line.change) for line in marked if line.is_changed]
    assert changes == [("G0 X0 Y0 Z3", "was G0 X0 Y0"), ("G0 Z0", "new")]
    assert not any(line.is_changed for line in Remedy("lift", lines=lines).marked_lines)


def test_lines_of_a_program_that_stay_are_grouped_where_they_are_many():
    former = "".join(f"G1 X{k}\n" for k in range(9))
    lines = f'[program]\ntext = """\n{former}G0 Z3\n"""\n'
    groups = Remedy("lift", lines=lines, former=former).groups
    assert [(is_left_out, len(part)) for is_left_out, part in groups] == [(False, 2), (True, 9), (False, 2)]
    assert "\n".join(line.text for _, part in groups for line in part) == lines.rstrip()
