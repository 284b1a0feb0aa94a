"""The margins of a loop as people see them."""

from __future__ import annotations

from gantrysim.base.quantity import Quantity
from gantrysim.servo.stability.loops import Margins

GAIN_MARGIN = Quantity[Margins](
    "gain_margin",
    "gain margin",
    "",
    ".2f",
    "Largest stable factor on the gains, of the axis alone or of all axes that move each other, whichever is smaller",
    ("least_gain",),
)
GAIN_MARGIN_ALONE = Quantity[Margins](
    "gain_margin_alone",
    "gain margin alone",
    "",
    ".2f",
    "Largest factor on the axis' gains up to which its loop is stable",
    ("gain",),
)
GAIN_MARGIN_TOGETHER = Quantity[Margins](
    "gain_margin_together",
    "gain margin with all it moves",
    "",
    ".2f",
    "Largest factor on the gains of all axes that move each other up to which they are stable",
    ("together",),
)
GAIN_MARGIN_LOWER = Quantity[Margins](
    "gain_margin_lower",
    "lower gain margin",
    "",
    ".2f",
    "Smallest factor on the axis' gains down to which its loop is stable",
    ("gain_lower",),
)
PHASE_MARGIN = Quantity[Margins](
    "phase_margin",
    "phase margin",
    "deg",
    ".1f",
    "Smallest phase lag or lead that makes the loop unstable",
    ("phase",),
)
DELAY_MARGIN = Quantity[Margins](
    "delay_margin",
    "delay margin",
    "ms",
    ".2f",
    "Smallest delay that makes the loop unstable",
    ("delay",),
    1e3,
)
SENSITIVITY = Quantity[Margins](
    "sensitivity",
    "peak of |S|",
    "",
    ".2f",
    "Largest amplification of a disturbance of the loop, |S| = |1/(1 + L)|, over all frequencies",
    ("sensitivity",),
)
CROSSOVER = Quantity[Margins](
    "crossover",
    "crossover",
    "Hz",
    ".1f",
    "Lowest frequency at which the loop's gain |L| falls below 1",
    ("crossover",),
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
