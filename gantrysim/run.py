"""The record of a run: arrays with one row per servo tick, saved to and loaded from a file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.archive import CHECKSUM, Archive, Member, open_archive, write_archive
from gantrysim.arrays import Floats, read_only
from gantrysim.columns import Column, OptionalColumn, Stored, array_of, blocks
from gantrysim.controllers.paths.path import Path
from gantrysim.display import Shown
from gantrysim.errors import InputError
from gantrysim.faults import InjectedFault, fault_of
from gantrysim.files import replaced
from gantrysim.named_columns import frame

if TYPE_CHECKING:
    import pandas

_FORMAT = 7
# arrays of older formats that are still read, by their names today; what they lack has its default
_RENAMED: dict[int, dict[str, str]] = {4: {"asked": "flow_demand"}, 5: {}, 6: {}}
_SINCE = {6: ("face", "needle_length"), 7: ("injected", "job_sha256", "machine_sha256")}
_LAST_WITHOUT_CHECKSUM = 6
_NUMBERS = ("period", "gap", "face", "needle_length")
_TEXTS = ("machine", "requested", "fault", "injected", "job_sha256", "machine_sha256")
_LISTS = ("axes", "units")
# columns of each array; None for one per axis, 0 for a vector
_COLUMNS = {
    **dict.fromkeys(("time", "flow", "flow_demand", "dispense"), 0),
    **dict.fromkeys(("commanded_tip", "encoder_tip", "motor_tip", "nozzle"), 3),
    **dict.fromkeys(("commanded", "encoder", "motor", "demand", "torque", "current", "voltage"), None),
}
_OPTIONAL = {"geometric_tip": 3}  # columns that a record may lack
_NAN = ("current", "voltage")
_LAST = ("demand", "torque", "current", "voltage")  # not finite where a fault ends the run, in the tick that diverged
_LONGEST_REASON = 300  # characters of a damaged text


@dataclass(frozen=True)
class Fault:
    """Why a run ended before its setpoints did.

    Attributes:
        kind: "following error", "travel", "overspeed", "oscillation", "diverged", "position error" or "settling".
        axis: name of the axis that tripped.
        time: time of the servo tick that detected it [s].
        value: value of the quantity there.
        limit: bound of the quantity.
        unit: unit of both: mm or deg, mm/s or deg/s, N·m, or swings of the torque demand from limit to limit.
        reaction: reaction of the controller, where kinds differ in it.
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
        elif np.isfinite(self.limit):
            text += f": {self.value:.4g} {self.unit}, limit {self.limit:.4g} {self.unit}"
        return f"{text}; {self.reaction}" if self.reaction else text


