"""Files and folders that are replaced as a whole, whatever ends the process."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gantrysim import InputError
from gantrysim.base import files
from gantrysim.base.files import PARTIAL, SWAP, ReplacedError, complete, held_folder, replaced_file, replaced_files
from gantrysim.base.signals import ENDING, deferred, handled, interrupt

from support.kills import forked
from support.soaked import suite_runs
from support.studies import PATIENCE, content

NAMES = ("a.txt", "b.txt", "c.txt", "plots/d.txt", "plots/e.txt")
OLD = {"a.txt": b"old a", "b.txt": b"old b", "plots/d.txt": b"old d"}
NEW = {"a.txt": b"new a", "c.txt": b"new c", "plots/e.txt": b"new e"}
OTHERS = {"mine.txt": b"mine", "plots/mine.txt": b"mine too"}

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="kills copies of this process")


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text)


def replace(folder, new=NEW):
    with held_folder(folder, "here"), replaced_files(folder, NAMES, "here") as scratch:
        write(scratch, new)


def shown(folder):
    """Files that a user sees."""
    return {name: text for name, text in content(folder).items() if not name.startswith(".")}


@pytest.fixture(autouse=True)
def synced(monkeypatch):
    """What reaches the disk, which takes long; a killed process needs none of it."""
    written = []
    monkeypatch.setattr(os, "fsync", lambda number: written.append(Path(f"/proc/self/fd/{number}").readlink().name))
    return written


@pytest.fixture
def old(tmp_path):
    folder = tmp_path / "out"
    write(folder, {**OLD, **OTHERS})
    return folder


@pytest.mark.parametrize("number", suite_runs([signal.SIGKILL, signal.SIGTERM], 0), ids=lambda number: number.name)
def test_at_every_access_a_signal_leaves_the_old_files_or_the_new_ones(tmp_path, old, number):
    def action():
        with handled(interrupt):
            replace(old)

    seen = forked(action, old)[1]
    assert seen > 20
    assert content(old) == {**NEW, **OTHERS}
    found = set()
    for at in range(seen):
        replace(old, OLD)
        status, _, _ = forked(action, old, at, number=number)
        left = shown(old)
        kept = {name: text for name, text in left.items() if name not in OTHERS}
        assert {name: left[name] for name in OTHERS} == OTHERS
        assert kept.items() <= OLD.items() or kept.items() <= NEW.items()  # never some of each
        if number == signal.SIGKILL:
            assert status == -number
            pending = (old / SWAP).exists()
        else:
            assert status == 97
            pending = False
            assert not [name for name in content(old) if name.startswith((PARTIAL, SWAP))]
        assert pending or kept in (OLD, NEW)
        complete(old, "here")
        assert shown(old) in ({**OLD, **OTHERS}, {**NEW, **OTHERS})
        found.add((shown(old)["a.txt"], pending))
        with held_folder(old, "here"):
            assert set(content(old)) == {*shown(old)}
    assert {text for text, _ in found} == {b"old a", b"new a"}
    assert any(pending for _, pending in found) == (number == signal.SIGKILL)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM], ids=lambda number: number.name)
def test_at_every_access_a_signal_leaves_the_old_file_or_the_new_one(tmp_path, number):
    file = tmp_path / "film.mp4"

    def action():
        with handled(interrupt), replaced_file(file) as partial:
            partial.write_bytes(b"new")

    seen = forked(action, tmp_path)[1]
    for at in range(seen):
        file.write_bytes(b"old")
        forked(action, tmp_path, at, number=number)
        assert file.read_bytes() in (b"old", b"new")
    with replaced_file(file) as partial:
        assert [item.name for item in tmp_path.iterdir() if item != file] == [partial.parent.name]
        partial.write_bytes(b"last")
    assert content(tmp_path) == {"film.mp4": b"last"}


@pytest.mark.soak
def test_a_second_kill_while_the_first_is_made_good_loses_nothing(old):
    def kill(at):
        return forked(lambda: replace(old), old, at)[0]

    count = forked(lambda: replace(old), old)[1]
    half = []
    for at in range(count):
        replace(old, OLD)
        if kill(at) and (old / SWAP).exists():
            half.append(at)
    assert half
    for at in half[:: len(half) // 2]:
        replace(old, OLD)
        kill(at)
        complete(old, "here")
        expected = shown(old)
        assert expected in ({**OLD, **OTHERS}, {**NEW, **OTHERS})
        for second in range(40):
            replace(old, OLD)
            kill(at)
            if not forked(lambda: complete(old, "here"), old, second)[0]:
                break
            kept = {name: text for name, text in shown(old).items() if name not in OTHERS}
            assert kept.items() <= OLD.items() or kept.items() <= NEW.items()
            complete(old, "here")
            assert shown(old) == expected


@pytest.mark.parametrize("number", ENDING, ids=lambda number: number.name)
def test_an_interrupt_says_what_it_has_left(old, number):
    def sent(when):
        with handled(interrupt), held_folder(old, "here"), replaced_files(old, NAMES, "here") as scratch:
            write(scratch, NEW)
            if when == "before":
                signal.raise_signal(number)
            end = files._end_swap

            def end_and_signal(folder):
                signal.raise_signal(number)
                end(folder)

            files._end_swap = end_and_signal
        pytest.fail("went on")

    with pytest.raises(KeyboardInterrupt, match=f"^nothing is written; the earlier files in {old}/ are kept$"):
        sent("before")
    assert shown(old) == {**OLD, **OTHERS}
    before = files._end_swap
    try:
        with pytest.raises(ReplacedError, match=f"^the files in {old}/ are complete$"):
            sent("after")
    finally:
        files._end_swap = before
    assert content(old) == {**NEW, **OTHERS}


def test_a_folder_in_use_is_refused_and_a_dead_owner_is_none(tmp_path):
    folder = tmp_path / "deep" / "out"
    script = "import sys, time; from pathlib import Path; from gantrysim.base.files import held_folder\n"
    script += "with held_folder(Path(sys.argv[1]), 'x'): print('held', flush=True); time.sleep(99)"
    owner = subprocess.Popen([sys.executable, "-c", script, folder], stdout=subprocess.PIPE)
    assert owner.stdout.readline() == b"held\n"
    with pytest.raises(InputError, match=r"^here: in use by another command$"), held_folder(folder, "here"):
        pytest.fail("held twice")
    owner.kill()
    owner.communicate()
    with held_folder(folder, "here"):
        pass
    assert [item.name for item in tmp_path.iterdir()] == ["deep"]  # the dead owner's


def test_new_files_are_on_disk_before_they_take_their_place(old, synced, monkeypatch):
    end = files._end_swap
    early = []
    monkeypatch.setattr(files, "_end_swap", lambda folder: (early.extend(synced), end(folder)))
    replace(old)
    assert set(early) >= {"a.txt", "c.txt", "e.txt"}


def test_of_two_writers_of_a_file_each_leaves_it_whole(tmp_path):
    file = tmp_path / "a"
    with replaced_file(file) as one, replaced_file(file) as other:
        one.write_bytes(b"one")
        other.write_bytes(b"other")
    assert content(tmp_path) == {"a": b"one"}


def test_what_stands_in_the_way_is_named_and_stays(tmp_path, old):
    (old / "c.txt").mkdir()
    (old / "c.txt" / "mine").write_text("mine")
    with pytest.raises(InputError, match=r"^here: c\.txt in it is a folder, must be a file: move it away$"):
        replace(old)
    assert content(old) == {**OLD, **OTHERS, "c.txt/mine": b"mine"}
    (tmp_path / "plots").write_text("mine")
    with pytest.raises(InputError, match=r"^here: plots in it is a file, must be a folder: move it away$"):
        replace(tmp_path)
    for bad, text in (
        (old, "is a folder"),
        ("/dev/null", "is not a regular file"),
        (old / "x" / "y", "no such folder "),
    ):
        with pytest.raises(InputError, match=f"^file {bad}: {text}"), replaced_file(bad):
            pytest.fail("begun")
    with (
        pytest.raises(InputError, match=r"^here: cannot be written: Not a directory$"),
        held_folder(old / "a.txt" / "b", "here"),
    ):
        pytest.fail("held")


def test_an_old_file_that_cannot_be_moved_keeps_all_old_files(old, monkeypatch):
    move = Path.replace

    def refuse(file, target):
        if file == old / "plots" / "d.txt":
            raise PermissionError(errno.EPERM, "Operation not permitted", str(target))
        return move(file, target)

    monkeypatch.setattr(Path, "replace", refuse)
    said = f"^file {old}/plots/d.txt: cannot be written: Operation not permitted; the earlier files in {old}/ are kept$"
    with pytest.raises(InputError, match=said):
        replace(old)
    assert content(old) == {**OLD, **OTHERS}


def test_a_full_disk_keeps_the_old_files(old):
    resource = pytest.importorskip("resource")

    def action():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
        said = f"^file {old}/c.txt: cannot be written: File too large; the earlier files in {old}/ are kept$"
        with pytest.raises(InputError, match=said):
            replace(old, {**NEW, "c.txt": b"c" * 1000})
        return 5

    assert forked(action, old)[0] == 5
    assert content(old) == {**OLD, **OTHERS}


def test_a_read_only_folder_is_refused(old):
    old.chmod(0o555)

    def action():
        if os.getuid() == 0:
            os.setgid(65534)
            os.setuid(65534)
        with pytest.raises(InputError, match=r"^here: cannot be written: Permission denied$"):
            replace(old)
        return 5

    for folder in old.parents:
        if folder == old.parent or folder.name.startswith(("pytest-", "popen-")):  # those of this run of pytest
            folder.chmod(0o755)
    assert forked(action, old)[0] == 5
    assert content(old) == {**OLD, **OTHERS}
    old.chmod(0o755)


def test_deferred_signals_come_at_the_end_and_an_ignored_hangup_stays_ignored():
    done = []

    def late():
        with deferred() as came:
            signal.raise_signal(signal.SIGINT)
            done.append(came())

    with pytest.raises(KeyboardInterrupt):
        late()
    assert done == [True]
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with handled(interrupt):
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_process_ends_with_its_parent_even_if_that_is_gone_before(tmp_path):
    def ends(script):
        file = tmp_path / "child"
        file.unlink(missing_ok=True)
        subprocess.run([sys.executable, "-c", script, file], check=True)
        until = time.monotonic() + PATIENCE
        while not file.exists() or not file.read_text():
            time.sleep(0.01)
        child = int(file.read_text())
        while _alive(child):
            assert time.monotonic() < until
            time.sleep(0.05)

    child = "import os, sys, time; from gantrysim.base.signals import end_with\n"
    child += (
        "open(sys.argv[1], 'w').write(str(os.getpid())); time.sleep({}); end_with(int(sys.argv[2])); time.sleep(99)"
    )
    start = "import os, subprocess, sys, time\n"
    start += "subprocess.Popen([sys.executable, '-c', {!r}, sys.argv[1], str(os.getpid())]); time.sleep({})"
    ends(start.format(child.format(0), 1.0))
    ends(start.format(child.format(1.0), 0))


def _alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
