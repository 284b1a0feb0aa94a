"""The whole run: a fitted machine repeats its own log, the nominal one does not, and a wrong fit is told."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim.identify.identification import identify
from gantrysim.identify.whole_run import LARGEST_ADDED_TORQUE, _compared_runs, _effective, whole_run

from support.identification_logs import MACHINE, random_log


@pytest.mark.soak
def test_the_fitted_machine_repeats_the_run_and_the_nominal_one_does_not():
    log = random_log(1008, "coulomb", slip="", noise=2e-3, period=1e-3).log
    found = identify(MACHINE, log)
    (run,) = whole_run(found, log)
    assert run.missing == ""
    assert run.written < 0.02 * run.torque
    assert run.nominal > 5 * run.written
    assert run.repeats
    # the same torque on a machine of 1.5 times the inertia
    (fit,) = found.fits
    heavy = replace(found, fits=(replace(fit, model=replace(fit.model, inertia=1.5 * fit.model.inertia)),))
    (other,) = whole_run(heavy, log)
    assert other.fitted > LARGEST_ADDED_TORQUE * other.torque
    assert f"{100 * run.written / run.torque:.2g} %" in run.sentence


@pytest.mark.parametrize(("held", "late"), [(True, 3e-3), (False, 2e-3)])
def test_the_engine_gets_the_torque_of_a_log_as_late_as_it_acts(held, late):
    """A demand acts after the delay; a motor's torque has the winding's lag of 1 ms, which the engine adds, in it."""
    ramp = np.arange(100.0)[:, None]
    fit = SimpleNamespace(axis="x", model=SimpleNamespace(delay=3e-3))
    machine = SimpleNamespace(axes=[SimpleNamespace(lag=1e-3)], axis_names=("x",))
    log = SimpleNamespace(torque=ramp, period=1e-3, held=held)
    torque = _effective(SimpleNamespace(fits=[fit], machine=machine), log)
    np.testing.assert_allclose(torque[10:, 0], ramp[10:, 0] - late / 1e-3)


@pytest.mark.parametrize(("end", "is_told"), [(0.2, False), (0.6, True)])
def test_what_the_loop_adds_until_it_has_a_log_s_speed_is_not_the_machine_s(end, is_told):
    """The simulated axis starts at rest, and is brought to the motion within 0.3 s."""
    time = np.arange(2000)[:, None] * 1e-3
    log = SimpleNamespace(position=10 * np.sin(10 * time), torque=np.cos(10 * time), period=1e-3, held=True)
    fit = SimpleNamespace(axis="x", model=SimpleNamespace(delay=0.0), law=SimpleNamespace(terms=(), words=()))
    machine = SimpleNamespace(axes=[SimpleNamespace(lag=0.0, resolution=1e-3)], axis_names=("x",))
    identification = SimpleNamespace(fits=[fit], machine=machine, adopted=[frozenset()])
    run = SimpleNamespace(demand=log.torque + np.where(time < end, 5.0, 0.0), encoder=log.position)
    compared = _compared_runs(identification, log, 0, run, run, None)
    assert compared.counts == 0
    assert compared.repeats != is_told
    assert (compared.written > 1.0) == is_told
