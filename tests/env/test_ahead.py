"""Threads that step an agent's places while the next episodes are drawn."""

import os

import pytest

from gantrysim.env.episode_batch import threads_for


@pytest.mark.parametrize(
    ("places", "cores", "threads"),
    [(64, 2, 2), (32, 2, 2), (31, 2, 4), (64, 16, 32), (3, 2, 3), (1, 8, 1), (64, None, 1)],
)
def test_a_core_has_one_thread_for_many_places_and_two_for_few(monkeypatch, places, cores, threads):
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    assert threads_for(places) == threads
