"""The example scripts on a short job: results, files and errors."""

import csv
import json
import runpy
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from gantrysim import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.servo.gains import GAIN_NAMES

SCRIPTS = Path(__file__).parent.parent / "scripts"

JOB = """
name = "short"

[program]
controller = "fanuc.Program"
start = [0.0, 20.0, 0.0]
acceleration = 2000.0
program = '''
%
O0001
N10 G17 G21 G90
N20 G02 X0 Y-8 I0 J-20 Q-8 F4000
N30 M30
%
'''

[servo]
integral_time = 0.03
following_error_limit = 4.0
"""

EXACT = 1e-12
SINGLE = 1e-6  # rounding of an action in single precision
ALONE = 0.02  # effect of one axis on the other, by friction alone


@pytest.fixture
def job(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(JOB)
    return file


@pytest.fixture
def script(monkeypatch, tmp_path, capsys):
    """Run a script in an empty folder; return its variables and its output."""

    def run(name, *arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "120")
        names = runpy.run_path(str(SCRIPTS / name), run_name="__main__")
        return names, capsys.readouterr().out

    return run


def test_changes_by_hand_scale_the_gains(script, job, tmp_path):
    names, output = script("tune_by_hand.py", job, "kp x 0.5", "kd 1.5, ki y 0", "ff 0", "kp 1")
    own = Job.load(job).built_servo
    servos = [servo for _, servo, _ in names["trials"]]
    assert servos[0] == own
    assert servos[1].per_axis("kp") == (0.5 * own.gains[0].kp, own.gains[1].kp)
    assert servos[2].per_axis("kp") == servos[1].per_axis("kp")  # changes add up
    assert servos[2].per_axis("kd") == (1.5 * own.gains[0].kd, 1.5 * own.gains[1].kd)
    assert servos[2].per_axis("ki") == (own.gains[0].ki, 0.0)
    assert servos[3].per_axis("velocity_ff") == servos[3].per_axis("acceleration_ff") == (0.0, 0.0)
    assert servos[4].per_axis("kp") == own.per_axis("kp")  # factors apply to the job's own gains
    before, after = (analysis.values.following for _, _, analysis in names["trials"][:2])
    assert after["x"].rms > 1.2 * before["x"].rms
    assert after["y"].rms == pytest.approx(before["y"].rms, rel=ALONE)
    for name, _, analysis in names["trials"]:
        assert name in output
        assert f"{1e3 * analysis.values.contour.rms:.1f}" in output
    assert (tmp_path / "out/tune-by-hand/trials.png").read_bytes()[:4] == b"\x89PNG"


def test_the_written_gains_reproduce_the_last_trial(script, job, tmp_path):
    names, _ = script("tune_by_hand.py", job, "kp 1.4, kd 1.1", "--out", tmp_path / "mine")
    loaded = Job.load(job, servo=tmp_path / "mine" / "tuned.toml")
    _, servo, analysis = names["trials"][-1]
    assert loaded.built_servo == servo
    assert np.array_equal(loaded.run().nozzle, analysis.run.nozzle)


def test_without_changes_the_script_prompts_until_the_end(script, job, monkeypatch):
    lines = iter(["kp 2", "foo 2", "kp z 2", "kp x", "kd nan", "kp 600", "kd y 1.2"])

    def answer(_prompt=""):
        try:
            return next(lines)
        except StopIteration:
            raise EOFError from None

    monkeypatch.setattr("builtins.input", answer)
    names, output = script("tune_by_hand.py", job)
    assert [name for name, _, _ in names["trials"]] == ["unchanged", "kp 2", "kd axis y 1.2"]
    for text in (
        "unknown change 'foo 2': known: ",
        "unknown axis 'z': known: x, y",
        "factor of kp = 'x': must be a number",
        "factor of kd = nan: must be finite",
        "kp 600: fault: following error on axis y",
    ):
        assert text in " ".join(output.split())


@pytest.mark.soak
def test_tuners_are_compared_on_the_same_runs_and_a_stopped_comparison_resumes(script, job, tmp_path):
    few = ["--jobs", job, "--starts", "tenth", "--budgets", 8, 14, "--out", "a"]
    few += ["--methods", "gantrysim tune", "Nelder-Mead", "CMA-ES", "differential evolution"]
    _, output = script("compare_tuners.py", *few)
    results, runs = tmp_path / "a" / "results.csv", tmp_path / "a" / "runs-short.jsonl"
    rows = list(csv.DictReader(results.read_text().splitlines()))
    assert len(rows) == 4 * 2
    made = [json.loads(line)[1] for line in runs.read_text().splitlines()]
    metrics = {found.get("contour_rms_um") for found in made}
    assert {float(row["metric"]) for row in rows} <= metrics | {np.inf}
    for method in ("gantrysim tune", "Nelder-Mead", "CMA-ES"):  # a larger budget is never worse
        less, more = (float(row["metric"]) for row in rows if row["method"] == method)
        assert more <= less
    assert f"| {float(rows[0]['metric']):.2f} |" in output
    kept, size = results.read_text(), runs.stat().st_size
    results.write_text("".join(kept.splitlines(keepends=True)[:-3]))  # stopped within the last but one
    with runs.open("a") as file:
        file.write('["cut')
    script("compare_tuners.py", *few)
    assert results.read_text() == kept
    assert runs.stat().st_size == size  # no run was made again


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["nowhere"], "unknown job 'nowhere'"),
        (["fanuc-spiral", "kp"], "unknown change 'kp': known: "),
        (["fanuc-spiral", "kp x y 2"], "unknown change 'kp x y 2'"),
    ],
)
def test_an_invalid_change_is_a_one_line_error(script, capsys, arguments, text):
    with pytest.raises(SystemExit) as stop:
        script("tune_by_hand.py", *arguments)
    assert stop.value.code == 2
    assert text in capsys.readouterr().err


