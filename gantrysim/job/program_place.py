"""How a program from a file fits its machine where nobody said: height, place in the plane, travel, speeds."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from gantrysim.base.arrays import Floats, extremes
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError
from gantrysim.base.user_code import is_code
from gantrysim.controllers.controller import Controller
from gantrysim.job.content import JobContent
from gantrysim.job.settings import MACHINES
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints

_DECIMALS = 4  # of a height [mm]
_Z = 2  # column of a position
_FLAT_HEIGHT = 1e-3  # of a height that is the same [mm]
_ROOM_AT_ENDS = 0.5  # left at both ends of a travel where a program is moved to its middle [mm]
# steps of a travel that is made for a program, and room at its ends, in which an axis may overshoot [mm]
_TRAVEL_STEP = 10.0
_OVERSHOOT = 5.0


class OpenPlace(Protocol):
    """Which values of a program's place nobody gave."""

    @property
    def height(self) -> bool:
        """Its height."""

    @property
    def place(self) -> bool:
        """Its place in the plane."""

    @property
    def travel(self) -> bool:
        """The travel of the machine."""

    @property
    def gap(self) -> bool:
        """The height of the needle above the work, where that of the program is given."""

    @property
    def speeds(self) -> bool:
        """The largest speeds of its axes."""


class _Heights(NamedTuple):
    """Lowest heights of the nozzle with the dispenser on, and of the nozzle at all [mm].

    Attributes:
        bead: while it moves in plan; inf where it never does.
        glue: at any time; inf where the dispenser is never on.
        tip: with the dispenser on or off.
    """

    bead: float
    glue: float
    tip: float


# arguments of a program that change neither what its text says nor how it is read
REPLANNED_ARGUMENTS = {"placement", "axis_speeds", "acceleration"}


def share_text(
    program: dict[str, Any], other_program: dict[str, Any], controller: Controller, other: Controller
) -> None:
    """Let a controller take over what another has read of the same text, if it can."""
    same = all(program.get(key) == other_program.get(key) for key in {*program, *other_program} - REPLANNED_ARGUMENTS)
    if same and hasattr(controller, "sharing_text_of"):
        controller.sharing_text_of(other)


def fit_changes(job: JobContent, machine: Machine, controller: Controller, open_place: OpenPlace) -> dict[str, Any]:
    """Return the values with which a program fits its machine, by dotted name: its place and its largest speeds.

    Args:
        job: on the machine.
        machine: of the job.
        controller: with its program; one that the controller refuses is left, and the run reports it.
        open_place: what nobody gave.
    """
    try:
        changes = place_changes(job, machine, controller, open_place) | _speed_changes(machine, controller, open_place)
    except InputError:
        return {}
    if changes:
        # its plan at the old place
        controller.release()
    return changes


def _speed_changes(machine: Machine, controller: Controller, open_place: OpenPlace) -> dict[str, Any]:
    """Return the machine's speeds as the program's limits where its feeds are beyond them."""
    needed = getattr(controller, "needed_speeds", None) if open_place.speeds else None
    if needed is None or not machine.kinematics.axes_are_coordinates:
        return {}
    limits = {axis.name: axis.speed_limit for axis in machine.plain_axes}
    if all(needed[name] <= limits.get(name, math.inf) for name in needed):
        return {}
    return {"program.axis_speeds": [limits.get(name, math.inf) for name in needed]}


