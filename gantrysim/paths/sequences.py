"""Sequences of feet that the search of `nearest` continues along a trace, and the arrays for its work."""

# mypy: allow-untyped-defs, allow-untyped-calls

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.paths.minima import Minima

BEAM = 8  # of all sequences of feet up to a point, the best so many are continued
CANDIDATES = 1024  # minima about a point that are considered


class Trace(NamedTuple):
    """Points in the order of a motion.

    Attributes:
        points: (n, 3) [mm].
        travel: length of the trace from the point before where others between them are left out, 0 elsewhere, (n,)
            [mm].
    """

    points: Floats
    travel: Floats


class Sequences(NamedTuple):
    """Sequences of feet that are continued at each point of a trace, as Viterbi's algorithm stores them.

    Attributes:
        entry: candidates of each point, (n, BEAM).
        origin: which candidate of the point before each of them follows, (n, BEAM).
        candidates: number of candidates of each point, (n,).
    """

    entry: NDArray[np.int32]
    origin: NDArray[np.int8]
    candidates: NDArray[np.int64]


class Ends(NamedTuple):
    """Ends of the sequences at the last point so far, one per candidate.

    Attributes:
        cost: of the sequence, above that of the best, (BEAM,).
        place: of the foot, in entries, (BEAM,).
    """

    cost: Floats
    place: Floats


class Buffers(NamedTuple):
    """Ends of the sequences, and arrays for the work on a point, made once.

    Attributes:
        ends: of the sequences, updated from point to point.
        cost, place: of the sequences extended to it, as of `Ends`.
        minima: about it.
        slots: of sequences on their way back.
    """

    ends: Ends
    cost: Floats
    place: Floats
    minima: Minima
    slots: NDArray[np.int32]


def begun(entry):
    """Return the sequences of a single point, whose foot is at an entry, and the buffers with their ends."""
    sequences = Sequences(np.zeros((1, BEAM), np.int32), np.zeros((1, BEAM), np.int8), np.ones(1, np.int64))
    ends = Ends(np.zeros(BEAM), np.zeros(BEAM))
    sequences.entry[0, 0] = entry
    ends.place[0] = entry
    numbers = np.zeros((3, CANDIDATES))
    minima = Minima(np.zeros(CANDIDATES, np.int64), numbers[0], numbers[1], numbers[2])
    return sequences, Buffers(ends, np.zeros(BEAM), np.zeros(BEAM), minima, np.zeros(BEAM, np.int32))


def extended(sequences, count):
    """Return sequences with room for further points, whose candidates are written later."""
    return Sequences(
        np.concatenate([sequences.entry, np.zeros((count, BEAM), np.int32)]),
        np.concatenate([sequences.origin, np.zeros((count, BEAM), np.int8)]),
        np.concatenate([sequences.candidates, np.ones(count, np.int64)]),
    )
