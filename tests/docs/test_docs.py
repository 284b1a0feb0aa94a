"""README and docs: their code runs, their numbers are those of the program, their links lead to files."""

import ast
import json
import math
import pkgutil
import re
import runpy
import shlex
import subprocess
import sys
import tomllib

import click
import pytest
import typer

import gantrysim
from gantrysim import Job, metrics
from gantrysim.cli.main import app
from gantrysim.glue.bead import Bead
from gantrysim.job.losses import Losses

from support.doc_pages import (
    DOCS,
    ROOT,
    SHOWN,
    SHOWN_LEAST,
    TASKS,
    assert_printed,
    blocks,
    blocks_of,
    read_pages,
    run_in_turn,
)
from support.jobs import job_run
from support.soaked import of_jobs, suite_runs

PAGES = read_pages()
README = PAGES["README.md"]
CONTROLLERS = PAGES["controllers.md"]
# jobs that show a language, without a picture
WITHOUT_PICTURE = ("linuxcnc-flanges", "slicer-square", "softmc-basic", "svg-gasket", "trio-basic")


def row_of(page, *cells):
    """The numbers of a page's table row that begins with these cells."""
    row = re.search(rf"^\| {re.escape(' | '.join(cells))} \|(.*)\|$", page, flags=re.MULTILINE)
    assert row, cells
    return [float(number) for number in re.findall(r"-?[\d.]+", re.sub("`.*?`", "", row[1]))]


def in_um(*lengths):
    return pytest.approx([1e3 * length for length in lengths], rel=SHOWN, abs=SHOWN_LEAST)


@pytest.fixture(scope="module")
def an225():
    return job_run("an225")


# what makes an example long, and what the tests run instead
SHORTER = {'gs.Job.load("an225").run(progress=True)': 'gs.Job.load("an225", ["turns=1"]).run(progress=True)'}


def shortened(code):
    for long, short in SHORTER.items():
        code = code.replace(long, short)
    return code


# those of start and of tasks run in test_pages_run.py, with the commands between them
SHOWN_IN_TASKS = {block.text for task in TASKS.values() for block in blocks_of(task)}
EXAMPLES = {
    name: [
        block
        for block in blocks_of(page)
        if block.language == "python" and not block.title and block.text not in SHOWN_IN_TASKS
    ]
    for name, page in PAGES.items()
    if not name.startswith("start/")
}


# those that identify, learn, film or take a tour
LONG = ["api/index.md", "identification.md", "learning.md", "rendering.md"]


@pytest.mark.first
@pytest.mark.parametrize(
    "names",
    suite_runs([[name for name in EXAMPLES if name not in LONG], LONG], 0),
    ids=["short", "long"],
)
def test_the_python_blocks_of_the_pages_run(names, fresh, tmp_path):
    """Page after page in one process, each with names of its own: imports and compiled functions are loaded once."""
    steps = []
    pages = {name: EXAMPLES[name] for name in names}
    for name, examples in pages.items():
        steps += [("page", name), *(("python", shortened(block.text)) for block in examples)]
    printed = iter(run_in_turn(fresh, tmp_path, steps))
    for name, examples in pages.items():
        next(printed)
        for block in examples:
            output, error = next(printed)
            assert error == "", (name, block.text)
            assert_printed(block.output, output)


def test_what_is_shortened_stands_on_a_page():
    assert all(any(long in page for page in PAGES.values()) for long in SHORTER)


def test_python_blocks_take_from_the_package_only_what_it_has():
    """A subpackage that some other module has imported is there, too, but not for whoever follows the page."""
    taken = {
        (name, node.attr)
        for name, page in PAGES.items()
        for block in blocks(page, "python")
        for node in ast.walk(ast.parse(block))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("gs", "gantrysim")
    }
    assert len(taken) > 10
    assert {(name, attribute) for name, attribute in taken if attribute not in gantrysim.__all__} == set()


@pytest.mark.parametrize(
    "settings",
    [
        ["wait_resolution=0", "acceleration=inf"],
        ["wait_resolution=0"],
        [],
        ["loop_period=0.01"],
    ],
    ids=" ".join,
)
def test_each_limit_of_the_controller_costs_what_the_readme_says(settings):
    program = metrics.values(Job.load("an225", settings).run()).program
    command = " ".join(f"--set {setting}" for setting in settings)
    cell = re.escape(f"`{command}` |" if command else "|")
    rms = re.search(rf"^\| [^|]+ \| ([\d.]+) µm \| {cell}$", README, flags=re.MULTILINE)
    assert [float(rms[1])] == in_um(program.rms)


