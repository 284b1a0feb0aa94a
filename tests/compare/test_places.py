"""Traces of a closed-form path at other speeds, moved, turned, with noise or another clock: claimed against true.

The traces are made without gantrysim: three lines and a half circle, each from rest to rest by a trapezoid of speed,
with a known deviation to the left of the path.
"""

import contextlib
import json
import math
import re
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Budget, InputError, Job, Machine
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.measured import Trace
from gantrysim.compare.page import headline
from gantrysim.compare.vertices import noise_of

from support.compared import circle_job
from support.jobs import job_run
from support.soaked import examples, suite_runs

MACHINE = Machine("xy")
FEED = 50.0  # [mm/s]
ACCELERATION = 1000.0  # of the program's axes [mm/s²]
DEVIATION = 4e-3  # amplitude, to the left [mm]
WAVE = 7.0  # its length along the path [mm]
TEXT = "G21 G17 G90 G61\nF3000\nG0 X0 Y0\nM62 P0\nG1 X60\nG1 Y40\nG3 X20 Y40 I-20 J0\nG1 Y0\nM63 P0\nM2\n"


def line(start, end):
    start, end = np.array(start, float), np.array(end, float)
    length = np.linalg.norm(end - start)
    way = (end - start) / length
    return length, lambda s: start + s[:, None] * way, lambda s: np.tile([-way[1], way[0]], (s.size, 1))


def arc(centre, radius, begin):
    def angle(s):
        return begin + s / radius

    def point(s):
        return np.array(centre) + radius * np.column_stack([np.cos(angle(s)), np.sin(angle(s))])

    # left of a counter-clockwise circle is inside
    return math.pi * radius, point, lambda s: -np.column_stack([np.cos(angle(s)), np.sin(angle(s))])


PIECES = [line((0, 0), (60, 0)), line((60, 0), (60, 40)), arc((40, 40), 20.0, 0.0), line((20, 40), (20, 0))]


def trapezoid(length, feed, acceleration):
    """Time of a move from rest to rest, and its way at a time."""
    ramp = feed / acceleration
    duration = length / feed + ramp

    def way(t):
        t = np.clip(t, 0, duration)
        rising = 0.5 * acceleration * np.minimum(t, ramp) ** 2
        steady = feed * np.clip(t - ramp, 0, duration - 2 * ramp)
        falling = np.clip(t - (duration - ramp), 0, ramp)
        return rising + steady + feed * falling - 0.5 * acceleration * falling**2

    return duration, way


def ways(feed, acceleration):
    """Time at 1 kHz, and the way along the path, by trapezoids from rest to rest."""
    moves = [trapezoid(piece[0], feed * FEED, acceleration * ACCELERATION) for piece in PIECES]
    time = np.arange(0, sum(duration for duration, _ in moves) + 0.5, 1e-3)
    s = np.zeros(time.size)
    begin = 0.3
    for duration, way in moves:
        s += way(time - begin)
        begin += duration
    return time, s


def trace(feed=1.0, acceleration=1.0, offset=(0.0, 0.0), turn=0.0, noise=0.0, clock=0.0, at=None):
    """Times and positions, and the true rms of the deviation while it moves; at are time and way of another motion."""
    time, along = ways(feed, acceleration) if at is None else at
    points = np.zeros((time.size, 2))
    lateral = DEVIATION * np.sin(2 * np.pi * along / WAVE)
    before = 0.0
    for length, point, normal in PIECES:
        rows = along >= before
        s = np.minimum(along[rows] - before, length)
        points[rows] = point(s) + lateral[rows, None] * normal(s)
        before += length
    moving = np.gradient(along) > 0
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    x, y = points.T
    moved = np.column_stack([cos * x - sin * y, sin * x + cos * y]) + offset
    moved += noise * np.random.default_rng(3).standard_normal(moved.shape)
    return (1 + clock) * time + 7.3, moved, float(np.sqrt(np.mean(lateral[moving] ** 2)))


@pytest.fixture(scope="module")
def run():
    return circle_job(text=TEXT).run()


