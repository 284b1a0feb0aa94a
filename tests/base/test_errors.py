"""What is refused, in one line with quantity, value, unit and bound; and names that may be meant."""

import math

import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.base.errors import (
    GantryError,
    TimedError,
    at_least,
    between,
    check_one_of,
    check_type,
    finite,
    meant_names,
    nearest,
    plane_point,
    positive,
    space_point,
    text_of,
    unknown,
    whole_number,
)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: finite("speed", "fast"), "speed = 'fast': must be a number"),
        (lambda: finite("speed", True), "speed = True: must be a number"),
        (lambda: finite("speed", None), "speed = None: must be a number"),
        (lambda: finite("speed", math.nan, "mm/s"), "speed = nan mm/s: must be finite"),
        (lambda: finite("speed", -math.inf), "speed = -inf: must be finite"),
        (lambda: finite("speed", 10**400), "speed: must be finite, at most 1.798e+308"),
        (lambda: positive("gap", 0, "mm"), "gap = 0 mm: must be greater than 0 mm"),
        (lambda: positive("gap", 3, "mm", 2), "gap = 3 mm: must be at most 2 mm"),
        (lambda: at_least("turns", 0.5, 1), "turns = 0.5: must be at least 1"),
        (lambda: at_least("turns", 5, 1, most=4), "turns = 5: must be at most 4"),
        (lambda: between("share", -0.1, 0, 1, "%"), "share = -0.1 %: must be 0 to 1 %"),
        (lambda: between("share", 1.1, 0, 1), "share = 1.1: must be 0 to 1"),
        (lambda: plane_point("centre", (1, 2, 3)), "centre = (1, 2, 3): must be two numbers, x and y [mm]"),
        (lambda: plane_point("centre", (1, math.nan)), "centre y = nan mm: must be finite"),
        (lambda: space_point("start", (1,)), "start of 1 numbers: must be x, y[, z]"),
        (lambda: space_point("start", (1, 2, math.inf)), "start z = inf mm: must be finite"),
        (lambda: finite("flow", "200", "mm³/s"), "flow = '200': must be a number"),
        (lambda: check_one_of("kind", 5, ("valve", "jet")), "unknown kind 5: known: jet, valve"),
        (
            lambda: check_one_of("kind", np.zeros((2, 1)), ("valve",)),
            "unknown kind array([[0.],        [0.]]): known: valve",
        ),
        (
            lambda: check_type("budget", "x", float, "a Budget", "write Budget(run)"),
            "budget is of type str: must be a Budget; write Budget(run)",
        ),
        (lambda: whole_number("repeats", 2.5, 1), "repeats = 2.5: must be a whole number"),
        (lambda: whole_number("repeats", 0, 1), "repeats = 0: must be at least 1"),
        (lambda: whole_number("repeats", 2.0**60, 1), "repeats = 1.15292e+18: must be at most 9.0072e+15"),
    ],
)
def test_a_refusal_names_quantity_value_and_bound(call, text):
    with pytest.raises(InputError) as refused:
        call()
    assert str(refused.value) == text


def test_values_at_their_bounds_are_taken():
    assert (finite("x", 1.5), positive("x", 2, "mm", 2), at_least("x", 1, 1, most=1)) == (1.5, 2.0, 1.0)
    assert (between("x", 0, 0, 1), between("x", 1, 0, 1)) == (0.0, 1.0)
    assert (plane_point("x", [1, 2]), space_point("x", [1, 2]), space_point("x", [1, 2, 3])) == (
        (1, 2),
        (1, 2, 0),
        (1, 2, 3),
    )
    assert whole_number("x", 3.0, 3) == 3
    assert isinstance(whole_number("x", 3.0, 3), int)


@pytest.mark.parametrize("kind", [GantryError, InputError, TimedError])
def test_a_text_that_quotes_too_much_loses_its_middle(kind):
    assert str(kind("x" * 1900)) == "x" * 1900
    long = f"begin {'x' * 10**5} end"
    text = str(kind(long))
    assert len(text) < 2000
    assert text.startswith("begin xxx")
    assert text.endswith("xxx end")
    assert " ... " in text


def test_an_error_in_one_line_has_its_type_where_it_is_none_of_the_domain():
    assert text_of(InputError("gap = 0:\n must be more")) == "gap = 0: must be more"
    assert text_of(ValueError("a\nb")) == "ValueError: a b"
    assert text_of(KeyError()) == "KeyError"
    assert text_of(OSError(28, "No space left on device")) == "OSError: No space left on device"


def test_the_names_that_may_be_meant_come_first():
    names = ["servo.period", "servo.delay", "program.speed", "bead.gap"]
    assert nearest("perod", names)[0] == "servo.period"
    assert nearest("PERIOD", names)[0] == "servo.period"
    assert nearest("xyzzy", names) == []
    text = "unknown key 'perod': did you mean servo.period? known: servo.period, program.speed, bead.gap, servo.delay"
    assert str(unknown("key", "perod", names)) == text
    assert str(unknown("key", "xyzzy", ["b", "a"])) == "unknown key 'xyzzy': known: a, b"
    assert str(unknown("key", "x", [])) == "unknown key 'x': there are none"
    assert meant_names([]) == ""
    assert meant_names(["a"]) == "did you mean a?"
    assert meant_names(["a", "b", "c"]) == "did you mean a, b or c?"
