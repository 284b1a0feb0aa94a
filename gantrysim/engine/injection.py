"""Deliberate faults in the engine: entries of the servo tick, models, drives, and the flow of glue."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.engine.native.functions import fault_stage
from gantrysim.engine.native.stages import Stage
from gantrysim.faults import InjectedFault, in_acting_order
from gantrysim.faults.fault import FaultAxis
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import FAULT, NEVER
from gantrysim.servo.servo import Servo

_GAIN = 0  # columns of the drives
_BUS = 3
_CONSTRAINTS_OFF = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)


class Injection(NamedTuple):
    """The deliberate faults that act in the servo tick.

    Attributes:
        faults: of each entry.
        entries: an entry per fault and axis, (entries,) of `FAULT`.
    """

    faults: tuple[InjectedFault, ...]
    entries: NDArray[np.void]

    def stages(self) -> list[Stage]:
        """Return the stages of the tick; the entries must be kept alive as long as they are in use."""
        return [
            Stage(point, fault_stage(function), self.entries[k : k + 1].ctypes.data)
            for k, fault in enumerate(self.faults)
            for point, function in fault.stages
        ]


NONE = Injection((), np.zeros(0, FAULT))


def injection(faults: Sequence[InjectedFault], machine: Machine, servo: Servo) -> Injection:
    """Return the faults that act in the servo tick.

    Raises:
        InputError: an axis that cannot have one of them.
    """
    # the axes of a perturbed machine take time to compute
    if not faults:
        return NONE
    axes = _fault_axes(machine, servo)
    acting: list[InjectedFault] = []
    entries = []
    for fault in in_acting_order(faults):
        for a in _numbers(fault, machine):
            value = fault.tick_value(axes[a], axes)
            if value is None or not fault.acts or not fault.stages:
                continue
            begin, end = fault.acting(servo.period)
            axis = machine.plain_axes[a]
            entries.append((a, min(begin, NEVER), min(end, NEVER), value, axis.motor_constant, axis.resistance))
            acting.append(fault)
    return Injection(tuple(acting), np.array(entries, FAULT)) if entries else NONE


def _fault_axes(machine: Machine, servo: Servo) -> list[FaultAxis]:
    return [
        FaultAxis(machine.name, axis.name, drive.resolution, axis.bus_voltage, drive.mode, axis.motion is None)
        for axis, drive in zip(machine.axes, servo.drives, strict=True)
    ]


def _numbers(fault: InjectedFault, machine: Machine) -> list[int]:
    """Return the numbers of the axes of a fault; none of one of the dispenser."""
    if not hasattr(fault, "axis"):
        return []
    return list(range(len(machine.plain_axes))) if fault.axis is None else [machine.axis_names.index(fault.axis)]


class Change(NamedTuple):
    """A change of a machine, or of its model, in a run.

    Attributes:
        step: number of physics steps before it.
        machine: the machine after it.
        model: its model with faults, None for its own.
    """

    step: int
    machine: Machine
    model: mujoco.MjModel | None = None


def faulted_models(
    faults: Sequence[InjectedFault], machine: Machine, plain: mujoco.MjModel, period: float, substeps: int
) -> tuple[Change, ...]:
    """Return the changes of a run with faults in the model.

    Such a fault, friction for one, stands in the model, not in the state. So the run changes models, each a copy of the
    plain one, where such faults begin and end.

    Raises:
        InputError: the machine's MJCF disables dry friction.
    """
    changing = [(fault, *fault.acting(period)) for fault in faults if fault.in_model and fault.acts]
    if changing and plain.opt.disableflags & _CONSTRAINTS_OFF:
        raise InputError(f"fault {changing[0][0].kind}: the MJCF of machine {machine.name} disables dry friction")
    models = []
    for edge in sorted({edge for _, begin, end in changing for edge in (begin, end) if edge < NEVER}):
        model = copy.copy(plain)
        for fault, begin, end in changing:
            if begin <= edge < end:
                for a in _numbers(fault, machine):
                    fault.change_model(model, a)
        models.append(Change(int(edge) * substeps, machine, model))
    return tuple(models)


def stretches(
    faults: Sequence[InjectedFault], axes: Sequence[str], period: float, ticks: range, drives: Floats
) -> Iterator[tuple[int, int, Floats]]:
    """Yield the stretches of ticks between faults in the drives: first tick, the one after the last, and the drives.

    Args:
        faults: deliberate faults.
        axes: names of the axes.
        period: servo period [s].
        ticks: servo ticks, each after the one before.
        drives: of each healthy axis, (axes, 7), see `gantrysim.engine.recording`.
    """
    electrical = [(fault, *fault.acting(period)) for fault in faults if fault.in_drive and fault.acts]
    edges = {ticks.start, ticks.stop}
    edges |= {int(end) for _, *ends in electrical for end in ends if ticks.start < end < ticks.stop}
    for first, after in zip(sorted(edges)[:-1], sorted(edges)[1:], strict=True):
        faulted = drives.copy()
        for fault, begin, end in electrical:
            if not begin <= first < end:
                continue
            for a, name in enumerate(axes):
                if getattr(fault, "axis", None) in (None, name):
                    healthy = faulted[a].copy()
                    gain, bus = fault.drive_left(healthy[_GAIN], healthy[_BUS], drives[a, _BUS])
                    faulted[a, _GAIN] = gain
                    faulted[a, _BUS] = bus
        yield first, after, faulted


def faulted_flow(faults: Sequence[InjectedFault], flow: Floats, valve: Floats, period: float) -> Floats:
    """Return the flow out of a nozzle with faults, the mean over the period after each tick, (n,) [mm³/s].

    What drips is added first, then bubbles pass, and a clogged nozzle holds back its share of all that.

    Args:
        faults: deliberate faults.
        flow: flow without them, (n,) [mm³/s].
        valve: share of the period for which the valve is open, (n,).
        period: servo period [s].
    """
    edges: Floats = np.arange(flow.size + 1, dtype=np.float64) * period
    for fault in in_acting_order(faults):
        if fault.acts:
            flow = fault.flow_left(flow, valve, edges)
    return flow
