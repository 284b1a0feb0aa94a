"""Metrics of a run: errors by link of the chain, spacing of the turns, circular deviation, repeatability.

The figures for circles follow ISO 230-4 and those for repeated paths ISO 9283, as both are publicly described.
Departures: the machine is a simulated one and the paths are the nozzle's, measured without an instrument; loads, speeds
and the shape of the path are the job's and not those that the standards prescribe; orientation is left out.
"""

from gantrysim.metrics.analysis import (
    THOUSANDTH,
    Analysis,
    AnalysisValues,
    ErrorSize,
    Range,
    path_speed,
    speed_ripple,
    steady,
    torque_ripple,
    tracking_error,
    values,
)
from gantrysim.metrics.budget import LINKS, Budget, BudgetValues, Part, PartValues, TurnValues
from gantrysim.metrics.circular import SPIKE_REACH, CircularTest, Reversal, Trace
from gantrysim.metrics.repeatability import RepeatedPath, interpolated, offset_over_length
from gantrysim.metrics.spacing import Spacing, spacing
from gantrysim.metrics.zone import MinimumZone, least_squares_circle, minimum_zone
