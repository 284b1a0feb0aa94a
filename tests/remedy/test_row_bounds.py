"""What keeps a row of the verdict from passing, said with its numbers."""

import math

import pytest

from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.bounds import _lag_text, bound_of

from support.remedies import fixed_flow, lagging, rubbing, spiral_job


def test_a_path_is_bound_by_its_largest_link():
    """On a circle, friction acts through the servo; the program is followed but for 3 nm."""
    sizes = {name: 1e3 * part.rms for name, part in Budget(rubbing().run()).part_values.items()}
    assert sizes["servo"] > 10 * max(size for name, size in sizes.items() if name != "servo")
    assert bound_of(rubbing(), "path") == f"the servo link, {sizes['servo']:.1f} µm rms of the error"


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ({"dead_time": 0.005}, "which lags by 5 ms dead time"),
        ({"opening": 0.02, "closing": 0.0123}, "which lags by 20 ms opening, 12.3 ms closing"),
        # that of closing is the other where it is not given
        ({"dead_time": 0.004, "closing_dead_time": 0.004}, "which lags by 4 ms dead time"),
        ({"dead_time": 0.004, "closing_dead_time": 0.006}, "which lags by 4 ms dead time, 6 ms dead time of closing"),
    ],
)
def test_each_time_of_a_valve_that_lags_is_named(times, words):
    assert _lag_text(Dispenser(area=2.0, **times)) == words


def test_glue_is_bound_by_the_lag_or_by_the_speed_of_the_program():
    lag = "5 ms dead time, 20 ms opening, 20 ms closing"
    assert bound_of(lagging(), "glue") == f"the dispenser, which lags by {lag}"
    assert bound_of(fixed_flow(), "glue") == "the program link: its speed changes more than the bead admits"


def test_margins_and_drives_are_bounds_of_their_rows():
    assert bound_of(rubbing(), "stability") == "the servo: its loops have too little margin"
    assert bound_of(rubbing(), "machine") == "the drives: their torque or speed has too little reserve"
    jumps = spiral_job(acceleration=math.inf)
    assert bound_of(jumps, "machine") == "the program: it limits no acceleration, so that its speed jumps"
