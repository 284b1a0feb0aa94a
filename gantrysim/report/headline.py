"""The headline of a run: its contour error, and the link in which most of it lies; or the faults that spoilt it."""

from __future__ import annotations

from gantrysim.job.losses import happened, reached
from gantrysim.metrics.budget import DESCRIPTIONS, Budget

NO_ERROR = 1e-6  # rms below which an error counts as none [mm]

_UM = 1e3
# of the mean square
_ALMOST_ALL = 0.9
_MOST = 0.5


def headline(budget: Budget) -> str:
    """Return the contour error with the link that has the largest share, and the error along the path if larger.

    For a run that ended in a fault, or came to a fault on purpose, it states what happened. Such a run's error has its
    cause in the fault, in whatever link it lies, so no link is named.
    """
    contour = budget.values.contour
    run = budget.analysis.run
    if run.fault is not None or reached(run):
        return f"{happened(run)} {_error_with_faults(budget)}"
    along = _along(budget)
    if contour.rms < NO_ERROR:
        exactly = "" if along else " exactly"
        return f"Contour error: none, the nozzle follows the requested path{exactly}.{along}"
    link, part = max(budget.values.parts.items(), key=lambda item: item[1].share)
    portion = _portion(part.share)
    return f"Contour error: {_size(contour.rms)} rms, {portion} in {link} ({DESCRIPTIONS[link]}).{along}"


def _portion(share: float) -> str:
    if share >= _ALMOST_ALL:
        return "almost all"
    return "mostly" if share > _MOST else "the largest share"


def _error_with_faults(budget: Budget) -> str:
    """Return the size of the contour error of a run with faults, in a sentence."""
    contour = budget.values.contour
    until = "" if budget.analysis.run.fault is None else " until then"
    if contour.rms < NO_ERROR:
        return f"Contour error{until}: none."
    return f"Contour error{until}: {_size(contour.rms)} rms, max {_size(contour.max)}."


def _size(length: float) -> str:
    micrometres = _UM * length
    return f"{micrometres:.{0 if micrometres >= 100 else 1}f} µm"


def _along(budget: Budget) -> str:
    """Return a sentence on the error along the path, where it is larger than the one normal to it."""
    values = budget.values
    if values.lag.max <= max(values.contour.max, NO_ERROR):
        return ""
    size = f"{values.lag.max:.3g} mm" if values.lag.max >= 1 else f"{_UM * values.lag.max:.3g} µm"
    return f" Along the path it is up to {size} from its command, {_UM * values.lag.rms:.3g} µm rms."
