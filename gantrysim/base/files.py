"""Results on disk: a file, or the files of a folder, are replaced as a whole or stay as they were.

New files are written to a hidden folder beside the old ones. A single file then takes its place in one step. The files
of a folder cannot: the hidden folder gets a name that marks it as complete, the old files are moved into it, then the
new ones out of it. So old and new files never lie side by side. The next command that writes to the folder ends what
was cut short: until all old files are away it moves them back, from then on the new ones in. A command that only reads
changes nothing: it waits, or reports what is left.

A folder may come from elsewhere, and its hidden folders with it: a link leads nothing that is written out of the
folder, and of what lies in a hidden one only files that the command itself writes are moved.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path, PurePath
from typing import BinaryIO

from gantrysim.base.errors import InputError, expanded_path
from gantrysim.base.signals import deferred

try:
    import fcntl
except ImportError:  # Windows: nothing is locked, and what a killed command left stays
    fcntl = None  # type: ignore[assignment]

PARTIAL = ".gantrysim-partial-"  # prefix of a hidden folder of new files that are being written
SWAP = ".gantrysim-complete"  # hidden folder of new files that are complete
# in it: new files while old ones are moved away, the same once all are, and the old ones
NEW = "new"
READY = "ready"
OLD = "old"
ANY_FILE = ("*",)  # names of all files
_HIDDEN_PREFIX = ".gantrysim-"  # prefix of all hidden names
_OF_HIDDEN = re.compile(rf"(?:{re.escape(PARTIAL)}[^\\/]*|{re.escape(SWAP)})(?:[\\/](?:{NEW}|{READY}|{OLD}))?[\\/]?")
_NESTED_FOLDERS = 8  # subfolders in one another; outputs have one
_PATIENCE = 2.0  # of a reader, with a folder whose files are being replaced [s]
_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO}


class ReplacedError(KeyboardInterrupt):
    """An interrupt that arrived while new files took their place: they have."""


@contextmanager
def replaced_file(file: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a file in a hidden folder that replaces a file on success, in one step, and is removed otherwise.

    Raises:
        InputError: a folder, no regular file, a link to a file in another folder, or a file that cannot be written.
    """
    target = _writable(file)
    note = f"; the earlier {target.name} is kept" if target.exists() else ""
    with _staging_folder(target.parent, f"file {_visible(str(file))}", note, f"{file} is complete") as (scratch, done):
        yield scratch / target.name
        # else the folder around it does
        if PARTIAL not in str(target.parent):
            _to_disk([scratch / target.name])
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
    with _staging_folder(folder, label, note, f"the files in {folder}/ are complete") as (scratch, done):
        (scratch / NEW).mkdir()
        yield scratch / NEW
        check_free(folder, names, label)
        _to_disk(file for file in scratch.rglob("*") if not file.is_dir())
        swap = folder / SWAP
        with deferred():
            scratch.rename(swap)
            try:
                for name in names:
                    if os.path.lexists(folder / name):
                        _move(name, folder, swap / OLD)
            except OSError:
                _end_swap(folder)
                raise
            for parent in {(folder / name).parent for name in names} - {folder}:
                # other files are in it, or it never was
                with suppress(OSError):
                    parent.rmdir()
            (swap / NEW).rename(swap / READY)
            _end_swap(folder)
            done.append(True)


@contextmanager
def held_folder(folder: Path, label: str, names: Collection[str] = ANY_FILE) -> Iterator[None]:
    """Hold a folder against other commands that write to it, in the block; however a process ends, its hold ends.

    The folder is made where it is missing, and removed if the block leaves it empty. What a killed command has left in
    it is ended or removed.

    Args:
        folder: to be held.
        label: of the folder in errors.
        names: of the files that the command writes, with * for any characters; others are not touched.

    Raises:
        InputError: in use by another command, or not to be written to; or hidden files that no command can have left.
    """
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    with ExitStack() as stack:
        stack.callback(_remove_empty, missing)
        try:
            with deferred():
                folder.mkdir(parents=True, exist_ok=True)
                stack.enter_context(_locked_folder(folder.resolve()))
                if pending(folder):
                    _check_swap(folder, names)
                    _end_swap(folder)
                # fails where nothing can be written
                with _scratch(folder):
                    pass
        except BlockingIOError:
            raise InputError(f"{label}: in use by another command") from None
        except OSError as error:
            raise InputError(f"{label}: cannot be written: {error.strerror}") from None
        yield


