"""Cost of deliberate faults: the bead of a run with them compared with the same job without."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import Quantity
from gantrysim.faults import InjectedFault
from gantrysim.glue.bead import Bead
from gantrysim.record.run import Run

_LEFT = 0.5  # share of the section below which the bead is missing
_TICK_REACH = 1.5  # distance from a tick that stands for the path around it, in the largest distance between ticks


@dataclass(frozen=True)
class Losses:
    """Glue and accuracy lost by deliberate faults, compared with the same job without them.

    Along the requested path the beads are compared where the nozzle is nearest to it while the dispenser is on.

    Attributes:
        volume: volume missing at the end, negative for an excess [mm³].
        length: length of the path on which less than half the section without the faults is laid, or nothing, as
            after the fault that ends the run [mm].
        width: difference in width, with the faults less without, where it is largest [mm].
        width_s: place of that on the requested path, of what the nozzle passes in both runs [mm].
        shift: distance by which the faults displace the nozzle square to the path, where it is largest [mm].
        shift_s: place of that likewise [mm].
    """

    volume: float
    length: float
    width: float
    width_s: float
    shift: float
    shift_s: float

    @classmethod
    def of(cls, faulted: Bead, healthy: Bead) -> Losses:
        """Compare the bead of a run with faults with the bead of the same job without."""
        s = healthy.analysis.nozzle.s
        reach = _TICK_REACH * max(healthy.ds, float(np.diff(np.sort(s)).max(initial=0.0)))
        places = np.arange(s.min(), s.max() + 0.5 * healthy.ds, healthy.ds)
        before = _laid_bead(healthy, places, reach)
        after = _laid_bead(faulted, places, reach)
        both = before.passed & after.passed
        error = np.where(both, after.width - before.width, 0.0)
        shift = np.where(both, np.linalg.norm(after.offset - before.offset, axis=1), 0.0)
        worst = int(np.abs(error).argmax())
        furthest = int(shift.argmax())
        return cls(
            volume=healthy.total_volume - faulted.total_volume,
            length=healthy.ds * int(np.count_nonzero(after.section < _LEFT * before.section)),
            width=float(error[worst]),
            width_s=float(places[worst]),
            shift=float(shift[furthest]),
            shift_s=float(places[furthest]),
        )

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """The values as text: name, value, remark."""
        amount = MISSING_VOLUME.label if self.volume >= 0 else "excess volume"
        return [
            (amount, MISSING_VOLUME.text(abs(self.volume)), "compared with the job without the faults"),
            (MISSING_LENGTH.label, MISSING_LENGTH.text(self.length), "of the path, with less than half the section"),
            (
                WIDTH_ERROR.label,
                WIDTH_ERROR.text(self.width),
                f"at most where the nozzle passes, at s = {WIDTH_ERROR_PLACE.text(self.width_s)}",
            ),
            (
                NOZZLE_SHIFT.label,
                NOZZLE_SHIFT.text(self.shift),
                f"at most, square to the path, at s = {NOZZLE_SHIFT_PLACE.text(self.shift_s)}",
            ),
        ]


MISSING_VOLUME = Quantity[Losses](
    "missing_volume",
    label="missing volume",
    unit="mm³",
    form=".4g",
    meaning="Volume missing at the end compared with the job without the faults; negative for an excess",
    path=("volume",),
)
MISSING_LENGTH = Quantity[Losses](
    "missing_length",
    label="missing bead",
    unit="mm",
    form=".4g",
    meaning="Length of the path with less than half the section that is laid without the faults",
    path=("length",),
)
WIDTH_ERROR = Quantity[Losses](
    "width_error",
    label="width error",
    unit="mm",
    form="+.3f",
    meaning="Width of the bead with the faults less that without, where it differs most",
    path=("width",),
)
WIDTH_ERROR_PLACE = Quantity[Losses](
    "width_error_s",
    label="place of the width error",
    unit="mm",
    form=".1f",
    meaning="Arc length on the requested path there",
    path=("width_s",),
)
NOZZLE_SHIFT = Quantity[Losses](
    "nozzle_displaced",
    label="nozzle displaced",
    unit="µm",
    form=".1f",
    meaning="Largest distance between the nozzle with the faults and without, square to the path",
    path=("shift",),
    factor=1e3,
)
NOZZLE_SHIFT_PLACE = Quantity[Losses](
    "nozzle_displaced_s",
    label="place of the displacement",
    unit="mm",
    form=".1f",
    meaning="Arc length on the requested path there",
    path=("shift_s",),
)
LOSSES = (MISSING_VOLUME, MISSING_LENGTH, WIDTH_ERROR, WIDTH_ERROR_PLACE, NOZZLE_SHIFT, NOZZLE_SHIFT_PLACE)


def reached_faults(run: Run) -> list[InjectedFault]:
    """Return the deliberate faults that a run came to and that change anything, by time."""
    last = float(run.time[-1])
    faults = [fault for fault in run.injected if fault.acts and fault.time <= last]
    return sorted(faults, key=lambda fault: fault.time)


def events(run: Run) -> list[str]:
    """Return what happened in a run with deliberate faults: the faults by time, then what the supervision did."""
    last = float(run.time[-1])
    lines = [
        str(fault) + ("" if fault.time <= last else " (the run ended before)")
        for fault in sorted(run.injected, key=lambda fault: fault.time)
    ]
    if run.fault is None:
        return [*lines, f"supervision: no limit exceeded, complete at t = {last:.4f} s"]
    return [*lines, f"supervision: {run.fault}"]


def happened_events(run: Run) -> str:
    """Return the deliberate faults and the trip of a run in the order of time, a sentence each."""
    lines = events(run) if reached_faults(run) else [f"fault: {run.fault}"]
    return " ".join(f"{line[0].upper()}{line[1:]}." for line in lines)


class _Laid(NamedTuple):
    """A run at places on the requested path: section [mm²], width, the nozzle's offset [mm], and whether it passed."""

    section: Floats
    width: Floats
    offset: Floats
    passed: NDArray[np.bool_]


def _laid_bead(bead: Bead, places: Floats, reach: float) -> _Laid:
    """Return a run at places on the path, without a bead where the nozzle has not passed."""
    analysis = bead.analysis
    order = np.argsort(analysis.nozzle.s, kind="stable")
    s = analysis.nozzle.s[order]
    trace = bead.length[analysis.ticks[order]]
    after = np.clip(np.searchsorted(s, places), 1, max(s.size - 1, 1))
    near = np.minimum(np.abs(places - s[after - 1]), np.abs(places - s[np.minimum(after, s.size - 1)])) <= reach
    section, width = (
        np.where(near, np.interp(places, s, np.interp(trace, bead.place, values)), 0.0)
        for values in (bead.area, bead.width)
    )
    offset = np.stack([np.interp(places, s, column) for column in analysis.nozzle.offset[order].T], axis=1)
    return _Laid(section, width, offset, near)
