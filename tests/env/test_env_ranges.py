"""Ranges of random values: presets, and ranges given by name; what is drawn lies within them."""

import math

import gymnasium
import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.env.registry import TASKS
from gantrysim.machine.tolerances import Tolerances

from support.soaked import suite_runs

EPISODES = 12
SPIRAL = ("diameter", "thickness", "speed", "turns")


def made(task, **settings):
    return gymnasium.make(f"gantrysim/{task}", **settings).unwrapped


def drawn(env, count=EPISODES):
    return [env.reset(seed=seed)[1] for seed in range(count)]


@pytest.fixture(params=suite_runs(list(TASKS), 1))
def task(request):
    return request.param


def test_training_is_the_default(task):
    assert drawn(made(task), 2) == drawn(made(task, preset="training"), 2)


def test_nothing_varies_in_the_nominal_preset_and_the_machine_is_the_nominal_one(task):
    env = made(task, preset="nominal")
    source = env._episodes.source
    settings = type(env.settings)()
    first, *others = drawn(env, 3)
    assert all(other == first for other in others)
    middle = {name: sum(settings.between(name)) / 2 for name in SPIRAL}
    task_values = {name: value.nominal for name, value in source.values.items()}
    assert first == {**middle, "turns": math.floor(middle["turns"]), **task_values}
    assert env._episodes.episodes[0].simulation.machine.digest == source.machine.digest


def test_the_values_of_a_task_lie_in_the_ranges_of_its_preset(task):
    for preset in ("training", "shifted"):
        env = made(task, preset=preset)
        values = env._episodes.source.values
        for info in drawn(env):
            for name, value in values.items():
                low, high = getattr(value, preset)
                assert low <= info[name] <= high


def test_the_shifted_values_lie_beyond_those_of_training(task):
    """Of a value that varies, none but the phase, the noise and the moment of a change may be met in training."""
    for name, value in made(task)._episodes.source.values.items():
        (low, high), (least, most) = value.training, value.shifted
        met_in_training = least < high and most > low
        assert met_in_training == (
            name in ("dip_phase", "camera") or (name.endswith("_time") and name != "warming_time")
        )
        assert value.limits[0] <= least <= most <= value.limits[1]
        assert value.limits[0] <= value.nominal <= value.limits[1]


def test_shifted_machines_have_half_as_large_tolerances_again(task):
    env = made(task, preset="shifted")
    training = type(env.settings)().spread
    for info in drawn(env):
        assert 0 <= info["payload_kg"] <= 1.5 * training.payload
        for name in ("friction", "viscous", "stiffness", "motor_constant"):
            most = 1 + 1.5 * getattr(training, name)
            assert all(1 / most <= info[f"{name}_{axis}"] <= most for axis in "xy")
    assert max(info["friction_x"] for info in drawn(env, 40)) > 1 + training.friction


@pytest.mark.parametrize("preset", ["nominal", "shifted"])
def test_what_is_given_holds_in_any_preset(preset):
    given = {"speed": (40.0, 50.0), "spread": Tolerances(payload=0.1), "ranges": {"viscosity": (1.1, 1.2), "clog": 0.9}}
    infos = drawn(made("BeadWidth-v1", preset=preset, **given))
    assert all(40.0 <= info["speed"] <= 50.0 for info in infos)
    assert len({info["speed"] for info in infos}) == EPISODES
    assert all(0.0 < info["payload_kg"] <= 0.1 for info in infos)
    assert all(1.1 <= info["viscosity"] <= 1.2 for info in infos)
    assert {info["clog"] for info in infos} == {0.9}


def test_ranges_of_the_machine_replace_those_of_its_tolerances():
    ranges = {"friction_y": (2.0, 3.0), "payload_kg": 1.0}
    env, plain = made("ServoTorque-v1", ranges=ranges), made("ServoTorque-v1")
    for info, other in zip(drawn(env), drawn(plain), strict=True):
        assert 2.0 <= info["friction_y"] <= 3.0
        assert info["payload_kg"] == 1.0
        # all else is drawn as without
        assert {name: info[name] for name in info if name not in ranges} == {
            name: other[name] for name in other if name not in ranges
        }
    nominal = made("ServoTorque-v1", ranges=ranges, spread=None)
    for seed in range(3):
        info = nominal.reset(seed=seed)[1]
        assert (info["friction_x"], info["stiffness_x"]) == (1.0, 1.0)
        friction = [axis.coulomb for axis in nominal._episodes.episodes[0].simulation.machine.axes]
        start = [axis.coulomb for axis in nominal._episodes.source.machine.axes]
        assert np.divide(friction, start) == pytest.approx([1.0, info["friction_y"]])


def test_ranges_survive_the_registry_s_json():
    env = gymnasium.make("gantrysim/BeadWidth-v1", preset="shifted", ranges={"viscosity": (1.0, 2.0), "clog": 1.0})
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.settings == env.unwrapped.settings
    assert again.reset(seed=3)[1] == env.reset(seed=3)[1]


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"preset": "shfted"}, "unknown preset 'shfted': did you mean shifted? known: shifted, nominal, training"),
        ({"ranges": {"viscosty": 1.0}}, "unknown random value 'viscosty': did you mean viscosity? known: viscosity, "),
        ({"ranges": {"friction_z": 1.0}}, "unknown random value 'friction_z': did you mean friction_y? known: "),
        ({"ranges": {"speed": (50, 60)}}, "ranges: speed is a setting of its own: give speed = (50, 60)"),
        ({"ranges": 3}, "ranges = 3: must be a dict of names and ranges"),
        ({"ranges": {"lag": (1, 2, 3)}}, "ranges: lag = (1, 2, 3): must be one number, or the lowest and the highest"),
        ({"ranges": {"viscosity": (2, 1)}}, "ranges: viscosity = (2, 1): must be the lowest, then the highest"),
        ({"ranges": {"clog": (0.5, 2)}}, "ranges: clog = (0.5, 2): must be at least 0.001 and at most 1"),
        ({"ranges": {"friction_x": (-1, 1)}}, "ranges: friction_x = (-1, 1): must be greater than 0"),
        ({"ranges": {"payload_kg": -1}}, "ranges: payload_kg = (-1, -1): must be at least 0"),
        ({"ranges": {"lag": (0.1, math.inf)}}, "ranges: highest lag = inf: must be finite"),
    ],
)
def test_wrong_presets_and_ranges_are_one_line(settings, text):
    with pytest.raises(InputError) as refused:
        made("BeadWidth-v1", **settings)
    assert str(refused.value).startswith(text)
    assert "\n" not in str(refused.value)
