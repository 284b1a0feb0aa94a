"""What the physics step does to the figures of a loop study, in numbers and in words."""

from __future__ import annotations

from gantrysim.study.cases import Row
from gantrysim.study.loop.trends import Convergence
from gantrysim.study.loop.variants import AS_IT_IS, NO_FRICTION
from gantrysim.study.series import series

# figures whose convergence over the physics step is looked at
CONVERGING = {
    "contour_rms_um": "contour error",
    "tracking_rms_um": "tracking error",
    "tracking_along_rms_um": "tracking error along the path",
    "structure_rms_um": "structure's part",
    "spacing_std_mm": "spread of the spacing",
}
_PER_CENT = 100.0
_ARTEFACT = 0.05  # of a figure, from which what the physics step does to it is no small matter


def convergence(rows: list[Row], variant: str) -> dict[str, Convergence]:
    """Return the convergence of the figures of a variant over the physics step, by column."""
    found = {}
    for column in CONVERGING:
        step, value = series(rows, "value", column, sweep="physics_step", variant=variant)
        if step.size >= 3:
            found[column] = Convergence.of(step[::-1], value[::-1])
    return found


def integrator_findings(rows: list[Row]) -> list[str]:
    """Return what of the figures is the integrator's making: a paragraph, or none without cases for it."""
    as_is, smooth = convergence(rows, AS_IT_IS), convergence(rows, NO_FRICTION)
    if not as_is:
        return []
    steps = next(iter(as_is.values())).steps
    moved = {column: figure for column, figure in as_is.items() if figure.deviation > _ARTEFACT}
    kept = {column: figure for column, figure in as_is.items() if column not in moved}
    text = (
        f"The physics step was halved from {1e3 * steps[0]:.3g} ms down to {1e3 * steps[-1]:.3g} ms, and the figures "
        "extrapolated to a step of zero (Richardson) where they show an order of convergence; where they scatter, the "
        "whole scatter is told. "
    )
    if not moved:
        text += "The figures of the job as it is are no artefact of the integrator, they are off their limits by: "
    elif kept:
        text += (
            "Of the figures of the job as it is these depend on the step, and so are the integrator's as well as the "
            f"machine's: {_told(moved)}. The others are no artefact of it, they are off their limits by: "
        )
    else:
        text += (
            "The figures of the job as it is all depend on the step, take a shorter one; they are off their limits by: "
        )
    text += f"{_told(kept or moved)}."
    if smooth:
        text += f" Without friction, which is not smooth: {_told(smooth)}."
    return [text]


def _told(found: dict[str, Convergence]) -> str:
    parts = []
    for column, figure in found.items():
        order = f"order {figure.order:.2f}" if figure.order is not None else "scatter"
        parts.append(f"{CONVERGING[column]} {_PER_CENT * figure.deviation:.2g} % ({order})")
    return ", ".join(parts)
