"""A job that is reached by one change after the other is the one that is reached at once."""

import numpy as np
import pytest

from gantrysim.live.draft import Draft

CHANGES = {
    "fanuc-spiral": ({"program.acceleration": 800.0}, {"program.acceleration": 1500.0, "servo.damping": 0.8}),
    "linuxcnc-flanges": ({"program.acceleration": 700.0}, {"program.acceleration": 700.0, "servo.damping": 0.8}),
    "softmc-arc": ({"servo.damping": 0.9}, {"program.group.acceleration": 900.0, "dispenser.start_lead": 0.05}),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_shared_with_the_job_before_changes_nothing(name, tmp_path):
    opened = Draft(name).opened(tmp_path, allow_code=False)
    latest = opened
    for values, override in zip(({}, *CHANGES[name]), (100.0, 100.0, 80.0), strict=True):
        draft = Draft(name, values=values, override=override)
        latest = draft.job(opened, latest).sharing(latest)
        alone = draft.job(draft.opened(tmp_path, allow_code=False))
        assert latest.toml() == alone.toml()
        assert latest.start_wait == alone.start_wait
        for column in ("position", "dispense", "progress"):
            np.testing.assert_array_equal(getattr(latest.setpoints, column), getattr(alone.setpoints, column))
        s = np.linspace(0, alone.setpoints.requested.length, 50)
        np.testing.assert_array_equal(latest.setpoints.requested.position(s), alone.setpoints.requested.position(s))


def test_a_servo_value_keeps_the_setpoints_and_a_lead_does_not(tmp_path):
    opened = Draft("an225").opened(tmp_path, allow_code=False)
    first = opened.setpoints
    assert Draft("an225", values={"servo.damping": 0.8}).job(opened).sharing(opened).setpoints is first
    led = Draft("an225", values={"dispenser.start_lead": 0.4}).job(opened).sharing(opened)
    assert len(led.setpoints.position) > len(first.position)
