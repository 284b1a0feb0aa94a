"""Jobs with deliberate faults: their tables, what they reach, and what they cost by closed forms."""

import dataclasses
import json
import math
import re
import tomllib

import numpy as np
import pytest

from gantrysim import Dispenser, InputError, Job, Run, Verdict, causes_of
from gantrysim.engine.simulate import perfect_follower
from gantrysim.env.episodes import Source
from gantrysim.env.settings import PathSettings
from gantrysim.faults import CloggedNozzle, EncoderSlip, InjectedFault, OpenWinding, StuckAxis
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.job.losses import Losses, events
from gantrysim.metrics.analysis import Analysis, values
from gantrysim.record.run_file import Fault
from gantrysim.record.setpoints import Setpoints
from gantrysim.report.page import run_sections
from gantrysim.report.plots.error import draw_error
from gantrysim.report.plots.style import sheet
from gantrysim.report.writing import results_of
from gantrysim.study.cases import simulated
from gantrysim.study.tuning.objective import case_of, column, measure_together

from support.beads import AREA, GAP, PERIOD, PLATE, SPEED, line

SHORT = ["diameter=40", "turns=1", "settle=0.05"]
SLIP = '{kind="encoder slip", axis="x", time=0.4, counts=120}'
CLOG = '{kind="clogged nozzle", time=0.5, duration=0.2, share=0.25}'
STUCK = '{kind="stuck axis", axis="y", time=0.8}'


def faulty(*tables, extra=()):
    return Job.load("an225", [*SHORT, *extra, f"faults=[{', '.join(tables)}]"])


def test_faults_stand_in_the_job_file_with_every_default_and_are_written_only_where_there_are_some(tmp_path):
    job = faulty(SLIP, STUCK)
    assert job.faults == (EncoderSlip(time=0.4, axis="x", counts=120), StuckAxis(time=0.8, axis="y"))
    file = tmp_path / "job.toml"
    file.write_text(job.toml())
    assert Job.load(file) == job
    first, second = tomllib.loads(job.toml())["faults"]
    assert first == {"kind": "encoder slip", "time": 0.4, "duration": math.inf, "axis": "x", "counts": 120}
    assert second["friction"] == math.inf
    assert "faults" not in Job.load("an225").toml()
    assert job.without_faults() == Job.load("an225", SHORT)


def test_overrides_reach_a_fault_by_its_number(tmp_path):
    file = tmp_path / "job.toml"
    file.write_text(faulty(SLIP, STUCK).toml())
    job = Job.load(file, ["faults.0.counts=-7", "faults.1.time=0.9", "friction=30"])
    assert [fault.time for fault in job.faults] == [0.4, 0.9]
    assert job.faults[0].counts == -7
    assert job.faults[1].friction == 30
    assert job.changed({"faults.0.time": 0.1}).faults[0].time == 0.1
    assert job.changed({"faults": None}) == job.without_faults()
    assert faulty(SLIP).with_overrides(["faults.0.duration=0.1"]).faults[0].duration == 0.1


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("3", "faults = 3: must be tables, [[faults]]"),
        ("[3]", "faults = [3]: must be tables, [[faults]]"),
        ("[{time=1}]", "faults.0.kind is missing: must be one of encoder glitch, "),
        ('[{kind="stuck axes", time=1}]', "unknown fault 'stuck axes': did you mean stuck axis? known: stuck axis, "),
        ('[{kind="stuck axis", time=1}]', "faults.0.axis is missing"),
        ('[{kind="bus sag", time=1, share=0.5, level=1}]', "unknown key faults.0.level"),
        ('[{kind="bus sag", time=1, share=true}]', "faults.0.share = true: true and false are not numbers"),
        ('[{kind="bus sag", time=1, share=2}]', "fault bus sag: share = 2: must be 0 to 1"),
        ('[{kind="bus sag", time="now", share=1}]', "faults.0.time = 'now': must be a number"),
        ('[{kind="encoder slip", axis="x", time=1, counts=0.5}]', "faults.0.counts = 0.5: must be a"),
    ],
)
def test_bad_tables_are_refused_in_one_line(value, text):
    with pytest.raises(InputError, match=re.escape(text)) as raised:
        Job.load("an225", [f"faults={value}"])
    assert "\n" not in str(raised.value)


def test_a_number_without_a_fault_is_an_unknown_key():
    with pytest.raises(InputError, match=r"unknown key 'faults.1.time': did you mean faults.0.time"):
        faulty(SLIP).with_overrides(["faults.1.time=1"])


def test_what_the_machine_cannot_have_is_refused_before_the_run():
    job = faulty('{kind="open winding", axis="z", time=0.1}')
    for refuse in (job.check_fit, job.run, job.check_faults):
        with pytest.raises(InputError, match="fault open winding: axis = 'z': machine xy has x, y"):
            refuse()
    with pytest.raises(InputError, match=r"fault bus sag: time = 99 s: must be at most"):
        faulty('{kind="bus sag", time=99, share=0}').check_faults()