def compared(run, what=("path", "offset", "rotation"), **changes):
    time, points, true = trace(**changes)
    nozzle = np.column_stack([points, np.full(len(points), np.nan)])
    return Comparison.of(Trace(time, {}, nozzle), run, MACHINE, what), true


SPEEDS = {
    "same": {},
    "feed 0.98": {"feed": 0.98},
    "feed 1.1": {"feed": 1.1},
    "acceleration halved": {"acceleration": 0.5},
    "acceleration doubled": {"acceleration": 2.0},
    "feed and acceleration": {"feed": 0.9, "acceleration": 0.5},
}


@pytest.mark.parametrize("turn", suite_runs([-8.0, 5.0], 0))
def test_a_trace_that_is_turned_far_is_laid_on_the_run_anew(run, turn):
    """Places found on the path as it was not turned bend offset and turn: once by tens of micrometres."""
    comparison, true = compared(run, feed=0.9, turn=turn, offset=(100.0, 40.0))
    assert comparison.measured.values.contour.rms == pytest.approx(true, abs=1e-3)
    assert comparison.alignment.offsets["nozzle"][:2] == pytest.approx([100.0, 40.0], abs=1e-3)
    assert comparison.alignment.rotation == pytest.approx(turn, abs=2e-3)


def test_a_part_that_lies_across_is_found_by_its_turn():
    """Of which no place lies where the run passes; at other times, so that the clock does not tell."""
    zigzag = TEXT.replace("Y40\nG3 X20 Y40 I-20 J0\nG1 Y0\n", "Y5\nG1 X0\nG1 Y10\nG1 X60\n")
    assert zigzag != TEXT
    run = circle_job(text=zigzag).run()
    points = np.column_stack([-run.nozzle[:, 1], run.nozzle[:, 0], np.full(len(run.time), np.nan)])
    points[:, :2] += 0.003 * np.random.default_rng(4).standard_normal((len(points), 2))
    found = Comparison.of(Trace(1.3 * run.time, {}, points), run, MACHINE, ("path", "offset", "rotation")).alignment
    assert found.criterion == "path"
    assert found.rotation == pytest.approx(90.0, abs=0.01)
    assert found.offsets["nozzle"][:2] == pytest.approx([0.0, 0.0], abs=0.005)


@pytest.mark.validates(
    "contour error of a trace at another feed or acceleration, moved, turned, with noise or another clock",
    "deviation by which the trace was made",
    "1 µm",
)
@pytest.mark.parametrize("name", SPEEDS)
@pytest.mark.parametrize(
    "place", suite_runs([{}, {"offset": (0.03, 0.0), "noise": 0.0005}, {"offset": (12.0, -5.0), "turn": 0.4}], 2)
)
def test_another_speed_is_no_contour_error_and_no_offset(run, name, place):
    comparison, true = compared(run, **SPEEDS[name], **place)
    measured = comparison.measured.values.contour.rms
    assert measured == pytest.approx(true, abs=1e-3)
    alignment = comparison.alignment
    for axis, value in zip("xy", place.get("offset", (0.0, 0.0)), strict=True):
        estimate = alignment.estimates[f"nozzle {axis}"]
        assert abs(estimate.value - value) <= max(2 * estimate.interval, 1e-3)
        # what is claimed is true to a micrometre
        assert alignment.offsets["nozzle"]["xyz".index(axis)] == pytest.approx(value, abs=1e-3)
    assert alignment.rotation == pytest.approx(place.get("turn", 0.0), abs=2e-3)
    feed = SPEEDS[name].get("feed", 1.0)
    # the controller's own ramps are not trapezoids everywhere
    assert name == "same" or alignment.timing.kind == "speed"
    assert alignment.timing.speed.value == pytest.approx(feed, abs=2e-3)


