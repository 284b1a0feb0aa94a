"""The geometry of a real machine: errors typical of its accuracy class, and single errors that replace them.

Accuracy classes of ball screws.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from gantrysim.base.errors import InputError, at_least, between, unknown

_UM = 1e-3
PerAxis = float | tuple[float, ...]
OF_SCREWS = ("travel_error", "periodic_error", "play")  # also of axes that are not x, y or z
OF_GUIDES = ("straightness", "straightness_vertical", "yaw")  # of each of x, y and z
SQUARENESS = ("squareness_xy", "squareness_xz", "squareness_yz")
BENDING = ("bending_x", "bending_y")  # of the ram
# errors of the frame, with the axes without which a machine has none
OF_FRAME = {
    "squareness_xy": "xy",
    "squareness_xz": "xz",
    "squareness_yz": "yz",
    "racking": "xy",
    "sag": "x",
    "bending_x": "x",
    "bending_y": "y",
}
LOADS = {"weight": 2, "force": 3}  # on the ram, with the power of its free length by which it bends
ERRORS = (*OF_SCREWS, *OF_GUIDES, *OF_FRAME)
_BOUNDS = {"travel_error": 10.0, "periodic_error": 1.0, "play": 5.0}  # of a magnitude; others 10

# band of the travel within 300 mm and within a turn [um]: C* of JIS B 1192, P* and T* of ISO 3408-3, as catalogues
# print them; grades 7 and 10 have no band within a turn: 12 and 30 are assumptions
SCREWS = {
    "C0": (3.5, 3.0),
    "C1": (5.0, 4.0),
    "C2": (7.0, 5.0),
    "C3": (8.0, 6.0),
    "C5": (18.0, 8.0),
    "C7": (50.0, 12.0),
    "C10": (210.0, 30.0),
    "P0": (3.5, 3.0),
    "P1": (6.0, 4.0),
    "P3": (12.0, 6.0),
    "P5": (23.0, 8.0),
    "P7": (52.0, 12.0),
    "T3": (12.0, 6.0),
    "T5": (23.0, 8.0),
    "T7": (52.0, 12.0),
    "T10": (210.0, 30.0),
}


_BOUNDS |= dict.fromkeys(("sag", *BENDING), 5.0)
_LEAST_VALUES = dict.fromkeys(("play", "periodic_error", "racking"), 0.0)
# of those not in mm; play is in the unit of its axis
_UNITS = dict.fromkeys(("yaw", *SQUARENESS, "racking"), "mm/m") | {"play": ""}

# assumption: errors to which a gantry with screws of a grade is built. Play, straightness and vertical straightness
# [um], yaw, squareness and racking [um/m], sag and bending of the ram [um]
_MACHINES = {
    0: (0.0, 1.0, 1.0, 5.0, 5.0, 0.0, 0.5, 0.5),
    1: (0.0, 2.0, 2.0, 10.0, 10.0, 2.0, 1.0, 1.0),
    2: (1.0, 2.0, 2.0, 15.0, 15.0, 3.0, 1.5, 1.5),
    3: (1.0, 3.0, 3.0, 20.0, 20.0, 5.0, 2.0, 3.0),
    5: (6.0, 6.0, 6.0, 50.0, 50.0, 20.0, 5.0, 6.0),
    7: (16.0, 10.0, 10.0, 100.0, 100.0, 40.0, 10.0, 12.0),
    10: (50.0, 30.0, 30.0, 300.0, 300.0, 100.0, 30.0, 40.0),
}


@dataclass(frozen=True)
class Geometry:
    """Errors of a machine's geometry, in the table [geometry] of a job; unspecified errors come from the class.

    They displace the nozzle; encoders on the motors do not see them. A servo with feedback = "load" has a linear scale
    on the axis: its loop corrects the errors of the screw, and only the scale's growth remains. An error per axis
    is one number for all axes in mm, or one per axis of the machine in their order. u is the unit of the axis, mm or
    deg. The formulas are in `gantrysim.machine.kinematic_errors`.

    Attributes:
        accuracy: accuracy class: C0, C1, C2, C3, C5, C7 or C10 of JIS B 1192, P0, P1, P3, P5, P7, T3, T5, T7 or T10 of
            ISO 3408-3; without a class, every error that is not given is 0.
        travel_error: travel error of a screw over 300 mm [mm].
        periodic_error: amplitude of the error within one turn of the screw [mm].
        play: lost motion between motor and load at a reversal; classes give z no play, because gravity preloads it [u].
        straightness: horizontal deviation of a guide from the line between its ends [mm].
        straightness_vertical: vertical deviation of a guide; for z, its deviation along y [mm].
        yaw: rotation of x or y about the vertical at the ends of its travel, relative to the middle [mm/m].
        squareness_xy: lean of y towards x, by which the angle between them falls short of 90 deg [mm/m].
        squareness_xz: lean of z towards x [mm/m].
        squareness_yz: lean of z towards y [mm/m].
        racking: rotation of the bridge about the vertical at a reversal [mm/m].
        sag: drop of the nozzle at the middle of the bridge, relative to its ends [mm].
        bending_x: deflection of the ram along x under a lateral load, with z at the lower end of its travel [mm].
        bending_y: deflection of the ram along y, likewise [mm].
        bending_load: load on the ram: "weight" of a head mounted beside it, or a lateral "force" at the nozzle.
        ram: free length of the ram below its guide, with z at the upper end of its travel [mm].
        abbe: Abbe offset: distance from the screw's axis to the nozzle, along the other horizontal axis, with all axes
            at zero [mm].
        guide_arm: distance from the middle of an axis' guide blocks to the nozzle, along the axis, with all axes at
            zero; by default the machine's value, 125 mm behind the nozzle for the bridges of the built-in machines
            [mm].
        warming: temperature rise of the screws above the frame [K].
        expansion: coefficient of thermal expansion of the screws; 11.5e-6 for steel [1/K].
        fixed_end: axis position of the screw's fixed bearing [mm].
        scale_warming: temperature rise of the linear scales above the frame; for axes whose servo has feedback = "load"
            [K].
        scale_expansion: coefficient of thermal expansion of the scales; 8e-6 for glass [1/K].
        scale_fixed: axis position at which the scale is fixed [mm].

    Raises:
        InputError: an unknown class, or an error that no machine has.
    """

    accuracy: str | None = None
    travel_error: PerAxis | None = None
    periodic_error: PerAxis | None = None
    play: PerAxis | None = None
    straightness: PerAxis | None = None
    straightness_vertical: PerAxis | None = None
    yaw: PerAxis | None = None
    squareness_xy: float | None = None
    squareness_xz: float | None = None
    squareness_yz: float | None = None
    racking: float | None = None
    sag: float | None = None
    bending_x: float | None = None
    bending_y: float | None = None
    bending_load: str = "weight"
    ram: float = 100.0
    abbe: PerAxis = 0.0
    guide_arm: PerAxis | None = None
    warming: float = 0.0
    expansion: float = 11.5e-6
    fixed_end: PerAxis = 0.0
    scale_warming: float = 0.0
    scale_expansion: float = 8e-6
    scale_fixed: PerAxis = 0.0

    def __post_init__(self) -> None:
        if self.accuracy is not None and self.accuracy not in SCREWS:
            raise unknown("accuracy class", str(self.accuracy), SCREWS)
        for name in ERRORS:
            bound = _BOUNDS.get(name, 10.0)
            self._check(name, _LEAST_VALUES.get(name, -bound), bound, _UNITS.get(name, "mm"))
        for name in ("abbe", "guide_arm", "fixed_end", "scale_fixed"):
            self._check(name, -1e4, 1e4, "mm")
        if self.bending_load not in LOADS:
            raise unknown("bending_load", str(self.bending_load), LOADS)
        between("ram", self.ram, 0, 1e4, "mm")
        for name in ("warming", "scale_warming"):
            between(name, getattr(self, name), -100, 100, "K")
        for name in ("expansion", "scale_expansion"):
            at_least(name, getattr(self, name), 0, "1/K", 1e-3)

    def _check(self, name: str, low: float, high: float, unit: str) -> None:
        value = getattr(self, name)
        if value is None:
            return
        if isinstance(value, list | tuple):
            checked: PerAxis = tuple(between(name, axis_value, low, high, unit) for axis_value in value)
        else:
            checked = between(name, value, low, high, unit)
        object.__setattr__(self, name, checked)

    def is_given_explicitly(self, name: str) -> bool:
        """Return whether an error is given explicitly rather than by the class."""
        return getattr(self, name) is not None

    def of(self, name: str) -> PerAxis:
        """Return an error: as given, otherwise typical of the class, 0 without one."""
        value: PerAxis | None = getattr(self, name)
        if value is not None:
            return value
        return 0.0 if self.accuracy is None else typical(self.accuracy)[name]


def typical(accuracy: str) -> dict[str, float]:
    """Return the errors typical of a class, by name, in the units of `Geometry`."""
    travel, turn = SCREWS[accuracy]
    sizes = [_UM * size for size in _MACHINES[int(accuracy[1:])]]
    play, straight, vertical, yaw, square, racking, sag, bending = sizes
    return {
        "travel_error": _UM * travel,
        "periodic_error": 0.5 * _UM * turn,
        "play": play,
        "straightness": straight,
        "straightness_vertical": vertical,
        "yaw": yaw,
        **dict.fromkeys(SQUARENESS, square),
        "racking": racking,
        "sag": sag,
        **dict.fromkeys(BENDING, bending),
    }


def check_lengths(geometry: Geometry, axes: tuple[str, ...]) -> None:
    """Raise InputError for a list whose length is not the number of axes."""
    for field in fields(geometry):
        value = getattr(geometry, field.name)
        if isinstance(value, tuple) and len(value) != len(axes):
            raise InputError(
                f"geometry.{field.name} has {len(value)} values: must be one or {len(axes)}, of the axes "
                f"{', '.join(axes)}"
            )
