"""Answers and figures of many small inputs are those that are pinned in the files beside this one.

A figure that changes on purpose is pinned anew by `scripts/pin_answers.py`, which prints what has changed.
"""

import pytest
from pinned.rooms import ROOMS, cases_of

from support.pins import differences, pinned, saved


@pytest.mark.parametrize("room", ROOMS)
def test_the_answers_of_a_room_are_those_pinned(room):
    cases = cases_of(room)
    found = {name: pinned(answer()) for name, answer in cases.items()}
    unlike = differences(saved(room), found, tolerance=ROOMS[room])
    assert not unlike, "\n".join([f"{len(unlike)} answers of {room} differ, see scripts/pin_answers.py:", *unlike])
