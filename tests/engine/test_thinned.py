"""A record with fewer ticks than its run has, against rows of the whole record."""

from dataclasses import fields, replace

import numpy as np
import pytest

from gantrysim.engine.simulate import stepped_simulation
from gantrysim.engine.simulation import Simulation
from gantrysim.record.setpoints import Supervision

from support.remedies import rubbing

EVERY = 7


def run_of(job, setpoints, dispenser=None):
    return stepped_simulation(Simulation.of(job.built_machine, job.built_servo, setpoints, dispenser=dispenser))


def check(run):
    whole = run.record()
    thin = run.record(every=EVERY)
    assert thin.period == EVERY * whole.period
    assert len(thin.time) == -(-len(whole.time) // EVERY)
    for field in fields(whole):
        values = getattr(whole, field.name)
        if isinstance(values, np.ndarray):
            assert np.array_equal(getattr(thin, field.name), values[::EVERY], equal_nan=True), field.name
        elif field.name != "period":
            assert getattr(thin, field.name) == values, field.name
    return whole


@pytest.mark.parametrize("changes", [{}, {"geometry.play": 0.05}], ids=["plain", "with play"])
def test_its_rows_are_those_of_the_whole_record(changes):
    job = rubbing().changed(changes)
    assert (check(run_of(job, job.setpoints)).geometric_tip is None) == (not changes)


def test_its_flow_is_that_of_the_whole_record():
    job = rubbing()
    assert check(run_of(job, job.setpoints, job.dispenser)).flow.any()


def test_waits_shift_its_rows():
    job = rubbing()
    settled = Supervision(settle_error=0.01, settle_time=0.013)
    setpoints = replace(job.setpoints, gates=np.array([300]), supervision=settled)
    assert len(check(run_of(job, setpoints)).time) > len(setpoints.position)
