"""Places that a GPU steps by the compiled loop, with numba-cuda: a thread steps one simulation, with its servo.

The functions are those of `tick`, `plant`, and of the laws and drives, compiled anew for the device, with all that they
call. A device has no table of C functions: the stages of the runs that it steps together are composed to one function.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from inspect import getclosurevars
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba import config
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.engine.advance import Numbers
from gantrysim.engine.drives import DRIVE
from gantrysim.engine.native import plant, tick
from gantrysim.engine.native.functions import take
from gantrysim.engine.native.plant import PLANT
from gantrysim.engine.native.stages import Body
from gantrysim.engine.places import LoopPlaces
from gantrysim.machine.row import LAW, LOG_AXIS, LOG_TICK, POINTS, ROW, Log
from gantrysim.servo.gains import GAIN_NAMES, Gains

LOG_ROOM = 4e9  # for the logs of the simulations that are stepped together [bytes]

with extra("cuda", 'device "cuda"'):
    from numba import cuda

THREADS = 64  # of a block


def _floor(number):
    return cuda.libdevice.floor(number)


def _sign(number):
    return math.copysign(1.0, number) if abs(number) > 0.0 else number


class _Numpy(ModuleType):
    """NumPy for a device, which has its functions of numbers by other names."""

    exp = math.exp
    log = math.log
    sqrt = math.sqrt
    sin = math.sin
    cos = math.cos
    isfinite = math.isfinite

    def __init__(self) -> None:
        super().__init__("numpy")
        self.floor = cuda.jit(device=True)(_floor)
        self.sign = cuda.jit(device=True)(_sign)

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)


class DeviceTape(NamedTuple):
    """What the stages of one simulation act on, see `gantrysim.machine.row.Tape`.

    Attributes:
        setpoints: positions of the axes, (n, axes) [mm or deg].
        gates: setpoints at which the stream waits, (gates,).
        log: the log.
        torque: sent with the setpoints, (n, axes), or of no setpoint [N·m].
        laws: of the axes, (axes,) of `LAW`, or of none.
        drives: of the axes, (axes,) of `DRIVE`, or of none.
    """

    setpoints: Floats
    gates: NDArray[np.int64]
    log: Log
    torque: Floats
    laws: NDArray[np.void]
    drives: NDArray[np.void]


@cache
def kernel(bodies: tuple[tuple[str, Body], ...]) -> Any:
    """Return the kernel for runs with some stages, as points of the tick and what acts there.

    Its arguments are, for each simulation: plants, states, rows, setpoints, gates, log of the machine, log of the axes,
    torques, laws and drives; then the number of physics steps.
    """
    others: dict[str, Any] = {"call": _function(_call_nothing, {}), "gains_of": _gains()}
    others["run_stages"] = _composed_stages(bodies, others)
    sense, sample, apply_law, command, output, follow = (
        _function(function, others)
        for function in (plant.sense, tick.sample, tick.apply_law, tick.command, tick.output, plant.follow)
    )
    missed = plant.MISSED

    def run(plants, states, rows, setpoints, gates, log, axis_log, torque, laws, drives, steps):
        number = cuda.grid(1)
        if number >= rows.shape[0]:
            return
        machine = plants[number]
        state = states[number]
        row = rows[number]
        tape = DeviceTape(
            setpoints[number],
            gates[number],
            Log(log[number], axis_log[number]),
            torque[number],
            laws[number],
            drives[number],
        )
        for _ in range(steps):
            if row.fault != 0 or row.index >= row.ticks or row.stops == missed:
                return
            sense(machine, state, row)
            if row.phase == 0 and sample(row, tape):
                apply_law(row, tape)
                command(row, tape)
            output(row, tape)
            follow(machine, state, row)

    return cuda.jit(run)


def _call_nothing(address, row, argument):
    """Stand for the call of an observer, which a device does not have."""


def _function(function: Any, others: Mapping[str, Any]) -> Any:
    """Return a compiled or plain function compiled for the device, with all that it calls.

    Args:
        function: the function.
        others: functions by the names of globals that they take the place of.
    """
    plain = getattr(function, "py_func", function)
    names = dict(plain.__globals__)
    for name, value in getclosurevars(plain).globals.items():
        if name in others:
            names[name] = others[name]
        elif hasattr(value, "py_func") or isinstance(value, FunctionType):
            names[name] = _function(value, others)
    # the simulator calls plain functions
    if "np" in names and not config.ENABLE_CUDASIM:
        names["np"] = _Numpy()
    copy = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, plain.__closure__)
    return cuda.jit(device=True)(copy)


def _composed_stages(bodies: Sequence[tuple[str, Body]], others: Mapping[str, Any]) -> Any:
    """Return a function of (row, tape, point) that runs the stages of a point, in their order."""

    def nothing(row, tape, point):
        pass

    before = cuda.jit(device=True)(nothing)
    # what a drive runs of the tick at its own samples are faults, which a device does not have
    within = {**others, "run_stages": before}
    for point, body in bodies:
        act = _KINDS[body.kind](_function(body.function, within))
        before = _after(before, np.int64(POINTS.index(point)), cuda.jit(device=True)(act))
    return before


def _after(before: Any, number: np.int64, act: Any) -> Any:
    def stages(row, tape, point):
        before(row, tape, point)
        if point == number:
            act(row, tape)

    return cuda.jit(device=True)(stages)


def _leading(count: int) -> Any:
    """Return a function of an array that returns its first numbers as a tuple."""
    if count == 1:
        return cuda.jit(device=True)(lambda array: (array[0],))
    before = _leading(count - 1)
    last = count - 1
    return cuda.jit(device=True)(lambda array: (*before(array), array[last]))


def _gains() -> Any:
    """Return `gains_of` for a device, which does not have the intrinsic that makes a tuple of an array."""
    leading = _leading(len(GAIN_NAMES))

    def gains_of(row, axis):
        return Gains(*leading(row.gains[axis]))

    return cuda.jit(device=True)(gains_of)


def _base(function: Any) -> Callable[..., None]:
    gains = _gains()
    taken = _function(take, {})

    def act(row, tape):
        for axis in range(row.axes):
            torque, integral = function(row, axis, gains(row, axis))
            taken(row, axis, torque, integral)

    return act


def _laws(function: Any) -> Callable[..., None]:
    def act(row, tape):
        function(row, tape.laws)

    return act


def _drives(function: Any) -> Callable[..., None]:
    def act(row, tape):
        for axis in range(row.axes):
            function(row, tape, axis, tape.drives[axis])

    return act


def _tape(function: Any) -> Callable[..., None]:
    def act(row, tape):
        function(row, tape)

    return act


_KINDS = {"base": _base, "laws": _laws, "drives": _drives, "tape": _tape}


def check_device() -> None:
    """Raise InputError unless there is a GPU that numba-cuda can use."""
    if not cuda.is_available():
        raise InputError(
            "device 'cuda': there is no NVIDIA GPU with its driver on this computer; engine=\"loop\" makes the same "
            "steps on the processor"
        )


class DevicePlaces(LoopPlaces):
    """Places that a GPU steps, one simulation in each of its threads; a stop that one reaches is MuJoCo's.

    Rows, states and logs are copied to the device and back in every call, so that whole runs are stepped soonest.
    Simulations with the same stages are stepped together.
    """

    # the whole of every run
    most_steps = 2**40

    def _loop(self, steps: int, numbers: Numbers) -> None:
        groups: dict[Any, list[int]] = {}
        for number in numbers.tolist():
            groups.setdefault(self.runs[number].bodies, []).append(number)
        for bodies, group in groups.items():
            run = self.runs[group[0]]
            size = (len(run.simulation.log.tick)) * (LOG_TICK.itemsize + run.simulation.servo.axes * LOG_AXIS.itemsize)
            together = max(int(LOG_ROOM // max(size, 1)), 1)
            for first in range(0, len(group), together):
                self._step_group(bodies, group[first : first + together], steps)

    def _step_group(self, bodies: Any, numbers: Sequence[int], steps: int) -> None:
        """Step simulations with the same stages on the device.

        Args:
            bodies: of the stages.
            numbers: of the simulations.
            steps: number of physics steps.
        """
        runs = [self.runs[number] for number in numbers]
        logs = [run.simulation.log for run in runs]
        axes = runs[0].simulation.servo.axes
        plants = np.concatenate([self._linear[number].plant for number in numbers], dtype=PLANT)
        states = self._state["physics"][list(numbers)]
        rows = self._userdata[list(numbers)].view(ROW)[:, 0]
        tapes = (
            _stacked_arrays([run.simulation.position for run in runs]),
            _stacked_arrays([run.simulation.setpoints.gates for run in runs]),
            _stacked_arrays([log.tick for log in logs]),
            _stacked_arrays([log.axis for log in logs]),
            _stacked_arrays([_or_none(run.simulation.torque, (0, axes), np.float64) for run in runs]),
            _stacked_arrays([_or_none(run.laws, (0,), LAW) for run in runs]),
            _stacked_arrays([_or_none(run.drives, (0,), DRIVE) for run in runs]),
        )
        machines = cuda.to_device(plants)
        stepped = [cuda.to_device(array) for array in (states, rows)]
        on_device = [cuda.to_device(array) for array in tapes]
        kernel(bodies)[-(-len(numbers) // THREADS), THREADS](machines, *stepped, *on_device, steps)
        self._state["physics"][list(numbers)] = stepped[0].copy_to_host()
        self._userdata[list(numbers)] = stepped[1].copy_to_host()[:, None].view(np.float64)
        _, _, ticks, of_axes, _, laws, drives = (array.copy_to_host() for array in on_device)
        for k, (run, log) in enumerate(zip(runs, logs, strict=True)):
            log.tick[:] = ticks[k, : len(log.tick)]
            log.axis[:] = of_axes[k, : len(log.axis)]
            for state, after in ((run.laws, laws), (run.drives, drives)):
                if state is not None:
                    state[:] = after[k]


def _or_none(array: NDArray[Any] | None, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    return np.zeros(shape, kind) if array is None else array


def _stacked_arrays(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays as one, (arrays, longest, ...); shorter ones with zeros behind them."""
    longest = max(len(array) for array in arrays)
    stacked = np.zeros((len(arrays), longest, *arrays[0].shape[1:]), arrays[0].dtype)
    for k, array in enumerate(arrays):
        stacked[k, : len(array)] = array
    return stacked
