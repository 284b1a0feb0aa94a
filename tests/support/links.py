"""Records with given links, and the distances that the links of an error budget span, the oracle of their sizes."""

import numpy as np

from gantrysim.record.run import Run

from support.runs import PERIOD


def record(path, s, *, commanded=0.0, encoder=0.0, motor=0.0, nozzle=0.0):
    """A run at arc lengths s; every link adds its offset to that of the link before it, (n, 3)."""
    tips = path.position(s) + np.cumsum(
        [np.broadcast_to(offset, (len(s), 3)) for offset in (commanded, encoder, motor, nozzle)], axis=0
    )
    nothing = np.zeros((len(s), 2))
    return Run(
        machine="none",
        axes=("x", "y"),
        units=("mm", "mm"),
        requested=path,
        period=PERIOD,
        time=np.arange(len(s)) * PERIOD,
        commanded=tips[0][:, :2],
        commanded_tip=tips[0],
        encoder=tips[1][:, :2],
        encoder_tip=tips[1],
        motor=tips[2][:, :2],
        motor_tip=tips[2],
        nozzle=tips[3],
        demand=nothing,
        torque=nothing,
        current=nothing,
        voltage=nothing,
        flow=np.zeros(len(s)),
        flow_demand=np.zeros(len(s)),
        gap=0.5,
        dispense=np.ones(len(s), bool),
        progress=s,
    )


def distances(budget):
    """Distance of the two points that each link lies between, and of command and nozzle as "lag", (m,) each [mm]."""
    run = budget.analysis.run
    spans = {
        "servo": (run.commanded_tip, run.encoder_tip),
        "encoder": (run.encoder_tip, run.motor_tip),
        "structure": (run.motor_tip, run.nozzle),
        "lag": (run.commanded_tip, run.nozzle),
    }
    on = budget.analysis.ticks
    return {link: np.linalg.norm((end - start)[on], axis=1) for link, (start, end) in spans.items()}


def excess(budget):
    """Largest size of each link beyond the distance that it spans, but for the path's curvature [mm]."""
    spans = distances(budget)
    curvature = np.abs(budget.analysis.run.requested.curvature(budget.analysis.nozzle.s))
    found = {}
    for link in ("servo", "encoder", "structure"):
        bound = spans[link] * (1 + 1.5 * curvature * (spans[link] + budget.contour.size))
        found[link] = float((budget.parts[link].size - bound).max())
    return found
