"""The plots of studies' reports show the columns that they are drawn of, on scales and in colours with one meaning."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import Job
from gantrysim.metrics import CircularTest, RepeatedPath, Trace
from gantrysim.results.colours import BAD, FAULT, GOOD, INK, LINKS, REQUESTED, RUNS
from gantrysim.study.acceptance import Acceptance, Scope
from gantrysim.study.circle.report import _division, _draw_chart, _draw_deviation
from gantrysim.study.laws.report import _bars, _draw_repeats
from gantrysim.study.loop.limits import SweepVerdicts, draw_limits
from gantrysim.study.machine.report import Influence, _draw_influence, _draw_scatter
from gantrysim.study.repeat.report import _draw_along, _draw_plan
from gantrysim.study.speed.report import _draw_links, _draw_metric
from gantrysim.study.speed.study import SpeedStudy

from support.figures import labels, legend, marks, size


def test_bars_of_influences_end_where_their_numbers_stand():
    factors = [Influence("friction of x", 0.5, True), Influence("stiffness", -0.25, False)]
    figure = _draw_influence(factors)
    (axes,) = figure.axes
    assert size(figure) == pytest.approx((9.0, 1.4 + 2 * 0.32))
    bars = [(bar.get_y() + bar.get_height() / 2, bar.get_width(), bar.get_alpha()) for bar in axes.patches]
    assert bars == [pytest.approx((0, 0.5, 0.9)), pytest.approx((1, -0.25, 0.25))]
    places = [(text.get_text(), *text.get_position(), text.get_ha()) for text in axes.texts]
    assert places == [("+0.50", 0.515, 0, "left"), ("−0.25", -0.265, 1, "right")]
    assert labels(axes, "y") == ["friction of x", "stiffness"]
    assert axes.yaxis_inverted()
    assert axes.get_xlim() == (-1.12, 1.12)
    assert [line.get_visible() for line in axes.get_ygridlines()] == [False] * 2
    assert all(line.get_visible() for line in axes.get_xgridlines())


def test_machines_out_of_tolerance_are_points_in_another_colour_and_failed_ones_none():
    metric = np.array([10.0, 40.0, 50.0, math.inf])
    factors = {"payload": np.arange(4.0), "friction": np.arange(4.0, 8.0), "stiffness": np.arange(8.0, 12.0)}
    figure = _draw_scatter(factors, metric, 40.0, "error [µm]")
    assert size(figure) == pytest.approx((9.0, 0.6 + 2 * 2.9))
    assert [axes.get_visible() for axes in figure.axes] == [True, True, True, False]
    assert [axes.get_xlabel() for axes in figure.axes[:3]] == ["payload [kg]", "friction, factor", "stiffness, factor"]
    assert figure.get_supylabel() == "error [µm]"
    for axes, values in zip(figure.axes, factors.values(), strict=False):
        within, beyond, limit = axes.lines
        assert (within.get_xdata().tolist(), within.get_ydata().tolist()) == (values[:2].tolist(), [10, 40])
        assert (beyond.get_xdata().tolist(), beyond.get_ydata().tolist()) == ([values[2]], [50])
        assert (within.get_color(), beyond.get_color()) == (GOOD, BAD)
        assert list(limit.get_ydata()) == [40, 40]


ANGLE = np.radians(np.arange(0.5, 360, 1.0))


def trace(deviation, clockwise):
    """A circle of 40 mm about (3, 4) with a radial deviation over the angle, run one way."""
    angle = ANGLE[:: -1 if clockwise else 1]
    radius = 40 + deviation(angle)
    return Trace(np.stack([3 + radius * np.cos(angle), 4 + radius * np.sin(angle)], 1), (3.0, 4.0), 40.0)


@pytest.fixture(scope="module")
def circles():
    """Clockwise 10 µm too large with a wave of 5 µm, counter-clockwise 4 µm too small."""
    one = trace(lambda angle: 0.010 + 0.005 * np.cos(2 * angle), clockwise=True)
    return CircularTest(one, trace(lambda angle: np.full_like(angle, -0.004), clockwise=False))


@pytest.mark.parametrize(("limit", "is_near"), [(20.0, True), (59.9, True), (60.1, False)])
def test_the_chart_of_a_circle_has_both_paths_their_zone_and_the_limit_where_it_fits(circles, limit, is_near):
    """The largest deviation is 15 µm: a limit of four times as much still fits."""
    figure = _draw_chart(circles, limit)
    (axes,) = figure.axes
    found = marks(axes)
    shown = "" if is_near else ", beyond this scale"
    assert legend(figure) == [
        "clockwise, G = 10.0 µm", "counter-clockwise, G = 0.0 µm", "minimum zone, G(b) = 19.0 µm",
        "nominal, radius 40 mm", "largest, +15.0 µm", f"limit ± {limit:g} µm{shown}",
    ]  # fmt: skip
    for name, colour, deviation in (
        ("clockwise, G = 10.0 µm", RUNS[0], 10 + 5 * np.cos(2 * ANGLE)),
        ("counter-clockwise, G = 0.0 µm", RUNS[1], np.full(360, -4.0)),
    ):
        x, y, drawn, _ = found[name]
        assert drawn == colour
        assert x == pytest.approx([*ANGLE, ANGLE[0] + 2 * np.pi])
        assert y == pytest.approx([*deviation, deviation[0]], abs=1e-6)
    inner = found["minimum zone, G(b) = 19.0 µm"]
    outer = found["_child3"]
    assert np.ptp(inner[0]) == pytest.approx(2 * np.pi)
    assert (min(inner[1]), max(inner[1])) == pytest.approx((-4, -4), abs=0.01)
    assert (min(outer[1]), max(outer[1])) == pytest.approx((15, 15), abs=0.01)
    assert (inner[2], outer[2], inner[3]) == (LINKS["structure"], LINKS["structure"], "--")
    nominal = found["nominal, radius 40 mm"]
    assert (set(nominal[1]), nominal[2]) == ({0.0}, INK)
    (at,), (top,), colour, shape = found["largest, +15.0 µm"]
    assert (abs(math.cos(at)), top, colour, shape) == pytest.approx((math.cos(ANGLE[0]), 15, FAULT, "v"), abs=1e-2)
    over = [set(line[1]) for line in (found[legend(figure)[5]], found["_child7"])]
    assert over == ([{limit}, {-limit}] if is_near else [set(), set()])
    reach = limit if is_near else 15.0
    division = _division(reach)
    rings = math.ceil(reach / division)
    assert list(axes.get_yticks()) == [division * k for k in range(-rings, rings + 1)]
    assert labels(axes, "y")[-1] == f"+{division * rings:g}"
    assert axes.get_ylim() == pytest.approx((-1.6 * rings * division, 1.05 * rings * division))
    assert np.degrees(axes.get_xticks()).tolist() == pytest.approx(list(range(0, 360, 45)))
    assert labels(axes, "x") == ["+x", "45°", "+y", "135°", "−x", "225°", "−y", "315°"]
    assert axes.get_title() == f"Radial deviation [µm], {division:g} µm per division"


@pytest.mark.parametrize(
    ("reach", "division"),
    # at most four of them, of 1, 2 or 5 times a power of ten
    [(4.0, 1), (4.1, 2), (8.0, 2), (8.1, 5), (20.0, 5), (20.1, 10), (40.0, 10), (41.0, 20), (0.4, 0.1), (200, 50)],
)
def test_a_division_is_the_smallest_that_needs_four(reach, division):
    assert _division(reach) == pytest.approx(division)


def test_the_deviation_over_the_angle_has_a_panel_by_direction_and_what_arises_behind_the_motors():
    reach = 10.0
    bump = lambda angle: 0.005 * np.exp(-(((np.degrees(angle) - 95.0) / 2.0) ** 2))  # noqa: E731
    traces = {
        "clockwise": trace(lambda angle: np.full_like(angle, 0.001), clockwise=True),
        "counter-clockwise": trace(bump, clockwise=False),
    }
    structure = {"clockwise": np.linspace(0, 0.001, 360), "counter-clockwise": np.full(360, 0.002)}
    figure = _draw_deviation(traces, structure, reach, 8.0)
    first, second, last = figure.axes
    assert size(figure) == (9.0, 7.2)
    for panel, name, values in (
        (first, "clockwise", np.full(360, 1.0)),
        (second, "counter-clockwise", 1e3 * bump(ANGLE)),
    ):
        curve = max(panel.lines, key=lambda line: len(line.get_xdata()))
        assert curve.get_xdata() == pytest.approx(np.degrees(ANGLE))
        assert curve.get_ydata() == pytest.approx(values, abs=1e-6)
        assert curve.get_color() == RUNS[0 if name == "clockwise" else 1]
        assert panel.get_title(loc="right") == f"nozzle, run {name}"
        assert panel.get_ylabel() == "outward [µm]"
        dotted = [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == ":"]
        assert sorted(dotted) == [0, 90, 180, 270]
        assert sorted({line.get_ydata()[0] for line in panel.lines if line.get_linestyle() == "--"}) == [-8, 8]
    assert first.get_ylim() == second.get_ylim()
    # clockwise runs, sorted by angle, are reversed
    found = marks(last)
    assert found["clockwise"][1] == pytest.approx(np.linspace(1, 0, 360))
    assert found["counter-clockwise"][:3] == (pytest.approx(np.degrees(ANGLE)), pytest.approx([2.0] * 360), RUNS[1])
    assert last.get_xlim() == (0, 360)
    assert last.get_xticks().tolist() == list(range(0, 361, 45))
    assert (last.get_xlabel(), last.get_ylabel()) == ("angle, counter-clockwise from +x [deg]", "outward [µm]")
    # y reverses at 90 deg, and the curve is highest at 95; it has a point at each half degree
    (spike,) = [text for text in second.texts if text.xy[0] in (94.5, 95.5)]
    assert float(spike.get_text()) == pytest.approx(5 * math.exp(-1 / 16), abs=0.1)
    assert spike.xy[1] == pytest.approx(5 * math.exp(-1 / 16), abs=0.01)
    assert spike.get_ha() == "left"


def test_values_by_law_are_points_in_a_row_each_from_the_top():
    shown = {"path": ([10.0, 100.0], RUNS[0]), "glue": ([20.0, math.nan], RUNS[1])}
    figure = _bars(["pd", "pid"], shown, "use [%]")
    (axes,) = figure.axes
    assert size(figure) == pytest.approx((9.0, 2 * 0.42 + 1.6))
    found = marks(axes)
    assert found["path"] == ([10, 100], [1, 0], RUNS[0], "o")
    assert found["glue"][1:] == ([1, 0], RUNS[1], "D")
    assert found["glue"][0][0] == 20
    assert (labels(axes, "y"), axes.get_yticks().tolist()) == (["pd", "pid"], [1, 0])
    assert (axes.get_xscale(), axes.get_xlabel()) == ("log", "use [%]")
    low, high = axes.get_xlim()
    assert 5 < low < 10 < 100 < high < 200
    assert legend(figure) == ["path", "glue"]


def test_what_is_learnt_is_drawn_over_the_repeats_from_the_law_without_learning_on():
    rows = [{"repeats": 1, "following_rms_um": 5.0}, {"repeats": 4, "following_rms_um": 2.0}]
    figure = _draw_repeats(rows, {"pid": {"following_rms_um": 8.0}})
    (axes,) = figure.axes
    (line,) = axes.lines
    assert (line.get_xdata().tolist(), line.get_ydata().tolist()) == ([0, 1, 4], [8.0, 5.0, 2.0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("repeats learnt from", "following error, rms [µm]")
    assert axes.get_yscale() == "log"
    assert size(figure) == (9.0, 4.2)


@pytest.fixture(scope="module")
def paths():
    """Two repeats along x, 1 µm apart from y = 5 µm on; a third of the way, no glue is laid."""
    s = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    command = np.stack([s, np.zeros(5), np.zeros(5)], 1)

    def of(spread):
        mean = 1e-3 * np.array([2.0, 4.0, 6.0, 8.0, 7.0])
        off = 1e-3 * np.array([1.0, 2.0, 5.0, 1.0, 1.0]) * spread
        attained = np.stack([command, command])
        attained[0, :, 1], attained[1, :, 1] = mean + off, mean - off
        return RepeatedPath(s, command, attained)

    return {"all": of(1.0), "friction": of(0.5)}


def test_accuracy_and_repeatability_are_drawn_along_the_path(paths):
    figure = _draw_along(paths, 10.0)
    above, below = figure.axes
    assert size(figure) == (9.0, 6.6)
    s = [0, 1, 2, 5, 6]
    found = marks(above)
    assert found["accuracy AT: mean of the repeats to the path"][:3] == (s, pytest.approx([2, 4, 6, 8, 7]), INK)
    assert found["ATp = 8.00 µm"] == ([5], pytest.approx([8]), FAULT, "v")
    (band,) = above.collections
    corners = band.get_paths()[0].vertices
    for place, low, high in ((0.0, 1, 3), (1.0, 2, 6), (2.0, 1, 11), (5.0, 7, 9)):
        heights = corners[corners[:, 0] == place, 1]
        assert (heights.min(), heights.max()) == pytest.approx((low, high))
    assert list(found["limit 10 µm"][1]) == [10, 10]
    assert above.get_ylim()[0] == 0
    assert below.get_ylim()[0] == 0
    assert above.get_xlim() == below.get_xlim() == (0, 6)
    found = marks(below)
    assert found["all varied, RTp = 5.00 µm"][:3] == (s, pytest.approx([1, 2, 5, 1, 1]), INK)
    assert found["friction alone, 2.50 µm"][:3] == (s, pytest.approx([0.5, 1, 2.5, 0.5, 0.5]), RUNS[0])
    assert (above.get_ylabel(), below.get_ylabel()) == ("to the requested path [µm]", "repeatability [µm]")
    assert below.get_xlabel() == "arc length along the requested path [mm]"


def test_no_line_of_the_plan_crosses_a_gap_in_the_glue(paths):
    figure = _draw_plan(paths["all"])
    axes, bar = figure.axes
    (lines,) = axes.collections
    drawn = [np.asarray(segment).tolist() for segment in lines.get_segments()]
    assert drawn == [
        [[0, 0], [1, 0]], [[1, 0], [2, 0]], [[5, 0], [6, 0]]
    ]  # fmt: skip
    assert np.asarray(lines.get_array()) == pytest.approx([1.5, 3.5, 1.0])
    assert lines.get_clim() == pytest.approx((0, 5))
    found = marks(axes)
    assert found["RTp = 5.00 µm"] == ([2], [0], FAULT, "o")
    assert found["ATp = 8.00 µm"] == ([5], [0], INK, "s")
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x [mm]", "y [mm]", 1.0)
    assert bar.get_ylabel() == "repeatability RT [µm]"
    # as flat as may be
    assert size(figure) == (7.4, 3.0)


def speeds(values, failed=()):
    rows = [
        {"speed_mm_s": speed, "status": "ok", "contour_max_um": value, "contour_rms_um": value / 2}
        | {"servo_rms_um": value / 4, "program_rms_um": 1e-4, "encoder_rms_um": 1e-4 if speed < 100 else 0.01}
        for speed, value in values.items()
    ]
    return [*rows, *({"speed_mm_s": speed, "status": "refused: no"} for speed in failed)]


def test_an_error_over_speed_is_marked_by_the_tolerance_with_the_speeds_that_fail():
    study = SpeedStudy(Job.load("an225"), tolerance=50.0)
    rows = speeds({50.0: 20.0, 100.0: 40.0, 200.0: 60.0}, failed=(400.0, 300.0))
    figure = _draw_metric(study, rows, rows[:3])
    (axes,) = figure.axes
    found = marks(axes)
    assert size(figure) == (9.0, 4.8)
    assert found["within the tolerance"] == ([50, 100], [20, 40], GOOD, "o")
    assert found["out of tolerance"] == ([200], [60], BAD, "o")
    assert found["tolerance"][1:] == ([50, 50], BAD, "--")
    assert found["fault or refused"] == ([300, 400], [0.97, 0.97], FAULT, "x")
    assert found["programmed speed"][:3] == ([100, 100], [0, 1], REQUESTED)
    joined = next(line for line in axes.lines if len(line.get_xdata()) == 3)
    assert joined.get_ydata().tolist() == [20, 40, 60]
    (span,) = axes.patches
    assert (span.get_x(), span.get_x() + span.get_width()) == pytest.approx((50, 100))
    assert axes.get_title(loc="right") == "within the tolerance up to 100 mm/s"
    assert axes.get_xscale() == "log"
    # the smallest and largest errors differ little
    assert (axes.get_yscale(), axes.get_ylim()) == ("linear", pytest.approx((0, 66)))
    low, high = axes.get_xlim()
    assert 40 < low < 50 < 400 < high < 500
    assert axes.get_xlabel() == "programmed path speed [mm/s]"
    assert legend(figure) == [name for name in found if not name.startswith("_")]
    rows = speeds({50.0: 60.0, 100.0: 1000.0})
    (axes,) = _draw_metric(study, rows, rows).axes
    assert axes.get_yscale() == "log"
    assert not axes.patches
    assert axes.get_title(loc="right") == ""


def test_links_over_speed_leave_out_what_a_logarithm_cannot_show():
    figure = _draw_links(speeds({50.0: 20.0, 100.0: 40.0}))
    (axes,) = figure.axes
    found = marks(axes)
    assert sorted(found) == ["contour", "encoder", "servo"]
    assert found["contour"][:3] == ([50, 100], [10, 20], INK)
    assert found["servo"] == ([50, 100], [5, 10], LINKS["servo"], "o")
    assert found["encoder"][1] == [1e-3, 0.01]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_ylabel() == "error normal to the path, rms [µm]"
    assert size(figure) == (9.0, 4.8)


def test_the_use_of_limits_over_a_swept_setting_with_what_fails_without_a_share():
    def verdict(use, state="pass"):
        return Acceptance.of(
            {"status": "ok", **{f"{aspect}_verdict": "pass" for aspect in ("path", "glue", "stability", "machine")}}
            | {f"{aspect}_limit_use_percent": 1.0 for aspect in ("glue", "stability", "machine")}
            | {f"{aspect}_check": "words" for aspect in ("path", "glue", "stability", "machine")}
            | {"path_limit_use_percent": use, "path_verdict": state}
        )

    lever = SimpleNamespace(text=lambda value: f"{1e3 * value:g} ms", noun="loop period")
    verdicts = {0.0: verdict(5.0), 0.01: verdict(20.0), 0.02: verdict(150.0, "fail"), 0.04: verdict(None, "fail")}
    sweep = SweepVerdicts(lever, verdicts, Scope(("path", "glue", "stability", "machine")))
    study = SimpleNamespace(job=SimpleNamespace(program={"loop_period": 0.01}))
    figure = draw_limits(study, {"loop_period": sweep})
    (axes,) = figure.axes
    found = marks(axes)
    assert size(figure) == (10.7, 4.4)
    assert found["keeps the limits"] == ([0.01], [20], GOOD, "o")
    assert found["does not"] == ([0.02], [150], BAD, "o")
    assert found["fails without a share"] == ([0.04], [0.98], BAD, "^")
    assert found["limit"][1:] == ([100, 100], BAD, "--")
    assert found["the job's own value"][:3] == ([0.01, 0.01], [0, 1], REQUESTED)
    joined = next(line for name, line in zip(found, axes.lines, strict=True) if name.startswith("_"))
    assert (joined.get_xdata().tolist(), joined.get_ydata().tolist()) == ([0.01, 0.02], [20, 150])
    assert axes.get_xlabel() == "loop period"
    assert axes.xaxis.get_major_formatter()(0.02, None) == "20 ms"
    assert sorted(legend(figure)) == sorted(name for name in found if not name.startswith("_"))
    low, high = axes.get_xlim()
    assert 0.005 < low < 0.01 < 0.04 < high < 0.06
    # without a failure that has no share, and with a present value of 0, which a logarithm has no place for
    study.job.program["loop_period"] = 0.0
    (axes,) = draw_limits(study, {"loop_period": SweepVerdicts(lever, {0.01: verdict(20.0)}, sweep.scope)}).axes
    assert "fails without a share" not in marks(axes)
    assert "the job's own value" not in marks(axes)
    assert axes.get_xlabel() == "loop period, the job's own 0"
