"""NumPy archives (.npz) with a checksum, read without trust: sizes are checked before anything is allocated."""

from __future__ import annotations

import hashlib
import math
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.columns import FileTable, Stored, array_of, blocks
from gantrysim.base.errors import InputError

CHECKSUM = "sha256"
_SUFFIX = ".npy"
_MAGIC = b"\x93NUMPY\x01\x00"
# a header as NumPy writes it, read without evaluating it as Python
_HEADER = re.compile(
    r"\{'descr': '([<|][fbiU]\d{1,9})', 'fortran_order': (True|False), "
    r"'shape': \(((?:\d{1,20}, ?)*(?:\d{1,20})?)\), \}\s*"
)
_MEMBERS = 64  # more than any archive has
# Deflate packs up to 1032 bytes into one. Records of a machine at rest reach 93, as all but their time is constant.
_EXPANSION = 250
_SMALL = 1 << 24  # expansion that is always allowed [bytes]
_CHUNK = 1 << 20
# exceptions that zipfile, zlib and numpy raise for damaged files
DAMAGE = (
    OSError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
    ArithmeticError,
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    RuntimeError,  # with NotImplementedError and RecursionError
    MemoryError,
)


@dataclass(frozen=True)
class Member:
    """An array of an archive, as its header announces it.

    Attributes:
        dtype: of its elements.
        shape: of the array.
        fortran: whether its first index changes fastest.
        info: of the archive.
        header: its bytes.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran: bool
    info: zipfile.ZipInfo
    header: bytes


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
        entries = self._zip.infolist()
        size = stream.seek(0, 2)
        names = [entry.filename for entry in entries]
        if len(names) > _MEMBERS or len(set(names)) < len(names):
            raise InputError("members stand there twice")
        expanded = sum(entry.file_size for entry in entries)
        if expanded > max(_SMALL, _EXPANSION * size):
            raise InputError(f"{size} bytes that expand to {expanded:.3g}")
        self.members = {_stem(entry.filename): self._member(entry) for entry in entries}

    def _member(self, info: zipfile.ZipInfo) -> Member:
        name = _stem(info.filename)
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or info.flag_bits & 1:
            raise InputError(f"{name} is encrypted or packed in another way")
        # the header alone: sizes are checked before the array is allocated
        with self._zip.open(info) as member:
            start = member.read(len(_MAGIC) + 2)
            header = member.read(int.from_bytes(start[-2:], "little"))
        announced = _HEADER.fullmatch(header.decode("latin-1"))
        if announced is None or not start.startswith(_MAGIC) or len(start) != len(_MAGIC) + 2:
            raise InputError(f"{name} is not an array of numbers or text")
        type_name = announced[1]
        dtype = np.dtype(type_name)
        shape = tuple(int(size) for size in announced[3].split(",") if size.strip())
        if len(start + header) + math.prod(shape) * dtype.itemsize != info.file_size:
            raise InputError(f"{name} has {info.file_size} bytes, not those of {type_name} and shape ({announced[3]})")
        return Member(dtype, shape, announced[2] == "True", info, start + header)

    def read(self, name: str) -> NDArray[Any] | Stored:
        """Return an array, in a temporary file if it belongs to a long run; add its name and bytes to the checksum.

        Raises:
            KeyError: there is no such member.
        """
        member = self.members[name]
        self._digest.update(_named(name) + member.header)
        with self._zip.open(member.info) as stream:
            stream.read(len(member.header))
            if len(member.shape) and member.shape[0] > memory.LONG and not member.fortran:
                values: NDArray[Any] | Stored = self._long(name, member, stream)
            else:
                flat = np.empty(math.prod(member.shape), member.dtype)
                self._fill(name, flat, stream)
                values = flat.reshape(member.shape, order="F" if member.fortran else "C")
            if stream.read(1):  # at the end zipfile compares its own checksum
                raise InputError(f"{name} is longer than announced")
        return values

    def _long(self, name: str, member: Member, stream: IO[bytes]) -> Stored:
        rows = member.shape[0]
        row_shape = member.shape[1:]
        table = FileTable(rows, {name: (member.dtype, row_shape)})
        for block in blocks(rows):
            values = np.empty((block.stop - block.start) * math.prod(row_shape), member.dtype)
            self._fill(name, values, stream)
            table.write(block.start, {name: values})
        return table.stored(rows)[name]

    def _fill(self, name: str, values: NDArray[Any], stream: IO[bytes]) -> None:
        """Fill in an array of one dimension from a stream, and add its bytes to the checksum."""
        unfilled = values.view(np.uint8).data if values.nbytes else memoryview(b"")
        while len(unfilled):
            chunk = stream.read(min(_CHUNK, len(unfilled)))
            if not chunk:
                raise InputError(f"{name} ends early")
            unfilled[: len(chunk)] = chunk
            self._digest.update(chunk)
            unfilled = unfilled[len(chunk) :]

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
        yield Archive(stream)
    except DAMAGE as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{type(error).__name__}: {error}") from None


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
        np.lib.format.write_array(_Tee(member, digest), np.asanyarray(array_of(value)), (1, 0), allow_pickle=False)


@dataclass(frozen=True)
class _Tee:
    """A stream whose bytes go to a digest too."""

    stream: Any
    digest: Any

    def write(self, content: bytes) -> int:
        self.digest.update(content)
        return int(self.stream.write(content))


def _named(name: str) -> bytes:
    return name.encode() + b"\0"


def _stem(name: str) -> str:
    return name.removesuffix(_SUFFIX)
