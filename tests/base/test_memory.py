"""What a run needs of memory and temporary files, and what the machine and its control groups leave."""

import math
import shutil
import tempfile
from types import SimpleNamespace

import pytest

from gantrysim.base import memory
from gantrysim.base.errors import InputError

GB = 10**9


def write(root, **files):
    for name, text in files.items():
        file = root / name.replace("__", "/").replace("_dot_", ".")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="ascii")


@pytest.fixture
def root(tmp_path):
    write(tmp_path, proc__meminfo="MemTotal:       16000000 kB\nMemAvailable:    8000000 kB\n")
    return tmp_path


def test_without_a_control_group_it_is_what_the_machine_has_left(root):
    assert memory.available_memory(root) == 8_000_000 * 1024


@pytest.mark.parametrize("group", ["", "one/two"])
def test_a_control_group_of_version_2(root, group):
    place = f"sys__fs__cgroup__{group.replace('/', '__')}__" if group else "sys__fs__cgroup__"
    write(root, proc__self__cgroup=f"0::/{group}\n")
    write(root, **{f"{place}memory_dot_max": "3000000000", f"{place}memory_dot_current": "2500000000\n"})
    assert memory.available_memory(root) == GB / 2
    write(root, **{f"{place}memory_dot_stat": "anon 9\ninactive_file 100000000\nactive_file 200000000\n"})
    assert memory.available_memory(root) == 0.8 * GB  # pages of files can go
    write(root, **{f"{place}memory_dot_max": "max"})
    assert memory.available_memory(root) == 8_000_000 * 1024


def test_the_group_above_may_have_less(root):
    write(root, proc__self__cgroup="0::/one/two\n")
    for place, limit in (("one", "2000000000"), ("one__two", "3000000000")):
        write(root, **{f"sys__fs__cgroup__{place}__memory_dot_max": limit})
        write(root, **{f"sys__fs__cgroup__{place}__memory_dot_current": "1000000000"})
    assert memory.available_memory(root) == GB


def test_a_control_group_of_version_1(root):
    write(root, proc__self__cgroup="4:memory:/box\n3:cpu:/other\n")
    place = "sys__fs__cgroup__memory__box__memory_dot_"
    write(root, **{f"{place}limit_in_bytes": "700000000", f"{place}usage_in_bytes": "900000000"})
    assert memory.available_memory(root) == 0


def test_a_machine_that_does_not_say_counts_whole(tmp_path):
    assert GB / 4 < memory.available_memory(tmp_path) < math.inf


@pytest.mark.parametrize(("available", "refused"), [(1.0 * GB, True), (100.0 * GB, False)])
def test_ticks_are_refused_above_the_memory(monkeypatch, available, refused):
    monkeypatch.setattr(memory, "available_memory", lambda: available)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=10**15))
    if refused:
        with pytest.raises(
            InputError, match=r"^a dwell: makes 4e\+07 ticks, which need about .* GB of memory, where 1 GB "
        ):
            memory.check_ticks(4e7, "a dwell", "dwell for less")
    else:
        memory.check_ticks(4e7, "a dwell", "dwell for less")


def test_ticks_are_refused_above_the_room_for_temporary_files(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=10**9))
    said = rf"^a dwell: makes 3e\+06 ticks, .* GB of temporary files, where 1 GB are free in {tempfile.gettempdir()}; "
    with pytest.raises(InputError, match=said + "dwell for less, or set TMPDIR to a folder with more room$"):
        memory.check_ticks(3e6, "a dwell", "dwell for less")


def test_a_job_of_any_usual_length_asks_nothing_of_the_system(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: pytest.fail("asked"))
    memory.check_ticks(1e5, "a dwell", "dwell for less")
    assert memory.needed_files(memory.LONG_RUN) == 0 < memory.needed_files(memory.LONG_RUN + 1)
    assert memory.needed_memory(memory.LONG_RUN) > memory.needed_memory(
        memory.LONG_RUN + 1
    )  # as its tables are in files
