"""Places that a GPU steps, by the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError
from gantrysim.engine.advance import Numbers
from gantrysim.engine.drives import DRIVE
from gantrysim.engine.native.device import THREADS, cuda, kernel
from gantrysim.engine.native.plant import PLANT
from gantrysim.engine.places import LoopPlaces
from gantrysim.machine.row import LAW, LOG_AXIS, LOG_TICK, ROW

ROOM = 4e9  # for the logs of the simulations that are stepped together [bytes]


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
            together = max(int(ROOM // max(size, 1)), 1)
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
            _stacked([run.simulation.position for run in runs]),
            _stacked([run.simulation.setpoints.gates for run in runs]),
            _stacked([log.tick for log in logs]),
            _stacked([log.axis for log in logs]),
            _stacked([_or_none(run.simulation.torque, (0, axes), np.float64) for run in runs]),
            _stacked([_or_none(run.laws, (0,), LAW) for run in runs]),
            _stacked([_or_none(run.drives, (0,), DRIVE) for run in runs]),
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


def _stacked(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays as one, (arrays, longest, ...); shorter ones with zeros behind them."""
    longest = max(len(array) for array in arrays)
    stacked = np.zeros((len(arrays), longest, *arrays[0].shape[1:]), arrays[0].dtype)
    for k, array in enumerate(arrays):
        stacked[k, : len(array)] = array
    return stacked
