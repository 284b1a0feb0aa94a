"""What a run offers in one call: columns by name, verdict, budget, figure, report; and what it says without a job."""

import io
import json
import pickle
import subprocess
import sys

import numpy as np
import pytest

import gantrysim as gs
from gantrysim.base import progress as bars
from gantrysim.results.colours import SHARE

from support.jobs import job_run

pytestmark = pytest.mark.usefixtures("blank_pictures")

JOB = "softmc-arc"


@pytest.fixture(scope="module")
def run():
    return job_run(JOB)


@pytest.fixture(scope="module")
def jobless(run):
    return run.replaced(job=None)


@pytest.mark.first
def test_verdict_and_budget_are_those_of_the_rooms_that_make_them(run):
    assert run.job.name == JOB
    assert run.verdict.content() == gs.Verdict.of(run.job, run).content()
    assert run.budget.values.contour == gs.Budget(run).values.contour
    assert run.verdict is run.verdict
    assert run.replaced(gap=run.gap).job is run.job
    assert run.replaced(nozzle=run.commanded_tip).budget is not run.budget
    assert pickle.loads(pickle.dumps(run)).verdict.content() == run.verdict.content()


def test_a_run_printed_has_its_verdict_and_facts_and_its_repr_computes_nothing(run):
    text = str(run)
    assert text.startswith(str(run.verdict))
    assert all(fact in text for fact in run.facts().values())
    fresh = run.replaced()
    assert "\n" not in repr(fresh)
    assert not {"budget", "verdict"} & set(vars(fresh))


def test_a_run_without_job_and_rig_says_what_to_write(jobless, tmp_path):
    for name, call in (
        ("verdict", lambda: jobless.verdict),
        ("report", lambda: jobless.report(tmp_path)),
        ("film", lambda: jobless.film(tmp_path / "a.mp4")),
    ):
        with pytest.raises(gs.InputError) as error:
            call()
        assert str(error.value) == (
            f"run.{name}: the record has neither its job nor its machine and servo: write run.replaced(job=job), or "
            f"run.replaced(rig=gantrysim.Rig(machine, servo, dispenser)), with .{name} behind it"
        )
    assert str(jobless).startswith("no verdict: run.verdict: the record has neither its job nor ")
    assert jobless.known_verdict is None
    assert gs.Verdict.of(job_run(JOB).job, jobless).state == job_run(JOB).verdict.state
    assert jobless.budget.values.contour == job_run(JOB).budget.values.contour


def test_a_run_without_glue_is_printed_without_a_verdict(run):
    dry = run.replaced(dispense=np.zeros_like(run.dispense))
    assert str(dry).startswith("no verdict: ")
    assert "dispense" in str(dry)


def test_every_column_of_the_table_has_its_name(run):
    frame = run.to_frame()
    assert list(run.columns) == list(frame.columns)
    assert len(run) == len(frame) == len(run.time)
    for name in run.columns:
        np.testing.assert_array_equal(run[name], frame[name])
        assert not run[name].flags.writeable
    for name, array in (("encoder_x", run.encoder[:, 0]), ("nozzle_z", run.nozzle[:, 2]), ("flow", run.flow)):
        np.testing.assert_array_equal(run[name], array)
    assert np.shares_memory(run["time"], run.time)


def test_a_name_with_its_unit_goes_before_an_axis_of_that_name(run):
    odd = run.replaced(axes=("x", "x_mm"))
    np.testing.assert_array_equal(odd["encoder_x_mm"], odd.encoder[:, 0])
    np.testing.assert_array_equal(odd["encoder_x_mm_mm"], odd.encoder[:, 1])


def test_an_unknown_column_gets_the_three_nearest(run):
    with pytest.raises(gs.InputError) as error:
        run["encodr_x"]
    assert str(error.value) == (
        "unknown column 'encodr_x': did you mean encoder_x, encoder_y or encoder_tip_x? run.columns lists all"
    )
    with pytest.raises(gs.InputError, match=r"unknown column 0: run\.columns lists all"):
        list(run)


def test_rows_of_a_time_are_a_mask_of_a_column(run):
    for key, text in ((slice(0.1, 0.2), "0.1:0.2"), (slice(None, 5, 2), ":5:2"), ((1, "x"), "(1, 'x')")):
        with pytest.raises(gs.InputError) as error:
            run[key]
        assert str(error.value) == (
            f"run[{text}]: a run has columns by name, with all its ticks: write run['encoder_x'][part] with "
            "part = (run.time >= 0.1) & (run.time < 0.2)"
        )
    part = (run.time >= 0.1) & (run.time < 0.2)
    assert len(run["encoder_x"][part]) == 100


def test_the_job_is_not_saved_and_comes_back_from_the_folder(run, tmp_path):
    run.save(tmp_path / "run.npz")
    assert gs.Run.load(tmp_path / "run.npz").job is None
    (tmp_path / "job.toml").write_text(run.job.toml(), encoding="utf-8")
    saved = gs.SavedRun.load(tmp_path)
    assert saved.run.verdict.content() == run.verdict.content()


def test_loading_a_record_needs_no_room_above(run, tmp_path):
    run.save(tmp_path / "run.npz")
    code = (
        "import sys; from gantrysim.record.run import Run\n"
        "run = Run.load(sys.argv[1]); len(run), repr(run), run['time']\n"
        "print(sorted({n.split('.')[1] for n in sys.modules if n.startswith('gantrysim.')}), 'mujoco' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "run.npz"], capture_output=True, text=True, check=True
    )
    assert done.stdout == "['base', 'faults', 'paths', 'record'] False\n"