@pytest.mark.soak
def test_the_agent_beats_the_detuned_start_and_is_compared_with_the_tuner(script, job):
    names, output = script("train_ppo.py", job, "--steps", 1024, "--budget", 16)
    start, own, tuned, agent = (Analysis(run).values.contour.rms for run, *_ in names["runs"].values())
    assert agent < 0.95 * start
    assert tuned < 0.9 * start
    assert own < start
    for rms in (start, own, tuned, agent):
        assert f" {1e3 * rms:.2f} " in output
    low, given = names["low"].built_servo, Job.load(job).built_servo
    for name in ("kp", "ki", "kd", "velocity_ff", "acceleration_ff"):
        assert low.per_axis(name) == pytest.approx([gain / 10 for gain in given.per_axis(name)], rel=EXACT)
    run, servos, _ = list(names["runs"].values())[-1]
    assert run.fault is None
    assert len(servos) == -(-len(run.time) // 100)
    assert names["agent"].num_timesteps == 1024
    # the listed servos are those of the episode
    env = gymnasium.make(names["ID"], **names["settings"]).unwrapped
    observation, _ = env.reset(seed=names["SEED"])
    for servo in servos:
        observation, *_ = env.step(names["agent"].predict(observation, deterministic=True)[0])
        for k, gain in enumerate(GAIN_NAMES):
            gains = env._episodes._batch.field("gains")[0, :2, k]
            assert gains == pytest.approx(servo.per_axis(gain), rel=SINGLE)


def test_the_page_of_attacks_keeps_what_people_write_below_its_table():
    page = (SCRIPTS.parent / "docs" / "validation.md").read_text(encoding="utf-8")
    soak = runpy.run_path(str(SCRIPTS / "soak.py"))
    tally = soak["Tally"]()
    assert tally.page(page) == page
    assert "| job files: inputs from a coverage-guided search |" in page
    tally.tries["bad jokes"] = 1000
    assert tally.page(page).replace("| bad jokes | 1,000 |  | 0 |\n", "") == page
    empty = "<!-- written by scripts/soak.py -->\n<!-- end -->"
    assert "|---|---:|---:|---:|\n| bad jokes | 1,000 |  | 0 |\n" in tally.page(empty)
