"""How far each slider of the workbench reaches about the job's own value, and that a page cannot send more."""

import pytest

from gantrysim import Job
from gantrysim.base.errors import InputError
from gantrysim.live.controls import checked_values, controls_of

# factors of the job's own value, distances from it, or bounds that hold whatever it is
FACTORS = {
    "program.acceleration": (0.1, 10),
    "program.group.acceleration": (0.1, 10),
    "program.initial_acceleration": (0.1, 10),
    "program.corner_radius": (0.1, 10),
    "servo.frequency": (0.25, 4),
    "servo.integral_time": (0.1, 10),
    "servo.period": (0.25, 4),
    "dispenser.flow": (0.1, 10),
    "dispenser.area": (0.1, 10),
    "bead.gap": (0.25, 4),
}
DISTANCES = {"program.placement.x": 200, "program.placement.y": 200, "program.placement.rotate": 180}
BOUNDS = {
    "program.corner_tolerance": (0, 1),
    "program.blend_time": (0, 0.1),
    "program.loop_period": (0.002, 0.2),
    "servo.damping": (0.2, 2),
    "dispenser.advance": (0, 0.2),
    "dispenser.start_lead": (0, 0.2),
    "dispenser.stop_lead": (0, 0.2),
}


@pytest.mark.parametrize(
    "name",
    [
        "an225",
        "linuxcnc-flanges",
        "slicer-square",
        "softmc-arc",
        "fanuc-spiral",
        "stage-outline",
        "trio-basic",
    ],
)
def test_a_slider_reaches_as_far_as_it_should(name):
    job = Job.load(name)
    controls = {control.key: control for control in controls_of(job, job, 100.0)}
    numbers = {key: control for key, control in controls.items() if not control.options}
    assert len(numbers) > 8
    for key, control in numbers.items():
        if key in FACTORS:
            expected = tuple(factor * control.initial for factor in FACTORS[key])
        elif key in DISTANCES:
            expected = (control.initial - DISTANCES[key], control.initial + DISTANCES[key])
        elif key in BOUNDS:
            low, high = BOUNDS[key]
            expected = (min(low, control.initial), max(high, control.initial))
        else:
            assert key == "override"
            expected = (10, 300)
        assert (control.low, control.high) == pytest.approx(expected), key
        for value, beyond in ((control.low, -1.0), (control.high, 1.0)):
            assert checked_values({key: value}, [control]) == {key: value}
            with pytest.raises(InputError, match=key.replace(".", r"\.")):
                checked_values({key: value + beyond * max(1e-3 * abs(value), 1e-6)}, [control])
