"""Runs setpoints, servo and machine at native speed: the servo lives inside MuJoCo's step."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from gantrysim.controllers.path import Floats
from gantrysim.controllers.servo import PlainLaw, Servo
from gantrysim.controllers.setpoints import MAX_TICKS, Setpoints, ticks
from gantrysim.dispenser import Dispenser
from gantrysim.errors import GantryError, InputError, at_least
from gantrysim.machine import Machine
from gantrysim.native.hook import installed, installed_law
from gantrysim.native.row import (
    ADDRESSES,
    GAINS,
    OVERSPEED,
    ROW,
    ROW_NUMBERS,
    log_width,
)
from gantrysim.native.tick import magic
from gantrysim.recording import fault_of, perfect_record, record
from gantrysim.run import Run

__all__ = ["perfect_follower", "simulate"]

_CALLS = 50
_SHORTEST_STEP = 1e-7  # [s]


def simulate(
    machine: Machine,
    servo: Servo,
    setpoints: Setpoints,
    *,
    physics_step: float | None = None,
    dispenser: Dispenser | None = None,
    law: PlainLaw | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run setpoints on a machine and return the record.

    The machine starts at rest at the first setpoint. At every servo period the encoders are sampled and
    the law's torque demands go out, to be held until the next; the physics makes a whole number of steps
    per period. The record has one row per servo tick, taken at the instant of the sample.

    Args:
        machine: the machine.
        servo: the servo, with as many axes as the machine and the setpoints' period.
        setpoints: commanded positions; axes of the machine that they leave out are held at zero.
        physics_step: longest physics step, at most and by default the timestep of the machine's MJCF; the servo
            period is divided evenly [s].
        dispenser: of the glue; by default there is none.
        law: a law in plain Python instead of the servo's own; slower, and alone in the process.
        progress: called now and then with the share of the job that is done, 0 to 1.

    Returns:
        The record; it is longer than the setpoints by the ticks that the stream waits at their gates. A drive that
        trips ends it there: see `Run.fault`.

    Raises:
        InputError: setpoints that the machine cannot follow: an unknown axis, a position outside the travel,
            a speed above the limit. A dispenser whose start lead is longer than the setpoints wait.
    """
    dispenser = _ready(dispenser, setpoints)
    position = _positions(machine, setpoints)
    if servo.axes != len(machine.axes):
        raise InputError(f"servo has {servo.axes} axes: machine {machine.name} has {len(machine.axes)}")
    if abs(servo.period - setpoints.period) > 1e-12:
        raise InputError(f"setpoints' period = {setpoints.period:g} s: must be the servo period, {servo.period:g} s")
    substeps = ticks(servo.period, _physics_step(machine, physics_step))
    model = machine.stepping(servo.period / substeps)
    data = mujoco.MjData(model)
    data.qpos[:] = machine.to_qpos(position[0])

    n, axes = position.shape
    log = np.empty((_most_ticks(setpoints), log_width(axes)))
    row = data.userdata[:ROW_NUMBERS].view(ROW)
    _fill(row, machine, servo, position, log, substeps)
    _supervise(row, machine, setpoints)
    with installed() if law is None else installed_law(data, law):
        # a few calls instead of one cost nothing, and let Ctrl-C and a fault end the job
        most = max((n - 1) * substeps // _CALLS, 1) + 1
        while row[0]["index"] < n and not row[0]["fault"]:
            begun = int(row[0]["steps"])
            # to the last setpoint, if the stream waits at no gate
            rest = (int(row[0]["tick"] - row[0]["index"]) + n - 1) * substeps + 1 - begun
            mujoco.mj_step(model, data, min(rest, most))
            if row[0]["steps"] == begun:
                break
            if progress is not None:
                progress(float(row[0]["index"]) / n)

    fault = fault_of(machine, servo, row[0], setpoints.supervision.settle_timeout)
    kept = int(row[0]["tick"])
    if row[0]["index"] < n and fault is None:
        raise GantryError(f"the servo of machine {machine.name} ran for {kept} of {n} ticks: MuJoCo did not call it")
    if fault is not None and not np.isfinite(log[kept - 1, : axes + 3]).all():
        kept -= 1  # the tick that saw the divergence has no position to record
    return record(machine, setpoints, position, log[:kept], dispenser, fault)


def perfect_follower(machine: Machine, setpoints: Setpoints, *, dispenser: Dispenser | None = None) -> Run:
    """Return the record of a machine that follows its setpoints exactly, motors and nozzle.

    It shows what the controller's program alone does to the bead. There is no servo and no torque, no tick more than
    there are setpoints, and no fault.

    Args:
        machine: the machine, for its axes and where they put the nozzle.
        setpoints: commanded positions, as for `simulate`.
        dispenser: of the glue; by default there is none.

    Raises:
        InputError: setpoints that the machine cannot follow, as for `simulate`.
    """
    return perfect_record(machine, setpoints, _positions(machine, setpoints), _ready(dispenser, setpoints))


def _ready(dispenser: Dispenser | None, setpoints: Setpoints) -> Dispenser:
    """Return the dispenser, or one that lays nothing, after a look at whether its start lead can be met."""
    ready = Dispenser() if dispenser is None else dispenser
    ready.check(setpoints)
    return ready


def _most_ticks(setpoints: Setpoints) -> int:
    """Return the number of servo ticks if the stream waits at every gate as long as it may."""
    most = len(setpoints.position) + setpoints.gates.size * ticks(
        setpoints.supervision.settle_timeout, setpoints.period
    )
    if most > MAX_TICKS:
        raise InputError(
            f"settle_timeout = {setpoints.supervision.settle_timeout:g} s at each of {setpoints.gates.size} gates: "
            f"makes {most:.3g} ticks, at most {MAX_TICKS:g}"
        )
    return most


def _physics_step(machine: Machine, wanted: float | None) -> float:
    longest = float(machine.model.opt.timestep)
    if wanted is None:
        return longest
    step = at_least("physics_step", wanted, _SHORTEST_STEP, "s")
    if step > longest * (1 + 1e-9):
        raise InputError(
            f"physics_step = {step:g} s: must be at most {longest:g} s, "
            f"the timestep that machine {machine.name} is made for"
        )
    return step


def _positions(machine: Machine, setpoints: Setpoints) -> Floats:
    """Return contiguous positions of all the machine's axes, checked against travel and speed, (n, axes)."""
    names = machine.axis_names
    for name in setpoints.axes:
        if name not in names:
            raise InputError(f"the program moves axis {name!r}: machine {machine.name} has {', '.join(names)}")
    position = np.zeros((len(setpoints.position), len(names)))
    for column, name in enumerate(setpoints.axes):
        position[:, names.index(name)] = setpoints.position[:, column]
    speed = np.abs(np.diff(position, axis=0)) / setpoints.period
    for a, axis in enumerate(machine.axes):
        low, high = axis.travel
        for k in (int(position[:, a].argmin()), int(position[:, a].argmax())):
            if not low <= position[k, a] <= high:
                raise InputError(
                    f"{axis.name} = {position[k, a]:.4g} {axis.unit} at t = {k * setpoints.period:.4g} s: "
                    f"must lie in the travel {low:g} to {high:g} {axis.unit} of machine {machine.name}"
                )
        k = int(speed[:, a].argmax())
        if speed[k, a] > axis.speed_limit * (1 + 1e-9):
            raise InputError(
                f"speed of {axis.name} = {speed[k, a]:.6g} {axis.unit}/s at t = {k * setpoints.period:.4g} s: "
                f"must be at most {axis.speed_limit:.6g} {axis.unit}/s, the limit of machine {machine.name}"
            )
    return position


def _fill(
    row: np.ndarray[tuple[int], np.dtype[np.void]],
    machine: Machine,
    servo: Servo,
    position: Floats,
    log: Floats,
    substeps: int,
) -> None:
    """Write the parameters of a run into a simulation's row; the magic last, which arms it."""
    delay = servo.delay / servo.period * substeps
    if abs(delay - round(delay)) > 1e-6:
        raise InputError(
            f"servo delay = {servo.delay:g} s: must be a multiple of the physics step, {servo.period / substeps:g} s"
        )
    row[:] = np.zeros(1, ROW)
    for name, value in ADDRESSES.items():
        row[name] = value
    row["axes"], row["ticks"], row["substeps"], row["delay"] = len(machine.axes), len(position), substeps, round(delay)
    row["setpoints"], row["log"] = position.ctypes.data, log.ctypes.data
    row["nozzle"], row["work"], row["period"] = machine.nozzle, machine.work, servo.period
    for name in ("resolution", "following_error_limit", *GAINS):
        row[name][0, : servo.axes] = getattr(servo, name)
    # a demand beyond what the drive can give is clamped by the drive itself
    peak = np.array([axis.peak_torque for axis in machine.axes]) / machine.drive_gain
    row["torque_limit"][0, : servo.axes] = np.minimum(servo.torque_limit, peak)
    row["drive_gain"][0, : servo.axes] = machine.drive_gain
    for a, (axis, address) in enumerate(zip(machine.axes, machine.addresses, strict=True)):
        row["control"][0, a], row["output"][0, a], row["current"][0, a] = (
            address.control,
            address.output,
            address.current,
        )
        row["scale"][0, a], row["speed_limit"][0, a] = axis.scale, axis.speed_limit
        row["low"][0, a], row["high"][0, a] = axis.travel
    row["magic"] = magic()


def _supervise(row: np.ndarray[tuple[int], np.dtype[np.void]], machine: Machine, setpoints: Setpoints) -> None:
    """Write what the controller watches besides its servo into a simulation's row."""
    supervision, gates = setpoints.supervision, setpoints.gates
    row["supervised"] = supervision.position_error < np.inf or gates.size > 0
    row["position_error"], row["position_error_delay"] = supervision.position_error, supervision.position_error_delay
    row["gates"], row["gate_count"], row["settle_error"] = gates.ctypes.data, gates.size, supervision.settle_error
    row["settle_ticks"] = ticks(supervision.settle_time, setpoints.period)
    row["timeout_ticks"] = ticks(supervision.settle_timeout, setpoints.period)
    for a, axis in enumerate(machine.axes):
        row["linear"][0, a] = axis.unit == "mm"
        if axis.unit == "mm":
            row["speed_limit"][0, a] = min(axis.speed_limit, supervision.velocity_limit / OVERSPEED)
