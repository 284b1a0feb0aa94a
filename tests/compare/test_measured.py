"""A trace that was shifted, moved, turned, resampled and made noisy is found again, and its error is the noise's."""

import dataclasses
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from gantrysim import Budget, InputError, Job, Machine, Run, Servo
from gantrysim.base.arrays import spans
from gantrysim.compare.alignment import aligned_trace
from gantrysim.compare.comparison import Comparison, coverage, evenly
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.compare.page import headline, share_text
from gantrysim.engine.simulate import perfect_follower
from gantrysim.metrics import circle_row
from gantrysim.record.setpoints import Setpoints
from gantrysim.study.circle.study import CircleStudy
from gantrysim.tables.column_table import ColumnTable, Source
from gantrysim.tables.reading import read_table

from support.compared import circle_job
from support.jobs import job_run
from support.soaked import examples, suite_runs

FOUND_SHIFT = 0.1  # of a sample
FOUND_PLACE = 1e-4  # [mm]
MACHINE = Machine("xy")


@pytest.fixture(scope="module")
def run():
    """The built-in spiral, but a turn and a half of it: a comparison takes as long as its run is."""
    job = Job.load("fanuc-spiral")
    text = job.program["program"].replace("Y-30", "Y-70")
    assert text != job.program["program"]
    return Job.load("fanuc-spiral", {"program.program": text}).run()


def logged(run, link, rate, late=0.0, moved=0.0, turn=0.0, noise=0.0, seed=1):
    """Positions of a run as another clock and frame have them, (time, positions)."""
    at = np.arange(0.0123 / rate, run.time[-1], 1 / rate)
    positions = CubicSpline(run.time, getattr(run, link))(at)
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    x, y, *more = positions.T
    positions = np.column_stack([cos * x - sin * y, sin * x + cos * y, *more])
    return at + late, positions + moved + np.random.default_rng(seed).normal(scale=noise, size=positions.shape)


@pytest.mark.validates(
    "a trace shifted, moved, turned, resampled, with noise",
    "what was done to it",
    "0.1 of a sample, 0.1 µm, 0.001 deg",
)
@given(
    late=st.floats(-5, 5),
    x=st.floats(-300, 300),
    rate=st.floats(400, 4000),
    turn=st.one_of(st.just(0.0), st.floats(-179, 179)),
    link=st.sampled_from(["commanded", "encoder", "nozzle"]),
)
@examples(15)
def test_shift_offset_and_turn_are_found_again(run, late, x, rate, turn, link):
    turn = turn if link == "nozzle" else 0.0
    time, positions = logged(run, link, rate, late, x, turn, noise=1e-3)
    trace = Trace(time, {} if link == "nozzle" else {link: positions}, positions if link == "nozzle" else None)
    found = aligned_trace(trace, run, ("time", "offset", "rotation") if turn else ("time", "offset"))
    assert abs(found.shift - late) * rate < FOUND_SHIFT
    assert found.offsets["nozzle" if link == "nozzle" else "axes"] == pytest.approx(x, abs=FOUND_PLACE)
    assert found.rotation == pytest.approx(turn, abs=1e-3)
    assert found.residual == pytest.approx(1e-3, rel=0.1)


@pytest.mark.validates(
    "what the model does not explain of it",
    "the noise",
    "2 %",
)
@pytest.mark.parametrize("turn", suite_runs([0.0, 25.0], 1))
def test_noise_on_the_nozzle_is_all_that_the_model_does_not_explain(run, turn):
    sigma = 2e-3
    time, nozzle = logged(run, "nozzle", 1730.0, 3.21765, np.array([12.3, -4.5, 1.0]), turn, sigma)
    what = ("time", "offset", "rotation") if turn else ("time", "offset")
    found = Comparison.of(Trace(time, {}, nozzle), run, MACHINE, what)
    assert found.alignment.shift == pytest.approx(3.21765, abs=FOUND_SHIFT / 1730)
    assert found.alignment.offsets["nozzle"] == pytest.approx([12.3, -4.5, 1.0], abs=FOUND_PLACE)
    for name in ("structure", "contour"):
        assert found.unexplained[name].rms == pytest.approx(math.sqrt(2) * sigma, rel=0.02)  # two directions
    mine, theirs = found.measured.values.contour.rms, found.simulated.values.contour.rms
    assert mine**2 - theirs**2 == pytest.approx(2 * sigma**2, rel=0.15)
    assert theirs == pytest.approx(Budget(run).values.contour.rms, rel=0.01)
    frequency, density = found.spectrum
    assert np.trapezoid(density, frequency) == pytest.approx(sigma**2, rel=0.1)  # white
    assert not found.peaks


