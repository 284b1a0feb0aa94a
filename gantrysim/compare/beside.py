"""The records of a measured and of a simulated run, at the same instants.

The measured samples are never interpolated: the simulation, which is smooth, is taken at their instants.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.compare.alignment import Alignment, turned
from gantrysim.compare.measured import Trace
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run

_UNEVEN = 0.01  # of a period, between samples of one rate


def beside(trace: Trace, alignment: Alignment, run: Run, machine: Machine) -> tuple[Run, Run]:
    """Return the records of the measured and of the simulated run, at the trace's instants that both cover.

    A link that is not measured repeats the link before it, in both runs, so that its share is zero: without
    the encoder, the nozzle's whole deviation from the command is structure; without the nozzle, the rigid machine's at
    the encoder is the nozzle. Of an encoder that is measured on some axes alone, the others are the command. Command,
    dispenser and flow are the simulation's unless the command is measured. What no link needs is nan.

    Raises:
        InputError: the dispenser is off for as long as both last.
    """
    instants = trace.time - alignment.shift
    rows = np.flatnonzero((instants >= run.time[0]) & (instants <= run.time[-1]))
    instants = instants[rows]
    period = float(np.median(np.diff(trace.time)))
    tick = np.clip(np.floor(instants / run.period + 1e-6).astype(int), 0, len(run.time) - 1)
    if not run.dispense[tick].any():
        bead = run.time[np.flatnonzero(run.dispense)[[0, -1]]]
        raise InputError(
            f"the trace covers {instants[0]:.4g} to {instants[-1]:.4g} s of the run, in which the dispenser is off: "
            f"must cover some of {bead[0]:.4g} to {bead[1]:.4g} s"
        )
    simulated = {name: CubicSpline(run.time, getattr(run, name), axis=0)(instants) for name in ("commanded", "encoder")}
    measured: dict[str, Floats] = {"commanded": simulated["commanded"]}
    if "commanded" in trace.axes:
        commanded = trace.axes["commanded"][rows] - alignment.offsets["axes"]
        measured["commanded"] = np.where(np.isnan(commanded), simulated["commanded"], commanded)
    if "encoder" in trace.axes:
        encoder = trace.axes["encoder"][rows] - alignment.offsets["axes"]
        missing = np.isnan(encoder)
        measured["encoder"] = np.where(missing, measured["commanded"], encoder)
        simulated["encoder"] = np.where(missing, simulated["commanded"], simulated["encoder"])
    else:
        measured["encoder"] = measured["commanded"]
        simulated["encoder"] = simulated["commanded"]
    records = []
    for chain, actual in ((measured, True), (simulated, False)):
        tips = {link: machine.tip(chain[link]) for link in ("commanded", "encoder")}
        if trace.nozzle is None:
            nozzle = tips["encoder"]
        elif actual:
            nozzle = turned(trace.nozzle[rows] - alignment.offsets["nozzle"], -np.radians(alignment.rotation))
            nozzle = np.where(np.isnan(nozzle), tips["commanded"], nozzle)
        else:
            nozzle = CubicSpline(run.time, run.nozzle, axis=0)(instants)
            nozzle = np.where(np.isnan(trace.nozzle[rows]), tips["commanded"], nozzle)
        # a trace cannot separate errors of the geometry from structure
        columns: dict[str, Any] = {
            "geometric_tip": None,
            **chain,
            **dict.fromkeys(("demand", "torque", "current", "voltage"), np.full_like(chain["encoder"], np.nan)),
        }
        records.append(
            replace(
                run,
                period=period,
                time=instants,
                **columns,
                motor=chain["encoder"],
                commanded_tip=tips["commanded"],
                encoder_tip=tips["encoder"],
                motor_tip=tips["encoder"],
                nozzle=nozzle,
                flow=run.flow[tick],
                flow_demand=run.flow_demand[tick],
                dispense=run.dispense[tick],
                progress=None if run.progress is None else np.interp(instants, run.time, run.progress),
            )
        )
    return records[0], records[1]


def evenly(time: Floats) -> bool:
    """Return whether samples have one rate."""
    steps = np.diff(time)
    return bool(np.ptp(steps) <= _UNEVEN * np.median(steps))
