"""Following error and torque of each axis over time, measured and simulated: what lies along the path, too.

Beside them stands the same machine without friction, a wrong one, which a trace should tell from the right one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.compare.measured import Trace
from gantrysim.compare.vertices import noise_of
from gantrysim.engine.simulate import simulate
from gantrysim.machine.ideal import frictionless_machine
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import THOUSANDTH, ErrorSize
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo

FOLLOWING = "following error"
TORQUE = "torque"
_NOISES = 1.5  # deviations of the noise, within which a difference is noise


@dataclass(frozen=True)
class AxisDifference:
    """A quantity of an axis over all samples of a trace that are part of the run, glue or not.

    Attributes:
        axis: name of the axis.
        quantity: following error or torque.
        unit: in which people see it, a thousandth of that of its sizes: "µm", "mdeg" or "mN·m".
        measured, simulated: sizes [mm, deg or N·m].
        difference: of the two at the same instants.
        frictionless: difference of the measured one and that of the machine without friction; None where that was not
            simulated.
        noise: standard deviation of white noise in the measured one.
    """

    axis: str
    quantity: str
    unit: str
    measured: ErrorSize
    simulated: ErrorSize
    difference: ErrorSize
    frictionless: ErrorSize | None
    noise: float

    def content(self) -> dict[str, Any]:
        """Return the values for JSON, in `unit`."""
        sizes = {"measured": self.measured, "simulated": self.simulated, "difference": self.difference}
        values: dict[str, Any] = {"axis": self.axis, "quantity": self.quantity, "unit": self.unit}
        for name, size in {**sizes, "difference_without_friction": self.frictionless}.items():
            for statistic in ("rms", "max"):
                values[f"{name}_{statistic}"] = None if size is None else 1e3 * getattr(size, statistic)
        return {**values, "noise": 1e3 * self.noise}

    @property
    def is_noise(self) -> bool:
        """Whether the difference is within the noise of the trace."""
        return self.difference.rms <= _NOISES * self.noise


def axis_differences(trace: Trace, measured: Run, simulated: Run, wrong: Run | None) -> list[AxisDifference]:
    """Return the following errors and torques that a trace measures.

    Args:
        trace: measured.
        measured: record at its samples.
        simulated: the same of the run.
        wrong: the same of the machine without friction; None where that was not simulated.
    """
    differences = []
    for a, axis in enumerate(measured.axes):
        unit = THOUSANDTH[measured.units[a]]
        if not is_missing(trace, a, "commanded") and not is_missing(trace, a, "encoder"):
            runs = [_following(run, a) for run in (measured, simulated, *([] if wrong is None else [wrong]))]
            differences.append(_difference(axis, FOLLOWING, unit, runs))
        for kind, values in trace.torques.items():
            if not np.isnan(values[:, a]).all():
                runs = [getattr(run, kind)[:, a] for run in (measured, simulated, *([] if wrong is None else [wrong]))]
                differences.append(_difference(axis, TORQUE, "mN·m", runs))
    return differences


def is_missing(trace: Trace, axis: int, link: str) -> bool:
    """Return whether a link of an axis is not measured."""
    return link not in trace.axes or bool(np.isnan(trace.axes[link][:, axis]).all())


def _following(run: Run, axis: int) -> Floats:
    return run.commanded[:, axis] - run.encoder[:, axis]


def _difference(axis: str, quantity: str, unit: str, runs: list[Floats]) -> AxisDifference:
    measured, simulated, *wrong = runs
    known = ~np.isnan(measured)
    return AxisDifference(
        axis=axis,
        quantity=quantity,
        unit=unit,
        measured=ErrorSize.of(measured[known]),
        simulated=ErrorSize.of(simulated[known]),
        difference=ErrorSize.of((measured - simulated)[known]),
        frictionless=ErrorSize.of((measured - wrong[0])[known]) if wrong else None,
        noise=noise_of(measured[known][:, None]),
    )


def frictionless_run(run: Run, machine: Machine, servo: Servo) -> Run:
    """Return the record of a run's command on its machine without friction, under the same servo.

    Args:
        run: whose command is sent, tick by tick.
        machine: of the run.
        servo: of the run.

    Raises:
        InputError: a run with deliberate faults, or one that the machine without friction cannot follow to its end.
    """
    if run.injected:
        raise InputError("it has deliberate faults")
    setpoints = Setpoints(
        run.period,
        run.axes,
        np.asarray(run.commanded),
        np.asarray(run.dispense),
        run.requested,
        progress=None if run.progress is None else np.asarray(run.progress),
    )
    wrong = simulate(frictionless_machine(machine), servo, setpoints, engine="loop")
    if wrong.fault is not None:
        raise InputError(f"it ends in a fault: {wrong.fault}")
    return wrong