def test_at_equal_times_another_feed_is_a_lag_and_no_clock(run):
    """Of millimetres, which the alignment at equal places leaves out; an offset that held a part bent the contour."""
    for feed in (0.98, 1.1):
        comparison, true = compared(run, ("time", "offset"), feed=feed)
        assert comparison.measured.values.contour.rms == pytest.approx(true, abs=1e-3)
        assert comparison.alignment.offsets["nozzle"][:2] == pytest.approx([0.0, 0.0], abs=1e-3)
        assert comparison.measured.values.lag.rms > 1.0
        assert not any("clock runs" in note for note in comparison.notes)
        assert any(
            note.endswith("--align path leaves out; that is most of the difference") for note in comparison.notes
        )
        at_places, _ = compared(run, feed=feed)
        assert at_places.measured.values.lag.rms < 0.1


@pytest.mark.parametrize("ppm", suite_runs([0.0, 30.0, -150.0, 800.0], 0, 1))
def test_a_clock_is_claimed_where_it_differs(run, ppm):
    # on the run's own way, of which the clock alone differs
    comparison, true = compared(run, clock=1e-6 * ppm, noise=1e-3, at=(run.time, run.progress))
    timing = comparison.alignment.timing
    assert timing.kind == ("clock" if ppm else "shift")
    assert abs(timing.clock.value - 1e-6 * ppm) <= max(1.5 * timing.clock.interval, 1e-6)
    assert timing.clock.interval < 1e-5
    assert comparison.measured.values.contour.rms == pytest.approx(math.hypot(true, 1e-3), abs=1e-3)


@pytest.mark.parametrize("seed_noise", suite_runs([1e-3, 4e-3], 0))
def test_noise_comes_back_as_noise(run, seed_noise):
    comparison, _ = compared(run, noise=seed_noise, offset=(0.03, 0.0))
    alignment = comparison.alignment
    assert alignment.noise == pytest.approx(seed_noise, rel=0.05)
    assert alignment.offsets["nozzle"][0] == pytest.approx(0.03, abs=1e-3)
    assert alignment.offsets["nozzle"][1] == 0.0
    assert alignment.rotation == 0.0
    assert alignment.estimates["nozzle x"].interval < 1e-3


@pytest.mark.soak
def test_intervals_hold_the_true_values_of_most_traces(run):
    """Of 95 % intervals of white noise, in 20 traces, at least nine tenths hold the offset; few claim one of zero."""
    time, points, _ = trace()
    rng = np.random.default_rng(11)
    held, claimed = 0, 0
    for _ in range(20):
        nozzle = np.column_stack([points + 2e-3 * rng.standard_normal(points.shape), np.full(len(points), np.nan)])
        estimates = Comparison.of(Trace(time, {}, nozzle), run, MACHINE).alignment.estimates
        held += abs(estimates["nozzle y"].value) <= estimates["nozzle y"].interval
        claimed += estimates["nozzle y"].distinguished
    assert held >= 18
    assert claimed <= 1


def test_a_straight_path_shows_no_rotation_about_it_but_offsets_at_its_ends():
    """Along a line places say nothing of an offset, but where it rests they do."""
    job = circle_job(text="G21 G17 G90 G61\nF3000\nG0 X0 Y0\nM62 P0\nG1 X80\nM63 P0\nM2\n")
    duration, way = trapezoid(80.0, 0.95 * FEED, ACCELERATION)
    time = np.arange(0, duration + 0.8, 1e-3)
    points = np.column_stack([way(time - 0.3) + 0.05, np.full(time.size, -0.02), np.full(time.size, np.nan)])
    points[:, :2] += 1e-3 * np.random.default_rng(2).standard_normal((time.size, 2))
    alignment = Comparison.of(Trace(time, {}, points), job.run(), MACHINE).alignment
    assert alignment.timing.kind == "speed"
    assert alignment.estimates["nozzle y"].value == pytest.approx(-0.02, abs=1e-3)
    along = alignment.estimates["nozzle x"]
    assert abs(along.value - 0.05) <= max(2 * along.interval, 5e-3)


@pytest.mark.parametrize("sigma", [1e-4, 3e-3])
def test_noise_is_found_beneath_a_motion(sigma):
    time = np.arange(0, 3, 1e-3)
    motion = np.column_stack([20 * np.cos(3 * time), 20 * np.sin(3 * time)])
    noisy = motion + sigma * np.random.default_rng(1).standard_normal(motion.shape)
    assert noise_of(motion) < 1e-6
    assert noise_of(noisy) == pytest.approx(sigma, rel=0.05)


