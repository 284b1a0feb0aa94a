"""The hidden folder in which the new files of a folder lie complete until they have taken the places of the old ones.

A killed command leaves it behind, and the next one that writes to the folder completes it. It may also have come with
a folder from elsewhere, so its content is checked before a file is moved: it names files of that folder alone.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterable, Iterator
from fnmatch import fnmatchcase
from pathlib import Path, PurePath
from typing import BinaryIO

from gantrysim.base.errors import InputError

PARTIAL = ".gantrysim-partial-"  # prefix of a hidden folder of new files that are being written
SWAP = ".gantrysim-complete"  # hidden folder of new files that are complete
# in it: new files, old ones, and the names of old ones to be moved away
NEW = "new"
OLD = "old"
NAMES = "names.json"
ANY = ("*",)  # names of all files
_HIDDEN = ".gantrysim-"  # prefix of all hidden names
_OF_HIDDEN = re.compile(rf"(?:{re.escape(PARTIAL)}[^\\/]*|{re.escape(SWAP)})(?:[\\/](?:{NEW}|{OLD}))?[\\/]?")
_LONGEST = 1 << 20  # list of names [bytes]
_DEEPEST = 8  # subfolders in one another; outputs have one


def pending(folder: Path) -> bool:
    """Return whether new files of a folder, complete, have not yet taken their places."""
    return os.path.lexists(folder / SWAP)


def complete_swap(folder: Path, names: Collection[str] = ANY, *, is_ours: bool = False) -> None:
    """Move the old files of a held folder away and the complete new ones in; continue where a killed process stopped.

    While the list of names is there, old files are still to be moved, and an error moves them back.

    Args:
        folder: that this process holds.
        names: of the files that the command writes, with * for any characters; others are not touched.
        is_ours: whether this process has made the hidden folder; some file systems show another owner even then.

    Raises:
        OSError: an old file cannot be moved; all are kept, and the new files are removed.
        InputError: a new file cannot be moved; all are kept. Or a hidden folder that is a link, is another user's, or
            names anything but files below this folder that the command writes; nothing is touched.
    """
    if not pending(folder):
        return
    swap = folder / SWAP
    list_file = swap / NAMES
    new = swap / NEW
    old = swap / OLD
    listed = _checked(folder, names, is_ours)
    if listed is not None:
        try:
            for name in listed:
                if os.path.lexists(folder / name):
                    _transfer(name, folder, old)
        except OSError:
            for name in _names_below(old):
                _transfer(name, old, folder)
            _discard(swap)
            raise
        list_file.unlink()
        for parent in {(folder / name).parent for name in listed} - {folder}:
            try:
                parent.rmdir()
            except OSError:  # other files are in it, or it never was
                continue
    try:
        for name in _names_below(new):
            _transfer(name, new, folder)
    except OSError as error:
        text = f"{folder}: cannot be written: {error.strerror}; the new files are in {new}, the earlier ones in {old}"
        raise InputError(text) from None
    shutil.rmtree(swap)


def check_free(folder: Path, names: Iterable[str], label: str) -> None:
    """Raise InputError where a folder stands in the place of a file to be written, or a file or link in a folder's."""
    for name in names:
        if (folder / name).is_dir():
            raise InputError(f"{label}: {name} in it is a folder, must be a file: move it away")
        parent = (folder / name).parent
        if parent != folder and parent.exists() and not parent.is_dir():
            raise InputError(f"{label}: {parent.name} in it is a file, must be a folder: move it away")
        if not has_real_parents(folder, name):
            raise InputError(f"{label}: {parent.name} in it is a link, must be a folder: move it away")


def visible(file: str) -> str:
    """Return the path of a new file without its hidden folders, as a user sees it."""
    return _OF_HIDDEN.sub("", file)


def has_real_parents(folder: Path, name: str) -> bool:
    """Return whether each folder between a folder and a file below it is missing or a folder, and no link to one."""
    for parent in PurePath(name).parents:
        try:
            mode = (folder / parent).lstat().st_mode
        except FileNotFoundError:
            continue
        except OSError:  # a name that is too long, or a file in place of a folder
            return False
        if parent != PurePath() and not stat.S_ISDIR(mode):
            return False
    return True


def open_regular(file: Path, *, write: bool = False) -> BinaryIO:
    """Open a hidden file of gantrysim's in a folder, which need not be gantrysim's: a link, or a pipe, is refused.

    Args:
        file: to be read.
        write: whether it is to be written too, and made where it is missing; its content stays.

    Raises:
        OSError: it cannot be opened, is a link or no regular file.
    """
    flags = os.O_RDWR | os.O_CREAT if write else os.O_RDONLY
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"):  # not all of them everywhere
        flags |= getattr(os, name, 0)
    if file.is_symlink():
        raise OSError(errno.ELOOP, f"{file.name} in it is a link: remove it", str(file))
    number = os.open(file, flags, 0o666)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(errno.EINVAL, f"{file.name} in it is not a regular file: remove it", str(file))
    return os.fdopen(number, "r+b" if write else "rb")


