"""Position of the extruder over time: what E commands, and what pressure advance makes of it.

Between two nodes of the speed profile the speed of the filament is linear in time, as E is linear along the path. With
the position e, its velocity v in moves that lay material along the work (elsewhere 0 is advanced), and the settings K,
E and V of `PressureAdvance`, the motor is sent to

    e + K v + E f(v / V),  f(u) = tanh(u) or, as the reciprocal law, u / (1 + u).

Klipper averages e and v over `smooth_time` T with the weight T/2 - |t - x| first (its `kin_extruder.c`); Marlin's
linear advance (M900) and RepRapFirmware's pressure advance (M572) do not, and have K alone. The non-linear laws and the
names of their settings are those of Klipper's descendants (`pressure_advance_model`); these average with another weight
of the same length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.controllers.gcode.extruder import PressureAdvance
from gantrysim.controllers.gcode.move_table import ADVANCE, ARC, DWELL, END, FLOW, KIND
from gantrysim.controllers.gcode.planned import PathPlan
from gantrysim.controllers.valve import SAME_PLACE

AdvanceLaw = Literal["tanh", "reciprocal"]
# exact for cubics, as a quadratic position times a linear weight
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(2)
_ROUNDING = 1e-6  # of a time, in periods
_REST_TIME = 1.0  # before and after the motion, longer than any average [s]


class Sampled(NamedTuple):
    """The ends of words E at ticks.

    Attributes:
        ticks: ascending, (k,).
        position: there, (k,) [mm].
        rests: first tick of each feed at rest that lays material, and the first after it, by their times, (d, 2).
        dots: the same as it is sampled, (d, 2).
    """

    ticks: NDArray[np.intp]
    position: Floats
    rests: NDArray[np.intp]
    dots: NDArray[np.intp]

    def apply(self, material: dict[str, Floats], dispense: NDArray[np.bool_], first: int) -> None:
        """Set positions of E and of its motor, and the dispenser's command, over a block of ticks from a first one on.

        The motor stays as far ahead of E as it is.
        """
        after = first + dispense.size
        here = (self.ticks >= first) & (self.ticks < after)
        ticks = self.ticks[here] - first
        change = self.position[here] - material["extrusion"][ticks]
        for position in material.values():
            position[ticks] += change
        for bounds, is_on in ((self.rests, False), (self.dots, True)):
            for begin, end in bounds[(bounds[:, 0] < after) & (bounds[:, 1] > first)].tolist():
                dispense[max(begin - first, 0) : end - first] = is_on


@dataclass(frozen=True)
class Extrusion:
    """Position of the extruder over time, in intervals of constant acceleration; at rest in the first and the last.

    Attributes:
        time: of the nodes, ascending, (m + 1,) [s].
        begin: position at the beginning of each interval, (m,) [mm].
        speed: of the filament at the beginning of each interval, (m,) [mm/s].
        change: acceleration of the filament, (m,) [mm/s²].
        setting: index of the pressure advance in force in each interval, (m,).
        acts: whether it acts: material is laid along the work, (m,).
        rests: whether E moves while the axes rest, (m,).
        lays: whether it lays material then, (m,).
        advances: settings of pressure advance.
        law: of the non-linear term.
    """

    time: Floats
    begin: Floats
    speed: Floats
    change: Floats
    setting: NDArray[np.intp]
    acts: NDArray[np.bool_]
    rests: NDArray[np.bool_]
    lays: NDArray[np.bool_]
    advances: tuple[PressureAdvance, ...]
    law: AdvanceLaw = "tanh"

    @property
    def is_advanced(self) -> bool:
        """Whether pressure advance acts anywhere."""
        used = np.unique(self.setting[self.acts])
        return any(self.advances[k].advance or self.advances[k].offset for k in used)

    @property
    def lateness(self) -> float:
        """Time by which the motor's motion ends after that of the axes: half the longest average [s]."""
        return 0.5 * max(advance.smooth_time for advance in self.advances) if self.is_advanced else 0.0

    def position(self, t: Floats) -> Floats:
        """Return the position that E commands at times, (n,) [mm]."""
        k = self._locate(t)
        elapsed = t - self.time[k]
        return np.asarray(self.begin[k] + elapsed * (self.speed[k] + 0.5 * elapsed * self.change[k]))

    @cached_property
    def _nodes(self) -> NDArray[np.intp]:
        """Intervals at whose beginning E turns back or forth, or a feed at rest begins or ends, ascending."""
        steps = np.diff(np.append(self.begin, self.begin[-1:]))
        moving = np.flatnonzero(steps)
        turns = moving[np.flatnonzero(np.diff(np.sign(steps[moving])))] + 1
        rests = np.flatnonzero(self.rests)
        return np.unique(np.concatenate([turns, rests, rests + 1]))

    def sampled(self, period: float, count: int) -> Sampled:
        """Return the ticks at which E reaches the ends of its words.

        Between two ticks, an end is at the next one, or the next without an end: what E feeds would else be cut by what
        it feeds in a part of a tick, and a feed at rest would begin before its dispensing. The last tick has the end of
        all.

        Args:
            period: of the ticks [s].
            count: number of ticks.
        """
        nodes = self._nodes
        rank = np.arange(nodes.size)
        reached = np.ceil(self.time[nodes] / period - _ROUNDING).astype(np.intp)
        ticks = np.maximum.accumulate(reached - rank) + rank
        ticks = np.minimum(ticks, count - 1 - ticks.size + rank)
        begins = np.flatnonzero(self.lays[nodes])
        rests, dots = (np.stack([places[begins], places[begins + 1]], axis=1) for places in (reached, ticks))
        # the last tick is still in a feed at rest that ends there
        rests[:, 1] += rests[:, 1] == count - 1
        is_within = ticks > 0
        return Sampled(ticks[is_within], self.begin[nodes[is_within]], rests, dots)

    def _locate(self, t: Floats) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, self.begin.size - 1)

    def advanced(self, t: Floats) -> Floats:
        """Return the position that pressure advance sends to the motor at times, (n,) [mm]."""
        settings = np.array(self.advances)[self.setting]
        # Klipper averages nothing without an advance
        settings[(settings[:, 0] == 0) & (settings[:, 2] == 0), 1] = 0.0
        k = self._locate(t)
        in_force = settings[k]
        intervals = np.stack([self.begin, self.speed, self.change], axis=1)
        acting = np.where(self.acts[:, None], settings[:, [0, 2]], 0.0)
        place, linear, speed = _averages(t, k, self.time, intervals, acting, 0.5 * in_force[:, 1])
        ratio = speed / in_force[:, 3]
        shape = np.tanh(ratio) if self.law == "tanh" else ratio / (1 + ratio)
        return np.asarray(place + linear + in_force[:, 2] * shape)