def test_causes_are_refused_for_a_job_with_faults():
    with pytest.raises(InputError, match=r"has deliberate faults: causes are those of the job without \[\[faults\]\]"):
        causes_of(faulty(SLIP))


def test_episodes_studies_and_the_tuner_have_the_faults_of_their_job(tmp_path):
    job = faulty(SLIP)
    episode = Source(PathSettings(job=job)).draw(np.random.default_rng(1))
    assert episode.simulation.faults == job.faults
    cases = [case_of(each, each.built_servo, None) for each in (job, job.without_faults())]
    faulted, healthy = measure_together(cases)
    assert faulted[column("contour_rms")] > healthy[column("contour_rms")] + 10
    for case, each in zip(cases, (job, job.without_faults()), strict=True):
        assert simulated(case).injected == each.faults
        assert measure_together([case])[0][column("contour_rms")] == 1e3 * values(each.run(engine="loop")).contour.rms


def follower(xy, flow=None, **changes):
    """The bead of a perfect follower along 100 mm of line, flat under a plate: width = section / gap."""
    setpoints = Setpoints.along(line(), SPEED, PERIOD)
    run = perfect_follower(xy, setpoints, dispenser=Dispenser(flow=AREA * SPEED))
    scaled = run.flow if flow is None else run.flow * flow(run.time)
    return Bead(dataclasses.replace(run, face=PLATE, flow=scaled, **changes), BeadSettings())


@pytest.mark.parametrize("share", [0.0, 0.25, 0.75])
def test_a_stretch_of_less_flow_costs_its_volume_its_length_and_its_width(xy, share):
    begin, end = 0.3, 0.5
    clogged = follower(xy, lambda t: np.where((t > begin - 1e-9) & (t < end - 1e-9), share, 1.0))
    losses = Losses.of(clogged, follower(xy))
    volume = (1 - share) * AREA * SPEED * (end - begin)
    assert losses.volume == pytest.approx(volume, rel=1e-9)
    assert losses.length == pytest.approx(SPEED * (end - begin) if share < 0.5 else 0.0, abs=0.6)
    widths = follower(xy).width
    expected = (share - 1) * AREA / GAP if share else -float(np.median(widths))
    assert losses.width == pytest.approx(expected, rel=0.02)
    assert SPEED * begin < losses.width_s < SPEED * end
    assert losses.shift == 0


def test_the_same_run_costs_nothing(xy):
    losses = Losses.of(follower(xy), follower(xy))
    assert (losses.volume, losses.length, losses.width, losses.shift) == (0, 0, 0, 0)


def test_a_nozzle_off_the_path_is_displaced_by_its_distance(xy):
    healthy = follower(xy).run
    aside = np.where((healthy.time > 0.3) & (healthy.time < 0.5), 0.3, 0.0)[:, None] * [0.0, 0.8, 0.6]
    moved = dataclasses.replace(healthy, nozzle=healthy.nozzle + aside)
    losses = Losses.of(Bead(moved, BeadSettings()), Bead(healthy, BeadSettings()))
    assert losses.shift == pytest.approx(0.3)
    assert 0.3 * SPEED < losses.shift_s < 0.5 * SPEED


def test_a_run_that_ends_early_lacks_the_rest_of_the_path(xy):
    whole, kept = follower(xy), 601
    arrays = {f.name: getattr(whole.run, f.name) for f in dataclasses.fields(whole.run)}
    cut = {name: value[:kept] for name, value in arrays.items() if isinstance(value, np.ndarray)}
    ended = Bead(dataclasses.replace(whole.run, **cut), BeadSettings())
    losses = Losses.of(ended, whole)
    assert losses.length == pytest.approx(100 - 60, abs=1.0)
    assert losses.volume == pytest.approx(AREA * 40, rel=0.01)


def test_events_name_faults_by_time_what_was_not_reached_and_the_supervision(xy):
    run = follower(xy).run
    faults: tuple[InjectedFault, ...] = (
        OpenWinding(time=9.0, axis="x"),
        CloggedNozzle(time=0.2, duration=0.1, share=0.5),
    )
    lines = events(dataclasses.replace(run, injected=faults))
    assert lines == [
        "clogged nozzle at t = 0.2000 s: 50 % of the flow for 0.1 s",
        "open winding on axis x at t = 9.0000 s: no current until the end (the run ended before)",
        "supervision: no limit exceeded, complete at t = 1.0000 s",
    ]
    fault = Fault("travel", "x", 0.7, 151.0, 150.1, "mm")
    assert events(dataclasses.replace(run, injected=faults, fault=fault))[-1] == f"supervision: {fault}"


def test_the_plot_of_the_errors_marks_the_faults_that_the_run_reached(xy):
    run = follower(xy).run
    faults = (OpenWinding(time=9.0, axis="x"), CloggedNozzle(time=0.25, share=0.5))
    with sheet(6, 4) as figure:
        draw_error(figure, Analysis(dataclasses.replace(run, injected=faults)))
        for axes in figure.axes:
            marked = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == ":"]
            assert marked == [0.25]
            assert [text.get_text() for text in axes.texts].count("clogged nozzle") == 1


