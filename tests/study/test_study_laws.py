"""The study of laws, and laws of the ladder and of the user in studies, tuner and environment."""

import dataclasses
import math
import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.study import Case, run_study
from gantrysim.study.laws import LADDER, LawsStudy, laws_row, reversals
from gantrysim.study.tuning import TuningStudy
from gantrysim.study.tuning.servo import servo_toml

from support import own_laws
from support.soaked import suite_runs
from support.tunings import circle

pytestmark = pytest.mark.usefixtures("blank_pictures")

FILE = f"{own_laws.__file__}:compiled_pd"


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """A study of a small circle, which every axis reverses on."""
    study = LawsStudy(circle(period=0.002), payload=0.3)
    return study, run_study(study, tmp_path_factory.mktemp("laws") / "out", workers=1)


def test_reversals_are_where_the_demand_turns():
    x = np.array([0, 0, 1, 2, 2, 2, 1, 0, 1, 1, 2.0])
    assert reversals(np.column_stack([x, 0 * x, -x])) == [(6, 0), (8, 0), (6, 2), (8, 2)]


@pytest.mark.soak
def test_the_ladder_gains_what_it_promises(studied):
    _, outcome = studied
    rows = {(row["law"], row["variation"]): row for row in outcome.rows}
    assert all(row["status"] == "ok" for row in outcome.rows)

    def value(law, name="following_rms_um", variation="nominal"):
        return rows[law, variation][name]

    assert value("pd") > 10 * value("pid+friction")
    assert value("pid", "reversal_max_um") > 2 * value("pid+friction", "reversal_max_um")
    exact = "exact encoder"
    best = value("pid+friction+preview+learning", variation=exact)
    assert value("pid+friction", variation=exact) > 5 * best
    assert value("pid+friction", variation="friction") > 1.5 * value("pid+friction")
    repeats = [row["following_rms_um"] for row in outcome.rows if row["variation"] == "repeats"]
    assert repeats == sorted(repeats, reverse=True)
    for law in ("pid+observer", "p-pi"):
        assert value(law, "gain_margin") < value("pd", "gain_margin")


def test_a_row_of_the_study_is_that_of_its_run(studied):
    study, outcome = studied
    row = next(row for row in outcome.rows if (row["law"], row["variation"]) == ("pid+friction", "nominal"))
    run = study.job.changed(study.overrides(("pid", "friction"))).run()
    error = 1e3 * (run.commanded - run.encoder)
    assert row["following_rms_um"] == pytest.approx(np.sqrt((error**2).sum(axis=1).mean()), rel=1e-12)
    speed = np.diff(run.commanded, axis=0)
    assert row["reversals"] == sum(np.count_nonzero(np.diff(np.sign(v[v != 0]))) for v in speed.T)
    assert 0 < row["reversal_max_um"] <= np.abs(error).max()


def test_the_report_says_which_law_is_best_and_which_does_not_pay(studied):
    study, outcome = studied
    report = outcome.report
    nominal = {row["law"]: row["following_rms_um"] for row in outcome.rows if row["variation"] == "nominal"}
    best = min(nominal, key=nominal.get)
    assert report.details.notes[0].startswith(f"Law {best} tracks best: ")
    assert [row[0] for row in report.table.rows] == [rung.name for rung in LADDER]
    for law, tracking, ratio, lag, _, _, contour, ripple, _, _, sensitivity, _, fails in report.table.rows:
        row = next(row for row in outcome.rows if (row["law"], row["variation"]) == (law, "nominal"))
        assert (tracking, ratio) == (nominal[law], pytest.approx(nominal["pd"] / nominal[law]))
        assert (lag, contour, sensitivity) == tuple(
            row[name] for name in ("following_along_rms_um", "contour_max_um", "sensitivity")
        )
        assert ripple == row["torque_ripple_Nm"]
        failed = [aspect for aspect in ("path", "glue", "stability", "machine") if row[f"{aspect}_verdict"] == "fail"]
        assert fails == (", ".join(failed) or "–")
    pairs = {"pid": "pd", "pid (Ti/3)": "pid", "p-pi": "pid"} | {
        law: law.rpartition("+")[0] for law in nominal if "+" in law
    }
    assert len(pairs) == len(LADDER) - 1
    idle = [law for law, before in pairs.items() if not nominal[law] < 0.95 * nominal[before]]
    start = "The last addition gains less than 5 % in following error: "
    said = next((note.removeprefix(start) for note in report.details.notes if note.startswith(start)), ".")
    assert set(said.rstrip(".").split(", ")) - {""} == set(idle)
    assert {plot.name for plot in report.plots} == set(study.plots)


@pytest.mark.parametrize(
    "law", [("pd",), ("pid", "friction"), ("pid", "friction", "preview", "learning")], ids="+".join
)
def test_the_page_s_table_is_the_program_s(law):
    page = (Path(__file__).parent.parent.parent / "docs" / "laws.md").read_text(encoding="utf-8")
    cells = re.search(rf"^\| {re.escape('+'.join(law))} \|(.*)\|$", page, flags=re.MULTILINE)[1].split("|")
    shown = [float(cell) for cell in cells[:-2]]
    lag = shown.pop(2)
    row = laws_row(Case.of(Job.load("softmc-arc"), {"servo.law": list(law)}))
    names = ("reversal_max_um", "contour_rms_um", "contour_max_um")
    assert [shown[0], *shown[2:5]] == pytest.approx([row["following_rms_um"], *(row[name] for name in names)], rel=0.02)
    assert lag == pytest.approx(row["following_along_rms_um"], rel=0.02)
    assert shown[6:] == pytest.approx(
        [row[name] for name in ("gain_margin", "phase_margin_deg", "sensitivity")], rel=0.01
    )


