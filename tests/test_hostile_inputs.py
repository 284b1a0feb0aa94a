"""Hostile inputs of every kind: refused in one line, or read, in a bounded time, with nothing left behind."""

from collections import Counter

import pytest

from support.hostile import KINDS, attempt, drawn, prepare

# seeds that once ended in a traceback, a warning or a message of several thousand characters
FOUND = [("studies", 10416), ("studies", 10229), ("studies", 33013), ("logs", 10230), ("MJCF", 33124)]


@pytest.mark.parametrize(("kind", "seed"), FOUND)
def test_what_once_failed(kind, seed):
    assert attempt(kind, seed) in ("read", "refused")


@pytest.mark.parametrize("kind", KINDS)
def test_some_hostile_inputs(kind):
    outcomes = [attempt(kind, seed) for seed in range(4)]
    assert not set(outcomes) - {"read", "refused"}, outcomes


@pytest.mark.soak
def test_many_hostile_inputs(record_property):
    prepare()
    counts = Counter(attempt(drawn(seed), seed) for seed in range(50_000, 55_000))
    record_property("attack", "readers and studies: extreme values, long texts, truncated files")
    record_property("tries", counts.total())
    record_property("refused", counts["refused"])
    assert not counts.keys() - {"read", "refused"}, counts