def test_every_link_of_an_exact_trace_has_the_simulation_s_budget():
    # of a shorter run the time is found less exactly
    run = job_run("fanuc-spiral")
    trace = Trace(run.time + 1.0, {"commanded": run.commanded + 5.0, "encoder": run.encoder + 5.0}, run.nozzle - 7.0)
    found = Comparison.of(trace, run, MACHINE)
    assert found.alignment.by == "commanded"
    expected = Budget(run).values
    for budget in (found.measured.values, found.simulated.values):
        for name in ("program", "servo"):
            assert budget.parts[name].rms == pytest.approx(expected.parts[name].rms, rel=1e-3, abs=1e-5)
        assert budget.contour.rms == pytest.approx(expected.contour.rms, rel=1e-3)
    assert max(size.max for size in found.unexplained.values()) < FOUND_PLACE
    assert list(found.parts) == ["program", "servo", "structure"]
    assert not found.peaks


def test_a_vibration_that_the_model_lacks_is_named_by_its_frequency(run):
    time, nozzle = logged(run, "nozzle", 1000.0, noise=2e-4)
    nozzle = nozzle + 0.01 * np.sin(2 * np.pi * 87.0 * time)[:, None] * [1, 1, 0]
    found = Comparison.of(Trace(time, {}, nozzle), run, MACHINE)
    peak = found.peaks[0]
    assert peak.frequency == pytest.approx(87, abs=2)
    assert peak.rms == pytest.approx(0.01 / math.sqrt(2), rel=0.15)  # (n.(1, 1))^2 is 1 in the mean over directions


def test_an_assignment_of_a_file_is_that_of_its_text(tmp_path):
    file = tmp_path / "columns.toml"
    file.write_text('period = 0.002\nblocks = 3\n[columns]\ntime = "t[ms]"\nx = "px*0.001"\n')
    columns = {"time": Source("t", 1.0, "ms"), "x": Source("px", 0.001)}
    assert Assignment.parse(str(file)) == Assignment(columns, 0.002, 3)
    assert Assignment.parse("time=t[ms], x = px*0.001") == Assignment(columns)
    file.write_text('[columns]\nx = "px"\n')
    assert Assignment.parse(str(file)) == Assignment({"x": Source("px")})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("period = 0.002", r"must have a table \[columns\]"),
        ("columns = 3", r"must have a table \[columns\]"),
        ('rate = 3\n[columns]\nx = "px"', "may have period and blocks"),
        ('blocks = 1.5\n[columns]\nx = "px"', "blocks = 1.5: must be a whole number"),
        ('period = 0\n[columns]\nx = "px"', "period = 0"),
    ],
)
def test_a_file_that_is_no_assignment_is_refused(tmp_path, text, message):
    file = tmp_path / "columns.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        Assignment.parse(str(file))


def two_strokes(first, second):
    """The run of two strokes of some lengths, 10 mm apart, at 50 mm/s."""
    strokes = f"M62 P0\nG1 X{first}\nM63 P0\nG0 Y10\nM62 P0\nG1 X{first - second}\nM63 P0\nM2\n"
    return circle_job(text=f"G21 G17 G90 G61\nF3000\n{strokes}").follow()


def test_a_stretch_of_few_samples_has_no_spectrum_wherever_it_lies():
    run = two_strokes(0.3, 0.5)
    longest = max(after - first for first, after in spans(run.dispense))
    assert longest < 64 < np.flatnonzero(run.dispense)[-1]
    assert Comparison.of(Trace(run.time, {}, run.nozzle), run, MACHINE, ()).spectrum[0].size == 0


@pytest.mark.parametrize("rows", [[0, 1, 2, 3, 5, 4, 6, 7, 8, 9], [0, 1, 2, 2, 3, 4, 5, 6, 7, 8]])
def test_times_of_a_trace_must_rise(run, rows):
    time = 1e-3 * np.array(rows)
    table = ColumnTable("log", {"t": time, "x": time, "y": time}, {"t": "s", "x": "mm", "y": "mm"})
    with pytest.raises(InputError, match=rf"log: time goes from {max(time[3], time[4]) if rows[4] == 5 else 0.002:g}"):
        Trace.of(table, Assignment.parse("time=t,x=x,y=y"), run)


def test_a_trace_has_at_least_eight_samples(run):
    def trace(count):
        time = 1e-3 * np.arange(count)
        return Trace.of(ColumnTable("log", {"t": time, "x": time, "y": time}, {}), Assignment({}), run)

    assert trace(8).time.size == 8
    with pytest.raises(InputError, match="has 7 samples, must have at least 8"):
        trace(7)


