"""The Move Spiral as the published listing has it, errors and all, and its differences in words."""

import cmath
import math

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral

from support.stepped import RELATIVE, WHOLE_MS, Controller, note, places


def published(**changed):
    return note(as_published=True, **changed)


def by_events(spiral, times):
    """The published program between ticks, its axes as complex numbers: literally 4 circles, no guard."""
    radius, sense = spiral.radius, -1 if spiral.clockwise else 1
    length, time, way, x = 4 * math.pi * spiral.diameter, 0.0, 0.0, 1.0
    begun, travelled, ratio = [0.0], [0.0], []
    while way < length * (1 - 1e-12):
        x = 1 - (len(ratio) + 1) * spiral.change
        if abs(x) < 1e-12:
            break
        ratio.append(x)
        lasting = max(spiral.loop_period * x, 0.0) + spiral.interpreter_time or spiral.loop_period
        way, time = min(way + spiral.speed / abs(x) * lasting, length), time + lasting
        begun.append(time)
        travelled.append(way)
    if travelled[-1] < length * (1 - 1e-12):  # the program has stopped; the axes go on
        begun[-1], travelled[-1] = math.inf, length
    found = []
    for t in times:
        place = 0j
        for k, x in enumerate(ratio):
            if t <= begun[k]:
                break
            ways = travelled[k], min(travelled[k] + spiral.speed / abs(x) * (t - begun[k]), travelled[k + 1])
            circle = [sense * radius * cmath.exp(1j * sense * s / radius) for s in ways]
            place += x * (circle[1] - circle[0])
        found.append(place)
    return np.array(found)


def halting(passes=40):
    """A program whose ratio falls to zero exactly on a pass, with 1.5 circles of its literal four still to run."""
    loop_period = math.pi * 120**2 / (2 * 20 * 100 * passes)
    return {"turns": 3, "thickness": 20, "loop_period": loop_period}


PROGRAMS = {
    "four": {},
    "three": {"turns": 3},
    "one": {"turns": 1, "thickness": 12},
    "backwards": {"turns": 2, "thickness": 29, "interpreter_time": 0.01},
    "counter-clockwise": {"turns": 3, "thickness": 18.5, "clockwise": False, "interpreter_time": 0.01},
    "halting": halting(),
}


@pytest.mark.parametrize("changed", PROGRAMS.values(), ids=PROGRAMS)
def test_the_published_program_between_ticks(changed):
    spiral = published(**changed)
    setpoints = spiral.setpoints(0.01)
    expected = by_events(spiral, setpoints.time[:-1])
    assert places(setpoints)[:-1] == pytest.approx(expected, abs=1e-8)
    assert places(setpoints)[-1] == pytest.approx(by_events(spiral, [1e3])[0], abs=1e-8)


@pytest.mark.parametrize(
    "limited",
    [
        {},
        {"acceleration": 2000.0, "wait_resolution": WHOLE_MS, "ratio_bits": 16},
    ],
    ids=["free", "limited"],
)
@pytest.mark.parametrize("changed", PROGRAMS.values(), ids=PROGRAMS)
def test_the_published_program_tick_by_tick(changed, limited):
    job = {"diameter": 120, "thickness": 10, "turns": 4, "speed": 100, "servo_period": 1e-3, **changed, **limited}
    stepped = Controller(**job, as_published=True).run()
    spiral = MoveSpiral(**job, as_published=True)
    commanded = places(spiral.setpoints(1e-3))
    n = min(len(commanded), len(stepped.places)) - 1
    assert abs(len(commanded) - len(stepped.places)) <= 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=1e-8)
    assert spiral.ratios == pytest.approx(np.array(stepped.ratios), abs=RELATIVE)
    if "thickness" in changed and limited:  # too thick for four circles
        assert spiral.passes.halted or np.sum(spiral.ratios < 0) > 10 or changed["turns"] == 1


def test_virtual_axes_slow_down_with_decel_behind_a_ratio_of_zero():
    """SPEED = V / |x| falls again there; tick by tick, and DECEL is what it takes."""
    job = {"diameter": 120, "thickness": 29, "turns": 2, "speed": 100, "servo_period": 1e-3, "interpreter_time": 0.02}
    job |= {"acceleration": 500.0, "deceleration": 2000.0, "as_published": True}
    stepped, spiral = Controller(**job).run(), MoveSpiral(**job)
    commanded = places(spiral.setpoints(1e-3))
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=1e-8)
    assert spiral.passes.profile.velocity(np.arange(n) * 1e-3) == pytest.approx(np.array(stepped.speeds)[:n], abs=1e-6)
    assert np.diff(stepped.speeds[: n - 200]).min() == pytest.approx(-2.0, rel=1e-6)  # before the last braking


