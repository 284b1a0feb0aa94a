"""What is built from the sources holds all that a user needs, and runs where it is installed."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import Distribution
from pathlib import Path

import pytest
from flit_core import buildapi
from packaging.requirements import Requirement
from packaging.version import Version

import gantrysim
from gantrysim.job.loading import builtin_jobs
from gantrysim.machine.machine import builtin_models

from support.soaked import WHOLE

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SUMMARY = "summary.json"
RUN = ("run", "an225", "--set", "turns=1", "--set", "loop_period=0.005")
RESULTS_ALONE = ("--no-video", "--no-report", "--no-causes", "--no-improve")
LOADED = """
import sys
import gantrysim as gs
print(gs.__file__)
for name in sys.argv[1:]:
    print(gs.Job.load(name).name)
"""


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """The wheel and the sdist, by these names."""
    folder = tmp_path_factory.mktemp("archives")
    with pytest.MonkeyPatch.context() as context:
        context.chdir(ROOT)
        return {
            "wheel": folder / buildapi.build_wheel(str(folder)),
            "sdist": folder / buildapi.build_sdist(str(folder)),
        }


def needed():
    package = ROOT / "gantrysim"
    files = [path for path in package.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {path.relative_to(ROOT).as_posix() for path in files}


def test_the_wheel_holds_the_package_once(archives):
    assert archives["wheel"].name.startswith(f"gantrysim-{gantrysim.__version__}-py3")
    with zipfile.ZipFile(archives["wheel"]) as wheel:
        names = wheel.namelist()
    assert {name for name in names if ".dist-info/" not in name} == needed()
    assert {"gantrysim/models/xy.xml", "gantrysim/models/parts/scene.xml", "gantrysim/jobs/an225.toml"} <= set(names)
    assert {"gantrysim/py.typed", "gantrysim/__init__.pyi"} <= set(names)
    assert any(name.endswith("entry_points.txt") for name in names)


def test_the_sdist_holds_sources_tests_and_scripts(archives):
    with tarfile.open(archives["sdist"]) as sdist:
        names = {member.name.partition("/")[2] for member in sdist.getmembers()}
    assert needed() <= names
    assert {"pyproject.toml", "README.md", "LICENSE", "scripts/demo.sh", "tests/test_package.py"} <= names
    assert {".ci/run", ".pre-commit-config.yaml", "CONTRIBUTING.md", "constraints-minimum.txt"} <= names


def installed(archive, folder):
    """Install an archive with pip into a folder, without the network."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    environment = os.environ | {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "PYTHONPATH": ""}
    subprocess.run([*command, "--no-compile", "--target", folder, archive], check=True, env=environment)
    return folder


def take_bytecode_of_the_sources(folder):
    """Lay the bytecode of the sources beside the same files installed in a folder: it is nine seconds' work."""
    for kept in (ROOT / "gantrysim").rglob("__pycache__"):
        place = folder / kept.relative_to(ROOT)
        shutil.copytree(kept, place)
        for source in kept.parent.glob("*.py"):
            # Python takes bytecode only of a source of the same size and time
            shutil.copystat(source, place.parent / source.name)


