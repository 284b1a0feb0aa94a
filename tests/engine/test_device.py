"""The compiled loop on a GPU, by numba-cuda's simulator: it equals the loop on the processor."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gantrysim import simulate_batch
from gantrysim.base.errors import InputError

from support.runs import ramp
from support.soaked import suite_runs

pytest.importorskip("numba_cuda")

# Python takes a millisecond for a step: short motions, of servos that together have every stage of a device.
COMPARED = """
import os
import sys
import numba
import numpy as np
from gantrysim import Machine, Servo, Setpoints, simulate_batch
from gantrysim.machine.perturbation import Perturbation
from gantrysim.paths.arcs import ArcChain

# now that the cache is open: the variable among those it begins with would make it another one, and empty
os.environ["NUMBA_ENABLE_CUDASIM"] = "1"
numba.config.ENABLE_CUDASIM = 1
PERIOD = 2e-3
OPTIONS = (
    {},
    {"law": ["pid", "friction", "observer", "contour"]},
    {"law": "p-pi", "encoder_noise": 1e-4, "feedback_delay": 2},
    {"feedback": "load", "current_bandwidth": 500.0},
    {"mode": "velocity"},
    {"mode": "position", "delay": PERIOD},
)
xy = Machine("xy")
machines = [xy, xy.perturbed(Perturbation(payload=0.5))]
path = ArcChain((-70.0, 0.0), 0.0, [0.0], [0.5])
for options in (OPTIONS[int(number)] for number in sys.argv[1:]):
    servo = Servo.derive(xy.axes, PERIOD, **options)
    # the second run is shorter
    setpoints = [Setpoints.along(path, speed, PERIOD) for speed in (70.0, 100.0)]
    runs = simulate_batch(machines, servo, setpoints, device="cuda")
    others = simulate_batch(machines, servo, setpoints, engine="loop")
    for run, other in zip(runs, others, strict=True):
        assert np.ptp(other.motor[:, 0]) > 0.1
        for name in ("motor", "encoder", "demand", "nozzle", "current"):
            np.testing.assert_allclose(getattr(run, name), getattr(other, name), rtol=0, atol=1e-9, err_msg=name)
    assert not np.array_equal(runs[0].motor, runs[1].motor)
print("equal")
"""


@pytest.mark.validates(
    "the compiled loop on a GPU, in numba-cuda's simulator",
    "the loop on the processor",
    "1e-6 µm",
)
# a law in torque, and the loop in the drive
@pytest.mark.parametrize("numbers", suite_runs(["0 4", "1 2 3 5"], 0))
def test_a_device_steps_as_the_processor_does(numbers):
    """In a process of its own, as the simulator takes the place of the device for good."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    asked = subprocess.run(
        [sys.executable, "-P", "-c", COMPARED, *numbers.split()],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert asked.stdout == "equal\n", asked.stderr


def test_an_unknown_device_is_refused(xy):
    from gantrysim import Servo

    with pytest.raises(InputError, match="device 'tpu': must be cpu or cuda"):
        simulate_batch(xy, Servo.derive(xy.axes, 1e-3), ramp(50.0), device="tpu")


def test_a_computer_without_a_gpu_is_told_so(xy, monkeypatch):
    from gantrysim import Servo
    from gantrysim.engine.device import cuda

    monkeypatch.setattr(cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match="device 'cuda': there is no NVIDIA GPU with its driver on this computer; "):
        simulate_batch(xy, Servo.derive(xy.axes, 1e-3), ramp(50.0), device="cuda")