def test_pd_leaves_out_what_the_job_gives_of_pid():
    job = Job.load("softmc-arc", ["ki=[1.0, 1.0]", "velocity_ff=[0.1, 0.1]"])
    servo = job.changed(LawsStudy(job).overrides(("pd",))).built_servo
    assert not any((*servo.per_axis("ki"), *servo.per_axis("velocity_ff")))
    with pytest.raises(InputError, match="payload"):
        LawsStudy(job, payload=-1)


@pytest.mark.parametrize("name", suite_runs(["trio-basic", "stage-outline"], 0))
def test_feed_forward_with_a_third_of_the_integral_time_tracks_ten_times_better_than_pd(name):
    study = LawsStudy(Job.load(name))
    pd, stiff = (laws_row(Case.of(study.job, study.overrides(*rung))) for rung in (LADDER[0], LADDER[2]))
    assert pd["following_rms_um"] > 10 * stiff["following_rms_um"]
    assert stiff["sensitivity"] < 1.02 * pd["sensitivity"] < 2.0


def test_feed_forward_alone_takes_the_lag_of_a_spiral_away():
    study = LawsStudy(Job.load("an225"))
    pd, fed = (laws_row(Case.of(study.job, study.overrides(*rung))) for rung in LADDER[:2])
    assert pd["following_along_rms_um"] > 20 * fed["following_along_rms_um"]


def test_a_third_of_the_integral_time_is_three_times_the_integral_gain():
    given = {"law": ["pid"], "notch_frequency": 0.0}
    for job in (circle(integral_time=0.03, **given), circle(ki=[1.0, 2.0], **given)):
        study = LawsStudy(job)
        stiff = job.changed(study.overrides(("pid",), 1 / 3)).built_servo
        assert stiff.per_axis("ki") == pytest.approx(np.multiply(job.built_servo.per_axis("ki"), 3.0))
        for name in ("kp", "kd"):
            assert stiff.per_axis(name) == job.built_servo.per_axis(name)
        assert study.ladder == LADDER
    without = LawsStudy(circle(integral_time=math.inf, **given))
    assert [rung.integral for rung in without.ladder] == [1.0] * (len(LADDER) - 1)
    assert without.expected == LawsStudy(circle(integral_time=0.03)).expected - 4


def test_a_case_of_a_study_takes_a_user_s_law():
    row = laws_row(Case.of(circle(), {"servo.law": [FILE, "friction"], "servo.notch_frequency": 0.0}))
    same = laws_row(Case.of(circle(), {"servo.law": ["pd", "friction"], "servo.notch_frequency": 0.0}))
    assert row["following_rms_um"] == pytest.approx(same["following_rms_um"], rel=1e-6)
    assert row["gain_margin"] == pytest.approx(same["gain_margin"], rel=1e-6)


@pytest.mark.soak
def test_the_tuner_tunes_a_law_and_writes_it(tmp_path):
    law = [FILE, "friction"]
    study = TuningStudy(circle(law=law), budget=12, robust=0, guards=2, unseen=1, law="pd")
    outcome = run_study(study, tmp_path / "out", workers=1)
    assert outcome.rows
    written = Job.load(tmp_path / "out" / "job.toml", servo=tmp_path / "out" / "tuned.toml", allow_code=True)
    assert written.built_servo.laws.names == tuple(law)
    assert written.built_servo.per_axis("friction_torque") == circle(law=law).built_servo.per_axis("friction_torque")


def test_a_servo_that_is_written_is_read_again(tmp_path):
    job = Job.load("softmc-arc", ['law=["p-pi", "friction", "observer", "zv", "preview", "learning"]'])
    (tmp_path / "tuned.toml").write_text(servo_toml(job, job.built_servo, []))
    assert Job.load("softmc-arc", servo=tmp_path / "tuned.toml").built_servo == job.built_servo


@pytest.mark.first
@pytest.mark.parametrize("law", [["pid", "friction", "preview"], [FILE]], ids=["ladder", "user"])
def test_the_environment_runs_its_episodes_with_the_job_s_law(law):
    def errors(own):
        job = circle(law=own, notch_frequency=0.0)
        env = gymnasium.make(
            "gantrysim.env:gantrysim/GainBandit-v0", decision_interval=0.1, job=job, spread=None, detune=1.0
        )
        env.reset(seed=1)
        done = False
        while not done:
            *_, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
            done = terminated or truncated
        run = env.unwrapped.run
        return run, run.demand

    run, demand = errors(law)
    assert run.fault is None
    known = circle(law=["pd"] if FILE in law else law, notch_frequency=0.0)
    np.testing.assert_allclose(demand, known.run().demand[: len(demand)], rtol=0, atol=1e-9)
    assert dataclasses.is_dataclass(run)
