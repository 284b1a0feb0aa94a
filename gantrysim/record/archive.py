"""NumPy archives (.npz) with a checksum, read without trust: sizes are checked before anything is allocated."""

from __future__ import annotations

import hashlib
import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.lib.format import read_array, read_array_header_1_0, read_magic, write_array
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.columns import FileTable, Stored, array_of, blocks
from gantrysim.base.errors import InputError, text_of

CHECKSUM = "sha256"
_SUFFIX = ".npy"
_VERSION = (1, 0)  # of a header
_LONGEST = 200  # characters of an error that is quoted
_MEMBERS = 64  # more than any archive has
# Deflate packs up to 1032 bytes into one. Records of a machine at rest reach 93, as all but their time is constant.
_EXPANSION = 250
_SMALL = 1 << 24  # expansion that is always allowed [bytes]


@dataclass(frozen=True)
class Member:
    """An array of an archive, as its header announces it.

    Attributes:
        dtype: of its elements.
        shape: of the array.
        fortran: whether its first index changes fastest.
        begin: place of its first element in the file [bytes].
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran: bool
    begin: int


class Archive:
    """An archive that is open for reading.

    Args:
        stream: of the file, which can be sought.

    Attributes:
        members: its arrays by name.

    Raises:
        InputError: a member that is no array, whose size differs from its header, or that occurs twice; members that
            expand to hundreds of times the size of the file.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._zip = zipfile.ZipFile(stream)
        self._digest = hashlib.sha256()
        size = stream.seek(0, 2)
        entries = {entry.filename.removesuffix(_SUFFIX): entry for entry in self._zip.infolist()}
        if len(self._zip.infolist()) > min(len(entries), _MEMBERS):
            raise InputError("members stand there twice")
        expanded = sum(entry.file_size for entry in entries.values())
        if expanded > max(_SMALL, _EXPANSION * size):
            raise InputError(f"{size} bytes that expand to {expanded:.3g}")
        self._entries = entries
        self.members = {name: self._member(name) for name in entries}

    def _member(self, name: str) -> Member:
        entry = self._entries[name]
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise InputError(f"{name} is packed in another way")
        with self._zip.open(entry) as file:  # the header alone
            if read_magic(file) != _VERSION:
                raise InputError(f"{name} is not an array of numbers or text")
            shape, fortran, dtype = read_array_header_1_0(file)
            begin = file.tell()
        if dtype.kind not in "fbiU" or dtype.str[0] == ">" or min(shape, default=0) < 0:
            raise InputError(f"{name} is not an array of numbers or text")
        if begin + math.prod(shape) * dtype.itemsize != entry.file_size:
            raise InputError(f"{name} has {entry.file_size} bytes, not those of {dtype.str} and shape {shape}")
        return Member(dtype, shape, fortran, begin)

    def read(self, name: str) -> NDArray[Any] | Stored:
        """Return an array, in a temporary file if it belongs to a long run; add its name and bytes to the checksum.

        Raises:
            KeyError: there is no such member.
        """
        member = self.members[name]
        self._digest.update(_named(name))
        with self._zip.open(self._entries[name]) as file:
            stream = _Tee(file, self._digest)
            if member.shape and member.shape[0] > memory.LONG and not member.fortran:
                values: NDArray[Any] | Stored = _long(name, member, stream)
            else:
                values = read_array(stream, allow_pickle=False)
            if file.read(1):  # at the end zipfile compares its own checksum
                raise InputError(f"{name} is longer than announced")
        return values

    def check(self) -> None:
        """Compare the checksum of the arrays read so far, in this order, with the one in the archive.

        Raises:
            InputError: they differ.
        """
        computed = self._digest.hexdigest()  # before the checksum itself is read
        if str(self.read(CHECKSUM)) != computed:
            raise InputError(f"its {CHECKSUM} does not match its content")


@contextmanager
def open_archive(stream: BinaryIO) -> Iterator[Archive]:
    """Open an archive; errors that its damage raises in the block become one InputError."""
    try:
        with warnings.catch_warnings(action="ignore"):  # NumPy's, of headers that are damaged
            yield Archive(stream)
    except InputError:
        raise
    except Exception as error:  # whatever zipfile, zlib and NumPy raise for damaged files
        raise InputError(text_of(error)[:_LONGEST]) from None


def write_archive(stream: BinaryIO, arrays: Mapping[str, Any]) -> None:
    """Write arrays, numbers and texts to an archive, packed, and last the SHA-256 of their names and bytes."""
    # over names and contents: zip's own CRC of each member notices neither a missing nor a renamed one
    digest = hashlib.sha256()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, value in arrays.items():
            digest.update(_named(name))
            _write(archive, name, value, digest)
        _write(archive, CHECKSUM, digest.hexdigest(), digest)


def _write(archive: zipfile.ZipFile, name: str, value: Any, digest: Any) -> None:
    with archive.open(name + _SUFFIX, "w", force_zip64=True) as member:
        write_array(_Tee(member, digest), np.asanyarray(array_of(value)), _VERSION, allow_pickle=False)


@dataclass(frozen=True)
class _Tee:
    """A stream whose bytes go to a digest too."""

    stream: Any
    digest: Any

    def read(self, size: int = -1, /) -> bytes:
        content: bytes = self.stream.read(size)
        self.digest.update(content)
        return content

    def write(self, content: bytes) -> int:
        self.digest.update(content)
        return int(self.stream.write(content))


def _long(name: str, member: Member, stream: _Tee) -> Stored:
    rows, *row = member.shape
    table = FileTable(rows, {name: (member.dtype, tuple(row))})
    stream.read(member.begin)
    for block in blocks(rows):
        count = block.stop - block.start
        content = stream.read(count * math.prod(row) * member.dtype.itemsize)
        table.write(block.start, {name: np.frombuffer(content, member.dtype).reshape(count, *row)})
    return table.stored(rows)[name]


def _named(name: str) -> bytes:
    return name.encode() + b"\0"
