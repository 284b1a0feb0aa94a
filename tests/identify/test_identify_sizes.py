"""Sizes in words."""

import pytest

from gantrysim.identify.sizes import change_words, count_words, number_words, share_words, times_words


@pytest.mark.parametrize(
    ("function", "value", "text"),
    [
        (count_words, 0.16, "0.16 counts"),
        (count_words, 3.21, "3.2 counts"),
        (count_words, 99.4, "99 counts"),
        (count_words, 99.6, "100 counts"),
        (count_words, 2345.6, "2,346 counts"),
        (share_words, 0.025, "2.5 % of"),
        (share_words, 1.38, "138 % of"),
        (share_words, 203810.46, "203,810 times"),
        (change_words, 0.35, "35 %"),
        (change_words, 12.0, "12 times its value"),
        (times_words, 29.38, "29.4 times"),
        (times_words, 2940.2, "2,940 times"),
        (times_words, 0.000873, "0.000873 times"),
        (times_words, -1.0, "-1 times"),
        (number_words, 80.0712, "80.07"),
        (number_words, 80071.2, "80,071"),
    ],
)
def test_sizes_in_words(function, value, text):
    assert function(value) == text
