"""The headline of a run: its contour error, and the link in which most of it lies."""

from __future__ import annotations

from gantrysim.metrics.budget import DESCRIPTIONS, Budget

NO_ERROR = 1e-6  # rms below which an error counts as none [mm]

_UM = 1e3
_ALMOST_ALL, _MOST = 0.9, 0.5  # of the mean square


def headline(budget: Budget) -> str:
    """Return the contour error with the link that has the largest share, and the error along the path if larger."""
    contour = budget.values.contour
    run = budget.analysis.run
    until = "" if run.fault is None else " until the fault"
    if run.injected:
        until = f" with faults on purpose{until}"
    along = _along(budget)
    if contour.rms < NO_ERROR:
        exactly = "" if along or run.injected else " exactly"
        return f"Contour error{until}: none, the nozzle follows the requested path{exactly}.{along}"
    link, part = max(budget.values.parts.items(), key=lambda item: item[1].share)
    share = "almost all" if part.share >= _ALMOST_ALL else "mostly" if part.share > _MOST else "the largest share"
    rms = _UM * contour.rms
    size = f"{rms:.{0 if rms >= 100 else 1}f} µm rms"
    return f"Contour error{until}: {size}, {share} in {link} ({DESCRIPTIONS[link]}).{along}"


def _along(budget: Budget) -> str:
    """Return a sentence on the error along the path, where it is larger than the one normal to it."""
    values = budget.values
    if values.lag.max <= max(values.contour.max, NO_ERROR):
        return ""
    size = f"{values.lag.max:.3g} mm" if values.lag.max >= 1 else f"{_UM * values.lag.max:.3g} µm"
    return f" Along the path it is up to {size} from its command, {_UM * values.lag.rms:.3g} µm rms."
