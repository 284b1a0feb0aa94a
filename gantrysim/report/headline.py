"""The headline of a run: its contour error, and the link in which most of it lies."""

from __future__ import annotations

from gantrysim.metrics.budget import DESCRIPTIONS, Budget

NO_ERROR = 1e-6  # rms below which an error counts as none [mm]

_UM = 1e3
_ALMOST_ALL, _MOST = 0.9, 0.5  # of the mean square


def headline(budget: Budget) -> str:
    """Return one sentence with the contour error and the link that has the largest share of it."""
    contour = budget.values.contour
    until = "" if budget.analysis.run.fault is None else " until the fault"
    if contour.rms < NO_ERROR:
        return f"Contour error{until}: none, the nozzle follows the requested path exactly."
    link, part = max(budget.values.parts.items(), key=lambda item: item[1].share)
    share = "almost all" if part.share >= _ALMOST_ALL else "mostly" if part.share > _MOST else "the largest share"
    rms = _UM * contour.rms
    return f"Contour error{until}: {rms:.{0 if rms >= 100 else 1}f} µm rms, {share} in {link} ({DESCRIPTIONS[link]})."