@dataclass(frozen=True, eq=False, repr=False)
class Run(Shown):
    """The record of a run, one row per servo tick, at the instant of its sample. All arrays are read-only.

    Attributes:
        machine: name of the machine.
        axes: names of its axes.
        units: their units, "mm" or "deg"; u below.
        requested: the requested path, in the work frame.
        period: servo period [s].
        gap: height of the nozzle above the work where its z is 0 [mm].
        time: (n,) [s].
        commanded: setpoints, DPOS, (n, axes) [u].
        encoder: measured positions, MPOS, in whole encoder counts, (n, axes) [u].
        motor: exact positions of the motors, (n, axes) [u].
        commanded_tip, encoder_tip, motor_tip: nozzle positions of a rigid machine at `commanded`, `encoder` and
            `motor`, in the work frame, (n, 3) [mm].
        geometric_tip: nozzle positions of a rigid machine at `motor`, with the errors of its geometry, (n, 3) [mm];
            None for an ideal geometry.
        nozzle: the nozzle's tip in the work frame, (n, 3) [mm].
        demand: torque demand of the servo, after its limit, (n, axes) [N·m].
        torque: electromagnetic torque of the motor, (n, axes) [N·m].
        current: motor current, (n, axes) [A]; nan for an ideal torque source.
        voltage: terminal voltage at the tick's demand, (n, axes) [V]; nan likewise.
        flow: flow out of the nozzle, the mean over the period after the tick, (n,) [mm³/s]; the volume laid is
            sum(flow[:-1]) * period.
        flow_demand: flow demanded by the program over the same period, (n,) [mm³/s].
        dispense: dispenser command, (n,).
        face: outer diameter of the needle, that of its face [mm].
        needle_length: length of the needle [mm].
        fault: why the run ended early, or None.
        injected: faults on purpose.
        job_sha256, machine_sha256: digests of the job, `Job.digest`, and of the machine, `Machine.digest`, that the
            record was saved with; empty for one that no output folder holds.
    """

    machine: str
    axes: tuple[str, ...]
    units: tuple[str, ...]
    requested: Path
    period: float
    gap: float
    time: Column[Floats] = Column()
    commanded: Column[Floats] = Column()
    commanded_tip: Column[Floats] = Column()
    encoder: Column[Floats] = Column()
    encoder_tip: Column[Floats] = Column()
    motor: Column[Floats] = Column()
    motor_tip: Column[Floats] = Column()
    nozzle: Column[Floats] = Column()
    demand: Column[Floats] = Column()
    torque: Column[Floats] = Column()
    current: Column[Floats] = Column()
    voltage: Column[Floats] = Column()
    flow: Column[Floats] = Column()
    flow_demand: Column[Floats] = Column()
    dispense: Column[NDArray[np.bool_]] = Column()
    geometric_tip: OptionalColumn[Floats] = OptionalColumn()
    face: float = 0.82  # of the 21 gauge needle of the built-in machines
    needle_length: float = 25.4
    fault: Fault | None = None
    injected: tuple[InjectedFault, ...] = ()
    job_sha256: str = ""
    machine_sha256: str = ""

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray) and _writable(value):
                own = value.copy()  # the caller's array stays the caller's
                own.flags.writeable = False
                object.__setattr__(self, name, own)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the record to a NumPy .npz file, with a SHA-256 of its content; an earlier file stays until then.

        Raises:
            InputError: the file cannot be written.
        """
        arrays: dict[str, Any] = {f.name: vars(self)[f.name] for f in fields(self)}
        arrays = {name: value for name, value in arrays.items() if name not in _OPTIONAL or value is not None}
        path = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in self.requested.parameters().items()}
        arrays["requested"] = json.dumps({"kind": type(self.requested).__name__, "parameters": path})
        arrays["fault"] = json.dumps(asdict(self.fault) if self.fault else None)
        arrays["injected"] = json.dumps([fault.table() for fault in self.injected])
        with replaced(file) as partial, partial.open("wb") as stream:  # by path it would add a suffix
            write_archive(stream, {"format": _FORMAT, **dict(sorted(arrays.items()))})

    def with_digests(self, job_sha256: str, machine_sha256: str) -> Run:
        """Return the record with these digests; the columns of a long one stay in their file."""
        own = {f.name: vars(self)[f.name] for f in fields(self)}
        return type(self)(**{**own, "job_sha256": job_sha256, "machine_sha256": machine_sha256})

    def to_frame(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with a row per servo tick, see `gantrysim.named_columns`; `attrs` describe the run.

        Raises:
            InputError: pandas is not installed.
        """
        return frame(self)

    def facts(self) -> dict[str, str]:
        return {
            "machine": self.machine,
            "axes": ", ".join(f"{axis} [{unit}]" for axis, unit in zip(self.axes, self.units, strict=True)),
            "ticks": f"{len(self.time)} of {1e3 * self.period:g} ms",
            "path": f"{self.requested.length:.4g} mm",
            "fault": "none" if self.fault is None else str(self.fault),
        }

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Run:
        """Read a record that `save` has written.

        Its members, their types and shapes are checked before they are read; then its SHA-256, which formats before 7
        lack; then that its numbers are finite and its times those of its period.

        Raises:
            InputError: no such file, no record in a format that is read, or a damaged one.
        """
        try:
            with (
                FilePath(file).open("rb") as stream,
                open_archive(stream) as archive,
                np.errstate(all="ignore"),  # of damaged numbers, which are refused
            ):
                return cls(**_content(archive))
        except (OSError, InputError) as error:
            reason = str(error.strerror if isinstance(error, OSError) else error)[:_LONGEST_REASON]
            raise InputError(f"run {file}: is no record of a run, or a damaged one: {reason}") from None


def _content(archive: Archive) -> dict[str, Any]:
    """Return the attributes of a record, checked.

    Raises:
        InputError: there is something wrong with them.
    """
    written = _format(archive)
    _check_members(archive.members, written)
    raw = {name: archive.read(name) for name in sorted(archive.members.keys() - {"format", CHECKSUM})}
    if written > _LAST_WITHOUT_CHECKSUM:
        archive.check()
    for old, new in _RENAMED.get(written, {}).items():
        raw[new] = raw.pop(old)
    content: dict[str, Any] = {name: float(array_of(raw.pop(name))) for name in _NUMBERS if name in raw}
    content |= {name: str(raw.pop(name)) for name in _TEXTS if name in raw}
    content |= {name: tuple(str(item) for item in array_of(raw.pop(name))) for name in _LISTS}
    from gantrysim.controllers.paths import arcs, chain, spirals  # noqa: F401  the kinds of path, for Path.build

    path, fault = json.loads(content["requested"]), json.loads(content["fault"])
    _check_values(content, raw)
    content["requested"] = Path.build(path["kind"], path["parameters"])
    length = content["requested"].length
    if not 0 < length < np.inf:
        raise InputError(f"requested has a length of {length:g} mm")
    content["fault"] = None if fault is None else _fault(fault, content["axes"])
    content["injected"] = tuple(fault_of(one) for one in json.loads(content.get("injected", "[]")))
    return {**content, **{name: read_only(one) if isinstance(one, np.ndarray) else one for name, one in raw.items()}}


