"""The causes of a job's error: what switching one off is worth, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from gantrysim import Budget, Job, causes_of
from gantrysim.base.errors import InputError
from gantrysim.job import causes as module
from gantrysim.job.causes import CAUSES, HEADS, Cause, Setup
from gantrysim.job.ideal import FINE_PERIOD
from gantrysim.metrics.budget import LINKS
from gantrysim.record.setpoints import Setpoints

from support.runs import PERIOD, plain
from support.soaked import of_jobs, suite_runs

EXACT = 1e-9  # [mm]
RODS = 2e-5  # what the equality constraints of a closed chain leave [mm]
SCATTER = 1e-4  # of the rms contour error [mm]
SHORT_STEP = 2.5e-5  # physics step of the closed forms [s]
WINDING = 0.03  # of its worth, relative
SAMPLING = FINE_PERIOD / PERIOD + 0.03  # what is left of the sampling, relative

OF_MACHINE = ("an225", "fanuc-conical", "slicer-square", "stage-outline", "delta-arc")  # counts and springs: one each
WITHOUT = {cause.name: cause.without for cause in CAUSES}
SMALL = ("diameter=40", "turns=1", "thickness=5")


@pytest.fixture(scope="module")
def found():
    """The causes of a small spiral."""
    job = Job.load("an225", SMALL)
    return job, causes_of(job)


def by_name(causes):
    return {effect.cause.name: effect for effect in causes.effects}


@pytest.mark.validates(
    "without counts, compliance or errors of the program, every job: the part of that link",
    "none",
    "1e-9 mm; 2e-5 mm behind the rods of the delta robot",
)
@pytest.mark.parametrize("name", of_jobs("an225", "delta-arc", "stage-outline"))
def test_every_cause_is_gone_from_the_link_in_which_it_acts(name):
    job = Job.load(name)
    setup = Setup(job.built_machine, job.built_servo, job.setpoints, job.simulation.physics_step)
    run = WITHOUT["program"](setup).run()
    assert Budget(run).parts["program"].size.max() < EXACT
    if name not in OF_MACHINE:
        return
    without_counts = Budget(WITHOUT["counts"](setup).run())
    assert not without_counts.parts["encoder"].size.any()
    link = RODS if job.built_machine.kinematics.followers else EXACT
    assert Budget(WITHOUT["compliance"](setup).run()).parts["structure"].size.max() < link


def test_structure_says_where_and_counts_are_among_its_causes():
    """Between motor and nozzle, count noise through kd shakes more than the path's accelerations bend."""
    effects = by_name(causes_of(Job.load("fanuc-spiral")))
    structure = effects["counts"].before["structure"].rms
    assert effects["counts"].without["structure"].rms < 0.6 * structure
    assert effects["counts"].worth["structure"].rms > 0.4 * structure
    assert effects["compliance"].worth["structure"].rms == pytest.approx(structure, abs=EXACT)


def test_the_errors_are_those_of_the_job_and_worths_are_differences(found):
    job, causes = found
    run = job.run()
    values = Budget(run).values
    for name, part in {**values.parts, "contour": values.contour}.items():
        assert (causes.errors[name].rms, causes.errors[name].max) == pytest.approx((part.rms, part.max))
    assert [effect.cause for effect in causes.effects] == list(CAUSES)
    for effect in causes.effects:
        assert not effect.failure
        for name, worth in effect.worth.items():
            assert worth.rms == effect.before[name].rms - effect.without[name].rms
            assert worth.max == effect.before[name].max - effect.without[name].max
        if effect.cause.name != "sampling":
            assert effect.before == causes.errors
    assert causes_of(job, run) == causes


def test_only_a_cause_that_acts_on_the_command_changes_the_part_of_the_program(found):
    _, causes = found
    for name, effect in by_name(causes).items():
        if name == "program":
            assert effect.without["program"].max < EXACT < causes.errors["program"].max
        elif name != "sampling":
            assert effect.without["program"] == causes.errors["program"]


def test_the_gains_stay_those_of_the_real_machine(found):
    job, _ = found
    setup = Setup(job.built_machine, job.built_servo, job.setpoints)
    for cause in CAUSES:
        ideal = cause.without(setup)
        values = ideal.servo.values()
        differ = {name for name, value in setup.servo.values().items() if value != values[name]}
        assert differ == {"counts": {"resolution"}, "sampling": {"period"}}.get(cause.name, set())


def test_the_number_of_threads_does_not_matter(found, monkeypatch):
    job, causes = found
    monkeypatch.setattr("gantrysim.job.causes.os.cpu_count", lambda: 1)
    assert causes_of(job) == causes


def test_the_order_of_the_causes_does_not_matter(found, monkeypatch):
    job, causes = found
    monkeypatch.setattr(module, "CAUSES", CAUSES[::-1])
    assert by_name(causes_of(job)) == by_name(causes)


