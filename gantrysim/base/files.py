"""Results on disk: a file, or the files of a folder, are replaced as a whole or stay as they were.

New files are written to a hidden folder beside the old ones. A single file then takes its place in one step. The files
of a folder cannot: the hidden folder gets a name that marks it as complete, the old files are moved into it, then the
new ones out of it. So old and new files never lie side by side, and the next command that writes to the folder
completes what was cut short. A command that only reads changes nothing: it waits, or reports what is left.

A folder may come from elsewhere, and its files with it: a link in it leads nothing that is written out of it.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from gantrysim.base.errors import InputError, expanded
from gantrysim.base.signals import deferred
from gantrysim.base.swap import (
    ANY,
    NAMES,
    NEW,
    PARTIAL,
    SWAP,
    check_free,
    complete_swap,
    is_of_this_user,
    open_regular,
    pending,
    to_disk,
    visible,
)

try:
    import fcntl
except ImportError:  # Windows: nothing is locked, and what a killed command left stays
    fcntl = None  # type: ignore[assignment]

LOCK = ".gantrysim-lock"
_PATIENCE = 2.0  # of a reader, with a folder whose files are being replaced [s]
_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO}


class ReplacedError(KeyboardInterrupt):
    """An interrupt that arrived while new files took their place: they have."""


@contextmanager
def replaced(file: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a file in a hidden folder that replaces a file on success, in one step, and is removed otherwise.

    Raises:
        InputError: a folder, no regular file, a link to a file in another folder, or a file that cannot be written.
    """
    target = _writable(file)
    note = f"; the earlier {target.name} is kept" if target.exists() else ""
    label = f"file {visible(str(file))}"
    with _written(label, note, f"{file} is complete") as done, _scratch(target.parent) as scratch:
        with _named(scratch):
            yield scratch / target.name
        if PARTIAL not in str(target.parent):  # else the folder around it does
            to_disk([scratch / target.name])
        with deferred():
            (scratch / target.name).replace(target)
            done.append(True)


@contextmanager
def replaced_files(folder: Path, names: Iterable[str], label: str) -> Iterator[Path]:
    """Give a hidden folder whose files replace those of these names in a held folder on success, as a whole.

    Other files in the folder stay.

    Args:
        folder: see `held`.
        names: of all files that may be written, in the folder or in a subfolder; those not written are removed.
        label: of the folder in errors.

    Raises:
        InputError: the files cannot be written; the old ones are kept.
    """
    names = list(names)
    note = f"; the earlier files in {folder}/ are kept" if any((folder / name).exists() for name in names) else ""
    with _written(label, note, f"the files in {folder}/ are complete") as done, _scratch(folder) as scratch:
        (scratch / NEW).mkdir()
        with _named(scratch):
            yield scratch / NEW
        check_free(folder, names, label)
        (scratch / NAMES).write_text(json.dumps(names), encoding="utf-8")
        to_disk(file for file in scratch.rglob("*") if not file.is_dir())
        with deferred():
            scratch.rename(folder / SWAP)
            complete_swap(folder, is_ours=True)
            done.append(True)


@contextmanager
def held(folder: Path, label: str, names: Collection[str] = ANY) -> Iterator[None]:
    """Hold a folder against other commands that write to it, in the block; however a process ends, its hold ends.

    The folder is made where it is missing, and removed if the block leaves it empty. What a killed command has left in
    it is completed or removed.

    Args:
        folder: to be held.
        label: of the folder in errors.
        names: of the files that the command writes, see `complete_swap`.

    Raises:
        InputError: in use by another command, or not to be written to; or hidden files that no command can have left.
    """
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    lock = folder / LOCK
    stream: BinaryIO | None = None
    try:
        try:
            with deferred():
                folder.mkdir(parents=True, exist_ok=True)
                if fcntl is not None:
                    stream = _locked(lock)
                complete_swap(folder, names)
                _sweep(folder)
        except BlockingIOError:
            raise InputError(f"{label}: in use by another command") from None
        except OSError as error:
            raise InputError(f"{label}: cannot be written: {error.strerror}") from None
        yield
    finally:
        with deferred():
            if stream is not None:
                with suppress(OSError):
                    lock.unlink()
                stream.close()  # releases the lock, after its file is gone
            for parent in missing:
                with suppress(OSError):  # not empty
                    parent.rmdir()


def complete(folder: Path, label: str, names: Collection[str] = ANY) -> None:
    """Complete what a killed command has left in a folder that is about to be written to; arguments as of `held`.

    Raises:
        InputError: as `held`.
    """
    if pending(folder):
        with held(folder, label, names):
            pass


