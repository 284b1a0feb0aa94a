"""The state of a running program: its variables, elements, clock, outputs and records."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.recording import Recording
from gantrysim.controllers.softmc.basic.timeline import LONGEST, Mark, Timeline
from gantrysim.controllers.softmc.basic.values import CONSTANTS, Element, Point, Value, Variable, array, number, text_of
from gantrysim.controllers.softmc.commands import Command, SoftMCError
from gantrysim.controllers.softmc.geometry import AXES
from gantrysim.controllers.softmc.group import Group

MOST_PRINTED = 1000  # lines
MOST_ITEMS = 1_000_000  # of all arrays
MOST_MARKS = 100_000  # of outputs and records
_AXIS = re.compile(r"a([1-9]\d?)")
_JOINT = re.compile(r"j([1-9]\d?)")
_SYSTEM = ("sys", "system")


@dataclass
class Frame:
    """Where a routine runs.

    Attributes:
        task: the running program.
        local: its variables by lower-case name.
    """

    task: Task
    local: dict[str, Variable]

    def find(self, key: str) -> Variable | None:
        """Return a variable by its lower-case name."""
        return self.local.get(key) or self.task.shared.get(key)


Expression = Callable[[Frame], Value]
Statement = Callable[[Frame], None]
Block = list[tuple[int, Statement]]


@dataclass
class Routine:
    """A sub, or a function where `kind` is given; `parameters` are name, whether by value, and kind."""

    name: str
    parameters: list[tuple[str, bool, str]]
    kind: str | None
    block: Block = field(default_factory=list)


@dataclass
class Task:
    """A running program.

    Attributes:
        group: properties of the group before the program sets them.
        placement: of the program on the work.
        start: initial position, or None.
        coordinates: how many a group has at most.
        line_time: [s].
        override: of all speeds [%].
        most: statements.
        output: number of the digital output that dispenses.
        interpret: from a text and a line to statements, for VesExecute.
    """

    group: Group
    placement: Placement
    start: Floats | None
    coordinates: int
    line_time: float
    override: float
    most: int
    output: int
    interpret: Callable[[str, int], Block]

    shared: dict[str, Variable] = field(default_factory=dict)
    routines: dict[str, Routine] = field(default_factory=dict)
    elements: dict[str, Element] = field(default_factory=dict)
    moved: Element | None = None
    default: Element | None = None
    axes: int | None = None
    begins: str = ""
    line: int = 0
    count: int = 0
    depth: int = 0
    items: int = 0
    marks: int = 0
    printed: list[str] = field(default_factory=list)
    prints: int = 0
    idle: dict[str, int] = field(default_factory=dict)
    outputs: dict[int, float] = field(default_factory=dict)
    switched: list[tuple[Mark, bool]] = field(default_factory=list)
    records: list[Recording] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)

    deepest: ClassVar[int] = 32

    def __post_init__(self) -> None:
        self.time = Timeline(self.placement, self.start)

    def step(self, line: int) -> None:
        """Count a statement and its time.

        Raises:
            SoftMCError: too many statements, or too long a program.
        """
        self.line = line
        self.count += 1
        self.time.clock += self.line_time
        if self.count > self.most:
            raise SoftMCError(f"{self.most} statements are run: a program must end before; see max_statements")
        if self.time.clock > LONGEST:
            raise SoftMCError(f"the program runs for more than {LONGEST:g} s: must end before")

    def array(self, dimensions: list[Value], value: Value | None) -> Any:
        """Return an array, or the value itself without dimensions.

        Raises:
            SoftMCError: too many items in all.
        """
        if not dimensions:
            return value
        made = array(dimensions, value)
        self.items += math.prod(int(number("dimension", size)) for size in dimensions)
        if self.items > MOST_ITEMS:
            raise SoftMCError(f"arrays of {self.items} items: must be at most {MOST_ITEMS} in all")
        return made

    def run(self, block: Block, frame: Frame) -> None:
        """Run statements one after the other."""
        for line, do in block:
            self.step(line)
            do(frame)

    # Elements

    def element(self, name: str, frame: Frame) -> Element | None:
        """Return the element of a name; the first unknown one names the group, if none has been declared."""
        key = name.lower()
        variable = frame.find(key)
        if variable is not None:
            return variable.value if isinstance(variable.value, Element) else None
        if key in _SYSTEM:
            return self._registered("sys", "system")
        if joint := _JOINT.fullmatch(key):
            group = self.focus()
            index = int(joint[1])
            if index > len(group.axes):
                return self._registered(f"a{index}", "axis") if not group.axes else None
            return self._registered(group.axes[index - 1], "axis")
        if _AXIS.fullmatch(key):
            return self._registered(key, "axis")
        if key in self.routines or key in CONSTANTS or properties.is_property(key):
            return None
        if self.moved is None or not self.moved.name:  # the first name is that of the group
            self.focus().name = name
            self.elements[key] = self.focus()
        return self.elements.get(key)

    def declared_group(self, name: str, axes: tuple[str, ...]) -> Element:
        """Return a new group.

        Raises:
            SoftMCError: there is one already, or it has too many axes.
        """
        if self.moved is not None and self.moved.name:
            raise SoftMCError(f"group {name}: must be {self.moved.name}; a program moves one group")
        if axes and not 2 <= len(axes) <= self.coordinates:
            raise SoftMCError(f"group {name} of {len(axes)} axes: must be 2 to {self.coordinates}")
        self.moved = self.moved or Element(name, "group", properties.initial(self.group))
        self.moved.name, self.moved.axes = name, axes
        self.axes = len(axes) or self.axes
        return self.moved

    def focus(self) -> Element:
        """Return the element of WITH, or else the group."""
        if self.default is not None:
            return self.default
        if self.moved is None:
            self.moved = Element("", "group", properties.initial(self.group))
        return self.moved

    def only_group(self, element: Element | None) -> Element:
        """Return the group that an element of a motion command stands for."""
        found = self.focus() if element is None else element
        if found.kind != "group":
            raise SoftMCError(f"{found.name} is no group: must be one; single axes do not move")
        return found

    def _registered(self, name: str, kind: str) -> Element:
        return self.elements.setdefault(name.lower(), Element(name, kind))

    # Properties

    def assign(self, element: Element, name: str, value: Value) -> None:
        """Assign a property."""
        short, held = properties.checked(element, name, value)
        if element.kind == "group" and short in properties.EFFECTIVE:
            element.properties[short] = held
            return
        element.properties[short] = held
        if element.kind == "system" and short == "vord":
            return
        self.idle[f"{element.kind} {short}"] = self.idle.get(f"{element.kind} {short}", 0) + 1

    def read(self, element: Element, name: str) -> Value:
        """Return the value of a property."""
        short = properties.canonical(name)
        if short not in properties.NAMES:
            raise SoftMCError(f"unknown property {name!r}{properties.hint(short, properties.NAMES)}")
        if short in ("clock", "time"):
            return 1e3 * self.time.clock
        if short == "elementname":
            return element.name
        if short == "ismoving":
            return float(self.time.moving)
        if short == "issettled":
            return self._is_settled()
        if short in ("pcmd", "pfb", "setpoint"):
            place = self.time.position.tolist()
            if element.kind == "axis":
                return float(place[self.index_of(element)])
            return Point(tuple(place[: self.axes or len(AXES)]))
        if short in element.properties:
            return element.properties[short]
        raise SoftMCError(f"{element.name}.{name} has no value yet: must be assigned first")

    def _is_settled(self) -> float:
        moved = self.focus()
        if self.time.clock < self.time.free + 1e-3 * float(moved.properties.get("timesettle", 0.0)):
            return 0.0
        self.time.settle()
        return 1.0

    def index_of(self, axis: Element) -> int:
        """Return the number of an axis among the group's, from 0."""
        axes = self.moved.axes if self.moved is not None else ()
        index = axes.index(axis.name.lower()) if axis.name.lower() in axes else int(axis.name[1:]) - 1
        if index >= len(AXES):
            raise SoftMCError(f"axis {axis.name}: must be an axis of the group")
        return index

    # Motion

    def begin(self, target: tuple[float, ...] | None) -> None:
        """Place the group where no start is given: at the target of its first motion, or at the origin."""
        place = [*(target or ()), 0.0, 0.0, 0.0, 0.0][: len(AXES)]
        self.time.start = np.array(place)
        self.begins = "at the origin" if target is None else "at the target of its first MOVE"

    def move(self, element: Element, nodal: dict[str, Any], command: Command, path: bool) -> None:
        """Issue a motion command with the properties of its group, and its own."""
        if not element.properties["en"] or not self._system("motion", 1.0):
            raise SoftMCError(f"{element.name or 'the group'} is disabled: must be en = 1, and sys.motion = on")
        own = {**element.properties, **nodal}
        if "vcruise" in nodal and "vtran" in nodal:
            raise SoftMCError("vcruise and vtran: must be one of the two")
        if "vcruise" in nodal:
            own.pop("vtran", None)
        factor = own["vord"] / 100 * (self._system("vord", 100.0) / 100) * (self.override / 100)
        group = properties.group_of(own, self.group, path or "vtran" in nodal, factor)
        self.time.issue(command, self.axes or 2, group, bool(own["dispense"]), own["starttype"] == 2, self.line)
        if self.time.travels:
            self.speeds.append(group.velocity)

    def _system(self, name: str, default: float) -> float:
        system = self.elements.get("sys")
        return default if system is None else float(system.properties.get(name, default))

    def switch(self, port: int, value: float) -> None:
        """Switch a digital output."""
        self.outputs[port] = value
        if port == self.output:
            self.switched.append((self.mark(), value != 0))

    def mark(self) -> Mark:
        """Return the present instant, for an output or a record.

        Raises:
            SoftMCError: too many.
        """
        self.marks += 1
        if self.marks > MOST_MARKS:
            raise SoftMCError(f"{MOST_MARKS} switchings: a program must have at most that many")
        return self.time.mark()

    def sleep(self, name: str, value: Value) -> None:
        """Let time pass [ms].

        Raises:
            SoftMCError: a negative time, or too long a program.
        """
        time = number(name, value)
        if time < 0:
            raise SoftMCError(f"{name} = {time:g} ms: must be at least 0 ms")
        self.time.clock += 1e-3 * time
        if self.time.clock > LONGEST:
            raise SoftMCError(f"the program runs for more than {LONGEST:g} s: must end before")

    def show(self, values: list[Value]) -> None:
        """Print values on a line."""
        self.prints += 1
        if len(self.printed) < MOST_PRINTED:
            self.printed.append(" ".join(text_of(value) for value in values)[:1000])