@pytest.mark.parametrize("lengths", [(10.0, 40.0), (40.0, 10.0)])
def test_the_spectrum_is_that_of_the_longest_stretch_of_bead(lengths):
    """Two strokes with a vibration across each, of another frequency in each."""
    run = two_strokes(*lengths)
    on = spans(run.dispense)
    frequencies = (60.0, 140.0)
    nozzle = run.nozzle.copy()
    for (begin, after), frequency in zip(on, frequencies, strict=True):
        nozzle[begin:after, 1] += 0.01 * np.sin(2 * np.pi * frequency * run.time[begin:after])
    found = Comparison.of(Trace(run.time, {}, nozzle), run, MACHINE, ())
    seen, unseen = (frequencies[choose(lengths)] for choose in (np.argmax, np.argmin))
    assert found.peaks[0].frequency == pytest.approx(seen, abs=2)
    assert found.peaks[0].rms == pytest.approx(0.01 / math.sqrt(2), rel=0.1)
    assert all(abs(peak.frequency - unseen) > 10 for peak in found.peaks)


@pytest.mark.parametrize(("rate", "lost"), [(3.0, 1), (500.0, 7)])
def test_few_or_uneven_samples_have_a_budget_but_no_spectrum(run, rate, lost):
    """At 3 Hz some 46 samples fall on the bead; of 500 Hz every seventh is lost."""
    time, nozzle = logged(run, "nozzle", rate, noise=1e-3)
    kept = np.ones(len(time), bool) if lost == 1 else np.arange(len(time)) % lost != 3
    found = Comparison.of(Trace(time[kept], {}, nozzle[kept]), run, MACHINE, ("offset",))
    frequency, density = found.spectrum
    assert (frequency.size, density.size, found.peaks) == (0, 0, [])
    assert found.unexplained["contour"].rms == pytest.approx(math.sqrt(2) * 1e-3, rel=0.35 if lost == 1 else 0.05)
    # the period is that of most samples
    assert found.measured.analysis.run.period == pytest.approx(1 / rate)


@pytest.mark.parametrize(("off", "even"), [(0.009, True), (0.011, False)])
def test_samples_have_one_rate_within_a_hundredth_of_their_period(off, even):
    time = 2e-3 * np.arange(50) + 7.0
    time[20:] += off * 2e-3
    assert evenly(time) == even


@pytest.mark.soak
def test_links_that_are_not_measured_have_no_share_in_either_budget(run):
    encoder = Comparison.of(Trace(run.time, {"encoder": run.encoder}, None), run, MACHINE)
    assert list(encoder.parts) == ["servo"]
    assert encoder.notes == ("the command is not measured: it is the simulation's in both budgets",)
    nozzle = Comparison.of(Trace(run.time, {}, run.nozzle), run, MACHINE)
    assert nozzle.parts["structure"] == "commanded to nozzle"
    for found, absent in ((encoder, ("encoder", "structure")), (nozzle, ("servo", "encoder"))):
        for budget in (found.measured, found.simulated):
            assert all(budget.values.parts[name].max == 0 for name in absent)


SIGMA = 0.02  # of the noise, twice the tracking error [mm]


@pytest.fixture(scope="module")
def noisy():
    """A job whose program makes forty times the error that its servo makes, and encoders with as much noise."""
    run = job_run("an225")
    return run, run.encoder + np.random.default_rng(5).normal(scale=SIGMA, size=run.encoder.shape)


def test_what_is_not_measured_explains_nothing(noisy):
    run, encoder = noisy
    found = Comparison.of(Trace(run.time, {"encoder": encoder}, None), run, MACHINE)
    explained = found.explained
    tracking = Budget(run).values.parts["servo"].rms
    assert Budget(run).values.parts["program"].rms > 20 * SIGMA
    assert explained.links == ("servo",)
    assert explained.difference == pytest.approx(SIGMA, rel=0.02)
    assert explained.simulated == pytest.approx(tracking, rel=1e-3)
    assert explained.measured**2 == pytest.approx(tracking**2 + SIGMA**2, rel=0.05)
    assert explained.share == pytest.approx(tracking**2 / (tracking**2 + SIGMA**2), abs=0.03)
    assert 0.1 < explained.share < 0.3  # with the command on both sides it was 99.8 %
    assert found.not_compared == {
        "program": "the command is not measured",
        "structure": "the nozzle is not measured",
    }
    text = headline(found)
    assert f"Of servo, {1e3 * explained.measured:.1f} µm rms measured, the simulation explains " in text
    assert "Not compared: program, as the command is not measured; structure, as the nozzle" in text
    written = found.summary()
    assert written["explained"]["explained_share_percent"] == 100 * explained.share
    assert written["explained"]["measured_rms_um"] == 1e3 * explained.measured
    assert written["budgets"]["measured"]["servo"]["rms_um"] == 1e3 * found.measured.values.parts["servo"].rms
    assert list(written["not_compared"]) == ["program", "structure"]