def test_the_published_program_runs_four_circles_whatever_the_turns():
    for turns in (1, 2, 3, 4, 5):
        path = published(turns=turns).generated
        turned = path.heading(0)[0] - path.heading(path.length)[0]
        assert turned == pytest.approx(8 * math.pi, abs=1e-9)
        assert published(turns=turns).circles == 4
        assert note(turns=turns).circles == turns


def test_with_four_turns_and_no_bad_ratio_the_published_program_is_the_corrected_one():
    for changed in ({}, {"acceleration": 1000, "servo_period": 1e-3, "wait_resolution": WHOLE_MS, "ratio_bits": 16}):
        ours, theirs = note(**changed), published(**changed)
        assert np.array_equal(ours.setpoints(1e-3).position, theirs.setpoints(1e-3).position)
        assert ours.notes == ()


def test_a_negative_ratio_runs_the_real_axes_backwards():
    """The real velocity is x times the virtual one."""
    spiral = published(turns=2, thickness=20)
    first = int(np.flatnonzero(spiral.ratios < 0)[0])
    path, passes = spiral.generated, spiral.passes
    for k in (first - 3, first):
        real = passes.connect(np.abs(passes.connected) * np.diff(passes.distance)).real
        tangent = complex(*path.tangent(real[k] + 1e-6)[0, :2])
        virtual = 1j * cmath.exp(-1j * passes.distance[k] / 60)
        assert tangent == pytest.approx(np.sign(spiral.ratios[k]) * virtual, abs=1e-4)


BASE = "listing: a BASE statement names an axis that does not exist; the virtual axes are used instead"
COUNTER = "listing: the turn counter is compared with a literal 4, not with the number of turns: "
GUARD = "listing: the guard accepts x = 0 and negative x"
COMMA = "listing: a trailing comma in the first MOVECIRC is a syntax error; it is ignored"
HELIX = "listing: MHELIX is not a command of the controller; MHELICAL is used instead"


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (
            {},
            (BASE, COUNTER + "no effect", GUARD + ": no effect, x ends at 0.3324", COMMA),
        ),
        (
            {"turns": 3, "height": 30},
            (
                BASE,
                COUNTER + "4 circles are run instead of 3",
                GUARD + ": no effect, x ends at 0.3324",
                COMMA,
                HELIX,
            ),
        ),
        (
            {"turns": 2, "thickness": 20},
            (
                BASE,
                COUNTER + "4 circles are run instead of 2",
                GUARD + ": from pass 114, at 5.605 s, the real axes run backwards, down to x = -0.007981, "
                "and WA of a negative time does not wait",
                COMMA,
            ),
        ),
        (
            halting(),
            (
                BASE,
                COUNTER + "4 circles are run instead of 3",
                GUARD + ": x is 0 on pass 40, SPEED = V / x divides by zero, the program stops "
                "and the axes continue with x = 0.025",
                COMMA,
            ),
        ),
    ],
)
def test_the_differences_of_the_listing_are_said_in_full(changed, text):
    assert published(**changed).notes == text


def test_a_first_ratio_of_zero_is_refused_even_as_published():
    with pytest.raises(InputError, match=r"^ratio x = 0 on pass 1 of \d+: must be at least 2\^-16"):
        published(**halting(1))


@pytest.mark.parametrize("passes", [2000])
def test_a_published_program_that_runs_backwards_without_end_is_refused(monkeypatch, passes):
    """SPEED = V / |x| falls as x falls on, so that what is left of the circles takes e^233 passes."""
    for module in ("loop", "spiral"):
        monkeypatch.setattr(f"gantrysim.controllers.trio.{module}.MAX_PASSES", passes)
    with pytest.raises(InputError) as error:
        published(turns=1, thickness=50, interpreter_time=0.001)
    change = 2 * 50 * 100 * 0.1 / (math.pi * 120**2)
    assert str(error.value).startswith(f"ratio x = {1 - passes * change:.4g} at ")
    assert str(error.value).endswith(
        f" s: the circles must end within {passes} passes; use a smaller thickness or a greater acceleration"
    )
