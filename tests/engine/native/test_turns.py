"""Turns that threads take in compiled code: each number once, whoever is free first."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import take_turn


@jit
def take_all(address, count, taken):
    """Take turns up to a number, and mark those that came; return how many did."""
    came = 0
    turn = take_turn(address)
    while turn < count:
        taken[turn] += 1
        came += 1
        turn = take_turn(address)
    return came


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_turn_is_taken_once(threads):
    count = 2_000_000
    turn = np.zeros(1, np.int64)
    taken = np.zeros(count, np.uint8)
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(take_all, turn.ctypes.data, count, taken) for _ in range(threads)]
        came = [future.result() for future in futures]
    assert sum(came) == count
    assert (taken == 1).all()
    # each thread has found out that there are no more
    assert turn[0] == count + threads