def test_no_difference_is_left_only_where_everything_is_measured_and_agrees(run):
    whole = Trace.of_run(run, run)
    same = Comparison.of(whole, run, MACHINE)
    assert same.is_all_noise
    assert "no difference is left" in headline(same)
    for partial in (
        Trace(whole.time, whole.axes, None, (), whole.torques),
        Trace(whole.time, whole.axes, whole.nozzle),
        Trace(whole.time, {"encoder": whole.axes["encoder"]}, whole.nozzle, (), whole.torques),
    ):
        comparison = Comparison.of(partial, run, MACHINE)
        assert not comparison.is_all_noise
        assert "no difference is left" not in headline(comparison)
    # a torque that differs by 2 %
    other = Trace(whole.time, whole.axes, whole.nozzle, (), {"demand": 1.02 * whole.torques["demand"]})
    assert not Comparison.of(other, run, MACHINE).is_all_noise
    assert json.dumps(same.summary(), allow_nan=False)


@pytest.mark.parametrize("link", suite_runs(["nozzle", "encoder", "commanded"], 0))
def test_a_program_run_at_another_feed_has_its_own_contour_error(link):
    """A simulated machine instead of a closed form: its error is that of its own budget."""
    job = Job.load("fanuc-spiral")
    run = job_run("fanuc-spiral")
    text = re.sub(r"F(\d+)", lambda word: f"F{0.98 * float(word[1]):g}", job.program["program"])
    slower = job.changed({"program.program": text}).run()
    whole = Trace.of_run(slower, run)
    trace = Trace(whole.time, {}, whole.nozzle + np.array([0.03, 0, 0]))
    if link != "nozzle":
        trace = Trace(whole.time, {name: whole.axes[name] for name in dict.fromkeys((link, "encoder"))}, None)
    found = Comparison.of(trace, run, MACHINE)
    assert found.alignment.timing.kind == "speed"
    assert found.measured.values.contour.rms == pytest.approx(Budget(slower).values.contour.rms, abs=1e-3)
    offset = next(iter(found.alignment.offsets.values()))
    assert offset[0] == pytest.approx(0.03 if link == "nozzle" else 0.0, abs=1e-3)
    assert offset[1] == pytest.approx(0.0, abs=1e-3)


@examples(40)
@given(
    st.integers(8, 400),
    st.sampled_from(["constant", "noise", "walk", "two places", "spike", "line"]),
    st.sampled_from([1e-6, 1.0, 1e3, 1e6]),
    st.sampled_from([1e-4, 1e-2, 1.0]),
    st.integers(0, 99),
)
def test_a_trace_of_anything_is_compared_or_refused(count, kind, scale, period, seed):
    run = line_run()
    rng = np.random.default_rng(seed)
    points = {
        "constant": lambda: np.zeros((count, 3)),
        "noise": lambda: rng.standard_normal((count, 3)),
        "walk": lambda: np.cumsum(rng.standard_normal((count, 3)), axis=0),
        "two places": lambda: np.where(np.arange(count)[:, None] % 2, 1.0, 0.0) * np.ones(3),
        "spike": lambda: np.where(np.arange(count)[:, None] == count // 2, 1.0, 0.0) * np.ones(3),
        "line": lambda: np.linspace(0, 1, count)[:, None] * np.array([1.0, 0, 0]),
    }[kind]()
    time = np.cumsum(period * rng.uniform(0.1, 2, count))
    with contextlib.suppress(InputError):
        found = Comparison.of(Trace(time, {}, scale * points), run, MACHINE)
        assert json.dumps(found.summary(), allow_nan=False)
        assert "no difference is left" not in headline(found)


@cache
def line_run():
    return circle_job(text="G21 G17 G90 G61\nF3000\nG0 X0 Y0\nM62 P0\nG1 X20\nG1 Y20\nM63 P0\nM2\n").run()
