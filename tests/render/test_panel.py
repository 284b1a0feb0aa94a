"""Telemetry, error strip, panel and headers of a film against the record."""

import dataclasses
import re
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Fault, InputError, Job
from gantrysim.base import columns, memory
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.machine.machine import model_file
from gantrysim.metrics.analysis import Analysis, path_speed
from gantrysim.render.colours import Scale, scale_for
from gantrysim.render.fonts import MUTED, PAPER, font, rgb
from gantrysim.render.header import Header, differences, headers
from gantrysim.render.panel import Panel, run_colours
from gantrysim.render.strip import Strip, axis_ticks
from gantrysim.render.telemetry import Telemetry
from gantrysim.report.plots.style import COLOURS
from gantrysim.results.colours import INK, MAGNITUDE

from support.films import SHAPES, cut, shows, small_job
from support.soaked import suite_runs

LETTERS = 16
SIZE = (600, 120)
FRAME = (960, 720)
PIXEL = 1.0  # within which a curve lies where it should
LABELLED = 0.005  # of its scale, to which a label is exact
GREY = COLOURS["requested"]
FAULT = Fault("following error", "x", 1.25, 5.02, 5.0, "mm", "the group stops with its greatest deceleration")


@pytest.fixture(scope="module")
def run():
    return small_job().run()


@pytest.fixture(scope="module")
def telemetry(run):
    return Telemetry(run)


@pytest.fixture(scope="module")
def strip(telemetry):
    return Strip([telemetry], [INK], SIZE, font(LETTERS))


@pytest.fixture(scope="module")
def panel(telemetry):
    return Panel([telemetry], FRAME, "small")


def test_telemetry_ends_with_the_values_of_the_run(run, telemetry):
    values = Analysis(run).values
    assert telemetry.rms[-1] == pytest.approx(1e3 * values.contour.rms, rel=1e-12)
    assert telemetry.max[-1] == pytest.approx(1e3 * values.contour.max, rel=1e-12)
    np.testing.assert_array_equal(telemetry.time, run.time)
    ticks = [0, 1, 700, len(run.time) - 2, len(run.time) - 1]
    # at the ends NumPy divides a difference by the period, which rounds otherwise
    assert [telemetry.speed(tick) for tick in ticks] == pytest.approx(path_speed(run)[ticks].tolist(), rel=1e-12)
    np.testing.assert_array_equal(np.isnan(telemetry.error), ~run.dispense)


def test_telemetry_at_a_tick_covers_the_run_up_to_it(run, telemetry):
    for share in (0.2, 0.5, 0.75):
        tick = int(share * len(run.time))
        until = Analysis(cut(run, tick + 1)).nozzle.distance
        assert telemetry.error[tick] == pytest.approx(1e3 * until[-1], rel=1e-9)
        assert telemetry.rms[tick] == pytest.approx(1e3 * np.sqrt(np.mean(until**2)), rel=1e-9)
        assert telemetry.max[tick] == pytest.approx(1e3 * until.max(), rel=1e-9)
    late = np.arange(len(run.time)) > np.flatnonzero(run.dispense)[-1]
    assert np.ptp(telemetry.rms[late]) == np.ptp(telemetry.max[late]) == 0


def test_before_the_dispenser_is_on_there_is_no_error(run):
    off = dataclasses.replace(run, dispense=np.zeros(len(run.time), bool))
    for values in (Telemetry(off).error, Telemetry(off).rms, Telemetry(off).max):
        assert np.isnan(values).all()
    later = Telemetry(dataclasses.replace(run, dispense=run.dispense & (run.time > 0.5)))
    assert np.isnan(later.rms[later.time <= 0.5]).all()
    assert np.isfinite(later.rms[later.time > 0.5]).all()


def test_ticks_and_end_of_a_run(run, telemetry):
    assert telemetry.tick(0.0) == 0
    assert telemetry.tick(0.3004) == 300
    assert telemetry.tick(1e3) == len(run.time) - 1
    assert not telemetry.has_ended(run.time[-1])
    assert telemetry.has_ended(run.time[-1] + 1e-3)
    assert not telemetry.has_faulted(run.time[-1])
    broken = Telemetry(dataclasses.replace(run, fault=FAULT))
    assert broken.has_faulted(run.time[-1])
    assert not broken.has_faulted(run.time[-2])


@given(st.floats(1e-3, 1e6), st.floats(1.0, 20.0))
def test_axis_ticks_have_the_shortest_round_step(top, most):
    ticks = axis_ticks(top, most)
    assert ticks[0] == 0
    assert ticks[-1] <= top * (1 + 1e-6)
    assert len(ticks) == 1 or np.allclose(np.diff(ticks), ticks[1])
    decades = 10.0 ** np.arange(-6, 9)
    allowed = sorted(factor * decade for factor in (1, 2, 5) for decade in decades)
    step = next(step for step in allowed if step >= top / most * (1 - 1e-9))
    assert len(ticks) == int(top / step * (1 + 1e-9)) + 1
    if len(ticks) > 1:
        assert ticks[1] == pytest.approx(step, rel=1e-9)