def test_a_measured_command_counts(noisy):
    run, encoder = noisy
    found = Comparison.of(Trace(run.time, {"commanded": run.commanded, "encoder": encoder}, None), run, MACHINE)
    assert found.explained.links == ("program", "servo")
    assert found.explained.share == pytest.approx(1 - (SIGMA / found.measured.values.contour.rms) ** 2, abs=2e-4)
    assert list(found.not_compared) == ["structure"]


def test_a_share_may_be_negative_and_is_none_without_an_error(noisy):
    run, _ = noisy
    # a real machine without following error: of nothing, nothing can be explained
    exact = Comparison.of(Trace(run.time, {"encoder": run.commanded}, None), run, MACHINE, ())
    assert exact.explained.share is None
    assert "Of servo there is no measured error; the simulated one is 9.9 µm rms." in headline(exact)
    # one that errs to the other side, by half as much
    other = run.commanded + 0.5 * (run.commanded - run.encoder)
    opposite = Comparison.of(Trace(run.time, {"encoder": other}, None), run, MACHINE, ())
    assert opposite.explained.share == pytest.approx(1 - (1.5 / 0.5) ** 2, rel=0.01)
    assert "the simulation explains none (−80" in headline(opposite)


@pytest.mark.parametrize(("share", "text"), [(1.0, "100.0 %"), (0.99996, "99.9 %"), (0.0, "0.0 %"), (-0.5, "−50.0 %")])
def test_only_all_is_a_hundred_percent(share, text):
    assert share_text(share) == text


def test_an_axis_that_is_not_measured_is_compared_in_neither_budget(noisy):
    run, _ = noisy
    missing = [np.nan, 0.0]  # of x
    encoder = Comparison.of(
        Trace(run.time, {"commanded": run.commanded + 0.01, "encoder": run.encoder + missing}, None), run, MACHINE, ()
    )
    for budget, command in ((encoder.measured, run.commanded + 0.01), (encoder.simulated, run.commanded)):
        record = budget.analysis.run
        np.testing.assert_allclose(record.encoder[:, 0], command[:, 0], atol=1e-9)
        np.testing.assert_allclose(record.encoder[:, 1], run.encoder[:, 1], atol=1e-9)
    command = {"commanded": run.commanded + missing, "encoder": run.encoder}
    partial = Comparison.of(Trace(run.time, command, None), run, MACHINE)
    assert partial.parts == {"servo": "commanded to encoder"}
    assert partial.not_compared["program"] == "the command of x is not measured"
    with pytest.raises(InputError, match="the command of some axes alone, not of x: must have that of every axis"):
        Comparison.of(Trace(run.time, {"commanded": run.commanded + missing}, None), run, MACHINE)


def test_the_command_of_an_axis_at_rest_need_not_be_measured():
    run = job_run("fanuc-conical")
    z = np.arange(len(run.axes)) == run.axes.index("z")
    resting = dataclasses.replace(run, commanded=np.where(z, run.commanded[0], run.commanded))
    machine = Job.load("fanuc-conical").built_machine
    trace = Trace(run.time, {"commanded": np.where(z, np.nan, run.commanded), "encoder": run.encoder}, None)
    assert "program" in Comparison.of(trace, resting, machine, ()).parts
    assert "program" not in Comparison.of(trace, run, machine, ()).parts


def test_a_turning_work_piece_is_compared_in_degrees_and_millimetres():
    run = job_run("stage-outline")
    rng = np.random.default_rng(2)
    encoder = run.encoder + np.array([3.0, -2.0, 1.0]) + rng.normal(scale=1e-3, size=run.encoder.shape)
    found = Comparison.of(
        Trace(run.time + 0.5, {"encoder": encoder}, None), run, Job.load("stage-outline").built_machine
    )
    assert found.alignment.shift == pytest.approx(0.5, abs=FOUND_SHIFT * run.period)
    assert found.alignment.offsets["axes"] == pytest.approx([3.0, -2.0, 1.0], abs=FOUND_PLACE)
    # across the path, with the encoders' counts
    assert found.alignment.residual == pytest.approx(1e-3, rel=0.1)


