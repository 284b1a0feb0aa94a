"""Compiled functions and their cache: dropped with all that is compiled into them, and safe to run from."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gantrysim
from gantrysim.base.jit import UNCOMPILED, c_function, jit

from support.soaked import suite_runs

ROOT = Path(gantrysim.__file__).parent
BASE = ("__init__.py", "errors.py", "jit.py", "progress.py")

HELPERS = """
from gantrysim.base.jit import jit

FACTOR = 2.0

@jit
def scaled(value):
    return FACTOR * value
"""

KERNELS = """
import numba

from gantrysim.base.jit import jit
from gantrysim.helpers import scaled

@jit
def function(value):
    return scaled(value) + 1.0

@numba.njit(cache=True)
def numbas(value):
    return scaled(value) + 1.0
"""

ASK = """
import os, sys
os.environ.update({environment!r})
sys.path.insert(0, {package!r})
{before}
from gantrysim.base.jit import count_compiled
from gantrysim.kernels import function
print(function(3.0), count_compiled())
"""


class Package:
    """A package with the decorator alone and two modules of its own, as an edited gantrysim would be.

    Args:
        folder: in which it is made, with its cache and a working folder.
        fresh: fresh processes.
    """

    def __init__(self, folder, fresh):
        self.root = folder / "package"
        self.cache = folder / "cache"
        self.work = folder / "work"
        self._fresh = fresh
        self.work.mkdir()
        (self.root / "gantrysim" / "base").mkdir(parents=True)
        for name in BASE:
            shutil.copy(ROOT / "base" / name, self.root / "gantrysim" / "base")
        self.write("__init__", "")
        self.write("helpers", HELPERS)
        self.write("kernels", KERNELS)

    def write(self, name, text):
        file = self.root / "gantrysim" / f"{name}.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)

    def ask(self, before="", **environment):
        """Return what the function gives for 3 in a new process, and how many functions that compiled."""
        variables = {"NUMBA_CACHE_DIR": str(self.cache), **environment}
        code = ASK.format(environment=variables, package=str(self.root), before=before)
        done = self._fresh.run("import sys; sys.dont_write_bytecode = True\n" + code, self.work)
        assert (done.status, done.error) == (0, ""), done
        value, count = done.output.splitlines()[-1].split()
        return float(value), int(count)

    @property
    def store(self):
        (store,) = self.cache.glob("gantrysim/*")
        return store

    @property
    def entries(self):
        return sorted(self.store.glob("*/*.nb?"))


@pytest.fixture
def package(tmp_path, fresh):
    return Package(tmp_path, fresh)


def test_what_is_compiled_is_kept_until_a_file_changes(package):
    assert package.ask() == (7.0, 2)
    assert package.ask() == (7.0, 0)
    package.write("cli/print", "COLOUR = 3")
    assert package.ask() == (7.0, 0)
    package.write("kernels", KERNELS.replace("+ 1.0", "+ 2.0"))
    assert package.ask() == (8.0, 2)


def test_settings_that_decide_nothing_leave_the_cache_as_it_is(package):
    """As the number of threads, which joblib sets in its workers."""
    assert package.ask() == (7.0, 2)
    assert package.ask(NUMBA_NUM_THREADS="1") == (7.0, 0)
    assert package.ask(NUMBA_OPT="1") == (7.0, 2)


@pytest.mark.parametrize(
    ("old", "new", "right"),
    suite_runs([("2.0", "5.0", 16.0), ("FACTOR * value", "FACTOR / value", 2.0 / 3.0 + 1.0)], 0),
)
def test_an_edited_helper_is_compiled_anew_where_numba_itself_keeps_the_old_one(package, tmp_path, old, new, right):
    numbas = f"""
