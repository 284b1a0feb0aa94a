"""Faults on purpose in the engine: entries of the servo tick, models of stuck axes, drives, and the flow of glue."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.faults import (
    AirBubble,
    BusSag,
    CloggedNozzle,
    DrippingNozzle,
    EncoderDropout,
    EncoderGlitch,
    EncoderSlip,
    InjectedFault,
    LostPackets,
    OpenWinding,
    SlippingAxis,
    StuckAxis,
)
from gantrysim.machine.machine import Machine
from gantrysim.native.row import BUS, DROPOUT, EXTRAPOLATED, HELD, INJECTED, NEVER, OFFSET, SLIP, WINDING
from gantrysim.servo.servo import Servo

_SEIZED = 1e9  # friction of a seized axis [N or N·m]
_RIGID = (0.9999, 0.9999, 0.001, 0.5, 2)  # impedance of its friction; MuJoCo's own lets it creep
_OFF = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)


def no_entries() -> NDArray[np.void]:
    """Return the entries of no faults, (0,) of `INJECTED`."""
    return np.zeros(0, INJECTED)


def injected_entries(faults: Sequence[InjectedFault], machine: Machine, servo: Servo) -> NDArray[np.void]:
    """Return the faults that act in the servo tick, an entry per fault and axis, (entries,) of `INJECTED`.

    Raises:
        InputError: counts of an axis without an encoder's counts, a bus sag of an ideal torque source, or an electrical
            fault of a machine with delayed actuators, whose voltage the tick does not set.
    """
    entries = []
    for fault in faults:
        for a in _axes(fault, machine):
            kind, value = _kind(fault, machine, servo, a)
            if kind and fault.acts:
                axis, (begin, end) = machine.plain_axes[a], fault.acting(servo.period)
                entries.append(
                    (kind, a, min(begin, NEVER), min(end, NEVER), value, axis.motor_constant, axis.resistance)
                )
    return np.array(entries, INJECTED)


def _axes(fault: InjectedFault, machine: Machine) -> list[int]:
    """Return the axes of a fault; none of one of the dispenser."""
    if not hasattr(fault, "axis"):
        return []
    return list(range(len(machine.plain_axes))) if fault.axis is None else [machine.axis_names.index(fault.axis)]


def _kind(fault: InjectedFault, machine: Machine, servo: Servo, a: int) -> tuple[int, float]:
    """Return what a fault does in the tick, 0 for nothing, and its value."""
    axis = machine.axes[a]
    if isinstance(fault, OpenWinding | BusSag) and axis.motion is None:
        raise InputError(f"fault {fault.kind}: machine {machine.name} has an actuator with a delay of its own")
    if isinstance(fault, OpenWinding | BusSag) and servo.mode[a] == "stepper":
        if fault.axis is None and set(servo.mode) != {"stepper"}:
            return 0, 0.0
        raise InputError(f"fault {fault.kind}: axis {axis.name} is a stepper in open loop; of a servo axis only")
    match fault:
        case EncoderDropout():
            return DROPOUT, 0.0
        case EncoderGlitch() | EncoderSlip():
            if not servo.resolution[a]:
                raise InputError(f"fault {fault.kind}: axis {axis.name} has no encoder counts; its position is exact")
            return OFFSET, fault.counts * servo.resolution[a]
        case SlippingAxis():
            return SLIP, fault.offset
        case LostPackets():
            return HELD if fault.drive == "hold" else EXTRAPOLATED, 0.0
        case OpenWinding():
            return WINDING, 0.0
        case BusSag():
            if not np.isfinite(axis.bus_voltage):
                if fault.axis is None and any(np.isfinite(one.bus_voltage) for one in machine.plain_axes):
                    return 0, 0.0
                raise InputError(f"fault {fault.kind}: axis {axis.name} is an ideal torque source, it has no bus")
            return BUS, fault.share * axis.bus_voltage
        case _:
            return 0, 0.0


def stuck_models(
    faults: Sequence[InjectedFault], machine: Machine, plain: mujoco.MjModel, period: float, substeps: int
) -> tuple[tuple[int, mujoco.MjModel], ...]:
    """Return the models of a run with stuck axes, made from a plain one: physics steps before each, and the model.

    A stuck axis has MuJoCo's dry friction (`frictionloss`), solved with all other forces, in the joint of its axis. It
    stands in the model, not in the state, so the run changes models, each a copy of its own, at the faults' ends.

    Raises:
        InputError: the machine's MJCF disables dry friction.
    """
    stuck = [(fault, *fault.acting(period)) for fault in faults if isinstance(fault, StuckAxis) and fault.acts]
    if stuck and plain.opt.disableflags & _OFF:
        raise InputError(f"fault {stuck[0][0].kind}: the MJCF of machine {machine.name} disables dry friction")
    models = []
    for edge in sorted({edge for _, begin, end in stuck for edge in (begin, end) if edge < NEVER}):
        model = copy.copy(plain)
        for fault, begin, end in stuck:
            if begin <= edge < end:
                joint = model.actuator_trnid[machine.axis_names.index(fault.axis), 0]
                dof = model.jnt_dofadr[joint]
                model.dof_frictionloss[dof] += min(fault.friction, _SEIZED)
                model.dof_solref[dof] = 2 * model.opt.timestep, 1.0
                model.dof_solimp[dof] = _RIGID
        models.append((int(edge) * substeps, model))
    return tuple(models)


def stretches(
    faults: Sequence[InjectedFault], axes: Sequence[str], period: float, ticks: range, drives: Floats
) -> Iterator[tuple[int, int, Floats]]:
    """Yield the stretches of ticks between electrical faults: first tick, the one after the last, and the drives.

    Args:
        faults: faults on purpose.
        axes: names of the axes.
        period: servo period [s].
        ticks: servo ticks, each after the one before.
        drives: of each healthy axis, (axes, 7), see `gantrysim.engine.recording`.
    """
    electrical = [(f, *f.acting(period)) for f in faults if isinstance(f, OpenWinding | BusSag) and f.acts]
    edges = {ticks.start, ticks.stop}
    edges |= {int(end) for _, *ends in electrical for end in ends if ticks.start < end < ticks.stop}
    for first, after in zip(sorted(edges)[:-1], sorted(edges)[1:], strict=True):
        own = drives.copy()
        bus = drives[:, 3].copy()
        for fault, begin, end in electrical:
            for a, name in enumerate(axes):
                if begin <= first < end and fault.axis in (None, name):
                    if isinstance(fault, OpenWinding):
                        own[a, 0] = 0.0
                    else:
                        own[a, 3] = min(own[a, 3], fault.share * bus[a])
        yield first, after, own


def faulted_flow(faults: Sequence[InjectedFault], flow: Floats, valve: Floats, period: float) -> Floats:
    """Return the flow out of a nozzle with faults, the mean over the period after each tick, (n,) [mm³/s].

    What drips is added first, then bubbles pass, and a clogged nozzle holds back its share of all that.

    Args:
        faults: faults on purpose.
        flow: flow without them, (n,) [mm³/s].
        valve: share of the period for which the valve is open, (n,).
        period: servo period [s].
    """
    acting = [fault for fault in faults if fault.acts]
    edges: Floats = np.arange(flow.size + 1, dtype=np.float64) * period
    for drip in (fault for fault in acting if isinstance(fault, DrippingNozzle)):
        flow = flow + drip.flow * np.minimum(1 - valve, _overlap(drip, edges))
    for bubble in (fault for fault in acting if isinstance(fault, AirBubble)):
        flow = _after_bubble(bubble, flow, edges)
    for clog in (fault for fault in acting if isinstance(fault, CloggedNozzle)):
        flow = flow * (1 - (1 - clog.share) * _overlap(clog, edges))
    return flow


def _overlap(fault: CloggedNozzle | DrippingNozzle, edges: Floats) -> Floats:
    """Return the share of every period for which a fault acts, (n,)."""
    inside = np.clip(edges, fault.time, fault.time + fault.duration)
    return np.diff(inside) / np.diff(edges)


def _after_bubble(bubble: AirBubble, flow: Floats, edges: Floats) -> Floats:
    """Return the flow with a bubble, see `AirBubble`."""
    volume = np.concatenate([[0.0], np.cumsum(flow * np.diff(edges))])
    before = float(np.interp(bubble.time, edges, volume))
    gone = before + bubble.volume + bubble.compression  # volume displaced by when it has left
    k = int(np.searchsorted(volume, gone))
    laid = np.minimum(volume, before)
    if k < volume.size:
        left = float(edges[k - 1] + (gone - volume[k - 1]) / flow[k - 1])
        surge = -np.expm1(-np.maximum(edges - left, 0.0) / bubble.recovery)
        laid = laid + np.maximum(volume - gone, 0.0) + bubble.compression * surge
    first = int(np.searchsorted(edges, bubble.time, "right")) - 1  # what came before keeps its last bit
    return np.concatenate([flow[:first], np.maximum(np.diff(laid[first:]) / np.diff(edges[first:]), 0.0)])
