"""The whole run: a fitted machine repeats its own log, the nominal one does not, and a wrong fit is told."""

from dataclasses import replace

from gantrysim.identify.identification import identify
from gantrysim.identify.whole_run import LARGEST_ADDED_TORQUE, whole_run

from support.identification_logs import MACHINE, random_log


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
