"""A value's description: its number, text and JSON content, its statistics and axes, and the code that reads it."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.quantity import (
    AXIS,
    NOTHING,
    PARTS,
    RANGE,
    SIZES,
    Item,
    Quantity,
    ascii_unit,
    contents,
    joined,
    number_text,
)

ERROR = Quantity(
    "contour",
    label="contour error",
    unit="µm",
    form=".1f",
    meaning="Distance",
    path=("values", "contour"),
    factor=1e3,
    statistics=PARTS,
)
LENGTH = Quantity("length", label="length", unit="mm", form=".3f", meaning="Length", path=("length",))
RATIO = Quantity("ratio", label="ratio", unit="", form=".2f", meaning="Ratio", path=("ratio",))
SHARE = Quantity("share", label="share", unit="%", form=".1f", meaning="Share", path=("share",), factor=100.0)


@pytest.mark.parametrize(
    ("unit", "ending"),
    [("µm", "um"), ("mm²", "mm2"), ("mm³/s", "mm3_s"), ("N·m", "Nm"), ("%", "percent"), ("mdeg", "mdeg"), ("", "")],
)
def test_a_unit_in_ascii(unit, ending):
    assert ascii_unit(unit) == ending


def test_the_key_is_name_and_unit():
    assert LENGTH.key == "length_mm"
    assert RATIO.key == "ratio"
    assert [number.key for number in ERROR.numbers] == [
        "contour_rms_um",
        "contour_p95_um",
        "contour_max_um",
        "contour_share_percent",
    ]
    assert [number.label for number in ERROR.numbers][:2] == ["contour error, rms", "contour error, 95 %"]
    assert [number.head for number in (LENGTH, RATIO)] == ["length [mm]", "ratio"]


def test_text_and_number():
    assert ERROR.text(0.0088) == "8.8 µm"
    assert ERROR.number(0.0088) == "8.8"
    assert RATIO.text(1.234) == "1.23"
    assert SHARE.text(-0.382) == "−38.2 %"


@pytest.mark.parametrize("value", [0.0, -0.0, 1e-9, -1e-9])
@pytest.mark.parametrize("form", [".0f", ".1f", ".4f", "+.2f"])
def test_what_rounds_to_zero_is_a_plain_zero(value, form):
    assert number_text(value, form) == "0"


def test_a_small_number_with_digits_is_no_zero():
    assert number_text(1e-9, ".3g") == "1e-09"
    assert number_text(0.0, ".3g") == "0"


@pytest.mark.parametrize("quantity", [ERROR, LENGTH, RATIO])
def test_what_is_missing_is_a_dash_without_a_unit(quantity):
    for value in (None, math.nan):
        assert quantity.text(value) == quantity.number(value) == NOTHING
        assert quantity.content(value) is None


def test_infinite_numbers_are_symbols_and_null_in_json():
    assert RATIO.text(math.inf) == "∞"
    assert LENGTH.text(-math.inf) == "−∞ mm"
    assert LENGTH.content(math.inf) is None


@given(st.floats(-1e6, 1e6), st.sampled_from([0, 1, 3, 6]), st.sampled_from([1.0, 100.0, 1e3]))
def test_text_and_number_read_back_are_the_value_as_rounded(value, decimals, factor):
    quantity = Quantity("x", label="x", unit="µm", form=f".{decimals}f", meaning="X", path=(), factor=factor)
    half = 0.5 * 10.0**-decimals
    number = quantity.number(value)
    read = float(number.replace("−", "-"))
    assert abs(read - factor * value) <= half * (1 + 1e-6) + 1e-9 * abs(factor * value)
    assert quantity.text(value) == f"{number} µm"
    assert quantity.content(value) == factor * value
    assert number == "0" or read != 0
    assert number != "−0"


def test_values_are_read_along_their_path():
    subject = SimpleNamespace(length=2.0, place=(1.0, 2.0), by_axis={"x": SimpleNamespace(rms=3.0, max=4.0)})
    assert LENGTH.get(subject) == 2.0
    second = Quantity("y", label="y", unit="mm", form=".1f", meaning="Y", path=("place", Item(1)))
    assert second.get(subject) == 2.0
    template = Quantity(
        "following", label="following error", unit="µm", form=".1f", meaning="F", path=(), factor=1e3, statistics=SIZES
    ).by_axis(("by_axis", Item(AXIS)))
    axis = template.of_axis("x")
    assert axis.label == "following error x"
    assert contents((axis,), subject) == {"following_x_rms_um": 3e3, "following_x_max_um": 4e3}
    rotary = template.of_axis("th", "mdeg")
    assert contents((rotary,), subject) == {"following_th_rms_mdeg": None, "following_th_max_mdeg": None}
    assert axis.numbers[0].code("run") == 'run.by_axis["x"].rms'
    assert eval(axis.numbers[0].code("run"), {"run": subject}) == 3.0


def test_nothing_on_the_way_is_no_value():
    assert LENGTH.get(None) is None
    missing = SimpleNamespace(values=SimpleNamespace(contour=None))
    assert set(contents((ERROR,), missing).values()) == {None}


def test_a_range_has_its_statistics_in_order():
    spacing = Quantity(
        "spacing", label="turn spacing", unit="mm", form=".4f", meaning="S", path=(), factor=1.0, statistics=RANGE
    )
    values = SimpleNamespace(mean=1.0, std=2.0, min=3.0, max=4.0)
    assert contents((spacing,), values) == {
        "spacing_mean_mm": 1.0,
        "spacing_std_mm": 2.0,
        "spacing_min_mm": 3.0,
        "spacing_max_mm": 4.0,
    }


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (-3.8, ".1f", "−3.8"),
        (3.8, "+.1f", "+3.8"),
        (-3.8, "+.1f", "−3.8"),
        (-0.04, ".1f", "0"),
        (-1234.5, ",.0f", "−1,234"),
    ],
)
def test_a_negative_number_has_a_minus_sign(value, form, text):
    assert number_text(value, form) == text
    assert number_text(-math.inf, form) == "−∞"


def test_a_sentence_has_no_space_at_which_a_number_parts_from_its_unit():
    text = "9.9 µm at x = −3.8, y = 4.0 mm, line 12, × 4, 2 sides, 100 mm/s, 15.2 → 2.0 %, 3 minutes"
    kept = "9.9_µm at x_=_−3.8, y_=_4.0_mm, line_12, ×_4, 2 sides, 100_mm/s, 15.2 →_2.0_%, 3 minutes"
    assert joined(text, "_") == kept
    assert joined("9.9 µm") == "9.9\N{NO-BREAK SPACE}µm"


@pytest.mark.parametrize(
    ("value", "text"),
    [(11309.7, "11310"), (-9.4214e6, "−9421000"), (9.9996e6, "10000000"), (3.2e-5, "3.2e-05"), (2e7, "2e+07")],
)
def test_numbers_that_people_read_have_no_power_of_ten(value, text):
    assert number_text(value, ".4g") == text
