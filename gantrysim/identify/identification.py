"""Identify the axes of a machine from a log, and judge which values the log shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.signal import welch

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.checks.judgement import Judgement, judged_fit
from gantrysim.identify.checks.residual import explained_residual
from gantrysim.identify.checks.sampling import CHECK as SAMPLING
from gantrysim.identify.checks.sampling import check_encoder, check_excitation, check_sampling, check_torque
from gantrysim.identify.checks.units import check_columns, check_inertia, check_swapped, check_travel, inertia_ratio
from gantrysim.identify.fit import AxisLog, fit_axis
from gantrysim.identify.log import Log
from gantrysim.identify.model import AxisModel, model_of
from gantrysim.identify.result import MODE, AxisFit
from gantrysim.identify.whiteness import correlation
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.machine import Machine

_SEGMENT = 256  # samples of a spectrum's segment
_NO_PRESLIDING = 0.2  # deflection of the bristles below which there is none, of the table's
_PEAK = 8.0  # of a residual's spectrum over its median, from which it is a mode's

# reported values of an axis: name, unit of a slide, unit of a hinge; m and rad stand for the travel
REPORTED = {
    "inertia": ("kg", "kg·m²"),
    "viscous": ("N·s/m", "N·m·s/rad"),
    "viscous_forward": ("N·s/m", "N·m·s/rad"),
    "viscous_back": ("N·s/m", "N·m·s/rad"),
    "coulomb": ("N·m", "N·m"),
    "static": ("N·m", "N·m"),
    "offset": ("N·m", "N·m"),
    "delay": ("s", "s"),
    "share": ("", ""),
    "stiffness": ("N/m", "N·m/rad"),
    "damping": ("N·s/m", "N·m·s/rad"),
    "gap": ("mm", "deg"),
}
_OF_THE_AXIS = (
    "inertia",
    "viscous",
    "viscous_forward",
    "viscous_back",
    "stiffness",
    "damping",
)  # reported at the axis, not at the motor


@dataclass(frozen=True)
class IdentifiedValue:
    """A fitted parameter of an axis with its confidence.

    Attributes:
        axis, name: of the parameter; inertia, viscous friction, stiffness and damping are those of the axis.
        unit: in SI, but the gap in mm or deg.
        value: fitted.
        low, high: ends of the 95 % confidence interval.
        nominal: that of the MJCF.
        identified: whether half the interval is within 15 % of the value and no check forbids it.
        reason: why it is not identified, empty if it is.
    """

    axis: str
    name: str
    unit: str
    value: float
    low: float
    high: float
    nominal: float
    identified: bool
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Identification:
    """The fitted axes of a machine.

    Attributes:
        machine: the nominal one.
        period: of the log [s].
        fits: by axis.
    """

    machine: Machine
    period: float
    fits: tuple[AxisFit, ...]

    @cached_property
    def judgements(self) -> tuple[Judgement, ...]:
        """The fits after their checks.

        Raises:
            NotIdentifiedError: a log whose torque has not made its motion.
        """
        return tuple(judged_fit(fit, self.period) for fit in self.fits)

    @property
    def values(self) -> list[IdentifiedValue]:
        """The parameters of all axes."""
        values = []
        for fit, judgement in zip(self.fits, self.judgements, strict=True):
            values += self._values_of(fit, judgement)
        return values

    def _values_of(self, fit: AxisFit, judgement: Judgement) -> list[IdentifiedValue]:
        rows = []
        for name, units in REPORTED.items():
            if name not in fit.estimates:
                continue
            estimate = judgement.estimates[name]
            factor = PER_SI[fit.unit] ** 2 / fit.model.scale if name in _OF_THE_AXIS else 1.0
            low, high = estimate.interval
            reason = judgement.reason(name)
            # a backlash shows by the load behind it
            if name in (*MODE, "gap") and not fit.shows_mode:
                reason = "beyond the log's rate"
            rows.append(
                IdentifiedValue(
                    axis=fit.axis,
                    name=name,
                    unit=units[fit.unit == "deg"],
                    value=factor * estimate.value,
                    low=factor * low,
                    high=factor * high,
                    nominal=factor * float(getattr(fit.nominal, name)),
                    identified=not reason,
                    reason=reason,
                )
            )
        return rows

    @property
    def notes(self) -> list[str]:
        """Remarks on each axis: values that the log does not show, and whether the model's structure holds."""
        notes = []
        for fit, judgement in zip(self.fits, self.judgements, strict=True):
            notes += self._unseen(fit)
            notes.append(friction_words(fit))
            notes += judgement.notes(fit.axis)
            notes.append(verdict(fit, self.period, doubted=bool(judgement.findings)))
            if not fit.holds and not (judgement.reason("inertia") and judgement.reason("coulomb")):
                notes[-1] += "; inertia and friction stand on the torque of the sliding axis, which it does not touch"
        return notes

    @property
    def unidentified(self) -> list[str]:
        """The axes without any identified value, with the first reason."""
        lines = []
        for fit, judgement in zip(self.fits, self.judgements, strict=True):
            if any(value.identified for value in self._values_of(fit, judgement)):
                continue
            # a cause comes before what it makes
            findings = judgement.findings
            reasons = [finding.reason for finding in findings if not finding.values or finding.check == SAMPLING]
            reasons.append("no value is known within 15 %, or passes its checks; see the notes")
            lines.append(f"axis {fit.axis}: {reasons[0]}")
        return lines

    @property
    def adopted(self) -> tuple[frozenset[str], ...]:
        """By axis the names of the values that the fitted machine takes from the log."""
        return tuple(judged.adopted(fit) for fit, judged in zip(self.fits, self.judgements, strict=True))

    @property
    def accepted(self) -> tuple[AxisFit, ...]:
        """The fits with the adopted values; all other values are the MJCF's."""
        return tuple(_with_adopted(fit, names) for fit, names in zip(self.fits, self.adopted, strict=True))

    def _unseen(self, fit: AxisFit) -> list[str]:
        if not fit.nominal.share or fit.shows_mode:
            return []
        reach = f"the {fit.highest:g} Hz that this log shows (half its rate; a tenth of torques)"
        why = "does not show in the log"
        if fit.nominal.resonance >= fit.highest:
            why = f"is beyond {reach}"
        elif "stiffness" in fit.estimates:
            why = f"is fitted at {fit.model.resonance:.0f} Hz, too near {reach}"
        return [f"{fit.axis}: its mode, at {fit.nominal.resonance:.0f} Hz by the MJCF, {why}; the MJCF's stays"]


