"""Cases and examples of a test that the soak runs all, and the test suite in part."""

import os
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import settings

from gantrysim.job.loading import builtin_jobs

# set by scripts/soak.py
WHOLE = os.environ.get("GANTRYSIM_EXAMPLES") == "whole"
FEWEST = 5  # examples


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


def of_jobs(*names: str) -> list[Any]:
    """Return the names of all built-in jobs, of which those that are given run in the test suite."""
    jobs = builtin_jobs()
    return suite_runs(jobs, *map(jobs.index, names))


def number_of_examples(whole: int) -> int:
    """Return how many of a property's examples are tried: a sixth of them in the test suite."""
    return whole if WHOLE else max(whole // 6, min(whole, FEWEST))


def examples(whole: int) -> settings:
    """Return hypothesis's settings of a property that the soak tries with this many examples."""
    return settings(max_examples=number_of_examples(whole))
