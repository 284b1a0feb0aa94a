"""Properties that follow from the motion and the program's time, not from an assignment."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.controllers.softmc.basic.elements import Elements
from gantrysim.controllers.softmc.basic.timeline import Timeline
from gantrysim.controllers.softmc.basic.values import Element, Point, Value
from gantrysim.controllers.softmc.geometry import AXES


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


STEADY = ("elementname", "ismoving")  # of them, those that stay as they are while a motion is under way
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
