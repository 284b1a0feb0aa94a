"""The record of a run: arrays with one row per servo tick, saved to and loaded from a file."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import asdict, dataclass, fields
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.columns import Column, load_arrays, save_arrays
from gantrysim.controllers.paths.path import Path
from gantrysim.errors import InputError

_FORMAT = 6
# arrays of older formats that are still read, by their names today; what they lack has its default
_RENAMED: dict[int, dict[str, str]] = {4: {"asked": "flow_demand"}, 5: {}}
_NUMBERS = ("period", "gap", "face", "needle_length")


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


@dataclass(frozen=True, eq=False)
class Run:
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
    face: float = 0.82  # of the 21 gauge needle of the built-in machines
    needle_length: float = 25.4
    fault: Fault | None = None

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray) and _writable(value):
                own = value.copy()  # the caller's array stays the caller's
                own.flags.writeable = False
                object.__setattr__(self, name, own)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the record to a NumPy .npz file."""
        arrays: dict[str, Any] = {f.name: vars(self)[f.name] for f in fields(self)}
        path = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in self.requested.parameters().items()}
        arrays["requested"] = json.dumps({"kind": type(self.requested).__name__, "parameters": path})
        arrays["fault"] = json.dumps(asdict(self.fault) if self.fault else None)
        arrays["format"] = _FORMAT
        with FilePath(file).open("wb") as stream:
            save_arrays(stream, arrays)

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Run:
        """Read a record that `save` has written.

        Raises:
            InputError: no such file, or no record in a format that is read.
        """
        try:
            with np.load(FilePath(file), allow_pickle=False) as arrays:
                content = load_arrays(arrays)
            written = int(content.pop("format"))
            if written != _FORMAT and written not in _RENAMED:
                raise InputError(f"run {file}: written in another format; run its job.toml again")
            for old, new in _RENAMED.get(written, {}).items():
                content[new] = content.pop(old)
            numbers: dict[str, Any] = {name: float(content.pop(name)) for name in _NUMBERS if name in content}
            path = json.loads(str(content.pop("requested")))
            fault = json.loads(str(content.pop("fault")))
            return cls(
                machine=str(content.pop("machine")),
                **numbers,
                axes=tuple(str(name) for name in content.pop("axes")),
                units=tuple(str(unit) for unit in content.pop("units")),
                requested=Path.build(path["kind"], path["parameters"]),
                fault=Fault(**fault) if fault else None,
                **content,
            )
        except (OSError, EOFError, zipfile.BadZipFile, KeyError, TypeError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"run {file}: is no record of a run ({error})") from None


def _writable(array: NDArray[Any]) -> bool:
    """Return whether anyone can write to the memory of an array."""
    memory = array.base if isinstance(array.base, np.ndarray) else array
    return bool(array.flags.writeable or memory.flags.writeable or not memory.flags.owndata)