def test_an_error_axis_always_has_two_ticks():
    for top in np.geomspace(0.01, 1e5, 200):
        assert len(axis_ticks(top, 2.5)) >= 2


def rows_like(column, colour, tolerance=2):
    return np.flatnonzero(np.abs(column.astype(int) - rgb(colour)).max(axis=1) <= tolerance)


def scales(strip, picture):
    """Time and error at columns and rows, by the marks at the ticks of the drawn axes alone."""
    base = rows_like(picture[:, strip.right - 8], GREY)
    zero = base[base > SIZE[1] // 2][0]
    marks = np.flatnonzero(np.abs(picture[zero + 2].astype(int) - rgb(GREY)).max(axis=1) <= 2)
    assert len(marks) == len(strip.time_ticks)
    faint = np.array(rgb(PAPER)) + 0.3 * (np.array(rgb(GREY)) - rgb(PAPER))
    empty = picture[:, marks[0] + 1 :].astype(int)
    lines = np.flatnonzero((np.abs(empty[:zero] - np.round(faint)).max(axis=2) <= 2).mean(axis=1) > 0.4)
    assert len(lines) == len(strip.error_ticks) - 1
    per_row = strip.error_ticks[-1] / (zero - lines[0])
    per_column = strip.time_ticks[-1] / (marks[-1] - marks[0])
    return (lambda column: (column - marks[0]) * per_column), (lambda row: (zero - row) * per_row), per_column, per_row


def test_the_curve_is_at_the_errors_of_the_record(strip, telemetry):
    picture = strip.picture(strip.end)
    time_at, error_at, per_column, per_row = scales(strip, picture)
    period = telemetry.run.period
    checked = 0
    for column in range(strip.left + 2, strip.right - 4):
        began, ended = time_at(column - 0.5) - per_column, time_at(column + 0.5) + per_column
        there = telemetry.error[max(int(began / period), 0) : int(ended / period) + 2]
        drawn = picture[:, column].astype(int)
        weight = np.clip((230 - drawn.mean(axis=1)) / (230 - np.mean(rgb(INK))), 0, 1)
        weight[: strip.above] = weight[strip.bottom - 1 :] = 0  # title and axis
        if np.isnan(there).all():
            assert weight.max() < 0.4  # shade and grid, no curve
            continue
        if np.isnan(there).any() or np.nanmin(there) < 3 * per_row or not weight.any():
            continue
        rows = np.flatnonzero(weight > 0.6)
        assert rows.size
        assert error_at(rows[0]) <= np.nanmax(there) + (PIXEL + 1) * per_row
        assert error_at(rows[-1]) >= np.nanmin(there) - (PIXEL + 1) * per_row
        middle = error_at(np.average(rows, weights=weight[rows]))
        assert np.nanmin(there) - PIXEL * per_row <= middle <= np.nanmax(there) + PIXEL * per_row
        checked += 1
    assert checked > 300


def test_the_axes_span_the_run_and_its_errors(strip, telemetry):
    """Time from edge to edge; errors from none at the bottom to a little more than the largest at the top."""
    assert (strip.column(0.0), strip.column(telemetry.time[-1])) == (strip.left, strip.right)
    assert (strip.row(0.0), strip.row(strip.top)) == (strip.bottom, strip.above)
    assert 1.0 < strip.top / telemetry.max[-1] < 1.1
    past = (strip.picture(float(telemetry.time[-1])) < 120).all(axis=2)
    highest = (
        strip.above + np.flatnonzero(past[strip.above : strip.bottom, strip.left : strip.right - 12].any(axis=1))[0]
    )
    largest = strip.bottom - telemetry.max[-1] / strip.top * (strip.bottom - strip.above)
    assert highest == pytest.approx(largest, abs=2 * PIXEL)


def test_errors_do_not_depend_on_the_blocks_in_which_they_are_computed(run, telemetry, monkeypatch):
    """Nor on whether they are kept in memory or, as those of a long run, in a file."""
    monkeypatch.setattr(columns, "BLOCK", 37)
    monkeypatch.setattr(memory, "LONG_RUN", 100)
    in_blocks = Telemetry(run)
    for name in ("error", "rms", "max"):
        np.testing.assert_array_equal(getattr(in_blocks, name), getattr(telemetry, name))
    assert isinstance(vars(vars(in_blocks)["_errors"])["error"], columns.Stored)


def test_a_spike_of_one_tick_is_drawn_in_full(run, strip):
    error = Telemetry(run).error.copy()
    error[700] = 1.5 * np.nanmax(error)
    spiked = type("Spiked", (Telemetry,), {"error": error, "max": np.fmax.accumulate(error)})(run)
    drawn = Strip([spiked], [INK], SIZE, font(LETTERS))
    picture = drawn.picture(drawn.end)
    time_at, error_at, per_column, per_row = scales(drawn, picture)
    dark = (picture.astype(int).mean(axis=2) < 90)[: drawn.bottom]
    dark[: drawn.above] = dark[:, drawn.right - 2 :] = False
    row, column = np.argwhere(dark)[0]
    assert abs(time_at(column) - 0.7) <= per_column
    assert abs(error_at(row) - error[700]) <= 1.5 * per_row


@pytest.mark.parametrize("share", [0.0, 0.25, 0.6, 1.0])
def test_the_cursor_stands_at_the_time(strip, share):
    time = share * strip.end
    picture = strip.picture(time)
    time_at, _, per_column, _ = scales(strip, strip.picture(strip.end))
    plot = picture[strip.above : strip.bottom]
    columns = np.flatnonzero((np.abs(plot.astype(int) - rgb(INK)).max(axis=2) <= 2).mean(axis=0) > 0.9)
    assert 1 <= len(columns) <= 3
    assert abs(time_at(columns.mean()) - time) <= 1.5 * per_column


def test_curves_are_bold_before_the_cursor_and_faint_after_it(strip, telemetry):
    half = strip.picture(0.5 * strip.end)
    whole, none = strip.picture(strip.end), strip.picture(0.0)
    cursor = round(strip.column(0.5 * strip.end))
    reach = LETTERS // 2
    np.testing.assert_array_equal(half[:, : cursor - reach], whole[:, : cursor - reach])
    np.testing.assert_array_equal(
        half[:, cursor + reach : strip.right - reach], none[:, cursor + reach : strip.right - reach]
    )
    middle = slice(cursor + reach, round(strip.column(0.85 * strip.end)))
    darkest = [picture[strip.above : strip.bottom - 3, middle].mean(axis=2).min(axis=0) for picture in (none, whole)]
    assert darkest[0].min() > 150
    assert np.median(darkest[1]) < 70
    assert np.median(darkest[0]) < 225  # yet it is there


def test_the_time_without_glue_is_shaded(strip, run):
    picture = strip.picture(0.0)
    time_at, _, per_column, _ = scales(strip, strip.picture(strip.end))
    row = strip.above + 1  # above the curve's largest value
    shaded = np.flatnonzero(picture[row].mean(axis=1) < 240)
    shaded = shaded[(shaded > strip.left + 4) & (shaded <= strip.right)]
    ended = run.time[run.dispense][-1]
    assert ended < run.time[-1] - 0.1
    assert shaded[-1] == strip.right
    assert abs(time_at(shaded[0]) - ended) <= 1.5 * per_column
    assert np.all(np.diff(shaded) == 1)
    assert shows(picture, "dispenser off", LETTERS, MUTED)
    always = dataclasses.replace(run, dispense=np.ones(len(run.time), bool))
    on = Strip([Telemetry(always)], [INK], SIZE, font(LETTERS)).picture(0.0)
    assert not shows(on, "dispenser off", LETTERS, MUTED)
    assert (on[row, strip.left + 4 :].mean(axis=1) > 250).mean() > 0.95


def test_a_run_without_error_or_of_one_tick_has_a_strip(run):
    dry = dataclasses.replace(run, dispense=np.zeros(len(run.time), bool))
    for one in (dry, cut(run, 1), cut(dry, 1)):
        drawn = Strip([Telemetry(one)], [INK], SIZE, font(LETTERS))
        assert drawn.top > 0
        assert drawn.picture(one.time[-1]).shape == (SIZE[1], SIZE[0], 3)


def test_curves_of_several_runs_have_their_colours_and_one_scale(run):
    slower = cut(run, 900)
    colours = run_colours(2)
    drawn = Strip([Telemetry(run), Telemetry(slower)], colours, SIZE, font(LETTERS))
    picture = drawn.picture(drawn.end)
    seen = [(np.abs(picture.astype(int) - rgb(colour)).max(axis=2) <= 8) for colour in colours]
    columns = [np.flatnonzero(mask[drawn.above : drawn.bottom].any(axis=0)) for mask in seen]
    border = drawn.column(slower.time[-1])
    assert columns[1].max() <= border + 1
    assert columns[0].max() > border + 50
    # where they lie on each other both are seen, by turns
    before = [((drawn.left + 20 < c) & (c < border - 5)).sum() for c in columns]
    assert min(before) > 0.3 * max(before)
    assert drawn.end == run.time[-1]


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_the_curve_of_each_run_has_its_own_colour_in_the_panel(run, order):
    """Of runs that end one after the other, the last part of the strip has only the curve of the longest."""
    lengths = [len(run.time), 1000, 700]
    runs = [Telemetry(run if lengths[k] == len(run.time) else cut(run, lengths[k])) for k in order]
    panel = Panel(runs, FRAME)
    strip = panel.picture(run.time[-1])[panel.strip_above :, panel.strip_left :]
    borders = [panel.strip.column(lengths[k] * run.period) for k in (0, 1, 2)]
    only = {0: (borders[1] + 6, borders[0] - 12), 1: (borders[2] + 6, borders[1] - 6)}
    for longest, (begin, end) in only.items():
        part = strip[panel.strip.above : panel.strip.bottom, round(begin) : round(end)].astype(int)
        seen = [(np.abs(part - rgb(colour)).max(axis=2) <= 8).any(axis=0).sum() for colour in run_colours(3)]
        alone = [seen[order.index(k)] for k in range(3)]
        assert alone[longest] > 50
        assert all(alone[k] == 0 for k in range(longest + 1, 3))


@pytest.mark.parametrize("time", [0.7004, 1.1])
def test_the_panel_shows_the_values_of_the_tick(panel, telemetry, time):
    picture = panel.picture(time, 4.0)
    tick = round(time / 1e-3)
    letters = panel.font.size
    right = (f"{time:.2f} s", f"{telemetry.speed(tick):.1f} mm/s", f"{telemetry.error[tick]:.1f} µm", "×4")
    for text in (*right, f"{telemetry.rms[tick]:.0f} / {telemetry.max[tick]:.0f} µm"):
        assert shows(picture, text, letters, INK), text
    assert shows(picture, "small", letters, INK, bold=True)
    for wrong in (f"{time + 0.01:.2f} s", f"{telemetry.error[tick] + 0.1:.1f} µm", "×2", "no glue"):
        assert not shows(picture, wrong, letters, INK), wrong
    assert not shows(panel.picture(time), "×4", letters, INK)
    np.testing.assert_array_equal(picture, panel.picture(time, 4.0))


def test_only_momentary_parts_change_from_frame_to_frame(panel):
    first, second = panel.picture(0.700, 4.0), panel.picture(0.705, 4.0)
    changed = np.argwhere((first != second).any(axis=2))
    block = changed[changed[:, 1] < panel.strip_left]
    strip = changed[changed[:, 1] >= panel.strip_left]
    assert len(block)
    cursor = panel.strip_left + panel.strip.column(0.7025)
    assert np.abs(strip[:, 1] - cursor).max() < panel.font.size


def test_while_the_dispenser_is_off_there_is_no_error_to_read(panel, run):
    assert shows(panel.picture(run.time[-1]), "no glue", panel.font.size, INK)
    assert shows(panel.picture(run.time[-1]), f"{run.time[-1]:.2f} s", panel.font.size, INK)


def test_a_long_title_is_cut_and_stays_in_its_place(panel, telemetry):
    size = FRAME
    long = Panel([telemetry], size, "a name that is longer than the readout is wide").picture(0.5, 4.0)
    short = Panel([telemetry], size, "a").picture(0.5, 4.0)
    changed = np.argwhere((long != short).any(axis=2))
    letters = panel.font.size
    assert changed[:, 0].max() < 2 * letters
    assert shows(long, "×4", letters, INK)


def test_a_fault_is_shown_in_red_when_it_happens_and_off_the_curve(run):
    broken = dataclasses.replace(run, fault=FAULT)
    for frame in (FRAME, (480, 360)):
        panel = Panel([Telemetry(broken)], frame, "small")
        red = [
            (np.abs(panel.picture(time).astype(int) - rgb(COLOURS["fault"])).max(axis=2) < 40)
            for time in (run.time[-1], run.time[-2], 0.5)
        ]
        assert red[0].sum() > 200
        assert not red[1].any()
        assert not red[2].any()
        words = red[0][:, : panel.strip_left + panel.strip.right - panel.font.size]
        assert np.argwhere(words)[:, 0].max() < panel.strip_above + panel.strip.above
        assert words[:, : panel.strip_left].sum() == 0


def test_the_message_of_a_fault_is_complete(run):
    short = dataclasses.replace(FAULT, reaction="")
    panel = Panel([Telemetry(dataclasses.replace(run, fault=short))], (1920, 1080), "small")
    picture = panel.picture(run.time[-1])
    text = "fault: following error on axis x at t = 1.2500 s: 5.02 mm, limit 5 mm"
    assert shows(picture, text, panel.font.size, COLOURS["fault"])
    four = Panel([Telemetry(dataclasses.replace(run, fault=FAULT))] * 4, (1280, 960))
    assert four.strip.bottom - four.strip.above > 1.5 * four.font.size


def test_the_fault_of_one_of_several_runs_has_the_colour_of_its_curve(run):
    broken = dataclasses.replace(run, fault=dataclasses.replace(FAULT, reaction=""))
    for place in range(3):
        runs = [Telemetry(broken if k == place else run) for k in range(3)]
        panel = Panel(runs, (1920, 1080))
        strip = panel.picture(run.time[-1])[panel.strip_above :, panel.strip_left :][: panel.strip.above]
        found = [(strip == rgb(colour)).all(axis=2).any() for colour in run_colours(3)]
        assert found == [k == place for k in range(3)]


def test_each_value_stands_in_the_row_of_its_name(run, telemetry, panel):
    tick = 600
    readout, size = panel.picture(run.time[tick])[:, : panel.strip_left], panel.font.size

    def height(text, colour):
        """Middle of the lines of pixels that hold all of a text."""
        high = round(1.5 * size)
        tops = [top for top in range(len(readout) - high) if shows(readout[top : top + high], text, size, colour)]
        return np.mean(tops) + 0.5 * high

    values = {
        "path speed": f"{telemetry.speed(tick):.1f} mm/s",
        "contour error": f"{telemetry.error[tick]:.1f} µm",
        "rms / max": f"{telemetry.rms[tick]:.0f} / {telemetry.max[tick]:.0f} µm",
    }
    apart = height("contour error", MUTED) - height("path speed", MUTED)
    for name, value in values.items():
        assert abs(height(name, MUTED) - height(value, INK)) < 0.3 * apart


def test_the_legend_shows_the_scale(run, telemetry):
    scale = scale_for("error", [run])
    panel = Panel([telemetry], FRAME, "small", scale)
    picture = panel.picture(0.5)
    assert shows(picture, "contour error [µm]", panel.font.size, INK)
    legend = picture[:, panel.strip_left + panel.strip.size[0] :]
    for text in scale.labels():
        assert shows(legend, text, panel.font.size, INK)
    bar = legend[:, round(0.6 * panel.font.size) + 2]
    place = [np.abs(scale.table.astype(int) - colour).max(axis=1) for colour in bar.astype(int)]
    rows = np.array([k for k, away in enumerate(place) if away.min() == 0])
    shade = np.array([place[k].argmin() for k in rows])
    assert len(rows) > 3 * panel.font.size
    assert shade[0] >= 253  # some shades are equal
    assert shade[-1] <= 2
    assert np.all(np.diff(shade) <= 0)
    plain = Panel([telemetry], FRAME, "small")
    assert plain.strip.size[0] > panel.strip.size[0]


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (0, 800, ("0", "400", "800")),
        (0, 15.07, ("0.0", "7.5", "15.1")),
        (0, 43, ("0.0", "21.5", "43.0")),
        (0, 10.43, ("0.0", "5.2", "10.4")),
        (3.2, 4.4, ("3.2", "3.8", "4.4")),
        (1.0, 1.001, ("1.0000", "1.0005", "1.0010")),
    ],
)
def test_the_labels_of_a_scale_have_the_digits_that_they_need(low, high, labels):
    assert Scale("", "", low, high, False, False, MAGNITUDE).labels() == labels
    assert Scale("", "", low, high, True, True, MAGNITUDE).labels() == (f"≤ {labels[0]}", labels[1], f"≥ {labels[2]}")


