"""Logs as real machines give them: that begin in motion, lack rows, or rub more in one direction."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim.identify.friction_law import _course, chosen_terms
from gantrysim.identify.friction_terms import COGGING, DIRECTION, LOAD, POSITION
from gantrysim.identify.identification import identify
from gantrysim.identify.model import model_of
from gantrysim.identify.pieces import bounds, gradient, inside, longest_piece, smoothed
from gantrysim.identify.torque_regression import NAMES, TorqueRegression
from gantrysim.identify.whole_run import fitted_machine, whole_run
from gantrysim.machine.axis import VISCOUS_DIFFERENCE, facts

from support.identification_logs import AXIS, MACHINE, confidently_wrong, random_log
from support.soaked import suite_runs

PERIOD = 1e-3


def named(found):
    return {value.name: value for value in found.values}


def test_filters_end_with_their_piece():
    starts = (0, 40, 100)
    values = np.random.default_rng(1).standard_normal(150)
    assert bounds(150, starts) == [slice(0, 40), slice(40, 100), slice(100, 150)]
    assert longest_piece(150, starts) == slice(40, 100)
    for function in (lambda x, s: smoothed(x, 3.0, s), lambda x, s: gradient(x, PERIOD, s)):
        pieces = [function(values[piece], (0,)) for piece in bounds(150, starts)]
        np.testing.assert_array_equal(function(values, starts), np.concatenate(pieces))
    mask = inside(150, starts, 21)
    assert np.flatnonzero(mask).tolist() == [*range(61, 79), *range(121, 129)]


@pytest.mark.parametrize("law", suite_runs(["coulomb", "lugre"], 1))
def test_a_log_may_begin_in_motion(law):
    made = random_log(61, law, slip="", noise=1e-3, period=PERIOD, in_motion=True)
    first = made.log.position[:20, 0]
    assert abs(np.diff(first)).min() > 5e-3  # fast
    found = identify(MACHINE, made.log)
    assert not confidently_wrong(found, made.truth)
    values = named(found)
    assert values["inertia"].identified
    assert values["coulomb"].identified
    # the predictor begins at the log's speed: from rest it would be half a millimetre behind at the second sample
    (fit,) = found.fits
    assert np.abs(fit.innovations[:5]).max() < 0.02 * np.abs(np.diff(first)).max()
    (run,) = whole_run(found, made.log)
    assert run.repeats


@pytest.mark.soak
def test_rows_that_are_missing_begin_a_new_piece():
    """The machine that is found is the one of the whole log; without the pieces there is no such log."""
    made = random_log(61, "coulomb", slip="", noise=1e-3, period=PERIOD)
    log = made.log
    lost = np.zeros(len(log.position), bool)
    random = np.random.default_rng(4)
    # in motion, from a few samples to a quarter of a second
    moving = np.flatnonzero(np.abs(np.gradient(log.position[:, 0], PERIOD)) > 20.0)
    for first in np.sort(random.choice(moving, 6, replace=False)):
        lost[first : first + random.integers(21, 250)] = True
    kept = np.flatnonzero(~lost)
    starts = (0, *(np.flatnonzero(np.diff(kept) > 1) + 1).tolist())
    cut = replace(log, position=log.position[kept], torque=log.torque[kept], starts=starts)
    assert len(starts) >= 4
    found, whole = identify(MACHINE, cut), identify(MACHINE, log)
    assert not confidently_wrong(found, made.truth)
    for name in ("inertia", "coulomb"):
        value, full = named(found)[name], named(whole)[name]
        assert value.identified
        assert value.value == pytest.approx(full.value, rel=0.02)
    with pytest.raises(Exception, match="the encoder skips, or samples are missing"):
        identify(MACHINE, replace(cut, starts=(0,)))


@pytest.mark.soak
@pytest.mark.parametrize("share", suite_runs([0.3, -0.25], 0))
def test_viscous_friction_by_direction_is_found_and_carried(share):
    made = random_log(62, "coulomb", slip="", noise=1e-3, period=PERIOD, uneven=share)
    found = identify(MACHINE, made.log)
    assert not confidently_wrong(found, made.truth)
    (fit,) = found.fits
    assert [term.kind for term in fit.law.terms] == [DIRECTION]
    values = named(found)
    for name in ("viscous", "viscous_forward", "viscous_back"):
        assert values[name].value == pytest.approx(made.truth[name], rel=0.1), name
    difference = 0.5 * (values["viscous_forward"].value - values["viscous_back"].value)
    machine = fitted_machine(found)
    assert facts(machine.physics, VISCOUS_DIFFERENCE)[AXIS] == pytest.approx(difference)
    assert model_of(machine, AXIS).difference == pytest.approx(fit.model.difference)
    assert model_of(machine, AXIS).offset == pytest.approx(fit.model.offset)
    (run,) = whole_run(found, made.log)
    assert run.lacking == ()
    assert run.written < 0.03 * run.torque


def sliding(torque_of, travel=60.0, seconds=12.0, stroke=0.8):
    """A regression of an axis that goes to and fro at several speeds, under inertia, friction and a torque beside."""
    time = PERIOD * np.arange(round(seconds / PERIOD))
    position = 0.5 * travel * (1 - np.cos(2 * np.pi * time / stroke * (1 + 0.2 * np.sin(2 * np.pi * time / seconds))))
    speed = np.gradient(position, PERIOD)
    model = replace(model_of(MACHINE, AXIS), lag=0.0, delay=0.0)
    torque = model.inertia * np.gradient(speed, PERIOD) + 1e-4 * speed + 0.02 * np.sign(speed)
    noise = 2e-4 * np.random.default_rng(3).standard_normal(time.size)
    torque = torque + torque_of(position, speed) + noise
    return TorqueRegression.of(model, PERIOD, position, torque, held=False)


@pytest.mark.parametrize("periods", suite_runs([12, 5, 3.2], 1))
def test_a_wave_over_the_travel_is_taken_that_repeats(periods):
    length = 60.0 / periods
    regression = sliding(lambda x, v: 0.004 * np.sin(2 * np.pi * x / length))
    terms, solution, _ = chosen_terms(regression, 5.0)
    assert [term.kind for term in terms] == [COGGING]
    assert terms[0].size == pytest.approx(length, rel=0.02)
    assert np.hypot(*solution.values[-2:]) == pytest.approx(0.004, rel=0.1)


@pytest.mark.parametrize(
    "bump",
    suite_runs(
        [
            lambda x, v: 0.004 * np.sin(2 * np.pi * x / 50.0),  # not even twice in the travel
            lambda x, v: 0.006 * np.exp(-(((x - 40.0) / 4.0) ** 2)) * np.sign(v),  # a tight place
            lambda x, v: 0.004 * np.sign(v) * np.clip((x - 30.0) / 30.0, 0, 1),  # a guide that rises
        ],
        1,
    ),
)
def test_what_does_not_repeat_over_the_travel_is_no_wave(bump):
    terms, _, _ = chosen_terms(sliding(bump), 5.0)
    assert not [term for term in terms if term.kind in (COGGING, POSITION)]


def law_of(seed, law):
    """Terms and coefficients of the friction of a random axis, with the truth, as the coverage script draws it."""
    made = random_log(seed, law, slip="", by_direction=True, in_motion=seed % 2 == 0)
    log = made.log
    model = model_of(MACHINE, AXIS)
    regression = TorqueRegression.of(model, log.period, log.position[:, 0], log.torque[:, 0], held=True)
    terms, solution, _ = chosen_terms(regression, model.scale * model.stribeck)
    return terms, dict(zip(NAMES, solution.values, strict=False)), made.truth


# whose torque takes effect half a sample late, of 2, 2 and 1 ms; the last has a mode at 336 Hz
@pytest.mark.parametrize(("seed", "law"), suite_runs([(1028, "lugre"), (1034, "backlash"), (1094, "load")], 1))
def test_a_late_torque_and_a_spring_do_not_bend_coulomb_friction(seed, law):
    _, values, truth = law_of(seed, law)
    assert values["coulomb"] == pytest.approx(truth["coulomb"], rel=0.06)


def test_friction_over_most_of_the_travel_is_no_wave_of_the_longest_period():
    """It varies by 35 % over 54 mm of a travel of 80 mm; as a wave of 27 mm Coulomb friction would be 31 % too high."""
    terms, _, _ = law_of(1012, "position")
    assert not [term for term in terms if term.kind in (COGGING, POSITION)]


def test_direction_comes_before_any_wave():
    regression = sliding(lambda x, v: -3e-5 * np.abs(v))
    terms, solution, _ = chosen_terms(regression, 5.0)
    assert [term.kind for term in terms] == [DIRECTION]
    assert solution.values[-1] == pytest.approx(-3e-5, rel=0.05)


@pytest.mark.soak
def test_a_log_without_braking_shows_no_friction_by_load():
    """Where the torque never brakes, |T| times the direction is the torque itself, and would explain all of it."""
    regression = sliding(lambda x, v: 0.004 * np.sin(2 * np.pi * x / 12.0), stroke=6.0)
    terms, solution, _ = chosen_terms(regression, 5.0)
    assert LOAD not in [term.kind for term in terms]
    assert solution.values[NAMES.index("coulomb")] == pytest.approx(0.02, rel=0.1)


def test_torque_that_turns_with_the_motion_is_a_level_of_friction_and_all_other_a_ripple():
    """A wave of two columns that keeps its sign, and a level of one; each with its own values."""
    place = np.linspace(0.0, 10.0, 101)
    motion = SimpleNamespace(position=place, calm=np.ones(101))

    def term(kind, *shapes):
        def words(values, covariance, *_):
            return f"{kind} {values.tolist()} {covariance.shape}"

        return SimpleNamespace(kind=kind, levels=lambda motion: shapes, words=words)

    terms = (term(COGGING, np.sin(place), np.cos(place)), term(LOAD, place))
    values = np.append(np.arange(len(NAMES), dtype=float), [0.3, 0.4, 2.0])
    solution = SimpleNamespace(values=values, covariance=np.eye(values.size))
    level, ripple, words = _course(SimpleNamespace(motion=motion), terms, solution, "mm")
    np.testing.assert_allclose(level, 2.0 * place)
    np.testing.assert_allclose(ripple, 0.3 * np.sin(place) + 0.4 * np.cos(place))
    assert words == (f"{COGGING} [0.3, 0.4] (2, 2)", f"{LOAD} [2.0] (1, 1)")
