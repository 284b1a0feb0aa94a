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
    the path speed ramps, a fixed area does not. A start lasts until the flow first meets its demand, or is steady short
    of it; a stop begins where it last did; in between a flow limit may reduce the flow.

    Attributes:
        nominal: requested section; of a program that states one for each line by E, their median along the path [mm²].
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
        missing_at_start: volume missing at a start, as length of the section requested there [mm].
        excess_at_stop: volume in excess at a stop, likewise; None where no stretch ends within the record [mm].
        delay_at_start: place where half the requested section is first reached, behind that of the nozzle at the
            command; None where no stretch reaches it [mm].
        overrun_at_stop: the same for where the section was last as large [mm].
        volume: volume laid [mm³].
        requested_volume: volume of the requested sections along the commanded path, while the dispenser is on [mm³].
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


# The values of a bead as people see them.

NOMINAL_SECTION = Quantity[BeadValues](
    "nominal_section",
    label="nominal section",
    unit="mm²",
    form=".2f",
    meaning="Requested cross-section of the bead: area of the dispenser, or its flow over the path speed",
    path=("nominal",),
)
SECTION = Quantity[BeadValues](
    "bead_section",
    label="cross-section",
    unit="mm²",
    form=".2f",
    meaning="Cross-section of the bead while the dispenser is on",
    path=("section",),
    statistics=RANGE,
)
WIDTH = Quantity[BeadValues](
    "bead_width",
    label="bead width",
    unit="mm",
    form=".2f",
    meaning="Width of the bead while the dispenser is on",
    path=("width",),
    statistics=RANGE,
)
CLEARANCE = Quantity[BeadValues](
    "turn_clearance",
    label="clearance of turns",
    unit="mm",
    form=".2f",
    meaning="Distance of neighbouring turns less their mean width, negative where they overlap",
    path=("clearance",),
    statistics=RANGE,
)
OVERLAP_SHARE = Quantity[BeadValues](
    "overlap_share",
    label="turns that overlap",
    unit="%",
    form=".1f",
    meaning="Share of the turns' length on which neighbouring turns overlap",
    path=("overlap_share",),
    factor=100.0,
)
GAP_SHARE = Quantity[BeadValues](
    "gap_share",
    label="turns with a gap",
    unit="%",
    form=".1f",
    meaning="Share of the turns' length on which neighbouring turns leave a gap",
    path=("gap_share",),
    factor=100.0,
)
COVERAGE = Quantity[BeadValues](
    "coverage",
    label="coverage",
    unit="%",
    form=".1f",
    meaning="Wet share of the area between neighbouring turns on the height map",
    path=("coverage",),
    factor=100.0,
)
APART_SHARE = Quantity[BeadValues](
    "turns_apart_share",
    label="turns apart in height",
    unit="%",
    form=".1f",
    meaning="Share of that area where the height map has no meaning, as the turns lie apart in height",
    path=("apart_share",),
    factor=100.0,
)
TURNS_APART = Quantity[BeadValues](
    "turns_apart",
    label="height between turns",
    unit="mm",
    form=".3g",
    meaning="Largest difference in height of neighbouring turns",
    path=("height_apart",),
)
MISSING_AT_START = Quantity[BeadValues](
    "missing_at_start",
    label="missing at start",
    unit="mm",
    form=".2f",
    meaning="Volume missing until the flow has settled, as length of nominal bead; negative for an excess",
    path=("missing_at_start",),
    statistics=RANGE,
)
EXCESS_AT_STOP = Quantity[BeadValues](
    "excess_at_stop",
    label="excess at stop",
    unit="mm",
    form=".2f",
    meaning="Volume in excess from when the dispenser closes, as length of nominal bead; negative where it is missing",
    path=("excess_at_stop",),
    statistics=RANGE,
)
DELAY_AT_START = Quantity[BeadValues](
    "delay_at_start",
    label="visible delay at start",
    unit="mm",
    form=".2f",
    meaning="Place where half the nominal section is first reached, behind the nozzle's place at the command to open",
    path=("delay_at_start",),
    statistics=RANGE,
)
OVERRUN_AT_STOP = Quantity[BeadValues](
    "overrun_at_stop",
    label="visible overrun at stop",
    unit="mm",
    form=".2f",
    meaning="Place where the section was last as large, behind the nozzle's place at the command to close",
    path=("overrun_at_stop",),
    statistics=RANGE,
)
VOLUME = Quantity[BeadValues]("volume", label="volume", unit="mm³", form=".4g", meaning="Volume laid", path=("volume",))
REQUESTED_VOLUME = Quantity[BeadValues](
    "requested_volume",
    label="requested volume",
    unit="mm³",
    form=".4g",
    meaning="Volume of the nominal section along the commanded path while the dispenser is on",
    path=("requested_volume",),
)
VOLUME_ERROR = Quantity[BeadValues](
    "volume_error",
    label="volume error",
    unit="mm³",
    form="+.3f",
    meaning="Volume laid beyond the requested one",
    path=("volume_error",),
)
VOLUME_ERROR_PERCENT = Quantity[BeadValues](
    "volume_error",
    label="relative volume error",
    unit="%",
    form="+.2f",
    meaning="Volume laid beyond the requested one, over the latter",
    path=("volume_error_percent",),
)
# the parts of the volume error by name, in the order of a bead
VOLUME_ERROR_PARTS = {
    part: Quantity[BeadValues](
        f"volume_error_{part}",
        label=f"volume error, {part}",
        unit="mm³",
        form="+.3f",
        meaning=meaning,
        path=(attribute,),
    )
    for part, attribute, meaning in (
        ("ramps", "ramp_error", "Part of the volume error requested by the program while the path speed ramps"),
        ("starts", "start_error", "Part of the volume error until the flow has settled: valve opening"),
        ("running", "running_error", "Part of the volume error while the flow is settled: flow limit"),
        ("stops", "stop_error", "Part of the volume error from when the dispenser closes: valve closing"),
    )
}
RIDGE = Quantity[BeadValues](
    "height_map_ridge",
    label="glue above the nozzle",
    unit="%",
    form=".3g",
    meaning="Share by which glue on the height map stands above the nozzle: above 0, heights and coverage are "
    "unreliable",
    path=("ridge",),
    factor=100.0,
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
    TURNS_APART,
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