def check_whole(folder: Path, label: str) -> None:
    """Wait while a command replaces the files of a folder; change nothing.

    Raises:
        InputError: they stay half replaced, as a command was killed.
    """
    until = time.monotonic() + _PATIENCE
    while pending(folder):
        if time.monotonic() > until:
            raise InputError(
                f"{label}: a killed command has left its new files in {folder / SWAP}, not yet in place: any command "
                f"that writes to the folder puts them there, as gantrysim run JOB --out {folder}"
            )
        time.sleep(0.01)


def _writable(file: str | os.PathLike[str]) -> Path:
    target = expanded(file).absolute()
    if target.is_symlink():
        beside = target.parent.resolve()
        target = Path(os.path.realpath(target))
        if not target.is_relative_to(beside):
            raise InputError(
                f"file {file}: is a link to {target}, in another folder: name that file, or remove the link"
            )
    if target.is_dir():
        raise InputError(f"file {file}: is a folder")
    if target.exists() and not target.is_file():
        raise InputError(f"file {file}: is not a regular file")
    if not target.parent.is_dir():
        raise InputError(f"file {file}: no such folder {Path(file).parent}")
    return target


@contextmanager
def _written(label: str, note: str, complete: str) -> Iterator[list[bool]]:
    """Report which files remain after an error or an interrupt of the block.

    Args:
        label: of the files, in errors.
        note: which earlier files are kept.
        complete: message of an interrupt once the new files are in place.

    Yields:
        A list to be filled once they are.
    """
    done: list[bool] = []
    try:
        yield done
    except KeyboardInterrupt:
        raise (ReplacedError(complete) if done else KeyboardInterrupt(f"nothing is written{note}")) from None
    except OSError as error:
        file = str(error.filename or "")
        if error.errno not in _DISK and not any(part in file for part in (PARTIAL, SWAP)):
            raise
        place = visible(file)
        failed = f"file {place}" if place and not place.endswith(os.sep) else label
        raise InputError(f"{failed}: cannot be written: {error.strerror or error}{note}") from None


@contextmanager
def _named(scratch: Path) -> Iterator[None]:
    """Name the file of a full disk: Python knows the one that cannot be opened, but not the one that is cut off."""
    try:
        yield
    except OSError as error:
        files = [file for file in scratch.rglob("*") if file.is_file()]
        if error.filename is None and error.errno in _DISK and files:
            error.filename = str(max(files, key=lambda file: file.stat().st_mtime_ns))
        raise


@contextmanager
def _scratch(folder: Path) -> Iterator[Path]:
    """Give a new hidden folder in a folder, locked as long as this process needs it, and remove it at the end."""
    _sweep(folder)
    with ExitStack() as stack:
        claimed = False
        while not claimed:
            with deferred():
                scratch = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=folder))
                stack.callback(deferred()(shutil.rmtree), scratch, ignore_errors=True)
                with suppress(FileNotFoundError, BlockingIOError):  # swept as abandoned before it was locked
                    stack.enter_context(_claimed(scratch, is_ours=True))
                    claimed = True
        yield scratch


def _sweep(folder: Path) -> None:
    """Remove the hidden folders of processes that no longer exist."""
    for scratch in folder.glob(f"{PARTIAL}*"):
        if fcntl is not None:
            with suppress(OSError, RecursionError), _claimed(scratch):
                shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _claimed(scratch: Path, *, is_ours: bool = False) -> Iterator[None]:
    """Lock a hidden folder in the block; without locks, one that `is_ours` counts as locked.

    Raises:
        BlockingIOError: another process has locked it.
        FileNotFoundError: it is gone.
        OSError: no folder but a link, or that of another user; a file system without locks, unless it is our own.
    """
    if fcntl is None:
        yield
        return
    number = os.open(scratch, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        if not is_ours and not is_of_this_user(os.fstat(number)):
            raise PermissionError(errno.EPERM, "belongs to another user", str(scratch))
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if not is_ours or isinstance(error, BlockingIOError):
                raise
        if not os.path.samestat(os.fstat(number), scratch.lstat()):
            raise FileNotFoundError(errno.ENOENT, "is another folder by now", str(scratch))
        yield
    finally:
        os.close(number)


def _locked(file: Path) -> BinaryIO:
    """Open and lock a file for reading and writing.

    Raises:
        BlockingIOError: another process has locked it.
        OSError: a link, or no regular file.
    """
    while True:
        stream = open_regular(file, write=True)
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.close()
            raise
        except OSError:  # a file system without locks
            return stream
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(stream.fileno()), file.lstat()):
                return stream
        stream.close()  # its owner has deleted it between the two calls