import numba
numba.config.CACHE_DIR = {str(tmp_path)!r}
from gantrysim.kernels import numbas
print(numbas(3.0), file=open("numbas.txt", "w"))
"""
    assert package.ask(numbas) == (7.0, 2)
    package.write("helpers", HELPERS.replace(old, new))
    assert package.ask(numbas) == (pytest.approx(right, rel=1e-15), 2)
    assert (package.work / "numbas.txt").read_text() == "7.0\n"


@jit
def _half(value):
    return value / 2


@jit
def _quarter(value):
    return _half(_half(value))


def test_a_helper_can_be_called_from_python():
    assert _quarter(3.0) == 0.75
    assert _half(3.0) == 1.5


def test_a_division_by_zero_is_numpys():
    assert jit(lambda x: 1.0 / x)(0.0) == float("inf")


def _flip(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0x10
    file.write_bytes(data)


DAMAGES = {
    "empty": lambda file: file.write_bytes(b""),
    "cut": lambda file: file.write_bytes(file.read_bytes()[:-100]),
    "a flipped bit": _flip,
    "gone": lambda file: file.unlink(),
}


@pytest.mark.parametrize("damage", suite_runs(list(DAMAGES), 0))
def test_what_is_damaged_is_compiled_anew_and_written(package, damage):
    package.ask()
    for ending in (".nbi", ".nbc"):
        (file,) = package.store.glob(f"*/kernels*{ending}")
        DAMAGES[damage](file)
        assert package.ask() == (7.0, 1)
    DAMAGES[damage](package.store / "checksums")
    value, count = package.ask()
    assert value == 7.0
    assert count > 0
    assert package.ask() == (7.0, 0)


def test_an_entry_that_no_process_has_kept_is_not_run(package, tmp_path):
    """As a killed process leaves it, or somebody who may write but does not know the checksums."""
    package.ask()
    kept = {file: file.read_bytes() for file in package.entries if file.name.startswith("kernels")}
    other = tmp_path / "other"
    other.mkdir()
    package.write("kernels", KERNELS.replace("+ 1.0", "+ 666.0"))
    package.cache = other
    assert package.ask() == (672.0, 2)
    planted = {file.suffix: file.read_bytes() for file in package.entries if file.name.startswith("kernels")}
    for file in kept:
        file.write_bytes(planted[file.suffix])
    package.write("kernels", KERNELS)
    package.cache = tmp_path / "cache"
    assert package.ask() == (7.0, 1)


def test_processes_at_the_same_time_keep_what_each_has_compiled(package):
    """The second begins and ends while the first is compiling; neither sees what the other writes."""
    within = f"""
