"""What the README shows runs as it stands."""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from gantrysim import Job, metrics
from gantrysim.bead import Bead
from gantrysim.job.job import builtin_jobs
from gantrysim.metrics.budget import LINKS, Budget

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


# Encoder counts and friction make a micrometre of the last bit of a setpoint, so other processors' sines show.
SHOWN = 0.02  # relative
SHOWN_LEAST = 0.5  # [µm]


def shown(*cells):
    """The numbers of the README's table row that begins with these cells."""
    row = re.search(rf"^\| {re.escape(' | '.join(cells))} \|(.*)\|$", README, flags=re.MULTILINE)
    assert row, cells
    return [float(number) for number in re.findall(r"[\d.]+", re.sub("`.*?`", "", row[1]))]


def in_um(*lengths):
    return pytest.approx([1e3 * length for length in lengths], rel=SHOWN, abs=SHOWN_LEAST)


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)^ *```", README, flags=re.DOTALL | re.MULTILINE)


def test_the_python_loop_runs_and_prints_the_budget_of_the_table(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks("python"):  # the second goes on from the first
        exec(compile(textwrap.dedent(block), "README.md", "exec"), names)
    assert names["run"].fault is None
    printed = capsys.readouterr().out
    for link in LINKS:
        numbers = re.search(rf"^{link} +([-\d.]+) µm rms, +([-\d.]+) µm at most, +([-\d.]+) %$", printed, re.MULTILINE)
        rms, _, largest, share = shown(link)[:4]
        assert [rms, largest] == [pytest.approx(float(n), rel=SHOWN, abs=SHOWN_LEAST) for n in numbers.groups()[:2]]
        assert share == pytest.approx(abs(float(numbers[3])), abs=0.2)


def test_the_table_is_what_the_job_gives():
    analysis = metrics.Analysis(Job.load("an225").run())
    budget = Budget(analysis).values
    for name, part in {**budget.parts, "contour": budget.contour}.items():
        assert shown(name)[:3] == in_um(part.rms, part.p95, part.max)
        assert shown(name)[3] == pytest.approx(abs(100 * part.share), abs=0.2)
    s = analysis.values.spacing
    said = re.search(r"The turns lie ([\d.]+) mm apart, from ([\d.]+) to ([\d.]+)\.", README)
    assert [1e3 * float(length) for length in said.groups()] == in_um(s.mean, s.min, s.max)


def test_the_bead_is_what_the_job_gives():
    job = Job.load("an225")
    run = job.run()
    bead_trace = Bead(run, job.bead)
    bead = bead_trace.values
    said = re.search(
        r"Here ([\d.]+) mm of bead are missing .*\s([\d.]+) mm too much .* the ([\d.]+) % more glue .* \(([\d.]+) mm³\)"
        r" .* makes ([\d.]+) mm³ .*\sother ([\d.]+) mm³ is its fixed flow .*, ([\d.]+) mm³ of it at the end",
        README,
        re.DOTALL,
    )
    assert float(said[1]) == pytest.approx(bead.start_shortfall.mean, abs=0.01)
    assert float(said[2]) == pytest.approx(bead.stop_excess.mean, abs=0.01)
    assert float(said[3]) == pytest.approx(bead.volume_error_percent, abs=0.01)
    assert float(said[4]) == pytest.approx(bead.volume_error, abs=0.1)
    assert float(said[5]) == pytest.approx(bead.dispenser_error, abs=0.1)
    assert float(said[6]) == pytest.approx(bead.ramp_error, abs=0.1)
    slow = slice(len(run.time) // 2, -1)
    at_end = (run.flow_demand[slow].sum() * run.period) - bead.nominal * (
        bead_trace.commanded_steps * run.dispense[:-1]
    )[slow].sum()
    assert float(said[7]) == pytest.approx(at_end, abs=1)
    even = job.changed({"dispenser.flow": 0.0, "dispenser.area": 2.0})
    assert Bead(even.follow(), even.bead).values.ramp_error == pytest.approx(0, abs=1e-6)
    assert bead.overlap_share > 0  # the blob touches the turn beside it


@pytest.mark.parametrize(
    "settings",
    [
        ["wait_resolution=0", "acceleration=inf"],
        ["wait_resolution=0"],
        [],
        ["loop_period=0.01"],
        ["loop_period=0.01", "wait_resolution=0"],
    ],
    ids=" ".join,
)
def test_what_of_the_controller_does_it(settings):
    figures = metrics.values(Job.load("an225", settings).run())
    command = " ".join(f"--set {setting}" for setting in settings)
    cell = re.escape(f"`{command}` |" if command else "|")
    rms = re.search(rf"^\| [^|]+ \| ([\d.]+) µm \| {cell}$", README, flags=re.MULTILINE)
    assert [float(rms[1])] == in_um(figures.generation.rms)


@pytest.mark.parametrize("name", builtin_jobs())
def test_the_jobs_table(name):
    job = Job.load(name)
    figures = metrics.values(job.run())
    row = shown(f"`{name}`", f"`{job.machine}`")
    assert row[:2] == in_um(figures.contour.rms, figures.contour.max)
    spacings = [] if figures.spacing is None else [figures.spacing.mean]
    assert [1e3 * spacing for spacing in row[2:]] == in_um(*spacings)
    assert f"pictures/{name}.png" in README


def test_the_job_file_runs(tmp_path):
    (tmp_path / "my-job.toml").write_text(blocks("toml")[0], encoding="utf-8")
    job = Job.load(tmp_path / "my-job.toml")
    assert job.run().fault is None
    assert job.built_servo.velocity_ff == (0.0, 0.0, 0.0)


def test_files_that_the_readme_names_exist():
    for name in re.findall(r"\]\((pictures/[^)]+)\)|`?(?:bash|python) (scripts/\S+?)`?[\s)]", README):
        assert (ROOT / (name[0] or name[1])).is_file(), name
    pictures = sum(picture.stat().st_size for picture in (ROOT / "pictures").iterdir())
    assert pictures < 3_000_000


@pytest.mark.parametrize("script", ["benchmark.py"])
def test_scripts_run(script):
    command = [sys.executable, ROOT / "scripts" / script, "--json", "--rounds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert '"engine"' in done.stdout
    assert '"setpoints"' in done.stdout
    assert '"analysis"' in done.stdout