@pytest.mark.soak
def test_a_machine_that_lags_by_a_time_constant_runs_a_circle_too_small(tmp_path, circle):
    # another program: a first-order lag behind the command, stepped at 10 kHz, logged in metres and milliseconds
    radius, omega, tau, step = 40.0, 2.5, 0.02, 1e-4
    follower = perfect_follower(MACHINE, Setpoints.along(circle(radius, 3.0), radius * omega, 1e-3))
    turn = follower.commanded
    at = np.arange(0, follower.time[-1], step)
    target = np.stack([np.interp(at, follower.time, turn[:, a]) for a in range(2)], axis=1)
    position = [target[0]]
    for aim in target[:-1]:
        position.append(position[-1] + (aim - position[-1]) * (1 - math.exp(-step / tau)))
    table = zip(at, position, target, strict=True)
    rows = [f"{1e3 * (t + 0.7):.4f};" + ";".join(f"{v / 1e3:.9f}" for v in (*own, *aim)) for t, own, aim in table]
    file = tmp_path / "plc.csv"
    file.write_text("\n".join(["Zeit;Ist X;Ist Y;Soll X;Soll Y", *rows[::7]]))
    columns = "time=Zeit[ms],encoder.x=Ist X[m],encoder.y=Ist Y[m]"
    command = ",commanded.x=Soll X[m],commanded.y=Soll Y[m]"
    table = read_table(file)
    alone, whole = (Trace.of(table, Assignment.parse(text), follower) for text in (columns, columns + command))
    # without the command, the shift takes up the lag
    assert aligned_trace(alone, follower).shift == pytest.approx(0.7 + math.atan(omega * tau) / omega, abs=5e-4)
    found = Comparison.of(whole, follower, MACHINE)
    assert found.alignment.shift == pytest.approx(0.7, abs=FOUND_SHIFT * 7 * step)
    tracking = found.measured.parts["servo"].lateral
    steady = slice(len(tracking) // 3, -len(tracking) // 20)
    inward = radius * (1 - 1 / math.sqrt(1 + (omega * tau) ** 2))
    assert tracking[steady] == pytest.approx(inward, rel=0.01)
    assert found.simulated.values.contour.max < 1e-5


@pytest.fixture(scope="module")
def circle_test():
    return CircleStudy(radius=30.0, speed=100.0)


@pytest.mark.soak
def test_a_measured_circle_has_the_values_of_the_circular_test(circle_test):
    run = circle_test.job.run()
    trace = Trace(run.time + 2.0, {"commanded": run.commanded, "encoder": run.encoder}, run.nozzle)
    found = Comparison.of(trace, run, MACHINE).circle(30.0, circle_test.centre)
    expected = circle_row(run, circle_test.centre, 30.0, circle_test.lead, 15.0)
    assert found["measured"]["circular_deviation_um"] == pytest.approx(expected["circular_deviation_um"], abs=0.01)
    for values in found.values():
        assert values == {key: pytest.approx(expected[key], abs=0.01) for key in values}
    # a spoilt lead does not count, before or after the one circle
    nozzle = run.nozzle.copy()
    swept = 360 + 2 * circle_test.lead
    angle = np.unwrap(np.arctan2(*(run.commanded_tip[:, :2] - circle_test.centre).T[::-1]))
    passed = np.degrees(np.abs(angle - angle[0]))
    nozzle[(passed < circle_test.lead - 5) | (passed > swept - circle_test.lead + 5)] *= 1.01
    spoilt = Comparison.of(Trace(run.time, {"commanded": run.commanded}, nozzle), run, MACHINE, ())
    assert spoilt.circle(30.0, circle_test.centre)["measured"] == pytest.approx(found["measured"], abs=0.01)
    for radius in (20.0, 40.0):
        with pytest.raises(InputError, match=r"10 mm off the radius of .* mm: must be a full circle there"):
            Comparison.of(trace, run, MACHINE).circle(radius, circle_test.centre)


@given(
    begin=st.floats(0.0, 0.7),
    share=st.floats(0.15, 0.6),
    late=st.floats(-5, 5),
    link=st.sampled_from(["commanded", "encoder", "nozzle"]),
)
@examples(10)
def test_a_trace_of_a_part_is_found_along_the_run_and_compared_there(run, begin, share, late, link):
    """Its budget is that of the whole run at the same ticks."""
    time, positions = logged(run, link, 1 / run.period, late, 7.0, noise=1e-3)
    part = slice(int(begin * len(time)), int((begin + share) * len(time)))
    positions = positions[part]
    axes, nozzle = ({}, positions) if link == "nozzle" else ({link: positions}, None)
    found = Comparison.of(Trace(time[part], axes, nozzle), run, MACHINE)
    assert found.alignment.shift == pytest.approx(late, abs=FOUND_SHIFT * run.period)
    assert found.alignment.others == ()
    simulated = found.simulated.analysis
    whole = Budget(run)
    at = np.searchsorted(run.time[whole.analysis.ticks], simulated.run.time[simulated.ticks] - 1e-9)
    inner = (at > 0) & (at < len(whole.analysis.ticks) - 1)
    expected = np.interp(
        simulated.run.time[simulated.ticks], run.time[whole.analysis.ticks], whole.analysis.commanded.s
    )
    assert simulated.commanded.s[inner] == pytest.approx(expected[inner], abs=0.05)
    if begin + share < 0.8:
        assert "% of the time for which the dispenser is on" in found.notes[-1]


def test_a_trace_that_fits_several_turns_of_a_circle_is_not_placed(circle):
    """Five turns at one speed: a trace of a part of a turn fits the other turns as well."""
    servo = Servo.derive(MACHINE.axes)
    path = circle(30.0, 5.0)
    angle = np.arange(0, 10 * np.pi, 0.1 / 30.0)
    position = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    setpoints = Setpoints(servo.period, ("x", "y"), position, np.ones(len(angle), bool), path)
    run = perfect_follower(MACHINE, setpoints)
    turn = 2 * np.pi * 30.0 / 0.1 * servo.period
    part = slice(int(1.3 * turn / servo.period), int(1.9 * turn / servo.period))
    found = Comparison.of(Trace(run.time[part], {"encoder": run.encoder[part]}, None), run, MACHINE)
    shifts = sorted([found.alignment.shift, *found.alignment.others])
    assert np.diff(shifts) == pytest.approx(turn, rel=1e-3)
    assert len(shifts) == 5
    assert "which part it covers is not identified" in found.notes[-1]


def test_traces_that_cannot_be_compared_are_refused(run):
    before = run.time < run.time[run.dispense.argmax()]
    with pytest.raises(InputError, match="in which the dispenser is off: must cover some of"):
        Comparison.of(Trace(run.time[before], {"encoder": run.encoder[before]}, None), run, MACHINE, ())
    with pytest.raises(InputError, match="covers 0 of its samples"):
        Comparison.of(Trace(run.time + 1e3, {"encoder": run.encoder}, None), run, MACHINE, ())
    with pytest.raises(InputError, match="unknown alignment 'place'"):
        Comparison.of(Trace(run.time, {"encoder": run.encoder}, None), run, MACHINE, ("place",))
    with pytest.raises(InputError, match="alignment path and time: must be one of the two"):
        Comparison.of(Trace(run.time, {"encoder": run.encoder}, None), run, MACHINE, ("path", "time"))
    for factor, told in ((1e3, "lasts"), (1e-3, "is its time in another unit")):
        with pytest.raises(InputError, match=told):
            aligned_trace(Trace(factor * run.time, {"encoder": run.encoder}, None), run)


def test_the_command_writes_both_budgets_and_their_plots(tmp_path, gantrysim_command):
    folder = tmp_path / "out"
    assert (
        gantrysim_command(
            "run", "fanuc-spiral", "--out", folder, "--no-video", "--no-report", "--no-causes", "--no-improve"
        )[0]
        == 0
    )
    time, nozzle = logged(Run.load(folder / "run.npz"), "nozzle", 800.0, 1.0, 2.0, 0.0, 1e-3)
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([time, nozzle[:, :2] * 1e3]), delimiter=",", header="t,px,py", comments="")
    columns = "time=t,x=px*0.001,y=py[um]"
    status, out, err = gantrysim_command("compare", folder, "--measured", log, "--columns", columns)
    assert (status, err) == (0, "")
    assert "nozzle in z is not measured" in " ".join(out.split())
    found = json.loads((folder / "compare" / "compare.json").read_text())
    assert found["alignment"]["shift_s"] == pytest.approx(1.0, abs=FOUND_SHIFT / 800)
    files = {"compare.json", "overlay.png", "spectrum.png", "report.html"}
    assert {item.name for item in (folder / "compare").iterdir()} == files
    for arguments, message in (
        (("--columns", "time=t,x=nope,y=py"), ": unknown column 'nope'"),
        (("--columns", columns, "--align", "tim"), "did you mean time"),
        (("--columns", columns, "--circle", "10,1"), "must be RADIUS or RADIUS,X,Y"),
    ):
        status, _, err = gantrysim_command("compare", folder, "--measured", log, *arguments)
        assert status == 2
        assert message in " ".join(err.split())


