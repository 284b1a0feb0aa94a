"""What a circular test has found, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gantrysim.metrics import CircularTest, Trace
from gantrysim.study.cases import OK, Row
from gantrysim.study.circle.rows import AXES, DECAY, SENSES, trace_of

if TYPE_CHECKING:
    from gantrysim.study.circle.study import CircleStudy

_UM = 1e3


def findings(study: CircleStudy, rows: list[Row]) -> list[str]:
    """Return the figures, where the deviation is largest, and what of it the servo makes."""
    traces = study.traces(rows)
    if len(traces) < len(SENSES):
        failed = next(row for row in rows if row["status"] != OK)
        return [f"The circle run {failed['direction']} has no figures: {failed['status']}"]
    test = CircularTest(traces["clockwise"], traces["counter-clockwise"])
    both = _UM * test.bidirectional_circular_deviation
    mean = _UM * test.mean_bidirectional_radial_deviation
    one, other = (_UM * trace.circular_deviation for trace in traces.values())
    text = (
        f"Radius {study.radius:g} mm at {study.speed:g} mm/s on {study.job.built_machine.name}: circular deviation "
        f"G = {one:.1f} µm clockwise and {other:.1f} µm counter-clockwise, bidirectional G(b) = {both:.1f} µm. The "
        f"paths' mean radius is {abs(mean):.2f} µm too {'large' if mean > 0 else 'small'} (D = {mean:+.2f} µm)."
    )
    return [text, _largest(study, traces), _structure_share(study, rows, one, other), _followed(study)]


def _largest(study: CircleStudy, traces: dict[str, Trace]) -> str:
    found = [(direction, one) for direction, trace in traces.items() for one in trace.reversals(study.reach)]
    direction, spike = max(found, key=lambda item: abs(item[1].spike))
    _, step = max(found, key=lambda item: abs(item[1].step))
    late = ""
    if study.decay > study.reach:
        late = (
            f" At this speed {DECAY:g} s are {study.decay:.0f} deg, so that a spike is not over where the step is "
            "taken: the two are not clearly told apart."
        )
    return (
        f"The largest spike is {_UM * spike.spike:+.1f} µm, {direction}, {spike.spike_at:.1f} deg after "
        f"{AXES[spike.axis]} reverses at {spike.angle:g} deg; the largest step is {_UM * step.step:+.1f} µm, at a "
        f"reversal of {AXES[step.axis]}.{late}"
    )


def _structure_share(study: CircleStudy, rows: list[Row], *nozzle: float) -> str:
    motors = [_UM * trace_of(row, study.centre, study.radius, "motor").circular_deviation for row in rows]
    return (
        f"The motors' own positions have G = {motors[0]:.1f} and {motors[1]:.1f} µm against the nozzle's "
        f"{nozzle[0]:.1f} and {nozzle[1]:.1f} µm; the difference is the structure's behind them."
    )


def _followed(study: CircleStudy) -> str:
    return (
        f"What counts is one full circle at constant speed after {study.lead:g} deg of lead. F is taken from the "
        "nominal circle about the axes' zero, G and G(b) from minimum-zone circles, D from the least-squares "
        "circle of both paths, after public descriptions of ISO 230-4:2005 and 2022; spikes and steps at reversals "
        "are not the standard's (see gantrysim.metrics)."
    )
