"""The fitted machine: of each axis, slide or hinge, the model of its MJCF is the one that was fitted."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from gantrysim import InputError, Machine
from gantrysim.identify.model import model_of
from gantrysim.identify.whole_run import fitted_machine
from gantrysim.machine.motors import spring_of

from support.soaked import suite_runs

# factors on the nominal values
CHANGED = {"inertia": 1.15, "share": 0.9, "stiffness": 0.7, "damping": 1.4, "viscous": 1.3, "coulomb": 1.2}


def fit_of(machine, index, **factors):
    """A fit as `identify` would give it, with values that are these multiples of the nominal ones."""
    nominal = model_of(machine, index)
    axis = machine.axes[index]
    model = replace(nominal, **{name: factor * getattr(nominal, name) for name, factor in factors.items()})
    return SimpleNamespace(axis=axis.name, unit=axis.unit, nominal=nominal, model=model, shows_mode=True)


@pytest.mark.parametrize("inertia", suite_runs([1.15, 0.97], 0))
@pytest.mark.parametrize(("name", "axis"), [("xy", "x"), ("xy", "y"), ("xyzr", "r"), ("stage", "th")])
def test_the_machine_has_the_inertia_mode_and_friction_that_were_fitted(name, axis, inertia):
    machine = Machine(name)
    index = machine.axis_names.index(axis)
    springs = spring_of(machine.layout, index) is not None
    factors = CHANGED if springs else {key: CHANGED[key] for key in ("inertia", "viscous", "coulomb")}
    fit = fit_of(machine, index, **{**factors, "inertia": inertia})
    fitted = model_of(fitted_machine(SimpleNamespace(machine=machine, accepted=[fit])), index)
    for key in factors:
        assert getattr(fitted, key) == pytest.approx(getattr(fit.model, key), rel=2e-3), key
    others = [other for other in range(len(machine.axes)) if other != index]
    for other in others:  # their own springs and friction are as they were
        mine, theirs = model_of(machine, other), model_of(Machine(name), other)
        assert (mine.stiffness, mine.coulomb) == (theirs.stiffness, theirs.coulomb)


def test_a_load_that_leaves_nothing_is_refused():
    machine = Machine("xy")
    with pytest.raises(InputError, match=r"axis y: the fitted (load|inertia) leaves"):
        fitted_machine(SimpleNamespace(machine=machine, accepted=[fit_of(machine, 1, inertia=0.1)]))


@pytest.mark.parametrize("damping", [12.0, 0.0])
def test_friction_of_a_machine_without_bristles_is_that_of_its_joint(rigid, damping):
    machine = rigid(damping=damping)
    model = model_of(machine, 0)
    assert (model.share, model.stiffness, model.damping) == (0, 0, 0)
    fit = fit_of(machine, 0, inertia=1.1)
    fit.model = replace(fit.model, coulomb=0.02, viscous=4e-5)
    fitted = model_of(fitted_machine(SimpleNamespace(machine=machine, accepted=[fit])), 0)
    assert fitted.inertia == pytest.approx(fit.model.inertia, rel=2e-3)
    assert (fitted.coulomb, fitted.viscous) == (pytest.approx(0.02, rel=1e-6), pytest.approx(4e-5, rel=1e-6))


def test_a_motor_without_inertia_may_stay_so(rigid):
    machine = rigid(damping=1.0).edited(lambda spec: setattr(spec.actuators[0], "armature", 0.0))
    for factor in (1.0, 1.4):
        fit = fit_of(machine, 0, inertia=factor)
        fitted = fitted_machine(SimpleNamespace(machine=machine, accepted=[fit]))
        assert model_of(fitted, 0).inertia == pytest.approx(factor * model_of(machine, 0).inertia, rel=2e-3)