def test_the_readme_s_errors_are_those_of_program_and_job(an225):
    text = " ".join(README.split())
    (ideal, job) = (float(number) for number in re.findall(r"(?:Here it is|errs by) (\d+) µm", text))
    shown = re.search(r"^contour +([\d.]+)", README, flags=re.MULTILINE)  # compared with what is printed, above
    assert ideal == round(float(shown[1]))
    assert [job] == in_um(metrics.values(an225).contour.rms)
    assert len(README.splitlines()) <= 120


@pytest.mark.parametrize("name", of_jobs("an225", "delta-arc", "fanuc-spiral", "stage-outline"))
def test_the_jobs_table_is_what_the_jobs_give(name):
    job = Job.load(name)
    values = metrics.values(job_run(name))
    row = row_of(CONTROLLERS, f"`{name}`", f"`{job.machine}`")
    assert row[:2] == in_um(values.contour.rms, values.contour.max)
    spacings = [] if values.spacing is None else [values.spacing.mean]
    assert [1e3 * spacing for spacing in row[2:]] == in_um(*spacings)
    assert name == "an225" or name in WITHOUT_PICTURE or f"pictures/{name}.png" in CONTROLLERS


def test_each_fault_costs_what_its_page_says(an225):
    job = Job.load("an225")
    healthy = Bead(an225, job.bead)
    page = PAGES["faults.md"]
    rows = re.findall(r"^\| `(kind=.*?)` \| (.*?) \| ([\d.]+) µm \| ([\d.]+) mm³ \| ([\d.]+) mm \|$", page, re.M)
    assert len(rows) == 9
    (example,) = blocks(page, "toml")
    assert len(job.changed(tomllib.loads(example)).faults) == 2
    for fault, tripped, *numbers in rows:
        broken = Job.load("an225", [f"faults=[{{time=3, {fault}}}]"])
        run = broken.run()
        losses = Losses.of(Bead(run, broken.bead), healthy)
        displaced, volume, length = map(float, numbers)
        assert [displaced] == in_um(losses.shift), fault
        assert losses.volume == pytest.approx(volume, rel=0.005, abs=0.05), fault
        assert losses.length == pytest.approx(length, abs=1), fault
        assert (tripped == "none") == (run.fault is None), fault
        if run.fault is not None:
            words, time = tripped.rsplit(" = ", 1)
            assert str(run.fault).startswith(words)
            assert run.fault.time == pytest.approx(float(time.removesuffix(" s")), abs=0.002)


@pytest.mark.parametrize("name", PAGES)
def test_commands_have_the_arguments_that_are_shown(name):
    lines = [line for block in blocks(PAGES[name], "") for line in block.replace("\\\n", " ").splitlines()]
    prose = re.sub(r"^```.*?^```", "", PAGES[name], flags=re.DOTALL | re.MULTILINE)
    lines += re.findall(r"`(gantrysim \w+ [^`]+)`", prose)  # one alone names the command
    root = typer.main.get_command(app)
    for line in lines:
        words = shlex.split(line.replace("[JOB]", "an225").partition(" #")[0])
        if words[:1] != ["gantrysim"]:
            continue
        if words[1:2] == ["identify"] and words[2:3] not in (["axes"], ["dispenser"]):
            words.insert(2, "axes")  # which needs no name
        command, rest, context = root, words[1:], click.Context(root, info_name="gantrysim")
        while hasattr(command, "commands"):
            command, rest = command.commands[rest[0]], rest[1:]
            context = click.Context(command, parent=context, info_name=command.name)
        command.parse_args(context, rest)  # raises where an option or an argument is unknown


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_to_files(name):
    folder = ROOT if name == "README.md" else (DOCS / name).parent
    for link in re.findall(r"\]\(([^)#]+)\)", PAGES[name]):
        assert (folder / link).exists(), link
    for script in re.findall(r"(?:bash|python) (scripts/\S+?)[`\s)]", PAGES[name]):
        assert (ROOT / script).is_file(), script


def test_names_of_the_package_exist():
    for page in PAGES.values():
        for name in re.findall(r"`gantrysim\.((?:\w+\.)*\w+)`", page):
            assert pkgutil.resolve_name(f"gantrysim.{name}") is not None


def test_every_picture_is_shown_and_together_they_are_small():
    pictures = list((ROOT / "docs" / "pictures").iterdir())
    assert sum(picture.stat().st_size for picture in pictures) < 4_000_000
    for picture in pictures:
        assert any(f"pictures/{picture.name}" in page for page in PAGES.values()), picture.name