@given(st.floats(0, 1e4), st.floats(1e-3, 1e4))
def test_the_labels_of_a_scale_are_exact_to_half_a_percent(low, span):
    scale = Scale("", "", low, low + span, False, False, MAGNITUDE)
    labels = np.array([float(label) for label in scale.labels()])
    away = np.abs(labels - [scale.low, 0.5 * (scale.low + scale.high), scale.high])
    assert away.max() <= LABELLED * (scale.high - scale.low)


@pytest.mark.parametrize(("below", "above"), [(False, True), (True, False), (False, False)])
def test_the_legend_shows_each_number_beside_its_colour(telemetry, below, above):
    scale = Scale("bead width", "mm", 3.2, 4.4, below, above, MAGNITUDE)
    panel = Panel([telemetry], FRAME, "small", scale)
    legend = panel.picture(0.5)[:, panel.strip_left + panel.strip.size[0] :]
    letters = panel.font.size
    upper, lower = legend[letters : len(legend) // 2], legend[len(legend) // 2 + letters // 2 :]
    for part, text, other in (
        (upper, "≥ 4.4" if above else "4.4", "≤ 3.2" if below else "3.2"),
        (lower, "≤ 3.2" if below else "3.2", "≥ 4.4" if above else "4.4"),
    ):
        assert shows(part, text, letters, INK)
        assert not shows(part, other, letters, INK)
    assert shows(legend, "3.8", letters, INK)
    assert shows(legend, "≥", letters, INK) is above
    assert shows(legend, "≤", letters, INK) is below


def test_the_end_of_a_faulted_run_is_marked(run):
    broken = Telemetry(dataclasses.replace(cut(run, 900), fault=FAULT))
    drawn = Strip([Telemetry(run), broken], run_colours(2), SIZE, font(LETTERS))
    for time, there in ((0.8, False), (0.9, True), (1.2, True)):
        red = np.abs(drawn.picture(time).astype(int) - rgb(COLOURS["fault"])).max(axis=2) < 3
        assert red.any() == there
        if there:
            row, column = np.argwhere(red).mean(axis=0)
            assert abs(column - drawn.column(0.899)) < 1
            assert abs(row - drawn.row(broken.error[-1])) < 1


def test_a_header_has_label_and_readout_and_shows_when_its_run_has_ended(run, telemetry):
    colour = run_colours(2)[1]
    header = Header(telemetry, "T = 1 s", colour, 640, 18)
    picture = header.picture(0.7)
    assert picture.shape == (*header.size[::-1], 3)
    letters = 18
    assert shows(picture, "T = 1 s", letters, colour, bold=True)
    for text in (f"{telemetry.error[700]:.1f} µm", f"{telemetry.speed(700):.1f} mm/s"):
        assert shows(picture, text, letters, INK)
    assert shows(picture, f"{telemetry.rms[700]:.0f} / {telemetry.max[700]:.0f} µm", letters, INK)
    said = f"ended at {run.time[-1]:.2f} s"
    assert not shows(header.picture(run.time[-1]), said, letters, MUTED)
    assert shows(header.picture(run.time[-1] + 1), said, letters, MUTED)
    broken = Header(Telemetry(dataclasses.replace(run, fault=FAULT)), "T = 1 s", colour, 640, 18)
    assert shows(broken.picture(run.time[-1]), f"fault at {run.time[-1]:.2f} s", letters, COLOURS["fault"])
    assert not shows(broken.picture(run.time[-2]), f"fault at {run.time[-1]:.2f} s", letters, COLOURS["fault"])


def test_a_narrow_header_leaves_out_what_does_not_fit(telemetry):
    picture = Header(telemetry, "a label that is far too long for it", INK, 160, 18).picture(0.7)
    margin = 6
    assert (picture[:, -margin:] == rgb(PAPER)).all()
    assert shows(picture, f"{telemetry.error[700]:.1f} µm", 10, INK)
    assert not shows(picture, f"{telemetry.speed(700):.1f} mm/s", 10, INK)


def test_letters_scale_with_the_frame_and_stay_legible(telemetry):
    panels = [Panel([telemetry], (width, 3 * width // 4)) for width in (320, 480, 640, 960, 1440)]
    sizes = [panel.font.size for panel in panels]
    assert sizes == sorted(sizes)
    assert sizes[0] >= 10
    assert sizes[-1] > 25
    assert panels[3].size == (960, pytest.approx(0.18 * 720, abs=1))


@pytest.mark.parametrize("scale", suite_runs([None, Scale("bead width", "mm", 0.0, 88.8, True, True, MAGNITUDE)], 1))
@pytest.mark.parametrize("runs", suite_runs([1, 2, 4], 0, 2))
@pytest.mark.parametrize("frame", SHAPES, ids=str)
def test_a_film_of_any_shape_has_a_panel_that_can_be_read(telemetry, frame, runs, scale):
    panel = Panel([telemetry] * runs, frame, "small", scale)
    picture = panel.picture(0.7, 4.0)
    letters = panel.font.size
    assert picture.shape == (*panel.size[::-1], 3)
    assert panel.size[0] == frame[0]
    assert panel.size[1] <= 0.55 * frame[1]
    assert letters >= max(9, min(frame) / 44)
    assert panel.strip.size[0] >= 12.5 * letters - 1
    assert panel.strip.bottom - panel.strip.above > 2 * letters
    said = ["0.70 s", "×4"] if runs > 1 else ["0.70 s", "×4", f"{telemetry.speed(700):.1f} mm/s", "contour error"]
    for text in said:
        assert shows(picture[:, : panel.legend_left], text, letters, INK if text != "contour error" else MUTED), text
    strip = picture[panel.strip_above :, panel.strip_left : panel.strip_left + panel.strip.size[0]]
    assert shows(strip, "error [µm]", letters, INK)
    assert shows(strip, "off", letters, MUTED)
    assert (strip[:, -1] == rgb(PAPER)).all() or panel.strip_above == 1
    if scale is not None:
        legend = picture[:, panel.legend_left :]
        for text in (*scale.labels(), "[mm]", "width"):
            assert shows(legend, text, letters, INK), text


@pytest.mark.parametrize("frame", [(240, 240), (320, 240), (240, 427), (480, 360)])
def test_a_fault_stays_legible_in_a_narrow_strip(run, frame):
    panel = Panel([Telemetry(dataclasses.replace(run, fault=FAULT))], frame, "small")
    strip = panel.picture(run.time[-1])[panel.strip_above :]
    assert any(shows(strip, "fault: following error", size, COLOURS["fault"]) for size in (9, 10, 11, 12))
    assert any(shows(strip, "…", size, COLOURS["fault"]) for size in (9, 10, 11, 12)) or frame == (480, 360)
    assert panel.strip.bottom - panel.strip.above > 1.5 * panel.font.size
    four = Panel([Telemetry(dataclasses.replace(run, fault=FAULT))] * 4, frame)
    assert four.strip.bottom - four.strip.above > 1.5 * four.font.size
    red = np.abs(four.picture(run.time[-1]).astype(int) - rgb(COLOURS["fault"])).max(axis=2) < 90
    words = red[: four.strip_above + four.strip.above].any(axis=1)
    assert np.count_nonzero(np.diff(words.astype(int)) == 1) >= 3  # lines, of small letters


def test_nothing_is_drawn_beside_a_fault(run):
    broken = Telemetry(dataclasses.replace(run, fault=FAULT))
    stood = []
    for frame in (*SHAPES, (270, 240), (290, 240), (310, 240)):
        panel = Panel([broken], frame, "small")
        part = slice(panel.strip_left + panel.strip.right + 1, panel.strip_left + panel.strip.size[0])
        before, after = (
            panel.picture(run.time[tick])[panel.strip_above + 1 : panel.strip_above + panel.strip.above, part]
            for tick in (-2, -1)
        )
        stood.append((before != rgb(PAPER)).any())
        ink = after[(after != rgb(PAPER)).any(axis=2)].astype(int)
        assert (ink[:, 0] > ink[:, 1] + 10).all()
    assert any(stood)


def test_a_strip_shows_the_names_that_fit(telemetry):
    for width, there in ((600, (1, 1, 1)), (300, (1, 0, 1)), (210, (0, 0, 1))):
        picture = Strip([telemetry], [INK], (width, 120), font(LETTERS)).picture(0.0)
        found = (("contour error [µm]", INK), ("dispenser off", MUTED), ("off", MUTED))
        assert tuple(shows(picture, text, LETTERS, colour) for text, colour in found) == there


def test_a_fault_replaces_the_title_of_a_narrow_strip(run):
    broken = Telemetry(dataclasses.replace(run, fault=FAULT))
    panel = Panel([broken], (240, 240), "small")
    before, after = (panel.picture(run.time[tick])[panel.strip_above :] for tick in (-2, -1))
    head = after[: panel.strip.above, panel.strip_left + panel.strip.left :]
    ink = (head != rgb(PAPER)).any(axis=2)
    red = head[ink].astype(int)
    assert len(red) > 50
    assert (red[:, 0] >= red[:, 1:].max(axis=1)).all()
    assert shows(before, "error [µm]", panel.font.size, INK)
    grey = np.abs(before[: panel.strip.above].astype(int) - rgb(INK)).max(axis=2) < 40
    assert grey.any()
    assert not (np.abs(after[: panel.strip.above].astype(int) - rgb(INK)).max(axis=2) < 40).any()


def test_a_panel_too_narrow_is_refused_with_the_least_width(telemetry):
    for runs, scale in ((1, None), (4, Scale("bead width", "mm", 0.0, 88.8, True, True, MAGNITUDE))):
        with pytest.raises(InputError, match="for readout and error strip") as refused:
            Panel([telemetry] * runs, (100, 240), "small", scale)
        least = int(re.fullmatch(r"width of the film = 100: must be at least (\d+), .*", str(refused.value))[1])
        assert 100 < least <= 240
        assert Panel([telemetry] * runs, (least, 240), "small", scale).font.size == 9
        with pytest.raises(InputError, match=f"must be at least {least}"):
            Panel([telemetry] * runs, (least - 1, 240), "small", scale)


def test_shortened_labels_stay_different():
    bold = font(12, True)
    fitting = ["loop_period = 1 s", "loop_period = 2 s"]
    assert bold.distinct(fitting, 200) == fitting
    ends = bold.distinct(["one and so on and on", "two and so on and on"], 80)
    assert [text[:3] for text in ends] == ["one", "two"]
    assert all(text.endswith("…") for text in ends)
    long = [f"loop_period = {period} s, following_error_limit = {limit}" for period, limit in
            ((0.1, 5), (1, 5), (0.01, 5), (0.1, 0.05))]  # fmt: skip
    assert bold.distinct(["loop_period = 1 s", "loop_period = 0.01 s"], 100) == ["loop_pe…= 1 s", "loop_p…0.01 s"]
    for width in range(80, 140, 5):
        assert all(part in text for part, text in zip(("1", "0.01"), bold.distinct(
            ["loop_period = 1 s", "loop_period = 0.01 s"], width), strict=True))  # fmt: skip
    two = bold.distinct(long[::3], 220)
    assert [text[:13] for text in two] == ["loop_period ="] * 2
    assert [text[-3:] for text in two] == ["= 5", ".05"]
    four = bold.distinct(long, 220)
    assert four == ["…0.1…5", "…1…5", "…0.01…5", "…0.1…0.05"]
    assert max(map(bold.width, two)) <= 220
    inside = [f"the same words in front {word} the same words behind, and a few more of them" for word in ("aa", "bb")]
    assert [text[:3] for text in bold.distinct(inside, 100)] == ["…aa", "…bb"]
    assert (
        bold.distinct(["twice the same label", "twice the same label"], 60)
        == [bold.shortened("twice the same label", 60)] * 2
    )


def test_headers_side_by_side_have_different_labels(telemetry):
    labels = [f"loop_period = 0.1 s, following_error_limit = {limit}" for limit in (5, 0.05)]
    made = headers([telemetry] * 2, labels, run_colours(2), 300, 18)
    for header, label, colour in zip(made, labels, run_colours(2), strict=True):
        end = label[-13:]
        assert shows(header.picture(0.5), end.split()[-1], header.font.size, colour, bold=True)
    roomy = headers([telemetry] * 2, labels, run_colours(2), 640, 18)
    for header, label, colour in zip(roomy, labels, run_colours(2), strict=True):
        assert shows(header.picture(0.5), label, header.font.size, colour, bold=True)
        assert shows(header.picture(99.0), label, header.font.size, colour, bold=True)


def test_an_upright_header_has_its_readout_in_two_lines(telemetry):
    one, two = (Header(telemetry, "a", INK, 358, 18, lines) for lines in (1, 2))
    assert two.font.size > 1.5 * one.font.size
    picture = two.picture(0.7)
    for text in (f"{telemetry.error[700]:.1f} µm", f"{telemetry.speed(700):.1f} mm/s"):
        assert shows(picture, text, two.font.size, INK)
    assert shows(picture, f"{telemetry.rms[700]:.0f} / {telemetry.max[700]:.0f} µm", two.font.size, INK)
    assert picture.shape[0] == two.size[1]
    assert (picture[-2:] == rgb(PAPER)).all()


def test_a_font_wraps_and_shortens():
    face = font(12)
    text = "following error on axis x at t = 1.2500 s"
    lines = face.wrapped(text, 100)
    assert " ".join(lines) == text
    assert max(map(face.width, lines)) <= 100
    assert face.shortened("abc", 100) == "abc"
    cut_off = face.shortened(text, 100)
    assert cut_off.endswith("…")
    assert 80 < face.width(cut_off) <= 100
    assert len({face.width(digit) for digit in "0123456789"}) == 1  # figures keep their places


def test_a_label_counts_the_values_beyond_three_in_which_jobs_differ():
    changes = ["program.speed=80", "program.turns=2", "dispenser.flow=90", "dispenser.opening=0.01", "bead.gap=0.5"]
    jobs = [Job.load("an225"), Job.load("an225", changes)]
    for label in differences(jobs):
        assert label.count(" = ") == 3
        assert label.endswith(", 2 more")


@pytest.mark.parametrize(("count", "is_shown"), [(24, True), (25, False)])
def test_a_value_of_more_than_24_letters_stands_in_no_label(tmp_path, count, is_shown):
    # with the files that it includes
    folder = shutil.copytree(model_file("xy").parent, tmp_path / "machines")
    machine = (folder / "xy.xml").rename(folder / f"{'m' * count}.xml")
    jobs = [Job.load("an225"), Job.load("an225", {"machine": str(machine), "program.turns": 2})]
    labels = differences(jobs)
    assert labels[1] == (f"machine = {'m' * count}, turns = 2" if is_shown else "turns = 2, 1 more")


def test_the_scale_of_widths_reaches_three_tolerances_to_either_side(run):
    """The tolerance is a share of the nominal width, by default 10 %."""
    nominal = float(BeadTrace.of(run, None).nominal_section.width[0])
    scale = scale_for("width", [run])
    assert (scale.low, scale.high) == pytest.approx((0.7 * nominal, 1.3 * nominal))
