"""What the README shows runs as it stands."""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from gantrysim import Job, metrics
from gantrysim.job import builtin_jobs

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)^ *```", README, flags=re.DOTALL | re.MULTILINE)


def test_the_python_loop_runs_and_prints_the_contour_error_of_the_table(capsys):
    names = {}
    for block in blocks("python"):  # the second goes on from the first
        exec(compile(textwrap.dedent(block), "README.md", "exec"), names)
    assert names["run"].fault is None
    rms, largest = re.findall(r"rms=([\d.]+), max=([\d.]+)", capsys.readouterr().out)[0]
    shown = re.search(r"\| contour error \| ([\d.]+) µm \| ([\d.]+) µm", README)
    assert f"{1e3 * float(rms):.1f}" == shown[1]
    assert f"{1e3 * float(largest):.1f}" == shown[2]


def test_the_table_is_what_the_job_gives():
    figures = metrics.figures(Job.load("an225").run())
    rows = {
        "generation error": figures.generation,
        "tracking error x": figures.tracking["x"],
        "tracking error y": figures.tracking["y"],
        "contour error": figures.contour,
    }
    for name, spread in rows.items():
        assert f"| {name} | {1e3 * spread.rms:.1f} µm | {1e3 * spread.max:.1f} µm |" in README
    s = figures.spacing
    assert f"{s.mean:.4f} mm | std {s.std:.4f}, from {s.min:.4f} to {s.max:.4f} mm" in README


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
    figures = metrics.figures(Job.load("an225", settings).run())
    command = " ".join(f"--set {setting}" for setting in settings)
    cell = f"`{command}` |" if command else "|"
    assert f"| {1e3 * figures.generation.rms:.1f} µm | {cell}" in README


@pytest.mark.parametrize("name", builtin_jobs())
def test_the_jobs_table(name):
    job = Job.load(name)
    figures = metrics.figures(job.run())
    spacing = f"{figures.spacing.mean:.4f} mm " if figures.spacing else ""
    contour = f"{1e3 * figures.contour.rms:.1f} µm | {1e3 * figures.contour.max:.1f} µm"
    assert f"| `{name}` | `{job.machine}` | {contour} | {spacing}|" in README
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
