"""Servos derived for random machines keep their margins, or are refused with a change that was tried and helps."""

import ast
import math
import random
import re
from collections import Counter

import numpy as np
import pytest

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import Setpoints

from support.closed_loops import shortfall
from support.random_tables import request, table
from support.runs import ramp

NO_LOOP = "no loop keeps a gain margin of 2 and a peak of |S| of at most 2 on every axis"
PROPOSED = re.compile(r"[:;] use (.*), each tried$")
KICK, TICKS = 1e-6, 400  # [mm]
SEEDS = 500


def proposed(message, arguments):
    """The arguments with each of what a message proposes, by its words."""
    found = {}
    for words in PROPOSED.search(message)[1].split(" or "):
        changed = dict(arguments)
        for change in re.sub(r" \([^)]* Hz\)$", "", words).split(" with "):
            name, value = change.split(" = ")
            unitless = re.sub(r" (s|Hz)$", "", value)
            changed[name] = math.inf if unitless == "inf" else ast.literal_eval(unitless)
        found[words] = changed
    return found


def bounded(machine, servo, factor):
    """Whether the compiled machine stays at rest after a kick, all gains on positions times a factor."""
    gains = {name: tuple(factor * gain for gain in servo.per_axis(name)) for name in ("kp", "ki", "kd")}
    stronger = servo.with_values(**gains, resolution=(0.0,) * servo.axes, following_error_limit=(1e3,) * servo.axes)
    smooth = machine.perturbed(Perturbation(friction=1e-15))
    position = np.zeros((TICKS, servo.axes))
    position[1:] = KICK
    setpoints = Setpoints(servo.period, machine.axis_names, position, np.zeros(TICKS, bool), ramp(50.0).requested)
    step = min(2.5e-5, smooth.physics.opt.timestep)
    run = simulate(smooth, stronger, setpoints, physics_step=step)
    return run.fault is None and np.abs(run.commanded - run.motor).max() < 50 * KICK


def outcome(seed, folder):
    """What becomes of a random servo on a random machine, in a word; what is wrong is an assertion."""
    chance = random.Random(seed)
    file = folder / "machine.toml"
    file.write_text(table(chance))
    machine = Machine(file)
    arguments = request(chance, machine)
    try:
        servo = Servo.derive(machine.axes, **arguments)
    except InputError as error:
        message = str(error)
        assert "\n" not in message
        if NO_LOOP not in message:
            return "another refusal"
        if PROPOSED.search(message) is None:
            assert "give the gains" in message
            return "no remedy"
        for words, changed in proposed(message, arguments).items():
            assert not shortfall(machine, Servo.derive(machine.axes, **changed)), (message, words)
        return "remedy"
    assert not shortfall(machine, servo), arguments
    return "kept"


@pytest.mark.parametrize(
    "seeds", [range(12), pytest.param(range(12, 52), marks=pytest.mark.soak)], ids=["short", "long"]
)
def test_the_compiled_machine_stays_at_rest_with_nearly_twice_the_gains(seeds, tmp_path):
    """Steppers apart: the torque of their detents at rest, a spring of its own, is in no margin."""
    tested = unbounded = 0
    for seed in seeds:
        chance = random.Random(seed)
        file = tmp_path / "machine.toml"
        file.write_text(table(chance))
        machine = Machine(file)
        mode = chance.choice(["torque", "velocity", "position"])
        if any(axis.phases and axis.phases.microsteps for axis in machine.axes):
            continue
        try:
            servo = Servo.derive(machine.axes, mode=mode, integral_time=0.1)
        except InputError:
            continue
        assert bounded(machine, servo, 1.9), (seed, mode)
        tested += 1
        unbounded += not bounded(machine, servo, 100.0)
    assert unbounded >= 0.9 * tested > 0  # the kick is large enough, and the run long


@pytest.mark.parametrize(
    "seeds", [range(6), pytest.param(range(6, 6 + SEEDS), marks=pytest.mark.soak)], ids=["short", "long"]
)
def test_a_derived_servo_keeps_its_margins_or_names_a_change_that_does(seeds, tmp_path, record_property):
    outcomes = Counter(outcome(seed, tmp_path) for seed in seeds)
    assert outcomes["kept"] > 0.5 * len(seeds)
    assert outcomes["remedy"] > 5 * outcomes["no remedy"]
    record_property("attack", "servos derived for random machines, with all laws, modes, feedbacks and periods")
    record_property("tries", len(seeds))
    record_property("refused", len(seeds) - outcomes["kept"])