@pytest.mark.parametrize(
    ("order", "signs", "words"),
    suite_runs(
        [
            ([1, 0], (1, 1), "with x and y swapped:"),
            ([0, 1], (-1, 1), "with x mirrored:"),
            ([1, 0], (1, -1), "with x and y swapped, x mirrored:"),
        ],
        2,
    ),
)
def test_swapped_and_mirrored_axes_are_named(run, order, signs, words):
    time, encoder = logged(run, "encoder", 1000.0, 0.3, 5.0, noise=1e-3)
    trace = Trace(time, {"encoder": encoder[:, order] * signs}, None)
    with pytest.raises(InputError, match=words):
        Comparison.of(trace, run, MACHINE)


def test_a_wrong_scale_and_a_wrong_clock_are_named(run):
    time, encoder = logged(run, "encoder", 1000.0, 0.3, 5.0, noise=1e-3)

    def notes(at, positions):
        return [
            note
            for note in Comparison.of(Trace(at, {"encoder": positions}, None), run, MACHINE).notes
            if "most" in note
        ]

    assert notes(time, encoder) == []
    (scale,) = notes(time, encoder * (1.0, 1.0004))
    assert scale.startswith("y of the trace is 1.0004")
    timing = aligned_trace(Trace(time * (1 + 50e-6), {"encoder": encoder}, None), run).timing
    assert timing.kind == "clock"
    assert abs(timing.clock.value - 50e-6) < timing.clock.interval < 1e-6
    trace = Trace(time * (1 + 50e-6), {"encoder": encoder}, None)
    (clock,) = [note for note in Comparison.of(trace, run, MACHINE, ("time", "offset")).notes if "most" in note]
    assert clock.startswith("the trace's clock runs fast by 50 ppm")
    with pytest.raises(InputError, match=r"x: the trace is 1\.03 times the run: a column in another unit"):
        notes(time, encoder * (1.03, 1.0))