def test_the_figure_shows_plan_and_budget(run):
    figure = run.plot()
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[0] == "Plan view, machine xy"
    (coloured,) = figure.axes[0].collections
    share = run.budget.values.contour.max / run.job.limits(run.face).path_max
    assert coloured.get_array().max() == pytest.approx(SHARE.places(share), rel=1e-3)
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_the_report_has_the_files_of_the_command(run, tmp_path):
    page = run.report(tmp_path / "out", causes=False, improve=False)
    assert page == tmp_path / "out" / "report.html"
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names >= {"job.toml", "plots", "report.html", "run.npz", "summary.json"}
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["verdict"] == json.loads(json.dumps(run.verdict.content()))
    assert gs.SavedRun.load(tmp_path / "out").job.toml() == run.job.toml()


def test_the_report_says_what_to_change_where_the_verdict_is_no_pass(run, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("gantrysim.remedy.report.improve", lambda job, **named: asked.append((job, named)) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run.report(tmp_path / "out", causes=False)
    ((job, named),) = asked
    bad = [row.name for row in run.verdict.rows if row.state in ("fail", "warn")]
    assert job is run.job
    assert set(named["rows"]) <= set(bad)
    assert not (tmp_path / "out").exists()


def test_the_film_is_of_the_job(run, monkeypatch):
    calls = []
    monkeypatch.setattr("gantrysim.render.save_video", lambda *given, **named: calls.append((given, named)) or 7)
    assert run.film("a.mp4", speed=2.0) == 7
    (((machine, filmed, file), named),) = calls
    assert (machine, filmed, file) == (run.job.built_machine, run, "a.mp4")
    assert named == {"bead": run.job.bead, "label": JOB, "verdict": run.verdict, "speed": 2.0}
    dry = run.replaced(dispense=np.zeros_like(run.dispense))
    dry.film("a.mp4")
    assert calls[1][1]["verdict"] is None


def test_rooms_are_reached_from_the_package(fresh, tmp_path):
    code = (
        "import gantrysim as gs\n"
        "print(gs.controllers.trio.MoveSpiral.__name__, gs.study.SpeedStudy.__name__, gs.tuning.TuningStudy.__name__,\n"
        "    gs.plots.save_plots.__name__, gs.render.Film.__name__, gs.Setpoints.__name__, gs.SavedRun.__name__)"
    )
    shown = "MoveSpiral SpeedStudy TuningStudy save_plots Film Setpoints SavedRun\n"
    assert fresh.run(code, tmp_path) == (0, shown, "")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def simulated(xy, **named):
    path = gs.controllers.trio.MoveSpiral(60, 1, 10, 100)
    return gs.simulate(xy, gs.Servo.derive(xy.axes), path, **named)


def test_a_bar_is_shown_in_a_terminal_alone(xy, monkeypatch):
    terminal, file = Terminal(), io.StringIO()
    monkeypatch.setattr(bars, "_sentences", [])
    monkeypatch.setattr(bars.sys, "stderr", terminal)
    simulated(xy, progress=True)
    drawn = terminal.getvalue().split("\r")
    assert drawn[1].startswith("simulate ")
    assert drawn[-3].endswith("100 %")
    assert not drawn[-2].strip()  # wiped out
    monkeypatch.setattr(bars.sys, "stderr", file)
    simulated(xy, progress=True)
    assert file.getvalue() == ""


def test_compiling_is_announced_once(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(bars.sys, "stderr", terminal)
    monkeypatch.setattr(bars, "_listeners", [])
    monkeypatch.setattr(bars, "_sentences", [])
    bars._announce_compiling.cache_clear()
    for _ in range(2):
        with bars.shown_progress("simulate", True):
            pass
    bars.tell_compiling(bars.COMPILING)
    assert terminal.getvalue().endswith(
        "\rcompiling what it computes with, once for this machine: some 25 s for a run\n"
    )
    assert terminal.getvalue().count("compiling") == 1


def test_a_bar_is_shown_in_the_output_of_a_notebook(xy, monkeypatch):
    output = io.StringIO()
    monkeypatch.setitem(sys.modules, "ipykernel", bars)
    monkeypatch.setattr(bars.sys, "stdout", output)
    simulated(xy, progress=True)
    assert " 100 %" in output.getvalue()


def test_progress_is_a_function_or_a_truth_value(xy):
    shares = []
    simulated(xy, progress=shares.append)
    assert shares
    assert shares == sorted(shares)
    assert shares[-1] == 1
    with pytest.raises(gs.InputError, match="progress = 3: must be True, False or a function"):
        simulated(xy, progress=3)


class OnCircle:
    """Sends setpoints, but derives from no class of the package."""

    def __init__(self, returned=None):
        self.returned = returned

    def setpoints(self, period):
        return self.returned or gs.controllers.trio.MoveSpiral(60, 1, 10, 100).setpoints(period)


def test_anything_with_setpoints_stands_for_them(xy):
    servo = gs.Servo.derive(xy.axes)
    np.testing.assert_array_equal(gs.simulate(xy, servo, OnCircle()).encoder, simulated(xy).encoder)
    with pytest.raises(gs.InputError, match=r"^OnCircle\.setpoints returned int: must return gantrysim\.Setpoints$"):
        gs.simulate(xy, servo, OnCircle(3))
    with pytest.raises(gs.InputError, match=r"^setpoints is of type type: must be Setpoints or a controller"):
        gs.simulate(xy, servo, OnCircle)