def identify(machine: Machine, log: Log, progress: Callable[[float], None] = lambda _: None) -> Identification:
    """Fit every axis of a log; the other axes of the machine stay as they are.

    Args:
        machine: the nominal machine.
        log: of its axes.
        progress: called with the completed share.

    Raises:
        NotIdentifiedError: a log without motion, or whose torque, position and time are not those of one axis.
        InputError: an axis whose mode is not known, or a machine with a closed chain.
    """
    if machine.kinematics.followers:
        raise InputError(f"machine {machine.name}: its axes are coupled by a closed chain; none can be fitted alone")
    for axis in machine.axes:
        if axis.mode == "stepper" and axis.name in log.axes:
            raise InputError(
                f"machine {machine.name}: axis {axis.name} is a stepper in open loop, whose torque cannot be logged; "
                "only drives in a closed loop can be identified"
            )
    fits: list[AxisFit] = []
    for column, name in enumerate(log.axes):
        index = machine.axis_names.index(name)
        axis = machine.axes[index]
        nominal = model_of(machine, index)

        def counted(done: int = len(fits)) -> None:
            progress(done / len(log.axes))

        axis_log = AxisLog(
            axis=name,
            unit=axis.unit,
            resolution=axis.resolution,
            period=log.period,
            position=log.position[:, column],
            torque=log.torque[:, column],
            held=log.held,
            starts=log.starts,
        )
        _check_log(axis, nominal, axis_log)
        # a measured torque has the winding's lag behind it
        if not log.held:
            nominal = replace(nominal, lag=0.0)
        try:
            fits.append(fit_axis(nominal, axis_log, counted))
        except InputError as error:
            text = str(error)
            raise NotIdentifiedError(text if text.startswith("axis") else f"axis {name}: {text}") from None
    identification = Identification(machine, log.period, tuple(fits))
    # an unusable log is refused here
    _ = identification.judgements
    return identification


