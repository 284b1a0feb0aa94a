"""Figures in the manner of ISO 230-4 for circles and of ISO 9283 for repeated paths.

Both standards are used as they are publicly described. Departures: the machine is a simulated one and the paths are the
nozzle's, measured without an instrument; loads, speeds and the shape of the path are the job's and not those that the
standards prescribe; orientation is left out.
"""

from gantrysim.iso.circular import SPIKE_REACH, CircularTest, Reversal, Trace
from gantrysim.iso.repeated import RepeatedPath, interpolated, offset_over_length
from gantrysim.iso.zone import MinimumZone, least_squares_circle, minimum_zone

__all__ = [
    "SPIKE_REACH",
    "CircularTest",
    "MinimumZone",
    "RepeatedPath",
    "Reversal",
    "Trace",
    "interpolated",
    "least_squares_circle",
    "minimum_zone",
    "offset_over_length",
]