def _format(archive: Archive) -> int:
    member = archive.members.get("format")
    if member is None or member.shape or member.dtype.kind != "i":
        raise InputError("it has no format")
    written = int(array_of(archive.read("format")))
    if written != _FORMAT and written not in _RENAMED:
        raise InputError(f"it is written in another format, {written}; run its job.toml again")
    return written


def _check_members(members: Mapping[str, Member], written: int) -> None:
    """Check which members there are, their types and their shapes, from their headers alone."""
    new = {new: old for old, new in _RENAMED.get(written, {}).items()}
    rows = members["time"].shape if "time" in members else ()
    axes = members["axes"].shape if "axes" in members else ()
    if len(rows) != 1 or len(axes) != 1 or not rows[0] or not axes[0]:
        raise InputError("its time or axes are missing")
    expected: dict[str, tuple[str, tuple[int, ...]]] = {"format": ("i", ())}
    for names, kind, shape in ((_NUMBERS, "f", ()), (_TEXTS, "U", ()), (_LISTS, "U", axes)):
        expected |= dict.fromkeys(names, (kind, shape))
    for name, width in (_COLUMNS | {name: width for name, width in _OPTIONAL.items() if name in members}).items():
        columns = axes if width is None else (width,) if width else ()
        expected[new.get(name, name)] = ("b" if name == "dispense" else "f", rows + columns)
    if written > _LAST_WITHOUT_CHECKSUM:
        expected[CHECKSUM] = ("U", ())
    else:
        expected = {name: kind for name, kind in expected.items() if name not in _SINCE[7]}
    optional = _SINCE[6] if written < 6 else ()
    for name in {**expected, **members}:
        if name not in expected or (name not in members and name not in optional):
            raise InputError(f"{name} is {'missing' if name in expected else 'no member of a record'}")
        if name in members:
            kind, own = expected[name]
            found = members[name]
            if found.dtype.kind != kind or found.shape != own or (kind == "f" and found.dtype.itemsize != 8):
                raise InputError(f"{name} has the shape {found.shape} and type {found.dtype}, must have {own}, {kind}")


def _check_values(content: Mapping[str, Any], columns: Mapping[str, NDArray[Any] | Stored]) -> None:
    """Check that names can be printed, numbers are finite and times follow the period."""
    for name in (*content["axes"], *content["units"], content["machine"]):
        if not name or not name.isprintable():
            raise InputError(f"{name!r} is no name")
    if len(set(content["axes"])) < len(content["axes"]) or not set(content["units"]) <= {"mm", "deg"}:
        raise InputError(f"axes {', '.join(content['axes'])} in {', '.join(content['units'])}")
    for name in _NUMBERS:
        number = content.get(name, 1.0)
        if not np.isfinite(number) or (name != "gap" and number <= 0):
            raise InputError(f"{name} = {number:g}")
    time, period = array_of(columns["time"]), content["period"]
    for rows in blocks(time.size):
        expected = period * np.arange(rows.start, rows.stop)
        if not np.allclose(time[rows], expected, rtol=1e-12, atol=1e-9 * period):
            raise InputError(f"time is not that of ticks every {period:g} s")
    if array_of(columns["dispense"]).view(np.uint8).max() > 1:
        raise InputError("dispense has values other than true and false")
    for name, column in columns.items():
        values = array_of(column)
        last = len(values) - (name in _LAST and content["fault"] != "null")
        unknown = name in _NAN and np.isnan(values[0])  # of an axis whose motor is an ideal source of torque
        wrong = 0
        for rows in blocks(last):
            finite = np.isfinite(values[rows]) | (unknown & np.isnan(values[rows]))
            wrong += finite.size - np.count_nonzero(finite)
        if wrong:
            raise InputError(f"{name} has {wrong} values that are not finite")


def _fault(content: Any, axes: Sequence[str]) -> Fault:
    fault = Fault(**content)
    texts, numbers = (fault.kind, fault.axis, fault.unit, fault.reaction), (fault.time, fault.value, fault.limit)
    if (
        fault.axis not in axes
        or not all(isinstance(text, str) and text.isprintable() for text in texts)
        or not all(type(number) in (int, float) for number in numbers)
        or not np.isfinite(fault.time)
    ):
        raise InputError(f"fault = {content}")
    return fault


def _writable(array: NDArray[Any]) -> bool:
    """Return whether anyone can write to the memory of an array."""
    memory = array.base if isinstance(array.base, np.ndarray) else array
    return bool(array.flags.writeable or memory.flags.writeable or not memory.flags.owndata)
