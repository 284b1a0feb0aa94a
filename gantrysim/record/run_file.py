"""The file of a record: writing, and validation on load."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.lib.format import read_array, read_array_header_1_0, read_magic, write_array
from numpy.typing import NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import read_only
from gantrysim.base.columns import FileTable, Stored, array_of, blocks
from gantrysim.base.errors import InputError, text_of
from gantrysim.base.quantity import number_text
from gantrysim.faults import fault_of
from gantrysim.paths.kinds import kind_of, path_of
from gantrysim.record.setpoints import progress_fault

# NumPy archives (.npz) with a checksum, read without trust: sizes are checked before anything is allocated.

CHECKSUM = "sha256"
_SUFFIX = ".npy"
_VERSION = (1, 0)  # of a header
_ERROR_LENGTH = 200  # characters of an error that is quoted
_MEMBERS = 64  # more than any archive has
# Deflate packs up to 1032 bytes into one. Records of a machine at rest reach 93, as all but their time is constant.
_EXPANSION = 250
_ALWAYS_ALLOWED = 1 << 24  # expansion that is always allowed [bytes]


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
        if expanded > max(_ALWAYS_ALLOWED, _EXPANSION * size):
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
        self._digest.update(_archive_name(name))
        with self._zip.open(self._entries[name]) as file:
            stream = _Tee(file, self._digest)
            if member.shape and member.shape[0] > memory.LONG_RUN and not member.fortran:
                values: NDArray[Any] | Stored = _long(name, member, stream)
            else:
                values = read_array(stream, allow_pickle=False)
            # at the end zipfile compares its own checksum
            if file.read(1):
                raise InputError(f"{name} is longer than announced")
        return values

    def check(self) -> None:
        """Compare the checksum of the arrays read so far, in this order, with the one in the archive.

        Raises:
            InputError: they differ.
        """
        # before the checksum itself is read
        computed = self._digest.hexdigest()
        if str(self.read(CHECKSUM)) != computed:
            raise InputError(f"its {CHECKSUM} does not match its content")


@contextmanager
def open_archive(stream: BinaryIO) -> Iterator[Archive]:
    """Open an archive; errors that its damage raises in the block become one InputError."""
    try:
        # NumPy's, of headers that are damaged
        with warnings.catch_warnings(action="ignore"):
            yield Archive(stream)
    except InputError:
        raise
    except Exception as error:  # whatever zipfile, zlib and NumPy raise for damaged files
        raise InputError(text_of(error)[:_ERROR_LENGTH]) from None


def write_archive(stream: BinaryIO, arrays: Mapping[str, Any]) -> None:
    """Write arrays, numbers and texts to an archive, packed, and last the SHA-256 of their names and bytes."""
    # over names and contents: zip's own CRC of each member notices neither a missing nor a renamed one
    digest = hashlib.sha256()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, value in arrays.items():
            digest.update(_archive_name(name))
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
    return table.first_rows(rows)[name]


def _archive_name(name: str) -> bytes:
    return name.encode() + b"\0"


# Why a run ended before its setpoints did.


@dataclass(frozen=True)
class Fault:
    """Reason why a run ended before the end of its setpoints.

    Attributes:
        kind: "following error", "travel", "overspeed", "oscillation", "diverged", "position error" or "settling".
        axis: name of the axis that tripped.
        time: time of the servo tick that detected it [s].
        value: value of the quantity at that time.
        limit: bound of the quantity.
        unit: unit of value and limit: mm or deg, mm/s or deg/s, N·m, or the number of swings of the torque demand from
            limit to limit.
        reaction: reaction of the controller, if the kind has several.
    """

    kind: str
    axis: str
    time: float
    value: float
    limit: float
    unit: str
    reaction: str = ""

    def __str__(self) -> str:
        text = f"{self.kind} on axis {self.axis} at t = {self.time:.4f} s"
        if self.kind == "oscillation":
            text += f": the torque demand has swung {self.value:g} times from limit to limit"
        elif math.isfinite(self.limit):
            text += f": {number_text(self.value, '.4g')} {self.unit}, limit {self.limit:.4g} {self.unit}"
        return f"{text}; {self.reaction}" if self.reaction else text


RUN = "run.npz"  # the record in an output folder

_FORMAT = 8  # a number of its own for every change of the members; no other is read
_NUMBER_FIELDS = ("period", "gap", "face", "needle_length")
_TEXTS = ("machine", "requested", "fault", "injected", "job_sha256", "machine_sha256")
_LISTS = ("axes", "units")
# columns of each array; None for one per axis, 0 for a vector
_COLUMNS = {
    **dict.fromkeys(("time", "flow", "flow_demand", "dispense"), 0),
    **dict.fromkeys(("commanded_tip", "encoder_tip", "motor_tip", "nozzle"), 3),
    **dict.fromkeys(("commanded", "encoder", "motor", "demand", "torque", "current", "voltage"), None),
}
_OPTIONAL = {
    "geometric_tip": 3,
    "progress": 0,
    "extrusion": 0,
    "extruder": 0,
    "analogue": 0,
}  # columns that a record may lack
_NAN = ("current", "voltage")
# not finite where a fault ends the run, in the tick that diverged
_DIVERGED_COLUMNS = ("demand", "torque", "current", "voltage")


def write_record(stream: BinaryIO, content: Mapping[str, Any]) -> None:
    """Write the attributes of a record to a NumPy .npz file, with a SHA-256 of its content."""
    arrays = {name: value for name, value in content.items() if name not in _OPTIONAL or value is not None}
    path = content["requested"]
    fault = content["fault"]
    parameters = {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in path.parameters().items()
    }
    arrays["requested"] = json.dumps({"kind": kind_of(path), "parameters": parameters})
    arrays["fault"] = json.dumps(asdict(fault) if fault else None)
    arrays["injected"] = json.dumps([fault.table() for fault in content["injected"]])
    write_archive(stream, {"format": _FORMAT, **dict(sorted(arrays.items()))})


def read_record(stream: BinaryIO) -> dict[str, Any]:
    """Return the attributes of a record from its file, checked.

    Raises:
        InputError: it is no record of the present format, or a damaged one.
    """
    # of damaged numbers, which are refused
    with open_archive(stream) as archive, np.errstate(all="ignore"):
        return _content(archive)


def _content(archive: Archive) -> dict[str, Any]:
    """Return the attributes of a record, checked.

    Raises:
        InputError: a member, number, name or path that no record has.
    """
    # from the cheapest check on: a damaged file must not fill the memory before it is refused
    _check_format(archive)
    _check_members(archive.members)
    raw = {name: archive.read(name) for name in sorted(archive.members.keys() - {"format", CHECKSUM})}
    archive.check()
    content: dict[str, Any] = {name: float(array_of(raw.pop(name))) for name in _NUMBER_FIELDS}
    content |= {name: str(raw.pop(name)) for name in _TEXTS}
    content |= {name: tuple(str(item) for item in array_of(raw.pop(name))) for name in _LISTS}
    path = json.loads(content["requested"])
    fault = json.loads(content["fault"])
    _check_values(content, raw)
    content["requested"] = path_of(path["kind"], path["parameters"])
    length = content["requested"].length
    if not 0 < length < np.inf:
        raise InputError(f"requested has a length of {length:g} mm")
    content["fault"] = None if fault is None else _fault(fault, content["axes"])
    content["injected"] = tuple(fault_of(table) for table in json.loads(content["injected"]))
    if "progress" in raw:
        fault_of_progress = progress_fault(array_of(raw["progress"]), length)
        if fault_of_progress:
            raise InputError(fault_of_progress)
    for name, column in raw.items():
        content[name] = read_only(column) if isinstance(column, np.ndarray) else column
    return content


def _check_format(archive: Archive) -> None:
    """Check that the archive is a record of the present format.

    Raises:
        InputError: it has no format, or another one.
    """
    member = archive.members.get("format")
    if member is None or member.shape or member.dtype.kind != "i":
        raise InputError("it has no format")
    written = int(array_of(archive.read("format")))
    if written != _FORMAT:
        raise InputError(f"its format is {written}, only format {_FORMAT} is read: run its job.toml again")


def _check_members(members: Mapping[str, Member]) -> None:
    """Check which members there are, their types and their shapes, from their headers alone."""
    rows = members["time"].shape if "time" in members else ()
    axes = members["axes"].shape if "axes" in members else ()
    if len(rows) != 1 or len(axes) != 1 or not rows[0] or not axes[0]:
        raise InputError("its time or axes are missing")
    expected: dict[str, tuple[str, tuple[int, ...]]] = {"format": ("i", ()), CHECKSUM: ("U", ())}
    for names, kind, shape in ((_NUMBER_FIELDS, "f", ()), (_TEXTS, "U", ()), (_LISTS, "U", axes)):
        expected |= dict.fromkeys(names, (kind, shape))
    present = {name: width for name, width in _OPTIONAL.items() if name in members}
    for name, width in (_COLUMNS | present).items():
        columns: tuple[int, ...] = ()
        if width is None:
            columns = axes
        elif width:
            columns = (width,)
        expected[name] = ("b" if name == "dispense" else "f", rows + columns)
    for name in {**expected, **members}:
        if name not in expected or name not in members:
            problem = "missing" if name in expected else "no member of a record"
            raise InputError(f"{name} is {problem}")
        kind, size = expected[name]
        member = members[name]
        if member.dtype.kind != kind or member.shape != size or (kind == "f" and member.dtype.itemsize != 8):
            raise InputError(f"{name} has the shape {member.shape} and type {member.dtype}, must have {size}, {kind}")


def _check_values(content: Mapping[str, Any], columns: Mapping[str, NDArray[Any] | Stored]) -> None:
    """Check that names can be printed, numbers are finite and times follow the period."""
    for name in (*content["axes"], *content["units"], content["machine"]):
        if not name or not name.isprintable():
            raise InputError(f"{name!r} is no name")
    if len(set(content["axes"])) < len(content["axes"]) or not set(content["units"]) <= {"mm", "deg"}:
        raise InputError(f"axes {', '.join(content['axes'])} in {', '.join(content['units'])}")
    for name in _NUMBER_FIELDS:
        number = content[name]
        if not np.isfinite(number) or (name != "gap" and number <= 0):
            raise InputError(f"{name} = {number:g}")
    # by blocks: columns of a long run are in files
    time = array_of(columns["time"])
    period = content["period"]
    for rows in blocks(time.size):
        expected = period * np.arange(rows.start, rows.stop)
        if not np.allclose(time[rows], expected, rtol=1e-12, atol=1e-9 * period):
            raise InputError(f"time is not that of ticks every {period:g} s")
    # NumPy takes bytes other than 0 and 1 for true in some of its functions, but counts and compares them wrongly
    if array_of(columns["dispense"]).view(np.uint8).max() > 1:
        raise InputError("dispense has values other than true and false")
    for name, column in columns.items():
        values = array_of(column)
        count = len(values)
        if name in _DIVERGED_COLUMNS and content["fault"] != "null":
            count -= 1
        # of an axis whose motor is an ideal source of torque
        unknown = name in _NAN and np.isnan(values[0])
        not_finite = 0
        for rows in blocks(count):
            finite = np.isfinite(values[rows]) | (unknown & np.isnan(values[rows]))
            not_finite += finite.size - np.count_nonzero(finite)
        if not_finite:
            raise InputError(f"{name} has {not_finite} values that are not finite")


def _fault(content: Any, axes: Sequence[str]) -> Fault:
    fault = Fault(**content)
    texts = (fault.kind, fault.axis, fault.unit, fault.reaction)
    numbers = (fault.time, fault.value, fault.limit)
    if (
        fault.axis not in axes
        or not all(isinstance(text, str) and text.isprintable() for text in texts)
        or not all(type(number) in (int, float) for number in numbers)
        or not np.isfinite(fault.time)
    ):
        raise InputError(f"fault = {content}")
    return fault