@pytest.mark.parametrize("what", [("path", "offset", "rotation"), ("time", "offset", "rotation")])
@pytest.mark.parametrize(("scale", "clock"), [(1.002, 0.0), (1.0, 9e-4), (0.995, 0.0), (1.002, -4e-4)])
def test_offsets_and_turn_hold_nothing_of_a_scale_or_a_clock(run, scale, clock, what):
    """Of a part of the path, over which an offset and a turn take up much of both; what was done to it is known."""
    time, nozzle = logged(run, "nozzle", 1000.0, 0.3, 5.0, noise=1e-3)
    part = slice(0, int(0.55 * len(time)))
    middle = float(nozzle[part, 0].mean())
    wrong = nozzle[part] + (scale - 1) * np.column_stack([nozzle[part, 0] - middle, np.zeros((len(time[part]), 2))])
    trace = Trace((1 + clock) * time[part], {}, wrong)
    found = Comparison.of(trace, run, MACHINE, what).alignment
    # of the noise 0.1 µm is left, and of a scale that is off by a thousandth of itself 1e-3 x 5e-3 x 50 mm
    assert found.offsets["nozzle"] == pytest.approx([5.0, 5.0, 5.0], abs=4e-4)
    assert found.rotation == pytest.approx(0.0, abs=1e-3)
    assert found.shift == pytest.approx(0.3 + clock * np.mean(time[part]), abs=5e-4 * abs(clock / 1e-4) + 2e-5)


@pytest.mark.soak
def test_inches_are_named(run):
    """So far from the run that its axes are tried in every order, too."""
    time, encoder = logged(run, "encoder", 1000.0, 0.3, 5.0, noise=1e-3)
    with pytest.raises(InputError, match=r"x: the trace is 0\.03937 times the run: a column in another unit"):
        _ = Comparison.of(Trace(time, {"encoder": encoder / 25.4}, None), run, MACHINE).notes


@pytest.mark.parametrize(("factor", "refused"), suite_runs([(1e3, True), (2.1, True), (1.9, False)], 1))
def test_a_trace_far_wider_than_the_run_is_in_another_unit(run, factor, refused):
    time, nozzle = logged(run, "nozzle", 1000.0)
    trace = Trace(time, {}, nozzle * (1.0, factor, 1.0))
    # below the bound the scale is named instead
    with pytest.raises(InputError, match="y of the trace spans" if refused else "y: the trace is 1.9 times the run"):
        Comparison.of(trace, run, MACHINE)


