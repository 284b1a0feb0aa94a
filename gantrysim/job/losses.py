"""What faults on purpose cost: a run with them beside the run of the same job without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.bead import Bead
from gantrysim.run import Run

_LEFT = 0.5  # share of the section below which the bead is missing
_REACH = 1.5  # distance from a tick that stands for the path around it, in the largest distance between ticks

_UM = 1e3


@dataclass(frozen=True)
class Losses:
    """What a run with faults on purpose lacks, compared with the same job without them.

    Along the requested path the beads are compared where the nozzle is nearest to it while the dispenser is on.

    Attributes:
        volume: volume missing at the end, negative for an excess [mm³].
        length: length of the path on which less than half the section without the faults is laid, or nothing, as
            after the fault that ends the run [mm].
        width: difference in width, with the faults less without, where it is largest, of what both nozzles pass [mm].
        s: place of that on the requested path [mm].
        contour: largest contour error with the faults [mm].
        contour_without: the same without them [mm].
    """

    volume: float
    length: float
    width: float
    s: float
    contour: float
    contour_without: float

    @classmethod
    def of(cls, faulted: Bead, healthy: Bead) -> Losses:
        """Compare the bead of a run with faults to that of the same job without."""
        s = healthy.analysis.nozzle.s
        reach = _REACH * max(healthy.ds, float(np.diff(np.sort(s)).max(initial=0.0)))
        places = np.arange(s.min(), s.max() + 0.5 * healthy.ds, healthy.ds)
        section, width, passed = _laid(healthy, places, reach)
        left, left_width, still_passed = _laid(faulted, places, reach)
        error = np.where(passed & still_passed, left_width - width, 0.0)
        worst = int(np.abs(error).argmax())
        return cls(
            volume=healthy.total_volume - faulted.total_volume,
            length=healthy.ds * int(np.count_nonzero(left < _LEFT * section)),
            width=float(error[worst]),
            s=float(places[worst]),
            contour=faulted.analysis.values.contour.max,
            contour_without=healthy.analysis.values.contour.max,
        )

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """The values as text: name, value, remark."""
        amount = "missing" if self.volume >= 0 else "in excess"
        return [
            (f"volume {amount}", f"{abs(self.volume):.4g} mm³", "compared with the job without the faults"),
            ("bead missing", f"{self.length:.4g} mm", "of the path, with less than half the section"),
            ("width error", f"{self.width:+z.3f} mm", f"at most where the nozzle passes, at s = {self.s:.1f} mm"),
            ("contour error", f"{_UM * self.contour:.1f} µm", f"at most; {_UM * self.contour_without:.1f} without"),
        ]


def events(run: Run) -> list[str]:
    """Return what happened in a run with faults on purpose: the faults by time, then what the supervision did."""
    last = float(run.time[-1])
    lines = [
        str(fault) + ("" if fault.time <= last else " (the run ended before)")
        for fault in sorted(run.injected, key=lambda fault: fault.time)
    ]
    if run.fault is None:
        return [*lines, f"supervision: no limit exceeded, complete at t = {last:.4f} s"]
    return [*lines, f"supervision: {run.fault}"]


def _laid(bead: Bead, places: Floats, reach: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return section and width of a bead at places on the path, and where the nozzle has passed; zero elsewhere."""
    analysis = bead.analysis
    order = np.argsort(analysis.nozzle.s, kind="stable")
    s, trace = analysis.nozzle.s[order], bead.length[analysis.ticks[order]]
    after = np.clip(np.searchsorted(s, places), 1, max(s.size - 1, 1))
    near = np.minimum(np.abs(places - s[after - 1]), np.abs(places - s[np.minimum(after, s.size - 1)])) <= reach
    section, width = (
        np.where(near, np.interp(places, s, np.interp(trace, bead.place, values)), 0.0)
        for values in (bead.area, bead.width)
    )
    return section, width, near