def place_changes(job: JobContent, machine: Machine, controller: Controller, open_place: OpenPlace) -> dict[str, Any]:
    """Return the values with which a program fits its machine, by dotted name.

    Its lowest bead lies a needle's gap above the work: a program whose zero is the top of the stock, a print whose
    first layer lies above its bed, or a machine's own frame then lays its bead on the work. A plunge may begin
    anywhere, but where the travel ends above the lowest point of the dispenser, that point lies on the work. A start
    below is raised to it. A program that leaves the travel in the plane is moved to its middle; where it is larger, or
    higher, the machine gets the travel that it needs. A program that is given another height than that runs with its
    needle so much higher or lower above the work.

    Args:
        job: on a machine of Cartesian axes; any other is left as it is, and so is the user's own controller.
        machine: of the job.
        controller: with its program.
        open_place: what nobody gave.

    Raises:
        InputError: a program that the controller refuses.
    """
    if is_code(job.program["controller"]) or job.machine not in MACHINES or not hasattr(controller, "placement"):
        return {}
    if not (open_place.height or open_place.place or open_place.gap):
        return {}
    setpoints = controller.setpoints(job.servo.period)
    travel = {axis.name: axis.travel for axis in machine.plain_axes}
    if not set(setpoints.axes) <= set(travel):
        # the plan names the axis that the machine lacks
        return {}
    box = _box(setpoints)
    changes: dict[str, Any] = {}
    if open_place.height and "z" in box:
        rise = _rise(_heights(setpoints), travel["z"][0])
        if rise:
            changes = _raised_program(controller, rise)
        if "program.start" in changes and _rises_to_glue(setpoints):
            rise = _rise(_heights(_begun_above(job, controller, box["z"][1])), travel["z"][0])
            changes = _raised_program(controller, rise)
        box["z"] = (box["z"][0] + rise, box["z"][1] + rise)
    if open_place.gap and "z" in box:
        if getattr(controller, "start", None) is not None and _rises_to_glue(setpoints):
            setpoints = _begun_above(job, controller, box["z"][1])
        changes = _gap_changes(job.machine, machine.gap, setpoints)
    shift = _shift(box, travel) if open_place.place else {}
    changes |= {f"program.placement.{axis}": value for axis, value in shift.items()}
    if not open_place.travel:
        return changes
    box |= {axis: (box[axis][0] + value, box[axis][1] + value) for axis, value in shift.items()}
    movable = ("x", "y") * open_place.place + ("z",) * open_place.height
    outside = [a for a in movable if a in box and not travel[a][0] <= box[a][0] <= box[a][1] <= travel[a][1]]
    if outside:
        changes["travel"] = {axis: _wide(box[axis], travel[axis]) for axis in outside}
    return changes


def _gap_changes(name: str, gap: float, setpoints: Setpoints) -> dict[str, Any]:
    """Return the needle's height above the work where a program is given another height than `place_changes` gives it.

    Args:
        name: of the machine.
        gap: of the machine [mm].
        setpoints: of the program.
    """
    lowest_travel = next(axis.travel[0] for axis in Machine(name).plain_axes if axis.name == "z")
    height = round(gap - _rise(_heights(setpoints), lowest_travel), _DECIMALS)
    is_another = abs(height - gap) > _FLAT_HEIGHT
    return {"bead.gap": height} if is_another and height > 0 else {}


def _box(setpoints: Setpoints) -> dict[str, tuple[float, float]]:
    """Return the least and largest position of every axis [mm]."""
    low = np.full(len(setpoints.axes), math.inf)
    high = -low
    for block in blocks(len(setpoints.position)):
        lowest, highest = extremes(setpoints.position[block])
        low = np.minimum(low, lowest)
        high = np.maximum(high, highest)
    return dict(zip(setpoints.axes, zip(low.tolist(), high.tolist(), strict=True), strict=True))


def _heights(setpoints: Setpoints) -> _Heights:
    """Return the lowest heights of a program, block by block, each with the first setpoint of the next."""
    parts = blocks(len(setpoints.position) - 1)
    heights = [_heights_of(setpoints.part(slice(block.start, block.stop + 1))) for block in parts]
    return _Heights(*(min(column) for column in zip(*heights, strict=True)))


