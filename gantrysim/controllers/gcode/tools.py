"""The tools of a program: which one is in the spindle, and their diameters."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Tools:
    """The tools of a machine that runs a program.

    Attributes:
        diameters: by number [mm].
        selected: number of the last T.
        in_spindle: number of the tool that M6 or M61 put there; 0 without.
        without_diameter: tools of cutter compensation whose diameter nobody gave.
    """

    diameters: dict[int, float] = field(default_factory=dict)
    selected: int = 0
    in_spindle: int = 0
    without_diameter: set[int] = field(default_factory=set)

    def diameter(self, number: int) -> float:
        """Return the diameter of a tool; 0, and noted, where nobody gave it [mm]."""
        if number not in self.diameters:
            self.without_diameter.add(number)
        return self.diameters.get(number, 0.0)
