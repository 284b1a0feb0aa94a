"""What is built from the sources holds all that a user needs."""

import tarfile
import zipfile
from pathlib import Path

import pytest
from flit_core import buildapi

import gantrysim

ROOT = Path(__file__).parent.parent


@pytest.fixture
def at_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def needed():
    package = ROOT / "gantrysim"
    files = [path for path in package.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {path.relative_to(ROOT).as_posix() for path in files}


def test_the_wheel_holds_the_package_once(at_root, tmp_path):
    name = buildapi.build_wheel(str(tmp_path))
    assert name.startswith(f"gantrysim-{gantrysim.__version__}-py3")
    with zipfile.ZipFile(tmp_path / name) as wheel:
        names = wheel.namelist()
    assert {name for name in names if ".dist-info/" not in name} == needed()
    assert {"gantrysim/models/xy.xml", "gantrysim/models/parts/scene.xml", "gantrysim/jobs/an225.toml"} <= set(names)
    assert any(name.endswith("entry_points.txt") for name in names)


def test_the_sdist_holds_sources_tests_and_scripts(at_root, tmp_path):
    name = buildapi.build_sdist(str(tmp_path))
    with tarfile.open(tmp_path / name) as sdist:
        names = {member.name.partition("/")[2] for member in sdist.getmembers()}
    assert needed() <= names
    assert {"pyproject.toml", "README.md", "LICENSE", "scripts/demo.sh", "tests/test_package.py"} <= names
    assert {".ci/run", ".pre-commit-config.yaml", "CONTRIBUTING.md"} <= names


def test_the_links_at_the_top_lead_into_the_package():
    for name in ("models", "controllers"):
        assert (ROOT / name).readlink() == Path("gantrysim") / name


def test_every_public_name_can_be_imported():
    """Each is imported at its first use: a stale module in the stub would fail only there."""
    for name in gantrysim.__all__:
        getattr(gantrysim, name)
    assert {"Job", "Machine", "Run", "Servo", "Tick"} <= set(gantrysim.__all__)