@pytest.mark.parametrize(
    ("heads", "links"),
    [
        ("time [s],x [um],y [um]", ("nozzle",)),
        ("t,nozzle_x [um],nozzle_y [um]", ("nozzle",)),
        ("time,encoder.x [um],encoder.y [um]", ("encoder",)),
        ("time,commanded x [um],commanded y [um]", ("commanded",)),
        ("time,x command [um],y command [um]", ("commanded",)),
        ("time,x_position [um],y_position [um]", ("encoder",)),
    ],
)
def test_columns_that_are_named_as_the_quantities_need_no_option(tmp_path, run, heads, links):
    time, nozzle = logged(run, "nozzle", 500.0)
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([time, 1e3 * nozzle[:, :2]]), delimiter=",", header=heads, comments="")
    trace = Trace.of(read_table(log), Assignment({}), run)
    assert trace.links == links
    measured = trace.nozzle if links == ("nozzle",) else trace.axes[links[0]]
    assert measured[:, :2] == pytest.approx(nozzle[:, :2], abs=1e-9)
    said = [note for note in trace.notes if note.startswith("taken as the nozzle's: x [um], y [um]")]
    assert len(said) == ("x [um]" in heads.split(","))


@pytest.mark.parametrize("heads", ["time,x position,y position", "time,x_command,y_command"])
def test_positions_of_a_machine_s_log_without_a_unit_are_in_metres_as_identify_reads_them(tmp_path, run, heads):
    time, nozzle = logged(run, "nozzle", 500.0)
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([time, 1e-3 * nozzle[:, :2]]), delimiter=",", header=heads, comments="")
    (measured,) = Trace.of(read_table(log), Assignment({}), run).axes.values()
    assert measured[:, :2] == pytest.approx(nozzle[:, :2], abs=1e-9)


@pytest.mark.parametrize(("end", "note"), [(0.9, []), (0.86, ["95.0 % of the time"]), (0.5, ["50.0 % of the time"])])
def test_what_a_trace_covers_of_the_bead_is_told_where_it_is_not_all(end, note):
    """The dispenser is on from 0.1 s to 0.9 s."""
    time = np.arange(1000) * 1e-3
    run = SimpleNamespace(time=time, period=1e-3, dispense=(time >= 0.1) & (time < 0.9))
    covered = SimpleNamespace(time=time[time <= end - 1e-9])
    notes = coverage(covered, run, SimpleNamespace(others=(), shift=0.0))
    assert len(notes) == len(note)
    assert all(words in text for words, text in zip(note, notes, strict=True))


TURNS = "G21 G90 G64 P0.01\nG0 X0 Y0\nG{} X0 Y0 I20 J0 P2 F3000\nM2\n"
OVAL = 0.05  # amplitude of the ellipse that is added to the trace [mm]


@pytest.mark.parametrize("code", suite_runs([2, 3], 0))
def test_the_command_gives_the_circle_of_a_trace_beside_that_of_the_run(tmp_path, gantrysim_command, code):
    """Its radial range over the middle 360 degrees, by the trace itself, in both directions from the angle of 180."""
    (tmp_path / "turns.ngc").write_text(TURNS.format(code))
    folder = tmp_path / "out"
    alone = ("--no-video", "--no-report", "--no-causes", "--no-improve")
    gantrysim_command("run", tmp_path / "turns.ngc", "--out", folder, *alone)
    run = Run.load(folder / "run.npz")
    centre = np.array([20.0, 0.0])
    arm = run.encoder[:, :2] - centre
    angle = np.arctan2(*arm.T[::-1])
    oval = centre + arm * (1 + OVAL / 20 * np.cos(2 * angle))[:, None]
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([run.time, oval]), delimiter=",", header="t,px,py", comments="", fmt="%.9f")
    measured = ("compare", folder, "--measured", log, "--columns", "time=t,x=px,y=py", "--align", "none")
    status, out, err = gantrysim_command(*measured, "--circle", "20,20,0")
    assert (status, err) == (0, "")
    found = json.loads((folder / "compare" / "compare.json").read_text())["circle"]
    swept = np.abs(np.unwrap(np.arctan2(*(run.commanded[:, :2] - centre).T[::-1])))
    swept -= swept[0]
    lead = 0.5 * (swept[-1] - 2 * np.pi)
    middle = (swept >= lead) & (swept <= swept[-1] - lead)
    for name, points in (("measured", oval), ("simulated", run.nozzle[:, :2])):
        radius = np.hypot(*(points[middle] - centre).T)
        assert found[name]["circular_deviation_um"] == pytest.approx(1e3 * np.ptp(radius), rel=0.02)
    assert found["measured"]["circular_deviation_um"] > found["simulated"]["circular_deviation_um"] + 0.5e3 * OVAL
    row = next(line for line in out.splitlines() if "circular_deviation_um" in line)
    assert [f"{found[name]['circular_deviation_um']:.2f}" in row for name in ("measured", "simulated")] == [True, True]
    status, _, err = gantrysim_command(*measured, "--circle", "25")
    assert status == 2
    assert "must be a full circle there" in " ".join(err.split())