def extrusion_of(plan: PathPlan, law: AdvanceLaw) -> Extrusion:
    """Return the position of the extruder over the time of a planned program.

    Args:
        plan: of the program.
        law: of the non-linear term.
    """
    table = plan.program.moves
    moves = table[:, KIND] != DWELL
    fed = np.cumsum(np.where(moves, table[:, FLOW], 0.0))
    done = np.concatenate([[0.0], plan.requested.ends])
    # a move too short for the path feeds with the next one
    at_ends = np.interp(plan.progress, done, np.concatenate([[0.0], fed[plan.rows]]))
    s, v, t = plan.profile.knots
    duration = np.diff(t)
    lasting = duration > 0
    piece = plan.path.locate(0.5 * (s[:-1] + s[1:]))
    lengths = plan.path.lengths
    # the path keeps the place of a piece that rounding leaves without length
    rate = np.divide(np.diff(at_ends), lengths, out=np.zeros(lengths.size), where=lengths > 0)[piece]
    row = plan.source[piece]
    # a dwell lies between two nodes' intervals
    dwells = plan.dwells
    place = np.searchsorted(0.5 * (t[1:] + t[:-1]), dwells.begin)
    length = np.insert(duration, place, dwells.times)
    change = np.insert(rate * np.diff(v) / np.where(lasting, duration, 1.0), place, 0.0)
    speed = np.insert(rate * v[:-1], place, table[dwells.rows, FLOW] / dwells.times)
    step = np.insert(rate * np.diff(s), place, table[dwells.rows, FLOW])
    rows = np.insert(row, place, dwells.rows)
    is_kept = np.concatenate([[True], length > 0, [True]])
    length = np.concatenate([[_REST_TIME], length, [_REST_TIME]])[is_kept]
    step = np.pad(step, 1)[is_kept]
    rows = np.pad(rows, 1, "edge")[is_kept]
    plane = np.concatenate([[plan.program.start[:2]], table[:, END : END + 2]])
    along = (table[:, KIND] == ARC) | (np.abs(np.diff(plane, axis=0)).max(axis=1, initial=0.0) > SAME_PLACE)
    acts = (moves & along & (table[:, FLOW] > 0))[rows]
    acts[[0, -1]] = False
    rests = (~moves & (table[:, FLOW] != 0))[rows]
    rests[[0, -1]] = False
    return Extrusion(
        time=np.concatenate([[0.0], np.cumsum(length)]) - _REST_TIME,
        begin=np.concatenate([[0.0], np.cumsum(step)[:-1]]),
        speed=np.pad(speed, 1)[is_kept],
        change=np.pad(change, 1)[is_kept],
        setting=table[rows, ADVANCE].astype(np.intp),
        acts=acts,
        rests=rests,
        lays=rests & (plan.program.glue & (table[:, FLOW] > 0))[rows],
        advances=plan.program.advances,
        law=law,
    )


