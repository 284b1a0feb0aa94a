"""The margins of a loop as people see them."""

from __future__ import annotations

from gantrysim.base.quantity import Quantity
from gantrysim.servo.stability.loops import Margins

GAIN_MARGIN = Quantity[Margins](
    "gain_margin",
    label="gain margin",
    unit="",
    form=".2f",
    meaning="Largest stable factor on the gains, of the axis alone or of all axes that move each other, whichever is "
    "smaller",
    path=("least_gain",),
)
GAIN_MARGIN_ALONE = Quantity[Margins](
    "gain_margin_alone",
    label="gain margin alone",
    unit="",
    form=".2f",
    meaning="Largest factor on the axis' gains up to which its loop is stable",
    path=("gain",),
)
GAIN_MARGIN_TOGETHER = Quantity[Margins](
    "gain_margin_together",
    label="gain margin with all it moves",
    unit="",
    form=".2f",
    meaning="Largest factor on the gains of all axes that move each other up to which they are stable",
    path=("together",),
)
GAIN_MARGIN_LOWER = Quantity[Margins](
    "gain_margin_lower",
    label="lower gain margin",
    unit="",
    form=".2f",
    meaning="Smallest factor on the axis' gains down to which its loop is stable",
    path=("gain_lower",),
)
PHASE_MARGIN = Quantity[Margins](
    "phase_margin",
    label="phase margin",
    unit="deg",
    form=".1f",
    meaning="Smallest phase lag or lead that makes the loop unstable",
    path=("phase",),
)
DELAY_MARGIN = Quantity[Margins](
    "delay_margin",
    label="delay margin",
    unit="ms",
    form=".2f",
    meaning="Smallest delay that makes the loop unstable",
    path=("delay",),
    factor=1e3,
)
SENSITIVITY = Quantity[Margins](
    "sensitivity",
    label="peak of |S|",
    unit="",
    form=".2f",
    meaning="Largest amplification of a disturbance of the loop, |S| = |1/(1 + L)|, over all frequencies",
    path=("sensitivity",),
)
CROSSOVER = Quantity[Margins](
    "crossover",
    label="crossover",
    unit="Hz",
    form=".1f",
    meaning="Lowest frequency at which the loop's gain |L| falls below 1",
    path=("crossover",),
)

MARGINS = (
    GAIN_MARGIN,
    GAIN_MARGIN_ALONE,
    GAIN_MARGIN_TOGETHER,
    GAIN_MARGIN_LOWER,
    PHASE_MARGIN,
    DELAY_MARGIN,
    SENSITIVITY,
    CROSSOVER,
)