@pytest.mark.validates(
    "effect of an absent cause",
    "none",
    "exact",
)
def test_a_cause_that_is_absent_is_worth_nothing_at_all(rigid):
    machine = rigid(inductance=0.0).source
    program = {"controller": "trio.MoveSpiral", "diameter": 60, "turns": 1, "thickness": 5, "speed": 100}
    exact = {"feedforward": 0.5, "resolution": 0.0}
    job = Job(name="ideal", machine=str(machine), program={**program, "loop_period": 0}, servo=exact)
    effects = by_name(causes_of(job))
    assert effects["sampling"].worth["contour"].rms != 0
    setup = Setup(
        job.built_machine, job.built_servo.with_values(period=FINE_PERIOD), job.controller.setpoints(FINE_PERIOD)
    )
    assert WITHOUT["sampling"](setup) is setup
    for name in ("program", "counts", "friction", "winding", "compliance"):
        assert effects[name].without == effects[name].before
        assert {(worth.rms, worth.max) for worth in effects[name].worth.values()} == {(0.0, 0.0)}


def response(axis, servo, a, w, period, lag):
    """Position per command of one axis at the angular frequency w, in closed form.

    P = (C + F) G / (1 + C G) with the law C and the feed-forward F. The plant G is a mass with viscous friction and,
    unless the lag is 0, the winding. It is sampled exactly, or continuous where the period is 0.
    """
    plant = np.array([[0, 1, 0], [0, -axis.viscous / axis.inertia, 1 / axis.inertia], [0, 0, -1 / (lag or 1)]])
    drive = np.array([[0], [0], [1 / (lag or 1)]])
    if not lag:  # the torque acts at once
        plant, drive = plant[:2, :2], plant[:2, 2:]
    one = np.eye(len(plant))
    z = s = 1j * w
    if period:
        plant, drive, *_ = cont2discrete((plant, drive, one, 0 * drive), period)
        z = np.exp(1j * w * period)
        s = (1 - 1 / z) / period
    g = np.linalg.solve(z * one - plant, drive)[0, 0]
    c = servo.gains[a].kp + servo.gains[a].kd * s
    f = servo.gains[a].velocity_ff * s + servo.gains[a].acceleration_ff * s**2
    return (c + f) * g / (1 + c * g)


@pytest.mark.validates(
    "effect of the winding on a circle",
    "sampled loop with and without it, in closed form",
    "3 %",
)
@pytest.mark.parametrize("feedforward", suite_runs([0.0, 1.0], 1))
@pytest.mark.parametrize("speed", suite_runs([100.0, 200.0], 1))
def test_winding_and_sampling_are_worth_their_lag_on_a_circle(rigid, circle, feedforward, speed):
    """The steady radial error of two axes that lag by the winding's L/R, and by the hold and the difference."""
    machine, radius = rigid(), 20.0
    servo = plain(machine, feedforward=feedforward)
    setup = Setup(machine, servo, Setpoints.along(circle(radius, 4.0), speed, PERIOD), SHORT_STEP)

    def simulated(setup):
        run = setup.run()
        last = run.time > 0.75 * run.time[-1]
        last[-1] = False  # the last way is shorter than the others
        return np.sqrt(np.mean((np.hypot(*run.nozzle[last, :2].T) - radius) ** 2))

    def expected(period, lag):
        angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
        x, y = (
            (response(axis, servo, a, speed / radius, period, lag) * np.exp(1j * (angle - a * np.pi / 2))).real
            for a, axis in enumerate(machine.axes)
        )
        return np.sqrt(np.mean((radius * np.hypot(x, y) - radius) ** 2))

    lag = machine.axes[0].lag
    whole = simulated(setup)
    assert whole == pytest.approx(expected(PERIOD, lag), rel=WINDING)
    winding = expected(PERIOD, lag) - expected(PERIOD, 0.0)
    assert whole - simulated(WITHOUT["winding"](setup)) == pytest.approx(winding, rel=WINDING)
    sampling = expected(PERIOD, lag) - expected(0.0, lag)
    assert whole - simulated(WITHOUT["sampling"](setup)) == pytest.approx(sampling, rel=SAMPLING)
    assert min(winding, sampling) > 1e-5


def test_without_friction_the_spikes_at_reversals_vanish(xy, circle):
    radius, speed = 40.0, 100.0
    setup = Setup(xy, plain(xy, integral_time=0.03), Setpoints.along(circle(radius, 2.0), speed, PERIOD))

    def spikes(setup):
        """Largest radial error within the 150 ms after an axis' reversal, and elsewhere, in the second turn."""
        run = setup.run()
        angle = speed / radius * run.time
        error = np.abs(np.hypot(*run.nozzle[:, :2].T) - radius)
        second = (angle > 2 * np.pi) & (angle < 3.95 * np.pi)
        after = (angle % (np.pi / 2)) < 0.15 * speed / radius
        return error[second & after].max(), error[second & ~after].max()

    at_reversals, elsewhere = spikes(setup)
    assert at_reversals > 3 * elsewhere
    at_reversals, elsewhere = spikes(WITHOUT["friction"](setup))
    assert at_reversals == pytest.approx(elsewhere, rel=0.1)


