"""A job that is reached by one change after the other is the one that is reached at once."""

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.job.job import Job
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


@pytest.mark.parametrize("name", [*CHANGES, "an225", "svg-gasket", "stage-outline"])
def test_another_speed_keeps_the_requested_path(name, tmp_path):
    opened = Draft(name).opened(tmp_path, allow_code=False)
    path = opened.setpoints.requested
    slower = Draft(name, override=80.0).job(opened).sharing(opened)
    # the second change after the first, whose setpoints nobody has asked for
    slowest = Draft(name, override=60.0).job(opened, slower).sharing(slower)
    assert slowest.setpoints.requested is path
    assert slowest.setpoints.duration > opened.setpoints.duration


@pytest.mark.parametrize("name", ["fanuc-spiral", "linuxcnc-flanges", "svg-gasket"])
def test_another_place_has_a_path_of_its_own(name, tmp_path):
    opened = Draft(name).opened(tmp_path, allow_code=False)
    path = opened.setpoints.requested
    values = {"program.placement.x": 1.0, "program.placement.y": 2.0}
    moved = Draft(name, values=values).job(opened).sharing(opened)
    alone = Draft(name, values=values).job(Draft(name).opened(tmp_path, allow_code=False))
    assert moved.setpoints.requested is not path
    assert moved.setpoints.requested.coincides(alone.setpoints.requested)
    assert not moved.setpoints.requested.coincides(path)
    s = np.linspace(0, path.length, 50)
    np.testing.assert_array_equal(moved.setpoints.requested.position(s), alone.setpoints.requested.position(s))


def test_only_a_servo_value_takes_over_that_the_program_fits(tmp_path, monkeypatch):
    opened = Draft("an225").opened(tmp_path, allow_code=False)
    opened.check_fit()
    follow = Job.follow
    followed = []
    monkeypatch.setattr(Job, "follow", lambda job: followed.append(job) or follow(job))
    Draft("an225", values={"servo.damping": 0.8}).job(opened).sharing(opened).check_fit()
    assert not followed
    for values in ({"bead.cell": 0.004}, {"bead.cell": 5.0}):
        with pytest.raises(InputError, match=r"^cell = "):
            Draft("an225", values=values).job(opened).sharing(opened).check_fit()
    fast = Draft("an225", values={"dispenser.flow": 90.0}).job(opened).sharing(opened)
    fast.check_fit()
    assert len(followed) == 3
