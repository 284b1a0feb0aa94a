"""The values of a comparison as people see them, besides those of the two error budgets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gantrysim.base.quantity import SIZES, Quantity
from gantrysim.metrics.parts import ERROR

# of an `Alignment`
SHIFT = Quantity[Any](
    "shift",
    label="time shift",
    unit="s",
    form="+.6f",
    meaning="Time of the trace less that of the run",
    path=("shift",),
)
ROTATION = Quantity[Any](
    "rotation",
    label="rotation",
    unit="deg",
    form="+.4f",
    meaning="Turn of the trace's nozzle about z, counter-clockwise",
    path=("rotation",),
)

# differences are often smaller than the decimals of `ERROR`
DIFFERENCE: Quantity[Any] = replace(
    ERROR,
    name="difference",
    label="difference",
    form=".2f",
    meaning="Measured less simulated error at the same instant, lateral and vertical",
    statistics=(),
)
DIFFERENCES = replace(DIFFERENCE, name="", statistics=SIZES).numbers  # of an `ErrorSize`

# of what is `Explained`
MEASURED = replace(
    DIFFERENCE,
    name="measured_rms",
    label="measured, rms",
    form=ERROR.form,
    meaning="Measured error across the path, of the links that are compared",
    path=("measured",),
)
SIMULATED = replace(
    MEASURED,
    name="simulated_rms",
    label="simulated, rms",
    meaning="Simulated error of the same links at the same instants",
    path=("simulated",),
)
REMAINDER = replace(
    MEASURED,
    name="difference_rms",
    label="difference, rms",
    meaning="Difference of the two",
    path=("difference",),
)
SHARE = Quantity[Any](
    "explained_share",
    label="explained",
    unit="%",
    form=".1f",
    meaning="Share of the measured mean square that the simulation explains",
    path=("share",),
    factor=100.0,
)
EXPLAINED: tuple[Quantity[Any], ...] = (MEASURED, SIMULATED, REMAINDER, SHARE)

# of a `Peak`
FREQUENCY = Quantity[Any](
    "frequency", label="frequency", unit="Hz", form=".1f", meaning="Frequency of the peak", path=("frequency",)
)
PEAK_SIZE: Quantity[Any] = replace(
    DIFFERENCE, name="rms", label="rms", form=".3g", meaning="Difference within the peak", path=("rms",)
)
PEAK = (FREQUENCY, PEAK_SIZE)