def _check_log(axis: Axis, table: AxisModel, log: AxisLog) -> None:
    position = log.position
    torque = log.torque
    ratio = inertia_ratio(table, position, torque, log.period, log.starts)
    check_swapped(axis.name, position, torque, log.period, log.starts)
    check_travel(axis, position, ratio)
    check_excitation(axis, position, torque, ratio)
    check_sampling(axis, position, log.period)
    check_columns(axis.name, position, torque, log.period, log.starts)
    check_torque(axis, torque, ratio)
    check_inertia(axis, ratio)
    check_encoder(axis, table, position, torque, log.period, log.starts)


def _with_adopted(fit: AxisFit, adopted: frozenset[str]) -> AxisFit:
    """Return a fit whose model has the adopted values, and else those of the MJCF."""
    model = fit.model
    table = fit.nominal
    accepted = table
    if "inertia" in adopted:
        accepted = replace(accepted, inertia=model.inertia)
    if "coulomb" in adopted:
        # static friction keeps its ratio where the log does not show it
        ratio = table.excess / table.coulomb if table.coulomb > 0 else 0.0
        excess = max(model.static - model.coulomb, 0.0) if "static" in adopted else ratio * model.coulomb
        accepted = replace(
            accepted,
            viscous=model.viscous,
            difference=model.difference,
            coulomb=model.coulomb,
            offset=model.offset,
            excess=excess,
        )
    estimates = fit.estimates
    if "stiffness" in adopted:
        damping = model.damping if "damping" in adopted else table.damping
        accepted = replace(accepted, share=model.share, stiffness=model.stiffness, damping=damping)
    else:
        estimates = {name: estimate for name, estimate in estimates.items() if name not in MODE}
    return replace(fit, model=accepted, estimates=estimates)


def friction_words(fit: AxisFit) -> str:
    """Return which friction the log has chosen, in a sentence."""
    travel = fit.predicted.deflection * fit.predicted.scale
    unit = "µm" if fit.unit == "mm" else "mdeg"
    presliding = f"with presliding over {1e3 * travel:.2g} {unit}"
    if fit.predicted.deflection < _NO_PRESLIDING * fit.nominal.deflection:
        presliding = "without presliding"
    return f"{fit.axis}: friction by the log: {', '.join(('Coulomb and viscous', *fit.law.words))}; {presliding}"


def spectrum(fit: AxisFit, period: float) -> tuple[Floats, Floats]:
    """Return frequencies and power density of the residual, (k,) [Hz, u²/Hz]."""
    residual = fit.residual
    frequency, power = welch(residual, 1 / period, nperseg=min(_SEGMENT, residual.size))
    return frequency[1:], power[1:]


def verdict(fit: AxisFit, period: float, *, doubted: bool) -> str:
    """Return a sentence on whether the model's structure holds, from the whiteness and the size of the residual.

    Args:
        fit: of an axis.
        period: of the log [s].
        doubted: whether a check of the fit failed.
    """
    residual = fit.residual
    count = math.sqrt(12) * fit.expected
    coloured = float(np.abs(correlation(residual)).max())
    text = f"{fit.axis}: the residual is {float(np.std(residual)) / count:.2g} counts rms"
    explained = explained_residual(fit, period)
    if math.isfinite(explained):
        text += f", counts and the torque's noise at rest explain {explained / count:.2g},"
    unit, factor = ("µm", 1e3) if fit.unit == "mm" else ("mdeg", 1e3)
    backlash = f"backlash of about {factor * fit.model.gap:.2g} {unit}" if "gap" in fit.estimates else ""
    if fit.holds:
        text += f" and white (correlation at most {coloured:.2f})"
        text += ", but a check above doubts the model" if doubted else ": the structure of the model holds"
        return f"{text}, with a {backlash}" if backlash else text
    frequency, power = spectrum(fit, period)
    text += f" and not white (correlation up to {coloured:.2f}): the structure of the model is wrong"
    if float(power.max()) > _PEAK * float(np.median(power)):
        text += f", most at {frequency[int(power.argmax())]:.0f} Hz"
    if backlash:
        return f"{text}; {backlash} fits best"
    return f"{text}; a second mode or another friction may be missing"