def complete(folder: Path, label: str, names: Collection[str] = ANY_FILE) -> None:
    """End what a killed command has left in a folder that is about to be written to; arguments as of `held`.

    Raises:
        InputError: as `held`.
    """
    if pending(folder):
        with held_folder(folder, label, names):
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


def pending(folder: Path) -> bool:
    """Return whether new files of a folder, complete, have not yet taken their places."""
    return os.path.lexists(folder / SWAP)


def check_free(folder: Path, names: Iterable[str], label: str) -> None:
    """Raise InputError where a folder stands in the place of a file to be written, or a file or link in a folder's."""
    for name in names:
        if (folder / name).is_dir():
            raise InputError(f"{label}: {name} in it is a folder, must be a file: move it away")
        parent = (folder / name).parent
        if parent != folder and parent.exists() and not parent.is_dir():
            raise InputError(f"{label}: {parent.name} in it is a file, must be a folder: move it away")
        if not _has_real_parents(folder, name):
            raise InputError(f"{label}: {parent.name} in it is a link, must be a folder: move it away")


def open_regular(file: Path) -> BinaryIO:
    """Open a file in a folder, which need not be gantrysim's, for reading and writing; its content stays.

    Raises:
        OSError: it cannot be opened or made, is a link or no regular file.
    """
    flags = os.O_RDWR | os.O_CREAT
    # not all of them everywhere
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"):
        flags |= getattr(os, name, 0)
    if file.is_symlink():
        raise OSError(errno.ELOOP, f"{file.name} in it is a link: remove it", str(file))
    number = os.open(file, flags, 0o666)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(errno.EINVAL, f"{file.name} in it is not a regular file: remove it", str(file))
    return os.fdopen(number, "r+b")


def _writable(file: str | os.PathLike[str]) -> Path:
    target = expanded_path(file).absolute()
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
def _staging_folder(folder: Path, label: str, note: str, complete: str) -> Iterator[tuple[Path, list[bool]]]:
    """Give a hidden folder, removed at the end, and report which files remain after an error or an interrupt.

    Args:
        folder: in which the hidden one is made.
        label: of the files, in errors.
        note: which earlier files are kept.
        complete: message of an interrupt once the new files are in place.

    Yields:
        The hidden folder, and a list to be filled once the new files are in place.
    """
    done: list[bool] = []
    try:
        with _scratch(folder) as scratch:
            try:
                yield scratch, done
            except OSError as error:
                # of a full disk Python names the file that cannot be opened, but not the one that is cut off
                files = [file for file in scratch.rglob("*") if file.is_file()]
                if error.filename is None and error.errno in _DISK and files:
                    error.filename = str(max(files, key=lambda file: file.stat().st_mtime_ns))
                raise
    except KeyboardInterrupt:
        raise (ReplacedError(complete) if done else KeyboardInterrupt(f"nothing is written{note}")) from None
    except OSError as error:
        file = str(error.filename or "")
        if error.errno not in _DISK and not any(part in file for part in (PARTIAL, SWAP)):
            raise
        place = _visible(file)
        failed = f"file {place}" if place and not place.endswith(os.sep) else label
        raise InputError(f"{failed}: cannot be written: {error.strerror or error}{note}") from None


@contextmanager
def _scratch(folder: Path) -> Iterator[Path]:
    """Give a new hidden folder in a folder, locked as long as this process needs it, and remove it at the end."""
    _sweep(folder)
    with ExitStack() as stack:
        is_locked = False
        while not is_locked:
            with deferred():
                scratch = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=folder))
                stack.callback(deferred()(shutil.rmtree), scratch, ignore_errors=True)
                # swept as abandoned before it was locked
                with suppress(FileNotFoundError, BlockingIOError):
                    stack.enter_context(_locked_folder(scratch))
                    is_locked = True
        yield scratch


def _sweep(folder: Path) -> None:
    """Remove the hidden folders of processes that no longer exist; links and those of other users stay."""
    for scratch in folder.glob(f"{PARTIAL}*"):
        with suppress(OSError, RecursionError):
            if _is_own_folder(scratch):
                with _locked_folder(scratch) as is_locked:
                    if is_locked:
                        shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _locked_folder(folder: Path) -> Iterator[bool]:
    """Lock a folder in the block; yields whether that is possible here.

    Raises:
        BlockingIOError: another process has locked it, or put another folder in its place.
        OSError: it is gone, a link or no folder.
    """
    if fcntl is None:
        yield False
        return
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        is_locked = True
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:  # a file system without locks
            is_locked = False
        if not os.path.samestat(os.fstat(number), folder.lstat()):
            raise BlockingIOError(errno.EAGAIN, "is another folder by now", str(folder))
        yield is_locked
    finally:
        os.close(number)


