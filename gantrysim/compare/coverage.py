"""The part of a run that a measured trace covers."""

from __future__ import annotations

from gantrysim.compare.alignment import Alignment
from gantrysim.record.run import Run

_WHOLE = 0.999  # of the dispensing time, from which a trace covers it all


def coverage(measured: Run, run: Run, alignment: Alignment) -> list[str]:
    """Return notes on the part of the bead that the trace covers, and on other parts that it fits as well."""
    notes = []
    covered = measured.dispense.sum() * measured.period / (run.dispense.sum() * run.period)
    if covered < _WHOLE:
        notes.append(
            f"the trace covers {measured.time[0]:.4g} to {measured.time[-1]:.4g} s of the run, {100 * covered:.1f} % "
            "of the time for which the dispenser is on"
        )
    if alignment.others:
        shifts = ", ".join(f"{shift - alignment.shift:+.4g}" for shift in alignment.others)
        notes.append(
            f"the trace fits other parts of the run as well, with a time shift larger by {shifts} s: which part it "
            "covers is not identified"
        )
    return notes