def test_the_job_file_s_page_is_up_to_date():
    page = runpy.run_path(str(ROOT / "scripts" / "job_file_page.py"))["page"]
    assert page() == PAGES["job-file.md"], "run python scripts/job_file_page.py"


def test_the_tables_of_validation_are_up_to_date():
    page = runpy.run_path(str(ROOT / "scripts" / "validation_page.py"))["page"]
    assert page() == PAGES["validation.md"], "run python scripts/validation_page.py"
    assert PAGES["validation.md"].count("| `tests/") > 60


def test_a_tolerance_that_no_test_holds_is_refused(tmp_path, monkeypatch):
    names = runpy.run_path(str(ROOT / "scripts" / "validation_page.py"))
    monkeypatch.setitem(names["marked"].__globals__, "ROOT", tmp_path)
    file = tmp_path / "test_length.py"
    text = '@pytest.mark.validates("length", "ruler", "{}")\ndef test_it():\n    assert abs(length - 3.0) < 2e-4\n'
    file.write_text(text.format("0.2 µm"), encoding="utf-8")
    assert [comparison.tolerance for comparison in names["marked"](file)] == ["0.2 µm"]
    file.write_text(text.format("0.1 µm"), encoding="utf-8")
    with pytest.raises(ValueError, match=r"'length': no 0\.1 in the module"):
        list(names["marked"](file))


def test_the_notebook_is_shown_with_its_outputs_and_kept_without(tmp_path):
    page = runpy.run_path(str(ROOT / "scripts" / "notebook_page.py"))["page"]
    assert_printed(PAGES["start/notebook.md"], page(tmp_path))
    pictures = ["notebook-1.jpg", "notebook-5.png", "notebook-8.svg", "notebook-9.svg"]
    assert sorted(file.name for file in tmp_path.iterdir()) == pictures
    cells = json.loads((ROOT / "examples" / "first_run.ipynb").read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


def test_the_ten_keys_are_those_of_their_example(tmp_path):
    names = runpy.run_path(str(ROOT / "scripts" / "job_file_page.py"))
    (example,) = blocks(PAGES["job-file.md"], "toml")
    (tmp_path / "part.ngc").write_text("G21 G90\nG1 X40 F1200\nM30\n", encoding="utf-8")
    (tmp_path / "bracket.toml").write_text(example, encoding="utf-8")
    job = Job.load(tmp_path / "bracket.toml")
    assert job.setpoints.duration > 0
    assert len(names["TEN"]) == 10
    table = tomllib.loads(example)
    for key in names["TEN"]:
        place = table
        for part in key.split("."):
            place = place[part]


RATIOS = (
    "engine", "servo", "loop", "converged_cost", "batch", "vector_env", "bead_env", "speed_env", "torque_env",
    "tuning_env", "scalar_env", "study_case", "improve", "tune", "import_time", "frame_growth", "frame_cost",
    "bead_cost", "first_run", "verdict", "page", "film", "setpoints", "analysis",
)  # fmt: skip


@pytest.mark.soak
@pytest.mark.parametrize("keys", [("setpoints",), ()])
def test_the_benchmark_prints_what_it_is_asked_for(keys):
    command = [sys.executable, ROOT / "scripts" / "benchmark.py", "--json", "--rounds", "1", *keys]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    ratios = json.loads(done.stdout)
    assert tuple(ratios) == (keys or RATIOS)
    assert min(ratios.values()) > 0


LONG_BENCHMARKS = {
    "import_time",
    "scalar_env",
    "vector_env",
    "bead_env",
    "speed_env",
    "torque_env",
    "tuning_env",
    "improve",
    "tune",
    "frame_growth",
    "frame_cost",
    "bead_cost",
    "first_run",
    "verdict",
    "page",
    "film",
    "batch",
    "converged_cost",
    "study_case",
    "analysis",
}


@pytest.mark.filterwarnings("ignore::glfw.GLFWError")  # MuJoCo's renderer tries it before what needs no display
@pytest.mark.parametrize(
    "key",
    [pytest.param(key, marks=pytest.mark.soak if key in LONG_BENCHMARKS else ()) for key in RATIOS],
)
def test_every_benchmark_gives_a_ratio(key, monkeypatch):
    """With few simulations side by side, and of one job."""
    names = runpy.run_path(str(ROOT / "scripts" / "benchmark.py"))
    assert tuple(names["BENCHMARKS"]) == RATIOS
    measure = names["BENCHMARKS"][key].measure
    monkeypatch.setitem(measure.__globals__, "SIDE_BY_SIDE", 4)
    monkeypatch.setitem(measure.__globals__, "builtin_jobs", lambda: ["stage-outline"])
    assert 0 < measure(1) < math.inf