def _heights_of(setpoints: Setpoints) -> _Heights:
    columns = [setpoints.position[:, setpoints.axes.index(axis)] if axis in setpoints.axes else None for axis in "xy"]
    # a program that lies at the height 0 has no z
    is_level = "z" not in setpoints.axes
    z = np.zeros(len(setpoints.position)) if is_level else setpoints.position[:, setpoints.axes.index("z")]
    moves = np.zeros(len(z) - 1, bool)
    for column in columns:
        if column is not None:
            moves |= np.diff(column) != 0
    on = setpoints.dispense[:-1]
    lower = np.minimum(z[:-1], z[1:])
    return _Heights(_least(lower[moves & on]), _least(lower[on]), _least(z))


def _least(values: Floats) -> float:
    return float(values.min(initial=math.inf))


def _rise(heights: _Heights, lowest_travel: float) -> float:
    """Return by how much a program is raised [mm]."""
    if math.isinf(heights.glue):
        return 0.0
    bead = heights.glue if math.isinf(heights.bead) else heights.bead
    if heights.tip - bead < lowest_travel:
        bead = min(bead, heights.glue)
    return round(-bead, _DECIMALS) + 0.0


def _begun_above(job: JobContent, controller: Controller, height: float) -> Setpoints:
    """Return the setpoints of a program that begins at its greatest height.

    A corner at the end of the rise to its first bead is cut below the bead; a program that begins above has none.

    Args:
        job: with the program.
        controller: with a start.
        height: greatest one of the program on the work [mm].
    """
    x, y, *_ = controller.start  # type: ignore[attr-defined]  # of those that have one
    placement = controller.placement  # type: ignore[attr-defined]  # of those that can be placed
    changed = job.changed({"program.start": [x, y, (height - placement.z) / _upward(controller)]})
    return changed.controller.setpoints(job.servo.period)


def _rises_to_glue(setpoints: Setpoints) -> bool:
    """Return whether a program rises to its first glue, and never was as high before."""
    first = int(np.argmax(setpoints.dispense))
    z = setpoints.position[: first + 1, setpoints.axes.index("z")]
    return bool(z[-1] > z[0] and z[-1] == z.max())


def _upward(controller: Controller) -> float:
    """Return the height in the work frame per height in a program's own, negative for one that counts downwards."""
    placement = controller.placement  # type: ignore[attr-defined]  # of those that can be placed
    upward: float = placement.scale * placement.upward
    return upward


def _raised_program(controller: Controller, rise: float) -> dict[str, Any]:
    """Return the changes that raise a program; a start below its lowest bead is raised to that."""
    changes: dict[str, Any] = {"program.placement.z": rise}
    start = getattr(controller, "start", None)
    upward = _upward(controller)
    if start is not None and len(start) > _Z and upward * start[_Z] < -rise:
        changes["program.start"] = [*start[:_Z], -rise / upward, *start[_Z + 1 :]]
    return changes


def _shift(box: dict[str, tuple[float, float]], travel: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Return the shift to the middle of the travel; none where a program lies within it, or is larger."""
    axes = [axis for axis in "xy" if axis in box]
    if all(travel[axis][0] <= box[axis][0] and box[axis][1] <= travel[axis][1] for axis in axes):
        return {}
    if any(np.ptp(box[axis]) > np.ptp(travel[axis]) - 4 * _ROOM_AT_ENDS for axis in axes):
        return {}
    return {axis: float(round(0.5 * (sum(travel[axis]) - sum(box[axis])))) for axis in axes}


def _wide(extent: tuple[float, float], travel: tuple[float, float]) -> tuple[float, float]:
    """Return a travel that a program's extent needs, no smaller than the machine's [mm]."""
    low, high = travel
    if extent[0] < low:
        low = math.floor((extent[0] - _OVERSHOOT) / _TRAVEL_STEP) * _TRAVEL_STEP
    if extent[1] > high:
        high = math.ceil((extent[1] + _OVERSHOOT) / _TRAVEL_STEP) * _TRAVEL_STEP
    return low, high
