"""The values of a bead as people see them."""

from __future__ import annotations

from gantrysim.base.quantity import RANGE, Quantity
from gantrysim.glue.bead.values import BeadValues

NOMINAL_SECTION = Quantity[BeadValues](
    "nominal_section",
    "nominal section",
    "mm²",
    ".3f",
    "Requested cross-section of the bead: area of the dispenser, or its flow over the path speed",
    ("nominal",),
)
SECTION = Quantity[BeadValues](
    "bead_section",
    "cross-section",
    "mm²",
    ".3f",
    "Cross-section of the bead while the dispenser is on",
    ("section",),
    statistics=RANGE,
)
WIDTH = Quantity[BeadValues](
    "bead_width",
    "bead width",
    "mm",
    ".3f",
    "Width of the bead while the dispenser is on",
    ("width",),
    statistics=RANGE,
)
CLEARANCE = Quantity[BeadValues](
    "turn_clearance",
    "clearance of turns",
    "mm",
    ".3f",
    "Distance of neighbouring turns less their mean width, negative where they overlap",
    ("clearance",),
    statistics=RANGE,
)
OVERLAP_SHARE = Quantity[BeadValues](
    "overlap_share",
    "turns that overlap",
    "%",
    ".1f",
    "Share of the turns' length on which neighbouring turns overlap",
    ("overlap_share",),
    100.0,
)
GAP_SHARE = Quantity[BeadValues](
    "gap_share",
    "turns with a gap",
    "%",
    ".1f",
    "Share of the turns' length on which neighbouring turns leave a gap",
    ("gap_share",),
    100.0,
)
COVERAGE = Quantity[BeadValues](
    "coverage",
    "coverage",
    "%",
    ".1f",
    "Wet share of the area between neighbouring turns on the height map",
    ("coverage",),
    100.0,
)
APART_SHARE = Quantity[BeadValues](
    "turns_apart_share",
    "turns apart in height",
    "%",
    ".1f",
    "Share of that area where the height map has no meaning, as the turns lie apart in height",
    ("apart_share",),
    100.0,
)
APART = Quantity[BeadValues](
    "turns_apart",
    "height between turns",
    "mm",
    ".3g",
    "Largest difference in height of neighbouring turns",
    ("height_apart",),
)
MISSING_AT_START = Quantity[BeadValues](
    "missing_at_start",
    "missing at start",
    "mm",
    ".2f",
    "Volume missing until the flow has settled, as length of nominal bead; negative for an excess",
    ("missing_at_start",),
    statistics=RANGE,
)
EXCESS_AT_STOP = Quantity[BeadValues](
    "excess_at_stop",
    "excess at stop",
    "mm",
    ".2f",
    "Volume in excess from when the dispenser closes, as length of nominal bead; negative where it is missing",
    ("excess_at_stop",),
    statistics=RANGE,
)
DELAY_AT_START = Quantity[BeadValues](
    "delay_at_start",
    "visible delay at start",
    "mm",
    ".2f",
    "Place where half the nominal section is first reached, behind the nozzle's place at the command to open",
    ("delay_at_start",),
    statistics=RANGE,
)
OVERRUN_AT_STOP = Quantity[BeadValues](
    "overrun_at_stop",
    "visible overrun at stop",
    "mm",
    ".2f",
    "Place where the section was last as large, behind the nozzle's place at the command to close",
    ("overrun_at_stop",),
    statistics=RANGE,
)
VOLUME = Quantity[BeadValues]("volume", "volume", "mm³", ".4g", "Volume laid", ("volume",))
REQUESTED_VOLUME = Quantity[BeadValues](
    "requested_volume",
    "requested volume",
    "mm³",
    ".4g",
    "Volume of the nominal section along the commanded path while the dispenser is on",
    ("requested_volume",),
)
VOLUME_ERROR = Quantity[BeadValues](
    "volume_error", "volume error", "mm³", "+.3f", "Volume laid beyond the requested one", ("volume_error",)
)
VOLUME_ERROR_PERCENT = Quantity[BeadValues](
    "volume_error",
    "relative volume error",
    "%",
    "+.2f",
    "Volume laid beyond the requested one, over the latter",
    ("volume_error_percent",),
)
# the parts of the volume error by name, in the order of a bead
VOLUME_ERROR_PARTS = {
    part: Quantity[BeadValues](f"volume_error_{part}", f"volume error, {part}", "mm³", "+.3f", meaning, (attribute,))
    for part, attribute, meaning in (
        ("ramps", "ramp_error", "Part of the volume error requested by the program while the path speed ramps"),
        ("starts", "start_error", "Part of the volume error until the flow has settled: valve opening"),
        ("running", "running_error", "Part of the volume error while the flow is settled: flow limit"),
        ("stops", "stop_error", "Part of the volume error from when the dispenser closes: valve closing"),
    )
}
RIDGE = Quantity[BeadValues](
    "height_map_ridge",
    "glue above the nozzle",
    "%",
    ".3g",
    "Share by which glue on the height map stands above the nozzle: above 0, heights and coverage are unreliable",
    ("ridge",),
    100.0,
)

BEAD: tuple[Quantity[BeadValues], ...] = (
    NOMINAL_SECTION,
    SECTION,
    WIDTH,
    CLEARANCE,
    OVERLAP_SHARE,
    GAP_SHARE,
    COVERAGE,
    APART_SHARE,
    APART,
    MISSING_AT_START,
    EXCESS_AT_STOP,
    DELAY_AT_START,
    OVERRUN_AT_STOP,
    VOLUME,
    REQUESTED_VOLUME,
    VOLUME_ERROR,
    VOLUME_ERROR_PERCENT,
    *VOLUME_ERROR_PARTS.values(),
    RIDGE,
)


def missing_at_start(length: float) -> str:
    """Return the name of the magnitude of glue missing at a start."""
    return MISSING_AT_START.label if length >= 0 else "excess at start"


def excess_at_stop(length: float) -> str:
    """Return the name of the magnitude of glue in excess at a stop."""
    return EXCESS_AT_STOP.label if length >= 0 else "missing at stop"
