"""Tolerances: machines drawn one by one, and from a Latin hypercube."""

import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.base.errors import InputError
from gantrysim.machine.perturbation import VARIED_FACTORS, Perturbation
from gantrysim.machine.tolerances import Tolerances

UNIFORM = 0.04  # largest gap between the distribution of 2000 draws and the one meant: Kolmogorov's at 0.3 %
DRAWS = 2000
NOTHING = Tolerances(0, 0, 0, 0, 0)


def draws(spread, machine, count, seed=1):
    random = np.random.default_rng(seed)
    return [spread.draw(random, machine) for _ in range(count)]


def with_a_spring_above_all_axes(machine):
    file = machine.source
    spring = '<body name="base"><joint name="base" stiffness="1e6" damping="10"/><geom size="0.01" mass="1"/>'
    text = file.read_text().replace('<body name="bridge">', spring + '<body name="bridge">')
    file.write_text(text.replace("</worldbody>", "</body></worldbody>"))
    return Machine(file)


def unit_of(value, spread):
    """Position of a factor in its range, from 0 to 1 on a logarithmic scale."""
    return 0.5 * (np.log(value) / np.log1p(spread) + 1)


def test_draws_are_uniform_over_every_range(xy):
    spread = Tolerances()
    drawn = draws(spread, xy, DRAWS)
    columns = [np.array([one.payload for one in drawn]) / spread.payload]
    for name in VARIED_FACTORS:
        values = np.array([getattr(one, name) for one in drawn])
        assert values.shape == (DRAWS, 2)
        columns += list(unit_of(values, getattr(spread, name)).T)
    even = (np.arange(DRAWS) + 0.5) / DRAWS
    for column in columns:
        assert np.abs(np.sort(column) - even).max() < UNIFORM
    assert np.abs(np.corrcoef(columns) - np.eye(9)).max() < 0.1  # independent


def test_the_same_seed_draws_the_same_machine(xyz):
    assert draws(Tolerances(), xyz, 5) == draws(Tolerances(), xyz, 5)
    assert draws(Tolerances(), xyz, 5) != draws(Tolerances(), xyz, 5, seed=2)


@pytest.mark.parametrize("name", ["payload", *VARIED_FACTORS])
def test_a_factor_does_not_depend_on_the_other_tolerances(xy, name):
    alone = Tolerances(**{**dict.fromkeys(("payload", *VARIED_FACTORS), 0.0), name: getattr(Tolerances(), name)})
    for one, other in zip(draws(alone, xy, 3), draws(Tolerances(), xy, 3), strict=True):
        assert getattr(one, name) == getattr(other, name)
        nominal = Perturbation()
        assert all(
            getattr(one, rest) == getattr(nominal, rest) for rest in ("payload", *VARIED_FACTORS) if rest != name
        )


def test_tolerances_of_zero_give_the_nominal_machine(xy):
    assert draws(NOTHING, xy, 2) == [Perturbation()] * 2
    assert NOTHING.machines(xy, 3, seed=1) == [Perturbation()] * 3


@pytest.mark.parametrize("name", ["xy", "xyz", "xyzr", "stage", "delta"])
def test_every_machine_takes_its_drawn_perturbations(name):
    machine = Machine(name)
    for perturbation in (*draws(Tolerances(), machine, 2), *Tolerances().machines(machine, 2, seed=3)):
        assert len(perturbation.stiffness) == len(machine.axes)
        made = machine.perturbed(perturbation)
        assert tuple(made.drive_gain) == perturbation.motor_constant


def test_springs_above_all_axes_have_one_factor(rigid):
    machine = with_a_spring_above_all_axes(rigid())
    perturbation = Tolerances().draw(np.random.default_rng(1), machine)
    assert isinstance(perturbation.stiffness, float)
    assert 1 / 1.3 < perturbation.stiffness < 1.3
    assert perturbation.stiffness != 1.0
    machine.perturbed(perturbation)
    assert all(isinstance(one.stiffness, float) for one in Tolerances().machines(machine, 2, seed=1))
    # the other factors are those of a machine whose springs have axes
    other = Tolerances().draw(np.random.default_rng(1), Machine("xy"))
    assert (perturbation.friction, perturbation.motor_constant) == (other.friction, other.motor_constant)


def test_a_hypercube_has_one_machine_in_each_part_of_every_range(xyz):
    machines = Tolerances().machines(xyz, 16, seed=4)
    assert np.sort([int(16 * one.payload / 0.3) for one in machines]).tolist() == list(range(16))
    for name in VARIED_FACTORS:
        values = unit_of(np.array([getattr(one, name) for one in machines]), getattr(Tolerances(), name))
        assert np.sort((16 * values).astype(int), axis=0).tolist() == np.arange(16)[:, None].repeat(3, axis=1).tolist()
    assert machines == Tolerances().machines(xyz, 16, seed=4)
    assert machines != Tolerances().machines(xyz, 16, seed=5)


@pytest.mark.parametrize(
    ("count", "seed", "text"),
    [
        (0, 1, "number of machines = 0: must be at least 1"),
        (1.5, 1, "number of machines = 1.5: must be a whole number"),
        (2, -1, "seed = -1: must be at least 0"),
    ],
)
@pytest.mark.parametrize("spread", [Tolerances(), NOTHING])
def test_invalid_counts_and_seeds_are_rejected(xy, spread, count, seed, text):
    with pytest.raises(InputError, match=text):
        spread.machines(xy, count, seed)