@jit
def _averages(
    t: Floats, first: NDArray[np.intp], time: Floats, intervals: Floats, acting: Floats, half: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return averages of the position, of K v, and of v where an offset acts, at times, (n,) each.

    Args:
        t: times, (n,) [s].
        first: interval at each of them, (n,).
        time: of the nodes, (m + 1,) [s].
        intervals: position, speed and acceleration of each interval, (m, 3).
        acting: K and E that act in each interval, (m, 2).
        half: half the window of the average at each time; 0 for none, (n,) [s].
    """
    place = np.zeros(t.size)
    linear = np.zeros(t.size)
    fast = np.zeros(t.size)
    for i in range(t.size):
        k = first[i]
        window = half[i]
        # relative to it, so that nothing is rounded in a long program
        origin = intervals[k, 0]
        if window == 0.0:
            elapsed = t[i] - time[k]
            speed = intervals[k, 1] + elapsed * intervals[k, 2]
            place[i] = origin + elapsed * (intervals[k, 1] + 0.5 * elapsed * intervals[k, 2])
            linear[i] = acting[k, 0] * speed
            fast[i] = speed if acting[k, 1] != 0.0 else 0.0
            continue
        while k > 0 and time[k] > t[i] - window:
            k -= 1
        while k < len(intervals) and time[k] < t[i] + window:
            begin = max(time[k], t[i] - window)
            end = min(time[k + 1], t[i] + window)
            middle = min(max(t[i], begin), end)
            # the weight has its tip at the time itself
            for a, b in ((begin, middle), (middle, end)):
                for node in range(2):
                    x = a + 0.5 * (b - a) * (1.0 + _NODES[node])
                    weight = 0.5 * (b - a) * _WEIGHTS[node] * (window - abs(t[i] - x)) / window**2
                    elapsed = x - time[k]
                    speed = intervals[k, 1] + elapsed * intervals[k, 2]
                    moved = elapsed * (intervals[k, 1] + 0.5 * elapsed * intervals[k, 2])
                    place[i] += weight * (intervals[k, 0] - origin + moved)
                    linear[i] += weight * acting[k, 0] * speed
                    fast[i] += weight * speed if acting[k, 1] != 0.0 else 0.0
            k += 1
        place[i] += origin
    return place, linear, fast
