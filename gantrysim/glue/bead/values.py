"""The values of a bead."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.base.quantity import RANGE, Quantity
from gantrysim.metrics.analysis import Range


@dataclass(frozen=True)
class BeadValues:
    """The values of a bead; ranges over its length or over its stretches of dispensing.

    The volume error has four parts,

        volume_error = ramp_error + start_error + running_error + stop_error,

    the first from the program, the others from the dispenser: a fixed flow demands more than the nominal section while
    the path speed ramps, a fixed area does not. A start lasts until the flow's deviation from its demand settles to its
    median over the stretch; a stop begins where it last has that value; in between a flow limit may reduce the flow.

    Attributes:
        nominal: requested section [mm²].
        width: width while the dispenser is on [mm].
        section: cross-section while the dispenser is on [mm²].
        clearance: distance of neighbouring turns less their mean width, negative where they overlap; None for a trace
            without neighbouring turns [mm].
        overlap_share: share of the turns' length on which they overlap; None likewise.
        gap_share: share on which they leave a gap; None likewise.
        coverage: wet share of the area between neighbouring turns on the height map; None likewise, and where the map
            has no meaning between any of them.
        apart_share: share of that area where the height map has no meaning, as the surfaces of the two turns lie apart
            in height, see `layers`; None likewise.
        height_apart: largest difference of height of neighbouring turns [mm]; None likewise.
        missing_at_start: volume missing at a start, as length of the nominal section [mm].
        excess_at_stop: volume in excess at a stop, likewise; None where no stretch ends within the record [mm].
        delay_at_start: place where half the nominal section is first reached, behind that of the nozzle at the command;
            None where no stretch reaches it [mm].
        overrun_at_stop: the same for where the section was last as large [mm].
        volume: volume laid [mm³].
        requested_volume: volume of the nominal section along the commanded path, while the dispenser is on [mm³].
        ramp_error: volume that the program demands beyond that [mm³].
        start_error: volume laid beyond the demand until the flow has settled [mm³].
        running_error: the same from there to the stop [mm³].
        stop_error: the same from there to the next start or the end of the record [mm³].
        ridge: share by which glue on the height map stands above the nozzle; 0 where the map has settled.
    """

    nominal: float
    width: Range
    section: Range
    clearance: Range | None
    overlap_share: float | None
    gap_share: float | None
    coverage: float | None
    apart_share: float | None
    height_apart: float | None
    missing_at_start: Range
    excess_at_stop: Range | None
    delay_at_start: Range | None
    overrun_at_stop: Range | None
    volume: float
    requested_volume: float
    ramp_error: float
    start_error: float
    running_error: float
    stop_error: float
    ridge: float

    @property
    def volume_error_parts(self) -> dict[str, float]:
        """The parts of `volume_error` by name, in the order of a bead [mm³]."""
        return {
            "ramps": self.ramp_error,
            "starts": self.start_error,
            "running": self.running_error,
            "stops": self.stop_error,
        }

    @property
    def apart_note(self) -> str:
        """Remark on neighbouring turns that lie apart in height."""
        where = "" if self.coverage is None else f" on {100 * (self.apart_share or 0.0):.1f} % of the area"
        return (
            f"neighbouring turns lie up to {self.height_apart:.3g} mm apart in height{where}: the height map, in plan "
            "view, has no coverage between them"
        )

    @property
    def ridge_note(self) -> str:
        """Warning for a height map that has not settled."""
        return f"glue stands {100 * self.ridge:.3g} % above the nozzle: heights and coverage are unreliable"

    @property
    def volume_error(self) -> float:
        """Volume laid beyond the requested one [mm³]."""
        return self.volume - self.requested_volume

    @property
    def volume_error_percent(self) -> float:
        """Volume error over the requested volume [%]."""
        return 100 * self.volume_error / self.requested_volume

    @property
    def dispenser_error(self) -> float:
        """The dispenser's part of the volume error [mm³]."""
        return self.start_error + self.running_error + self.stop_error


# The values of a bead as people see them.

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