def test_the_command_shows_and_writes_what_happened_and_what_it_cost(gantrysim_command, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(faulty(SLIP, CLOG, STUCK).toml())
    status, out, _ = gantrysim_command("check", file)
    assert status == 0
    assert "deliberate fault: stuck axis y at t = 0.8000 s: seized until the end" in out
    folder = tmp_path / "out"
    status, out, err = gantrysim_command("run", file, "--out", folder, "--no-video")
    assert status == 3
    text = " ".join(out.split())
    for words in ("encoder slip on axis x at t = 0.4000 s: +120 counts", "supervision: following error on axis y"):
        assert words in text.lower()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["headline"] in text
    assert text.startswith(f"verdict {summary['verdict']['headline']} ")
    assert summary["verdict"]["headline"].startswith("✗ fail: Encoder slip on axis x at t = 0.4000 s: +120 counts")
    assert "causes skipped: the run ended in a fault" in text
    assert summary["causes"] is None
    assert summary["changes"] is None
    assert "Stuck axis y at t = 0.8000 s: seized until the end. Supervision: following error on" in summary["headline"]
    injected, run = summary["injected"], Run.load(folder / "run.npz")
    assert [fault["kind"] for fault in injected["faults"]] == ["encoder slip", "clogged nozzle", "stuck axis"]
    assert all(fault["reached"] for fault in injected["faults"])
    assert injected["faults"][0]["duration"] is None
    healthy = Job.load("an225", SHORT).run()
    volume = (healthy.flow[:-1].sum() - run.flow[:-1].sum()) * PERIOD
    losses = injected["losses"]
    assert losses["missing_volume_mm3"] == pytest.approx(volume)
    assert losses["missing_length_mm"] > 30
    assert losses["nozzle_displaced_um"] > 100
    page = (folder / "report.html").read_text().replace("\xa0", " ")
    for words in ("Deliberate faults", "clogged nozzle at t = 0.5000 s: 25 % of the flow for 0.2 s", "missing bead"):
        assert words in page
    assert summary["fault"]["kind"] == "following error"
    status, _, err = gantrysim_command("run", file, "--out", tmp_path / "other", "--no-video", "--causes")
    assert (status, (tmp_path / "other").exists()) == (2, False)
    assert "has deliberate faults" in err


def test_a_complete_run_says_what_happened_and_blames_nothing_else(gantrysim_command, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(faulty(CLOG).toml())
    status, out, _ = gantrysim_command("run", file, "--out", tmp_path / "out", "--no-video", "--no-report")
    assert status == 0
    text = " ".join(out.split())
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert text.startswith(f"verdict {summary['verdict']['headline']} ")
    assert summary["verdict"]["headline"].endswith("; with clogged nozzle at t = 0.5000 s")
    assert summary["verdict"]["disturbances"] == ["clogged nozzle at t = 0.5000 s: 25 % of the flow for 0.2 s"]
    assert summary["headline"] in text
    assert summary["headline"].startswith("Clogged nozzle at t = 0.5000 s: 25 % of the flow for 0.2 s. Supervision: no")
    assert summary["causes"] is None
    assert "causes skipped: the job has deliberate faults" in text
    run = Run.load(tmp_path / "out" / "run.npz")
    sections = {section.title: section for section in run_sections(results_of(Job.load(file), run))}
    assert sections["Verdict"].answer.headline == summary["verdict"]["headline"]
    assert sections["Verdict"].answer.spoilt == summary["headline"]
    assert "Causes" not in sections
    assert "What to change" not in sections
    late = dataclasses.replace(run.injected[0], time=99.0)  # the run does not come to it
    assert Verdict.of(Job.load(file), run.replaced(injected=(late,))).disturbances == ()


def test_a_run_that_ends_before_the_glue_says_why(gantrysim_command, tmp_path):
    file = tmp_path / "mine.toml"
    jump = '{kind="encoder slip", axis="x", time=0.05, counts=100}'
    file.write_text(faulty(jump, extra=["start_lead=0.2", "following_error_limit=0.05"]).toml())
    status, out, _ = gantrysim_command(
        "run", file, "--out", tmp_path / "out", "--no-video", "--no-report", "--no-causes", "--no-improve"
    )
    assert status == 3
    assert "the run ended before the dispenser was on" in out
    assert "encoder slip on axis x at t = 0.0500 s: +100 counts until the end" in " ".join(out.split())
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["injected"]["faults"][0]["reached"]
    assert summary["injected"]["losses"] is None


def test_a_job_without_faults_has_none_in_its_summary(gantrysim_command, tmp_path):
    status, out, _ = gantrysim_command(
        "run",
        "an225",
        "--set",
        "turns=1",
        "--out",
        tmp_path,
        "--no-video",
        "--no-report",
        "--no-causes",
        "--no-improve",
    )
    assert status == 0
    assert "purpose" not in out
    assert json.loads((tmp_path / "summary.json").read_text())["injected"] is None
