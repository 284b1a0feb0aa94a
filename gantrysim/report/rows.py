"""Values of a run in words: rows of name, value and remark, as the terminal and the page show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from gantrysim.base.display import decimals_of
from gantrysim.base.quantity import Quantity, number_text
from gantrysim.glue.bead import BeadValues
from gantrysim.glue.bead.values import (
    CLEARANCE,
    COVERAGE,
    EXCESS_AT_STOP,
    GAP_SHARE,
    MISSING_AT_START,
    NOMINAL_SECTION,
    OVERLAP_SHARE,
    REQUESTED_VOLUME,
    VOLUME,
    VOLUME_ERROR,
    VOLUME_ERROR_PARTS,
    VOLUME_ERROR_PERCENT,
    WIDTH,
    excess_at_stop,
    missing_at_start,
)
from gantrysim.metrics.analysis import Analysis, Range
from gantrysim.metrics.error_quantities import DURATION, PATH_LENGTH, REQUESTED_SPACING, SPACING, SPEED
from gantrysim.results.glue import DotVerdict

RowTexts = tuple[str, str, str]

_NOMINAL_LENGTH = "length of nominal bead"


def between(quantity: Quantity[Any], values: Range) -> str:
    """Return the smallest and the largest value of a range."""
    return f"{quantity.number(values.min)} to {quantity.number(values.max)}"


def motion_rows(analysis: Analysis) -> Iterator[RowTexts]:
    """Yield spacing of the turns, speed and length of the path."""
    values = analysis.values
    duration = DURATION.text(values.duration)
    # the nozzle's way to the fault is another one, as where an axis is stuck
    remark_of_length = f"in {duration}" if analysis.run.fault is None else f"commanded in {duration}, until the fault"
    if values.spacing is not None:
        spacing = analysis.run.requested.turn_spacing
        requested = "" if spacing is None else f"requested {REQUESTED_SPACING.number(spacing)}, "
        remark = f"{requested}std {SPACING.number(values.spacing.std)}, {between(SPACING, values.spacing)}"
        yield SPACING.label, SPACING.text(values.spacing.mean), remark
    yield SPEED.label, SPEED.text(values.speed.mean), between(SPEED, values.speed)
    yield PATH_LENGTH.label, PATH_LENGTH.text(values.path_length), remark_of_length


def bead_rows(bead: BeadValues) -> Iterator[RowTexts]:
    """Yield the values of a bead."""
    nominal = f"{NOMINAL_SECTION.label} {NOMINAL_SECTION.text(bead.nominal)}"
    yield WIDTH.label, WIDTH.text(bead.width.mean), f"{between(WIDTH, bead.width)}; {nominal}"
    if bead.clearance is not None:
        coverage = "" if bead.coverage is None else f"; {COVERAGE.label} {COVERAGE.text(bead.coverage)}"
        remark = f"clearance {between(CLEARANCE, bead.clearance)}{coverage}"
        yield gap_or_overlap(bead.clearance), CLEARANCE.text(abs(bead.clearance.mean)), remark
        gap = f"of their length, a gap on {GAP_SHARE.text(bead.gap_share)}"
        yield OVERLAP_SHARE.label, OVERLAP_SHARE.text(bead.overlap_share), gap
    missing = bead.missing_at_start.mean
    yield missing_at_start(missing), MISSING_AT_START.text(abs(missing)), _NOMINAL_LENGTH
    if bead.excess_at_stop is not None:
        excess = bead.excess_at_stop.mean
        yield excess_at_stop(excess), EXCESS_AT_STOP.text(abs(excess)), _NOMINAL_LENGTH
    requested = (
        f"{VOLUME_ERROR_PERCENT.text(bead.volume_error_percent)} of {REQUESTED_VOLUME.number(bead.requested_volume)}"
    )
    yield VOLUME.label, VOLUME.text(bead.volume), f"{requested} requested"
    parts = volume_parts(bead).items()
    remark = ", ".join(f"{name} {part.number(part.get(bead))}" for name, part in parts)
    yield VOLUME_ERROR.label, volume_error(bead).text(bead.volume_error), remark


def dot_rows(dots: Sequence[DotVerdict]) -> Iterator[RowTexts]:
    """Yield volumes and diameters of dots, the diameters on the work; nothing without any."""
    if not dots:
        return
    volumes = [verdict.dot.volume for verdict in dots]
    diameters = [verdict.dot.diameter for verdict in dots]
    remark = f"{number_text(min(volumes), '.4g')} to {number_text(max(volumes), '.4g')} mm³ each"
    yield "dots", str(len(dots)), f"{number_text(sum(volumes), '.4g')} mm³ in all, {remark}"
    mean = sum(diameters) / len(dots)
    remark = f"{number_text(min(diameters), '.3f')} to {number_text(max(diameters), '.3f')}, on the work"
    yield "dot diameter", f"{number_text(mean, '.3f')} mm", remark


def bead_notes(bead: BeadValues) -> Iterator[RowTexts]:
    """Yield what makes the height map, and the values that are read from it, doubtful."""
    if bead.apart_share:
        yield "height map", "in layers", bead.apart_note
    if bead.ridge:
        yield "height map", "not settled", bead.ridge_note


def gap_or_overlap(clearance: Range) -> str:
    """Return the name of a mean clearance's magnitude."""
    return "gap between turns" if clearance.mean > 0 else "overlap between turns"


def volume_error(bead: BeadValues) -> Quantity[BeadValues]:
    """Return the volume error with the decimals of a hundred-thousandth of the requested volume."""
    return replace(VOLUME_ERROR, form=f"+.{decimals_of(bead.requested_volume)}f")


def volume_parts(bead: BeadValues) -> dict[str, Quantity[BeadValues]]:
    """Return the parts of the volume error by name, with the same decimals."""
    form = volume_error(bead).form
    return {name: replace(part, form=form) for name, part in VOLUME_ERROR_PARTS.items()}
