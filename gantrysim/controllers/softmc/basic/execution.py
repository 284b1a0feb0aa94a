"""A program under way: its scopes, elements, clock, outputs and records."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gantrysim.controllers.basic.code import STATEMENT, Code, Frame
from gantrysim.controllers.basic.tasks import StatementClock
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.elements import Elements
from gantrysim.controllers.softmc.basic.recording import Recording
from gantrysim.controllers.softmc.basic.timeline import LONGEST_TIME, Mark, Timeline
from gantrysim.controllers.softmc.basic.values import CONSTANTS, Element, Point, Value, Variable, array, number, text_of
from gantrysim.controllers.softmc.commands import Command, SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.stream import AXES

# Properties that follow from the motion and the program's time, not from an assignment.


def _clock(time: Timeline, elements: Elements, element: Element) -> Value:
    return 1e3 * time.clock


def _is_settled(time: Timeline, elements: Elements, element: Element) -> Value:
    group = elements.focus()
    if time.clock < time.free + 1e-3 * float(group.properties.get("timesettle", 0.0)):
        return 0.0
    time.settle()
    return 1.0


def _position(time: Timeline, elements: Elements, element: Element) -> Value:
    place = time.position.tolist()
    if element.kind == "axis":
        return float(place[elements.index_of(element)])
    return Point(tuple(place[: elements.axes or len(AXES)]))


STEADY_PROPERTIES = ("elementname", "ismoving")  # of them, those that stay as they are while a motion is under way
LIVE: dict[str, Callable[[Timeline, Elements, Element], Value]] = {
    "clock": _clock,
    "time": _clock,
    "elementname": lambda time, elements, element: element.name,
    "ismoving": lambda time, elements, element: float(time.moving),
    "issettled": _is_settled,
    "pcmd": _position,
    "pfb": _position,
    "setpoint": _position,
}


# Loops that wait for the end of a motion: their passes are counted, not run, while the motion goes on.

_STATEMENTS_AT_ONCE = 100_000  # statements at once


class Waits:
    """Skips passes of a loop in which nothing changes but the program's time.

    Such a pass only tests, jumps and sleeps, and reads of what follows from the time no more than whether the group
    moves. The next one is then the same, up to the one in which the motion ends: `WHILE isMoving: SLEEP 1: END WHILE`
    takes as long as the motion, a thousand passes a second.

    Args:
        time: the program's.
        clock: of the statements.

    Attributes:
        changed: whether something else has taken place, or was read, since the last jump back.
    """

    def __init__(self, time: Timeline, clock: StatementClock) -> None:
        self.changed = True
        self._time = time
        self._clock = clock
        # of the last jump back: where it lies and where it begins
        self._loop: tuple[Frame, int] | None = None
        self._count = 0  # of statements then
        # by which the time has advanced since
        self._durations: list[float] = []

    def pass_time(self, duration: float) -> None:
        """Let time pass [s]."""
        self._time.clock += duration
        if not self.changed:
            self._durations.append(duration)

    def come_back(self, frame: Frame, goal: int) -> None:
        """Begin a pass of a loop; skip those that are like the one that has ended."""
        if not self.changed and self._loop is not None and self._loop[0] is frame and self._loop[1] == goal:
            self._skip(self._clock.count - self._count)
        self.changed = False
        self._loop = (frame, goal)
        self._count = self._clock.count
        self._durations = []

    def _skip(self, statements: int) -> None:
        """Let the time of passes with so many statements go by, each to the same last bit, while the group moves."""
        duration = sum(self._durations)
        if not self._time.moving or duration <= 0:
            return
        most = int((self._time.free - self._time.clock) / duration) + 1
        if statements:
            most = min(most, self._clock.remaining // statements)
        size = len(self._durations)
        durations = np.tile(self._durations, min(most, _STATEMENTS_AT_ONCE // size + 1))
        # one after the other, as statements add them
        clocks = np.add.accumulate(np.concatenate([[self._time.clock], durations]))
        ends = clocks[size::size]
        passes = int(np.searchsorted(ends, self._time.free))
        if passes:
            self._time.clock = float(ends[passes - 1])
            self._clock.count += passes * statements


MOST_PRINTED = 1000  # lines
MOST_ITEMS = 1_000_000  # of all arrays
MOST_MARKS = 100_000  # of outputs and records
NESTED_CALLS = 32  # calls within one another


@dataclass(kw_only=True)
class RoutineFrame(Frame):
    """Code under way with the program that it belongs to."""

    execution: Execution

    def note_change(self) -> None:
        self.execution.waits.changed = True

    def come_back(self, goal: int) -> None:
        self.execution.waits.come_back(self, goal)


Expression = Callable[[RoutineFrame], Value]
Action = Callable[[RoutineFrame], None]  # of a command


@dataclass
class Routine:
    """A sub, or a function where `kind` is given; `parameters` are name, whether by value, and kind."""

    name: str
    parameters: list[tuple[str, bool, str]]
    kind: str | None
    code: Code[RoutineFrame] = field(default_factory=list)


@dataclass(frozen=True)
class RunSettings:
    """What a program runs with.

    Attributes:
        group: properties of the group before the program sets them.
        placement: of the program on the work.
        start: initial position, or None.
        coordinates: how many a group has at most.
        line_time: that a statement takes [s].
        override: of all speeds [%].
        most: statements.
        output: number of the digital output that dispenses.
    """

    group: Group
    placement: Placement
    start: tuple[float, ...] | None
    coordinates: int
    line_time: float
    override: float
    most: int
    output: int


class Execution:
    """A program under way, or after it has run.

    Args:
        settings: of the run.
        interpret: from a text and a line to code, for VesExecute.

    Attributes:
        shared: variables of all programs, subs and functions, by lower-case name.
        routines: subs and functions by lower-case name.
        elements: axes, group and system.
        clock: of the statements.
        time: the motions, and the program's time.
        waits: loops that wait for a motion.
        depth: calls under way within one another.
        begins: where the group begins, in words, where no start is given.
        printed: lines, the first of `prints`.
        idle: number of assignments without effect, by what they assign.
        outputs: states of digital outputs.
        switched: instants at which the dispensing output was switched, and whether on.
        ahead: longest time by which it was switched before the end of motions just issued [s], and the line.
        records: of the program.
        speeds: of the motions along a path [mm/s].
    """

    def __init__(self, settings: RunSettings, interpret: Callable[[str, int], Code[RoutineFrame]]) -> None:
        self.settings = settings
        self.interpret = interpret
        self.shared: dict[str, Variable] = {}
        self.routines: dict[str, Routine] = {}
        self.elements = Elements(settings.group, settings.coordinates)
        refusal = f"{settings.most} statements are run: a program must end before; see max_statements"
        self.clock = StatementClock({STATEMENT: settings.line_time}, settings.most, refusal)
        start = settings.start
        self.elements.axes = None if start is None else len(start)
        self.time = Timeline(
            settings.placement, None if start is None else np.array([*start, *[0.0] * (len(AXES) - len(start))])
        )
        self.waits = Waits(self.time, self.clock)
        self.depth = 0
        self.begins = ""
        self.printed: list[str] = []
        self.prints = 0
        self.idle: dict[str, int] = {}
        self.outputs: dict[int, float] = {}
        self.switched: list[tuple[Mark, bool]] = []
        self.ahead = (0.0, 0)
        self.records: list[Recording] = []
        self.speeds: list[float] = []
        self._items = 0
        self._marks = 0

    @property
    def axes(self) -> int | None:
        """Number of the group's axes, None where the program does not tell."""
        return self.elements.axes

    def run(self, code: Code[RoutineFrame], variables: dict[str, Any]) -> None:
        """Execute code to its end, with the variables of its scope."""
        RoutineFrame(code=code, variables=variables, shared=self.shared, execution=self).run(self._begin)

    def _begin(self, line: int, cost: str) -> None:
        """Count a statement and its time.

        Raises:
            InputError: too many statements, or too long a program.
        """
        self.pass_time(self.clock.begin(line, cost))

    def pass_time(self, duration: float) -> None:
        """Let time pass [s].

        Raises:
            SoftMCError: too long a program.
        """
        self.waits.pass_time(duration)
        if self.time.clock > LONGEST_TIME:
            raise SoftMCError(f"the program runs for more than {LONGEST_TIME:g} s: must end before")

    def call(self, code: Code[RoutineFrame], variables: dict[str, Any]) -> None:
        """Execute code within a statement, which goes on afterwards."""
        self.depth += 1
        line = self.clock.line
        self.run(code, variables)
        self.depth -= 1
        # of the statement that goes on, for its errors
        self.clock.line = line

    def check_depth(self, name: str) -> None:
        """Raise SoftMCError where a call would be too deep within others."""
        if self.depth >= NESTED_CALLS:
            raise SoftMCError(f"{name}: calls are nested more than {NESTED_CALLS} deep")

    def array(self, dimensions: list[Value], value: Value | None) -> Any:
        """Return an array, or the value itself without dimensions.

        Raises:
            SoftMCError: too many items in all.
        """
        if not dimensions:
            return value
        items = array(dimensions, value)
        self._items += math.prod(int(number("dimension", size)) for size in dimensions)
        if self._items > MOST_ITEMS:
            raise SoftMCError(f"arrays of {self._items} items: must be at most {MOST_ITEMS} in all")
        return items

    # elements and their properties

    def element(self, name: str, scope: RoutineFrame) -> Element | None:
        """Return the element of a name, None where it is something else."""
        key = name.lower()
        variable = scope.find(key)
        if variable is not None:
            return variable.value if isinstance(variable.value, Element) else None
        if self.elements.is_reserved(key):
            return self.elements.reserved(key)
        if key in self.routines or key in CONSTANTS or properties.is_property(key):
            return None
        return self.elements.named(name)

    def assign(self, element: Element, name: str, value: Value) -> None:
        """Assign a property."""
        short, checked = properties.checked_property(element, name, value)
        element.properties[short] = checked
        is_effective = element.kind == "group" and short in properties.EFFECTIVE
        if not is_effective and (element.kind, short) != ("system", "vord"):
            key = f"{element.kind} {short}"
            self.idle[key] = self.idle.get(key, 0) + 1

    def read(self, element: Element, name: str) -> Value:
        """Return the value of a property."""
        short = properties.canonical(name)
        if short not in properties.NAMES:
            raise SoftMCError(f"unknown property {name!r}{properties.hint(short, properties.NAMES)}")
        return self.read_known(element, short, name)

    def read_known(self, element: Element, short: str, name: str) -> Value:
        """Return the value of a property that there is, by its canonical name."""
        if short in LIVE:
            # the next pass of a loop reads another value
            self.waits.changed |= short not in STEADY_PROPERTIES
            return LIVE[short](self.time, self.elements, element)
        if short in element.properties:
            value: Value = element.properties[short]
            return value
        raise SoftMCError(f"{element.name}.{name} has no value yet: must be assigned first")

    # motion

    def begin(self, target: tuple[float, ...] | None) -> None:
        """Place the group where no start is given: at the target of its first motion, or at the origin."""
        place = [*(target or ()), 0.0, 0.0, 0.0, 0.0][: len(AXES)]
        self.time.start = np.array(place)
        self.begins = "at the origin" if target is None else "at the target of its first MOVE"

    def move(self, element: Element, nodal: dict[str, Any], command: Command, path: bool) -> None:
        """Issue a motion command.

        Args:
            element: the group.
            nodal: properties of this command alone.
            command: the motion.
            path: whether Vtran, where given, is the speed; else it is VCruise.
        """
        if not element.properties["en"] or not self.elements.of_system("motion", 1.0):
            raise SoftMCError(f"{element.name or 'the group'} is disabled: must be en = 1, and sys.motion = on")
        of_motion = {**element.properties, **nodal}
        if "vcruise" in nodal and "vtran" in nodal:
            raise SoftMCError("vcruise and vtran: give only one of the two")
        # the speed of the command comes before that of the group, whichever it is
        if "vcruise" in nodal:
            of_motion.pop("vtran", None)
        override = self.settings.override / 100
        factor = of_motion["vord"] / 100 * (self.elements.of_system("vord", 100.0) / 100) * override
        group = properties.group_of(of_motion, self.settings.group, path or "vtran" in nodal, factor)
        settles = of_motion["starttype"] == 2
        self.time.issue(command, self.axes or 2, group, bool(of_motion["dispense"]), settles, self.clock.line)
        if self.time.travels:
            self.speeds.append(group.velocity)

    # outputs, time and printing

    def switch(self, port: int, value: float) -> None:
        """Switch a digital output."""
        self.outputs[port] = value
        if port == self.settings.output:
            self.ahead = max(self.ahead, (self.time.unawaited, self.clock.line))
            self.switched.append((self.mark(), value != 0))

    def mark(self) -> Mark:
        """Return the present instant, for an output or a record.

        Raises:
            SoftMCError: too many.
        """
        self._marks += 1
        if self._marks > MOST_MARKS:
            raise SoftMCError(f"{MOST_MARKS} switchings: a program must have at most that many")
        return self.time.mark()

    def sleep(self, name: str, value: Value) -> None:
        """Let time pass [ms].

        Raises:
            SoftMCError: a negative time, or too long a program.
        """
        duration = number(name, value)
        if duration < 0:
            raise SoftMCError(f"{name} = {duration:g} ms: must be at least 0 ms")
        self.pass_time(1e-3 * duration)

    def show(self, values: list[Value]) -> None:
        """Print values on a line."""
        self.prints += 1
        if len(self.printed) < MOST_PRINTED:
            self.printed.append(" ".join(text_of(value) for value in values)[:1000])
