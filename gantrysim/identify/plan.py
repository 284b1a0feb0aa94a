"""The moves that excite a machine for its identification, as a program in a controller's language."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gantrysim.base.errors import InputError, unknown
from gantrysim.identify.model import model_of
from gantrysim.machine.axis import Axis
from gantrysim.machine.machine import Machine

COORDINATES = ("x", "y", "z", "r")  # that programs move, in the order of a controller's axes

_TRAVEL_SHARE = 0.35  # share of the travel that strokes use at most
_LONGEST_STROKE = 80.0  # stroke [u]
_EFFORT = 0.4  # share of the torque left by friction that the strongest acceleration takes
_ACCELERATIONS = (0.25, 0.5, 1.0)  # of the strongest
_SPEEDS = 6
_FASTEST_SHARE = 0.5  # of the speed limit
_CRUISE = 0.3  # at a constant speed [s]
_STROKES = 20  # strokes of a pass at the strongest acceleration
_SHORTEST_SHARE = 0.02  # of the longest of them
_SHORT_TIME = 0.03  # of the longest of them [s]
_PASSES = 8
_BLOCK = 1e-3  # least stroke [u]


@dataclass(frozen=True)
class Stroke:
    """A move of one axis by a distance and back; u is mm or deg.

    Attributes:
        axis: its name.
        distance: signed [u].
        speed: at most [u/s].
        acceleration: of both ramps [u/s²].
    """

    axis: str
    distance: float
    speed: float
    acceleration: float


def strokes(machine: Machine) -> list[Stroke]:
    """Return the moves for all axes, one after the other, from all axes at zero.

    Each axis moves to and fro at speeds from below the Stribeck speed up (friction), at several accelerations
    (inertia), then in ever shorter strokes at the strongest acceleration: quick reversals that sweep the spectrum
    (mode, delay).

    Raises:
        InputError: an axis without room to move, or coordinates that are not the axes.
    """
    names = machine.axis_names
    if not machine.kinematics.axes_are_coordinates or not set(names) <= set(COORDINATES):
        raise InputError(
            f"machine {machine.name}: its axes {', '.join(names)} are not those of a program, {', '.join(COORDINATES)}"
        )
    return [stroke for axis in range(len(names)) for stroke in _of_axis(machine, axis)]


def _of_axis(machine: Machine, index: int) -> list[Stroke]:
    axis = machine.axes[index]
    model = model_of(machine, index)
    strongest = _rounded_value(_EFFORT * (axis.peak_torque - axis.coulomb) / axis.inertia)
    room = _room(axis)
    fastest = min(_FASTEST_SHARE * axis.speed_limit, math.sqrt(abs(room) * strongest / 2))
    slowest = min(0.5 * model.stribeck * model.scale, 0.1 * fastest)
    moves = []
    for speed in np.geomspace(slowest, fastest, _SPEEDS):
        ramps = speed**2 / (0.25 * strongest)
        moves.append((min(abs(room), speed * _CRUISE + ramps), speed, 0.25 * strongest))
    moves += [(abs(room), fastest, share * strongest) for share in _ACCELERATIONS]
    longest = min(abs(room), strongest * _SHORT_TIME**2 / 4)
    shares = np.geomspace(1.0, _SHORTEST_SHARE, _STROKES * _PASSES)
    # each with strokes of its own, so that counts of the encoder average out
    for first in range(_PASSES):
        moves += [(longest * share, fastest, strongest) for share in shares[first::_PASSES]]
    return [
        Stroke(
            axis.name,
            math.copysign(max(_rounded_value(distance), _BLOCK), room),
            _rounded_value(speed),
            _rounded_value(acceleration),
        )
        for distance, speed, acceleration in moves
    ]


def _room(axis: Axis) -> float:
    """Return the longest stroke from zero, towards the further end of the travel [u]."""
    low, high = axis.travel
    if not low <= 0 <= high or high - low < 10 * _BLOCK:
        raise InputError(
            f"axis {axis.name}: its travel is {low:g} to {high:g} {axis.unit}, must extend to both sides of zero"
        )
    side = 1.0 if high >= -low else -1.0
    return side * min(_LONGEST_STROKE, _TRAVEL_SHARE * (high - low))


def _rounded_value(value: float) -> float:
    """Return a value with three significant digits, as a program shows it."""
    return float(f"{value:.3g}")


def _trio(machine: Machine, moves: list[Stroke]) -> str:
    numbers = {name: COORDINATES.index(name) for name in machine.axis_names}
    lines = [f"' Excitation of the axes {', '.join(numbers)} for identification; log torque and MPOS at every tick"]
    lines += ["MERGE=OFF"]
    last = ""
    for move in moves:
        if move.axis != last:
            lines += ["WAIT IDLE", "WA(100)", f"BASE({numbers[move.axis]})  ' {move.axis}"]
        last = move.axis
        lines.append(f"SPEED={_text(move.speed)}: ACCEL={_text(move.acceleration)}: DECEL={_text(move.acceleration)}")
        lines.append(f"MOVE({_text(move.distance)}): MOVE({_text(-move.distance)}): WAIT IDLE")
    return "\n".join([*lines, "WA(100)", "STOP", ""])


def _softmc(machine: Machine, moves: list[Stroke]) -> str:
    names = machine.axis_names
    members = " ".join(f"Axnm = a{k + 1}" for k in range(len(names)))
    lines = [
        f"' Excitation of the axes {', '.join(names)} for their identification; record icmd and pfb at every tick",
        f"common shared machine as group {members}",
        "program",
        "  with machine",
        "  abs = 1",
        "  prftype = 0",
        f"  amax = {_text(max(move.acceleration for move in moves))}",
        "  dmax = amax",
        f"  vmax = {_text(max(move.speed for move in moves))}",
        f"  move {_point(names, moves[0].axis, 0.0)}",
    ]
    for move in moves:
        lines += [f"  acc = {_text(move.acceleration)}", "  dec = acc", f"  vcruise = {_text(move.speed)}"]
        lines += [f"  move {_point(names, move.axis, distance)}" for distance in (move.distance, 0.0)]
    return "\n".join([*lines, "end program", ""])


def _point(names: tuple[str, ...], axis: str, distance: float) -> str:
    return "{" + ", ".join(_text(distance) if name == axis else "0" for name in names) + "}"


def _gcode(machine: Machine, moves: list[Stroke]) -> str:
    lines = [
        f"( Excitation of the axes {', '.join(dict.fromkeys(move.axis for move in moves))} for their identification )",
        "( the accelerations are those of the configuration )",
        "G21 G90 G94 G61.1",
    ]
    last = ""
    for move in moves:
        if last and move.axis != last:
            lines.append("G4 P0.1")
        last = move.axis
        lines.append(f"G1 {move.axis.upper()}{_text(move.distance)} F{_text(60 * move.speed)}")
        lines.append(f"G1 {move.axis.upper()}0")
    return "\n".join([*lines, "M2", ""])


def _text(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")


_LANGUAGES: dict[str, tuple[str, Callable[[Machine, list[Stroke]], str]]] = {
    "trio": (".bas", _trio),
    "softmc": (".prg", _softmc),
    "linuxcnc": (".ngc", _gcode),
}
CONTROLLERS = tuple(_LANGUAGES)


def excitation(machine: Machine, controller: str) -> tuple[str, str]:
    """Return the program that excites a machine, and the suffix of its file.

    Args:
        machine: the nominal machine.
        controller: "trio", "softmc" or "linuxcnc".

    Raises:
        InputError: an unknown controller, or axes that its programs do not move.
    """
    if controller not in _LANGUAGES:
        raise unknown("controller", controller, CONTROLLERS)
    suffix, write = _LANGUAGES[controller]
    moves = strokes(machine)
    if controller == "linuxcnc" and "r" in machine.axis_names:
        moves = [move for move in moves if move.axis != "r"]
    return write(machine, moves), suffix