def contents(folder):
    """The files of the package in a folder, without compiled code."""
    files = [path for path in (folder / "gantrysim").rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.parametrize(
    "words",
    [
        ("info", "machines"),
        # compile all that a verdict and a run need, as nothing is kept for that folder
        pytest.param(("check", "an225"), marks=pytest.mark.soak),
        pytest.param((*RUN, "--out", "out", *RESULTS_ALONE), marks=pytest.mark.soak),
    ],
    ids=["info", "check", "run"],
)
def test_wheel_and_sdist_install_the_same_package_which_works_on_a_job(archives, tmp_path, words):
    folder = installed(archives["sdist"], tmp_path / "sdist")
    with zipfile.ZipFile(archives["wheel"]) as wheel:
        wheel.extractall(tmp_path / "wheel")
    assert {path.name for path in folder.iterdir()} == {
        "bin",
        "gantrysim",
        f"gantrysim-{gantrysim.__version__}.dist-info",
    }
    assert contents(folder) == contents(tmp_path / "wheel")
    assert set(contents(folder)) == needed()
    take_bytecode_of_the_sources(folder)
    work = tmp_path / "elsewhere"
    work.mkdir()
    environment = os.environ | {"PYTHONPATH": str(folder)}

    def output(*command):
        done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    command = folder / "bin" / "gantrysim"
    assert output(command, "--version") == f"{gantrysim.__version__}\n"
    # one with a program of the package; the others' files are there as well, see above
    wanted = builtin_jobs() if WHOLE else ["trio-basic"]
    file, *jobs = output(sys.executable, "-c", LOADED, *wanted).splitlines()
    assert Path(file).parent == folder / "gantrysim"
    assert jobs == wanted
    shown = output(command, *words)
    if "run" in words:
        assert "Contour error: " in shown
        summary = json.loads((work / "out" / SUMMARY).read_text(encoding="utf-8"))
        assert summary["versions"]["gantrysim"] == gantrysim.__version__
    elif "check" in words:
        assert "an225: trio.MoveSpiral on xy, not simulated" in shown
    else:
        assert re.findall(r"^(\w+) +\w+ +-?\d", shown, flags=re.MULTILINE) == builtin_models()


def test_the_metadata_name_python_and_packages(archives, tmp_path):
    with zipfile.ZipFile(archives["wheel"]) as wheel:
        wheel.extractall(tmp_path)
    metadata = Distribution.at(next(tmp_path.glob("*.dist-info"))).metadata
    assert metadata["Version"] == gantrysim.__version__
    assert metadata["Requires-Python"] == PROJECT["requires-python"]
    oldest = f"Programming Language :: Python :: {PROJECT['requires-python'].removeprefix('>=')}"
    assert oldest in metadata.get_all("Classifier")


def test_the_version_is_stated_once():
    stated = [
        file.relative_to(ROOT).as_posix()
        for file in [ROOT / "pyproject.toml", ROOT / "CITATION.cff", *(ROOT / "gantrysim").rglob("*.py")]
        if re.search(
            rf"\b(?:version|__version__)\W+{re.escape(gantrysim.__version__)}\b", file.read_text(encoding="utf-8")
        )
    ]
    assert stated == ["gantrysim/__init__.py"]


def test_a_release_has_one_date():
    """The heading of the changelog dates a release, or says that there is none yet; so does the citation."""
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    dated = re.search(rf"^## {re.escape(gantrysim.__version__)}, (\S+)$", changes, flags=re.MULTILINE)
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    released = re.search(r"^date-released: (\S+)$", citation, flags=re.MULTILINE)
    assert dated is not None
    assert (released[1].strip("'\"") if released else "unreleased") == dated[1]


def test_the_lowest_versions_are_those_that_are_tried():
    """The bound of every package of the user's is a version of the file that `scripts/minimum.sh` installs."""
    lines = (ROOT / "constraints-minimum.txt").read_text(encoding="utf-8").splitlines()
    tried = dict(line.split("==") for line in lines if not line.startswith("#"))
    extras = PROJECT["optional-dependencies"]
    names = [name for name in extras if name != "all"]
    stated = {}
    for text in [*PROJECT["dependencies"], *(text for name in names for text in extras[name])]:
        requirement = Requirement(text)
        if requirement.name != "gantrysim":
            (bound,) = requirement.specifier
            assert bound.operator == ">="
            stated[requirement.name] = Version(bound.version)
    assert {name: Version(version) for name, version in tried.items()} == stated


@pytest.mark.parametrize("name", ["constraints.txt", "constraints-minimum.txt"])
def test_constraints_are_names_and_numbers_alone(name):
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    assert len(lines) > 20
    assert [line for line in lines if not re.fullmatch(r"# .*|[\w.-]+==[\w.]+", line)] == []
    assert not any("://" in line for line in lines)


def test_the_links_at_the_top_lead_into_the_package():
    for name in ("models", "controllers"):
        assert (ROOT / name).readlink() == Path("gantrysim") / name


def test_every_public_name_can_be_imported():
    """Each is imported at its first use: a stale module in the stub would fail only there."""
    for name in gantrysim.__all__:
        getattr(gantrysim, name)
    assert {"Job", "Machine", "Run", "Servo", "Tick"} <= set(gantrysim.__all__)


def test_the_reference_lists_every_public_name_once():
    """Its page states that these names stay."""
    page = (ROOT / "docs" / "api" / "index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[.*?\) \| (.*) \|$", page, flags=re.MULTILINE)
    listed = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    errors = re.findall(r"`gs\.(\w+Error)`", page)
    assert sorted(listed + errors) == sorted(gantrysim.__all__)


@pytest.mark.parametrize(
    ("module", "name", "hint"),
    [
        (gantrysim, "simulat", "did you mean simulate?"),
        (gantrysim, "machine_", "did you mean Machine?"),
        (gantrysim, "qqqq", "dir(gantrysim) lists its names"),
        (gantrysim.controllers, "trioo", "did you mean trio?"),
        (gantrysim.controllers.trio, "MoveSpirl", "did you mean MoveSpiral?"),
        (gantrysim.study, "SpedStudy", "did you mean SpeedStudy?"),
    ],
)
def test_a_wrong_name_gets_the_nearest(module, name, hint):
    with pytest.raises(AttributeError) as error:
        getattr(module, name)
    assert str(error.value) == f"module {module.__name__!r} has no attribute {name!r}: {hint}"
    assert not hasattr(module, "_repr_html_")
