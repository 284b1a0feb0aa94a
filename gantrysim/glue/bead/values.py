"""The values of a bead."""

from __future__ import annotations

from dataclasses import dataclass

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