import subprocess
code = '''
import os, sys
sys.path.insert(0, {str(package.root)!r})
from gantrysim.kernels import function
from gantrysim.base.jit import count_compiled
assert (function(3), count_compiled()) == (7.0, 2)
'''
from gantrysim.kernels import function
subprocess.run([sys.executable, "-c", code], check=True)
"""
    assert package.ask(within) == (7.0, 2)
    count = "from gantrysim.kernels import function\nfunction(3)"
    value, compiled = package.ask(count)
    assert value == 7.0
    # the index of a function is that of the process that ended last
    assert compiled in (0, 2)
    assert package.ask(count) == (7.0, 0)


def _writable_by_others(package):
    package.store.chmod(0o777)


def _of_another_user(package):
    if os.geteuid():
        pytest.skip("only root gives files away")
    os.chown(package.store, 65534, 65534)


def _on_a_way_that_others_can_change(package):
    package.cache.chmod(0o777)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and modes as on POSIX")
@pytest.mark.parametrize(
    "give", [_writable_by_others, _of_another_user, _on_a_way_that_others_can_change], ids=lambda give: give.__name__
)
def test_a_folder_that_others_may_write_is_not_used(package, give):
    assert package.ask() == (7.0, 2)
    give(package)
    before = sorted(package.cache.rglob("*"))
    assert package.ask() == (7.0, 2)
    assert sorted(package.cache.rglob("*")) == before


@pytest.mark.parametrize("named", suite_runs(["cache", "./cache", "~/cache"], 2))
def test_a_folder_is_never_named_from_the_working_folder(package, named):
    assert package.ask(NUMBA_CACHE_DIR=named) == (7.0, 2)
    assert package.ask(NUMBA_CACHE_DIR=str(package.work / "cache")) == (7.0, 2)
    assert package.ask(NUMBA_CACHE_DIR="", XDG_CACHE_HOME=named, HOME=named) == (7.0, 2)
    assert not list(package.work.iterdir())


def test_the_home_folder_may_be_the_working_folder(package):
    home = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": "", "HOME": str(package.work)}
    assert package.ask(**home) == (7.0, 2)
    assert package.ask(**home) == (7.0, 0)
    assert len(list(package.work.glob(".cache/gantrysim/*/checksums"))) == 1


FULL = """
import shutil
from types import SimpleNamespace
shutil.disk_usage = lambda folder: SimpleNamespace(free=1000)
"""


def test_a_full_disk_means_computing_without_a_cache(package):
    assert package.ask(FULL) == (7.0, 2)
    assert package.entries == []
    package.ask()
    before = {file: file.read_bytes() for file in package.entries}
    assert package.ask(FULL) == (7.0, 2)
    assert {file: file.read_bytes() for file in package.entries} == before


def test_what_cannot_be_kept_is_computed(package):
    """The disk has become full since the process began."""
    cannot = "import os\nfrom pathlib import Path\ndef fail(*_): raise OSError(28, 'full')\nPath.replace = fail"
    assert package.ask(cannot) == (7.0, 2)
    assert package.ask() == (7.0, 2)


def test_caches_of_old_versions_are_removed(package):
    package.ask()
    store = package.store
    for k in range(20):
        old = package.cache / "gantrysim" / f"{k:016x}"
        old.mkdir()
        os.utime(old, (k, k))
    killed = store / "process-killed"
    killed.mkdir()
    os.utime(killed, (0, time.time() - 1e6))
    assert package.ask() == (7.0, 0)
    assert len(list(package.cache.glob("gantrysim/*"))) == 8
    assert not killed.exists()


def test_the_cache_of_a_users_functions_is_left_alone():
    import numba

    before = numba.config.CACHE_DIR
    jit(_half.py_func)
    assert before == numba.config.CACHE_DIR


def test_a_c_function_is_compiled():
    import numba

    function = c_function(_twice, numba.types.float64(numba.types.float64))
    assert function.ctypes(3.0) == 6.0


def _twice(value):
    return 2.0 * value


def test_rooms_that_do_not_count_for_the_cache_compile_nothing_and_nothing_compiled_uses_them():
    folders = [folder.name for folder in ROOT.iterdir() if folder.is_dir()]
    for room in folders:
        for file in (ROOT / room).rglob("*.py"):
            text = file.read_text()
            if re.search(r"^\s*@jit\b|\bc_function\(|= jit\(|with_parts\(", text, re.MULTILINE):
                assert room not in UNCOMPILED, file
                used = set(re.findall(r"^from gantrysim\.(\w+)", text, re.MULTILINE))
                assert not used & UNCOMPILED, file


COMMANDS = (("check", "an225"), ("run", "an225", "--no-video", "--no-report"), ("compile",))


def _command(folder, *words, **environment):
    command = [str(Path(sys.executable).with_name("gantrysim")), *words]
    return subprocess.run(command, cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True)


@pytest.mark.parametrize("settings", suite_runs(["cache_dir: planted", "disable_jit: 1", "[", ""], 0))
def test_numbas_settings_in_a_strangers_folder_are_refused(tmp_path, settings):
    """They could name a folder of machine code there, which would be run."""
    (tmp_path / ".numba_config.yaml").write_text(settings)
    done = _command(tmp_path, "check", "an225")
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(r"error: file \.numba_config\.yaml in the current folder: .*\n", done.stderr)
    assert [file.name for file in tmp_path.iterdir()] == [".numba_config.yaml"]


@pytest.mark.parametrize("words", suite_runs([(words,) for words in COMMANDS], 0))
def test_a_command_without_compilation_ends_with_a_line(tmp_path, words):
    done = _command(tmp_path, *words, NUMBA_DISABLE_JIT="1")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: NUMBA_DISABLE_JIT is set: gantrysim runs compiled only, unset it\n"
    assert not list(tmp_path.iterdir())
