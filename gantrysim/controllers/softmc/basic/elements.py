"""The elements that a program names: axes, the one group that it moves, and the system."""

from __future__ import annotations

import re

from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.values import Element
from gantrysim.controllers.softmc.commands import SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.stream import AXES

_AXIS = re.compile(r"a([1-9]\d?)")
_JOINT = re.compile(r"j([1-9]\d?)")
_SYSTEM = ("sys", "system")


class Elements:
    """The elements of a program.

    Args:
        properties_of_group: before the program sets them.
        coordinates: how many a group has at most.

    Attributes:
        by_name: those that were named, by their names in lower case.
        group: that moves; None until the program speaks of it.
        default: the element of WITH, None outside.
        axes: number of the group's axes, None until it is known.
    """

    def __init__(self, properties_of_group: Group, coordinates: int) -> None:
        self.by_name: dict[str, Element] = {}
        self.group: Element | None = None
        self.default: Element | None = None
        self.axes: int | None = None
        self.coordinates = coordinates
        self._properties = properties_of_group

    @staticmethod
    def is_reserved(key: str) -> bool:
        """Whether a name in lower case is that of the system, an axis or a joint."""
        return key in _SYSTEM or bool(_JOINT.fullmatch(key) or _AXIS.fullmatch(key))

    def reserved(self, key: str) -> Element | None:
        """Return the element of a reserved name; None for a joint that the group has not."""
        if key in _SYSTEM:
            return self._registered_element("sys", "system")
        joint = _JOINT.fullmatch(key)
        if joint is not None:
            return self._joint(int(joint[1]))
        return self._registered_element(key, "axis")

    def named(self, name: str) -> Element | None:
        """Return the element of another name, None for an unknown one; the first names the group if it has no name."""
        # a program seldom declares its group: that stands in the controller's configuration
        if self.group is None or not self.group.name:
            self.focus().name = name
            self.by_name[name.lower()] = self.focus()
        return self.by_name.get(name.lower())

    def _joint(self, number: int) -> Element | None:
        group = self.focus()
        if number > len(group.axes):
            return self._registered_element(f"a{number}", "axis") if not group.axes else None
        return self._registered_element(group.axes[number - 1], "axis")

    def declared_group(self, name: str, axes: tuple[str, ...]) -> Element:
        """Return a new group.

        Raises:
            SoftMCError: there is one already, or it has too many axes.
        """
        if self.group is not None and self.group.name:
            raise SoftMCError(f"group {name}: must be {self.group.name}; a program moves one group")
        if axes and not 2 <= len(axes) <= self.coordinates:
            raise SoftMCError(f"group {name} of {len(axes)} axes: must be 2 to {self.coordinates}")
        self.group = self.group or self._new_group(name)
        self.group.name = name
        self.group.axes = axes
        self.axes = len(axes) or self.axes
        return self.group

    def _new_group(self, name: str) -> Element:
        return Element(name, "group", properties.initial(self._properties))

    def focus(self) -> Element:
        """Return the element of WITH, or else the group."""
        if self.default is not None:
            return self.default
        if self.group is None:
            self.group = self._new_group("")
        return self.group

    def only_group(self, element: Element | None) -> Element:
        """Return the group that an element of a motion command stands for."""
        group = self.focus() if element is None else element
        if group.kind != "group":
            raise SoftMCError(f"{group.name} is not a group: must be one, as single axes do not move")
        return group

    def index_of(self, axis: Element) -> int:
        """Return the number of an axis among the group's, from 0."""
        axes = self.group.axes if self.group is not None else ()
        index = axes.index(axis.name.lower()) if axis.name.lower() in axes else int(axis.name[1:]) - 1
        if index >= len(AXES):
            raise SoftMCError(f"axis {axis.name}: must be an axis of the group")
        return index

    def of_system(self, name: str, default: float) -> float:
        """Return a property of the system, or a value where the program has not set it."""
        system = self.by_name.get("sys")
        return default if system is None else float(system.properties.get(name, default))

    def _registered_element(self, name: str, kind: str) -> Element:
        return self.by_name.setdefault(name.lower(), Element(name, kind))
