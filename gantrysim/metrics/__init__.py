"""Metrics of a run: errors by link of the chain, spacing of the turns, circular deviation, repeatability.

Positioning follows ISO 230-2, circular tests ISO 230-4 and repeated paths ISO 9283, as publicly described. Departures:
the machine is simulated and the nozzle's path is exact, without an instrument; loads, speeds and the shape of the path
are the job's, not the standards'; orientation is left out.
"""

from gantrysim.metrics.analysis import (
    THOUSANDTH,
    Analysis,
    AnalysisValues,
    ErrorSize,
    Range,
    following_error,
    path_speed,
    speed_ripple,
    steady,
    torque_ripple,
    values,
)
from gantrysim.metrics.budget import DESCRIPTIONS, GEOMETRY, LINKS, Budget
from gantrysim.metrics.circular import (
    SPIKE_REACH,
    CircularTest,
    MinimumZone,
    Reversal,
    Trace,
    circle_row,
    least_squares_circle,
    minimum_zone,
)
from gantrysim.metrics.parts import BudgetValues, Part, PartValues, TurnValues
from gantrysim.metrics.repeatability import Positioning, RepeatedPath, interpolated, offset_over_length
from gantrysim.metrics.spacing import Spacing, spacing