def test_sampling_is_compared_at_its_own_physics_step(found):
    job, causes = found
    effect = by_name(causes)["sampling"]
    again = Budget(job.changed({"simulation.physics_step": FINE_PERIOD}).run()).values
    assert effect.before["contour"].rms == pytest.approx(again.contour.rms)
    assert effect.before != causes.errors
    rms = 1e3 * again.contour.rms
    assert f"sampling: compared with the job at the same physics step, {rms:.1f} µm rms" in causes.notes
    # where the job's own step is as short, there is one reference
    fine = causes_of(job.changed({"simulation.physics_step": FINE_PERIOD}))
    assert by_name(fine)["sampling"].before == fine.errors


def test_the_record_without_sampling_has_the_ticks_of_the_program(found):
    job, _ = found
    setup = Setup(job.built_machine, job.built_servo, job.setpoints)
    run, fine = setup.run(), WITHOUT["sampling"](setup).run()
    assert fine.period == run.period
    assert fine.time == pytest.approx(run.time)
    for name in ("commanded", "dispense"):
        assert np.array_equal(getattr(fine, name), getattr(run, name))


def test_runs_that_fail_are_reported_in_their_rows(monkeypatch):
    def impossible(setup):
        raise InputError("x = 200 mm: must lie in the travel")

    def tripping(setup):
        return replace(setup, servo=setup.servo.with_values(following_error_limit=(1e-4, 1e-4)))

    monkeypatch.setattr(module, "CAUSES", (Cause("place", "", impossible), Cause("patience", "", tripping), CAUSES[2]))
    causes = causes_of(Job.load("an225", SMALL))
    place, patience, counts = causes.effects
    assert (place.failure, place.without, place.worth) == ("x = 200 mm: must lie in the travel", {}, {})
    assert patience.failure.startswith("following error on axis ")
    assert counts.worth
    assert [row[0] for row in causes.rows] == ["nothing", "place", "patience", "counts"]
    assert causes.rows[1][1] == [None] * 7
    lines = str(causes).splitlines()
    assert lines[3].split() == ["place", *["–"] * 7]
    assert lines[-2:] == [f"place: {place.failure}", f"patience: {patience.failure}"]


def test_a_loop_that_only_the_sampling_keeps_quiet_is_reported():
    """Coarse counts through kd at a short period drive the torque from limit to limit."""
    job = Job.load("an225", (*SMALL, "resolution=0.02"))
    effect = by_name(causes_of(job))["sampling"]
    assert "oscillation on axis" in effect.failure
    assert effect.without == {}


def test_a_job_that_ends_in_a_fault_has_no_causes():
    job = Job.load("an225", ("following_error_limit=0.01",))
    with pytest.raises(
        InputError, match=r"job an225: ends in a fault, following error on axis .*: causes are those of"
    ):
        causes_of(job)


def test_causes_print_as_a_table(found):
    _, causes = found
    title, heads, *rows = str(causes).splitlines()
    assert title == "contour error without one cause at a time, and rms by link [µm]"
    assert heads.split() == ["switched", "off", "rms", "max", "worth", *LINKS]
    assert max(map(len, (title, heads, *rows))) < 80
    cells = {row[0]: row[1:] for row in map(str.split, rows)}
    effects = by_name(causes)
    assert list(cells)[: 1 + len(CAUSES)] == ["nothing", *effects]
    assert cells["nothing"][2] == "–"
    for name, effect in effects.items():
        errors = [effect.without[link].rms for link in LINKS]
        shown = [effect.without["contour"].rms, effect.without["contour"].max, effect.worth["contour"].rms, *errors]
        assert [float(cell.replace("−", "-")) for cell in cells[name]] == pytest.approx(
            [1e3 * value for value in shown], abs=0.0501
        )
    assert causes.heads == (*HEADS, *LINKS)


def test_progress_is_the_share_of_the_runs(found):
    job, _ = found
    shares = []
    causes_of(job, progress=shares.append)
    assert shares == sorted(shares)
    assert 0 < shares[0] < shares[-1] == pytest.approx(1)


@pytest.mark.validates(
    "scatter of the contour error's rms: gains changed by 1e-9",
    "the job",
    "0.1 µm",
)
@pytest.mark.parametrize("name", suite_runs(["fanuc-conical", "softmc-arc", "stage-outline"], 1))
def test_scatter_of_the_contour_error_is_below_what_counts_as_worth(name):
    job = Job.load(name)
    setup = Setup(job.built_machine, job.built_servo, job.setpoints)
    rms = []
    for k in range(4):
        servo = setup.servo.with_values(kp=tuple(kp * (1 + 1e-9 * k) for kp in setup.servo.per_axis("kp")))
        rms.append(Budget(replace(setup, servo=servo).run()).values.contour.rms)
    assert 0 < np.ptp(rms) < SCATTER
