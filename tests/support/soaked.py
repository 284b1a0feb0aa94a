"""Cases of a test that the soak runs all, and the test suite in part."""

from collections.abc import Sequence
from typing import Any

import pytest


def suite_runs(cases: Sequence[Any], *chosen: int) -> list[Any]:
    """Return the cases of a parametrised test, all but the chosen ones (by their numbers) for the soak alone.

    A case of several arguments is a tuple.
    """
    marked = []
    for number, case in enumerate(cases):
        arguments = case if isinstance(case, tuple) else (case,)
        marks = () if number in chosen else pytest.mark.soak
        marked.append(pytest.param(*arguments, marks=marks))
    return marked
