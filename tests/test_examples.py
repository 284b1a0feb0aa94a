"""The examples run from top to bottom, shortened where they search or train, and print what they promise."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "examples"
LONGEST = 60  # lines
SHORTER = {
    "tune_and_export.py": {"BUDGET = 60": "BUDGET = 12", "robust=2, unseen=4": "robust=0, unseen=0"},
    "train_agent.py": {"DECISIONS = 16_384": "DECISIONS = 1024", "EPISODES = 20": "EPISODES = 1"},
    "loop_resolution.py": {"(1.0, 0.5, 0.2, 0.1, 0.05, 0.02)": "(0.5, 0.1, 0.05)"},
}


@pytest.fixture
def example(fresh, tmp_path):
    """Run an example in an empty folder; return what it printed."""

    def run(name, *arguments, without=()):
        code = (FOLDER / name).read_text(encoding="utf-8")
        for long, short in SHORTER.get(name, {}).items():
            assert long in code
            code = code.replace(long, short)
        for line in without:
            assert line in code
            code = code.replace(line, "")
        done = fresh.run(code, tmp_path, *arguments)
        assert (done.status, done.error) == (0, "")
        return done.output

    return run


def rms(output, link):
    """The rms of a link in a printed budget [µm]."""
    return float(re.search(rf"^{link} +([\d.]+)", output, flags=re.MULTILINE)[1])


def test_every_example_is_short_and_has_a_test():
    scripts = sorted(FOLDER.glob("*.py"))
    assert len(scripts) == 5
    for script in scripts:
        text = script.read_text(encoding="utf-8")
        assert len(text.splitlines()) < LONGEST
        assert f'"{script.name}"' in Path(__file__).read_text(encoding="utf-8").partition("def test_every")[2]


def test_the_spiral_is_judged_and_its_program_spoils_it(example):
    output = example("spiral.py")
    assert rms(output, "program") > 10 * rms(output, "servo")
    laid, requested = map(int, re.search(r"volume: (\d+) mm³, requested: (\d+)", output).groups())
    assert laid == pytest.approx(requested, rel=0.01)
    assert "contour error, 95 % 261" in output
    assert "at most 300.0 µm (given)" in output


@pytest.mark.soak
def test_a_file_of_g_code_is_run_judged_and_improved(example, tmp_path):
    output = example("own_gcode.py", without=('run.report("out/own-gcode")',))
    assert "machine xyz, the smallest for this program" in output
    assert "verdict ✓ pass" in output
    straight = tmp_path / "straight.ngc"
    straight.write_text("G21 G90\nG1 X40 F1200\nM30\n", encoding="utf-8")
    # by hand: 40 mm at 20 mm/s
    output = example("own_gcode.py", straight, without=("print(gs.improve(job))",))
    assert "path     40 mm" in output
    assert (tmp_path / "out/own-gcode/report.html").stat().st_size > 10_000


def test_an_ideal_loop_errs_in_proportion_to_its_period_and_a_real_one_does_not(example):
    rows = [[float(number) for number in line.split()] for line in example("loop_resolution.py").splitlines()[1:]]
    periods, ideal, real = zip(*rows, strict=True)
    assert periods == (0.5, 0.1, 0.05)
    # a point that lags by half a period of the loop, on average, lags in proportion to it
    assert [error / ideal[0] for error in ideal] == pytest.approx([1.0, 0.2, 0.1], rel=0.05)
    assert real[2] > real[1]


@pytest.mark.soak
def test_tuned_gains_are_better_and_written_for_a_controller(example, tmp_path):
    output = example("tune_and_export.py")
    derived, tuned = (float(text) for text in re.findall(r"contour error ([\d.]+) µm rms$", output, flags=re.MULTILINE))
    assert tuned < derived
    words = [float(text) for text in re.findall(r"^setp pid.x.Pgain ([\d.]+)", output, flags=re.MULTILINE)]
    assert len(words) == 1
    assert (tmp_path / "out/tuned/tuned.toml").is_file()


@pytest.mark.soak
def test_an_agent_trains_and_is_compared(example, tmp_path):
    output = example("train_agent.py")
    returns = [float(text) for text in re.findall(r"mean return (-[\d.]+)", output)]
    assert len(returns) == 2
    assert (tmp_path / "bead-width-agent.zip").is_file()