def _remove_empty(folders: Iterable[Path]) -> None:
    with deferred():
        for folder in folders:
            with suppress(OSError):  # not empty
                folder.rmdir()


def _end_swap(folder: Path) -> None:
    """Move the new files of a held folder in, or where the old ones are not yet all away, these back.

    Raises:
        InputError: a new file cannot be moved; all are kept.
    """
    swap = folder / SWAP
    is_ready = (swap / READY).exists()
    origin = swap / (READY if is_ready else OLD)
    try:
        for name in _names_below(origin):
            _move(name, origin, folder)
    except OSError as error:
        note = f"new files are in {swap}, the earlier ones in {swap / OLD}"
        raise InputError(f"{folder}: cannot be written: {error.strerror}; {note}") from None
    # first, or a kill on the way would leave old files to be moved back
    if is_ready:
        shutil.rmtree(swap / OLD, ignore_errors=True)
    shutil.rmtree(swap)


def _check_swap(folder: Path, names: Collection[str]) -> None:
    """Check what lies in the hidden folder of complete files, before a file is moved.

    Raises:
        InputError: it is a link or another user's, or holds anything but files that the command writes.
    """
    swap = folder / SWAP
    if not _is_own_folder(swap):
        raise _refused_folder(folder, "is no folder of this user's")
    try:
        for path in swap.rglob("*"):
            part, *below = path.relative_to(swap).parts
            name = "/".join(below)
            mode = path.lstat().st_mode
            if part not in (NEW, READY, OLD) or not (stat.S_ISDIR(mode) or (below and stat.S_ISREG(mode))):
                raise _refused_folder(folder, f"holds {'/'.join((part, *below))!r:.60}, which no command has left")
            if len(below) > _NESTED_FOLDERS:
                raise _refused_folder(folder, "holds folders nested too deeply")
            if stat.S_ISDIR(mode):
                continue
            if name.startswith(_HIDDEN_PREFIX) or not any(fnmatchcase(name, pattern) for pattern in names):
                raise _refused_folder(folder, f"names {name!r:.60}, which this command does not write")
            if not _has_real_parents(folder, name) or _is_folder(folder / name):
                raise _refused_folder(folder, f"names {name!r:.60}, which is no file in {folder}/")
    except (OSError, RecursionError):
        raise _refused_folder(folder, "cannot be read") from None


def _refused_folder(folder: Path, reason: str) -> InputError:
    return InputError(f"{folder}: {SWAP} in it {reason}: nothing is changed; remove it, or name another folder")


def _has_real_parents(folder: Path, name: str) -> bool:
    """Return whether each folder between a folder and a file below it is missing or a folder, and no link to one."""
    return all(
        _is_folder(folder / parent) or not os.path.lexists(folder / parent)
        for parent in PurePath(name).parents
        if parent != PurePath()
    )


def _is_folder(file: Path) -> bool:
    """Return whether a path is a folder, and no link to one."""
    return file.is_dir() and not file.is_symlink()


def _is_own_folder(file: Path) -> bool:
    """Return whether a path is a folder of this process's user, and no link to one."""
    status = file.lstat()
    return stat.S_ISDIR(status.st_mode) and (not hasattr(os, "geteuid") or status.st_uid == os.geteuid())


def _names_below(folder: Path) -> list[str]:
    """Return the relative names of all files below a folder."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not _is_folder(path))


def _move(name: str, origin: Path, target: Path) -> None:
    """Move a file from one folder to the place of the same name in another, unless a link leads elsewhere by now."""
    for folder in (origin, target):
        if not _has_real_parents(folder, name):
            raise OSError(errno.ELOOP, f"a folder of {name} is a link", str(folder / name))
    (target / name).parent.mkdir(parents=True, exist_ok=True)
    (origin / name).replace(target / name)


def _visible(file: str) -> str:
    """Return the path of a new file without its hidden folders, as a user sees it."""
    return _OF_HIDDEN.sub("", file)


def _to_disk(files: Iterable[Path]) -> None:
    """Have the content of files written before anything refers to it, so that it also survives a loss of power."""
    for file in files:
        with file.open("rb") as stream:
            os.fsync(stream.fileno())