def is_of_this_user(status: os.stat_result) -> bool:
    """Return whether a file belongs to the user of this process; true where files have no numbers of users."""
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()


def _checked(folder: Path, names: Collection[str], is_ours: bool) -> list[str] | None:
    """Return the names in the hidden folder's list, None without one, after all that it holds has been checked.

    Raises:
        InputError: see `complete_swap`.
    """
    swap = folder / SWAP
    status = swap.lstat()
    if stat.S_ISLNK(status.st_mode):
        raise _refused(folder, "is a link")
    if not stat.S_ISDIR(status.st_mode):
        raise _refused(folder, "is no folder")
    if not (is_ours or is_of_this_user(status)):
        raise _refused(folder, "belongs to another user")
    parts = [part.name for part in swap.iterdir()]
    for part in parts:
        if part not in (NEW, OLD, NAMES) or (part != NAMES and not stat.S_ISDIR((swap / part).lstat().st_mode)):
            raise _refused(folder, f"holds {part!r:.60}, which no command has left")
    listed = _list_of_names(folder) if NAMES in parts else None
    for name in (*(listed or ()), *_names_below(swap / NEW), *_names_below(swap / OLD)):
        if not _is_plain(name) or not has_real_parents(folder, name) or _is_folder(folder / name):
            raise _refused(folder, f"names {name!r:.60}, which is no file in {folder}/")
        if not is_ours and not any(fnmatchcase(name, pattern) for pattern in names):
            raise _refused(folder, f"names {name!r:.60}, which this command does not write")
    if not all(stat.S_ISREG((swap / NEW / name).lstat().st_mode) for name in _names_below(swap / NEW)):
        raise _refused(folder, "holds what is not a regular file")
    return listed


def _refused(folder: Path, reason: str) -> InputError:
    return InputError(f"{folder}: {SWAP} in it {reason}: nothing is changed; remove it, or name another folder")


def _list_of_names(folder: Path) -> list[str]:
    """Return the list of names as it stands in its file, once it is one."""
    try:
        with open_regular(folder / SWAP / NAMES) as stream:
            content = stream.read(_LONGEST + 1)
        listed = json.loads(content) if len(content) <= _LONGEST else None
    except (OSError, ValueError, RecursionError):
        listed = None
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        raise _refused(folder, f"has no list of names in {NAMES}")
    return listed


def _is_plain(name: str) -> bool:
    """Return whether a text is the relative name of a file below a folder, written in the one way, and none hidden."""
    path = PurePath(name)
    try:
        os.fsencode(name)
    except UnicodeError:  # half a surrogate pair, say
        return False
    if not path.parts or path.anchor or path.as_posix() != name or "\0" in name:
        return False
    if os.name == "nt" and ":" in name:  # another stream of a file
        return False
    return ".." not in path.parts and not path.parts[0].startswith(_HIDDEN) and len(path.parts) <= _DEEPEST


def _is_folder(file: Path) -> bool:
    try:
        return stat.S_ISDIR(file.lstat().st_mode)
    except OSError:
        return False


def _names_below(folder: Path) -> list[str]:
    """Return the relative names of all files below a folder, and of links, which are not followed."""
    return sorted(path.relative_to(folder).as_posix() for path in _below(folder, 1)) if folder.is_dir() else []


def _below(folder: Path, depth: int) -> Iterator[Path]:
    for path in folder.iterdir():
        if not _is_folder(path):
            yield path
        elif depth < _DEEPEST:
            yield from _below(path, depth + 1)
        else:
            raise InputError(f"{folder}: holds folders nested too deeply: remove it")


def _transfer(name: str, origin: Path, target: Path) -> None:
    """Move a file from one folder to the place of the same name in another, unless a link leads elsewhere by now."""
    for folder in (origin, target):
        if not has_real_parents(folder, name):
            raise OSError(errno.ELOOP, f"a folder of {name} is a link", str(folder / name))
    move(origin / name, target / name)


def move(file: Path, target: Path) -> None:
    """Move a file, and make the folders of its new place."""
    target.parent.mkdir(parents=True, exist_ok=True)
    file.rename(target)


def _discard(swap: Path) -> None:
    """Remove the hidden folder; a kill on the way must not leave half of it to be completed."""
    scratch = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=swap.parent))
    swap.rename(scratch / SWAP)
    shutil.rmtree(scratch, ignore_errors=True)


def to_disk(files: Iterable[Path]) -> None:
    """Have the content of files written before anything refers to it, so that it also survives a loss of power."""
    for file in files:
        with file.open("rb") as stream:
            os.fsync(stream.fileno())
