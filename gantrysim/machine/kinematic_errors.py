"""From motor positions to the nozzle of a rigid machine that is not straight, square, or free of lost motion.

At the motor's position x of an axis in mm, with lead l, a temperature rise T and the lost motion d, its load stands at

    x + E x / 300 mm + e sin(2 pi x / l) + alpha T (x - f) + d        travel, periodic error, growth, play

The play b acts between motor and load: friction of its guide lets the load rest until the motor has crossed the play.
The axis' zero is found moving upwards, and a run begins so:

    d_0 = 0,    d_k = clip(d_(k-1) - (x_k - x_(k-1)), 0, b)

An axis that the servo controls by a scale on its load has none of these: its loop takes them out. Its scale, fixed at
g and warmer by T_s, grows, and the load stands at

    x + alpha_s T_s (x - g)

With u from -1 to 1 over the travel, u0 where the axis is zero, and the nozzle then displaced by, in the work frame,

    x:  s_xy y + s_xz z + h_y(y) + h_z(z) - theta_x A_x - theta_y B_y    h = s (u^2 - u0^2), a guide's bow
    y:  s_yz z + h_x(x) + v_z(z) + theta_y A_y + theta_x B_x             theta = yaw (u - u0)
    z:  v_x(x) + v_y(y) - sag ((1 - u^2)^2 - (1 - u0^2)^2)            v: vertical bow; sag of the axis on the bridge

and by the ram, a cantilever out of its guide by L = ram + (upper end of z) - z, longest L1 at the lower end, where a
lateral load bends it by b, along x and y:

    b ((L / L1)^p - (L0 / L1)^p)        p = 3: a force F at its end, F L^3 / (3 E I); 2: a moment M, M L^2 / (2 E I)

M is the moment of a head's weight whose centre of gravity lies beside the ram. A yaw turns the body of its axis about
the point where its screw holds it along the axis and the middle of its guide blocks across it: the nozzle moves by
theta x r, with the lever r from there. Across the axis r is the Abbe offset A, from the line of the screw to the
nozzle: `abbe`, and the other horizontal coordinate if that axis moves the nozzle against this body. Along the axis r is
the arm B: `guide_arm`, and the axis' own coordinate if it moves the work under the nozzle. Racking adds
r d_r / w to theta of the bridge, with d_r a play as wide as the presliding w of its guides. The sag follows a beam on
two supports at the ends of the travel with the load at a of its length L, a^2 (L - a)^2 / (3 E I L). All is 0 with
the axes at zero, but the growth of a screw or scale fixed elsewhere.

First order: errors act at the motors' positions and add up. Lost motion is quasi-static: no coasting of the load
through the play, no limit cycle of a loop closed on the load.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.machine.axis import Axis, fact
from gantrysim.machine.geometry import BENDING, ERRORS, LOADS, OF_FRAME, OF_GUIDES, SQUARENESS, Geometry, check_lengths

# Errors of a geometry that a machine can have, a value per column; the others are refused or left out.


class RigidMachine(Protocol):
    """A machine whose geometry is ideal."""

    @property
    def name(self) -> str: ...
    @property
    def axes(self) -> tuple[Axis, ...]: ...
    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame, (n, 3) [mm], at axis positions, (n, axes) [mm or deg]."""
        ...


def error_values(
    machine: RigidMachine, geometry: Geometry, placing: Collection[str], has_ram: bool
) -> dict[str, float]:
    """Return the errors that are not 0, by column such as "play_x" or "squareness_xy".

    An error of the accuracy class that the machine cannot have is left out, where the machine has others of its kind.

    Args:
        machine: the rigid machine.
        geometry: its errors.
        placing: names of the axes x, y and z that place the nozzle.
        has_ram: whether z carries the nozzle on a ram.

    Raises:
        InputError: an error that the machine cannot have.
    """
    values: dict[str, float] = {}
    for name in ERRORS:
        if name in OF_FRAME:
            values |= _of_frame(machine, geometry, name, placing, has_ram)
        else:
            values |= _of_axes(machine, geometry, name, placing)
    return values


def _of_frame(
    machine: RigidMachine, geometry: Geometry, name: str, placing: Collection[str], has_ram: bool
) -> dict[str, float]:
    value = geometry.of(name)
    assert isinstance(value, float | int)
    if not value:
        return {}
    if all(axis in placing for axis in OF_FRAME[name]) and (name not in BENDING or has_ram):
        return {name: value}
    # a class suits machines of other arrangements too, an error that a user states is meant for this one
    if geometry.is_given_explicitly(name) or not placing:
        raise refusal(machine, name)
    return {}


def _of_axes(machine: RigidMachine, geometry: Geometry, name: str, placing: Collection[str]) -> dict[str, float]:
    """Return the values of an error of screws or guides, a column per axis."""
    value = geometry.of(name)
    given = geometry.is_given_explicitly(name)
    listed = isinstance(value, tuple)
    columns = {}
    values = np.broadcast_to(np.asarray(value, float), len(machine.axes))
    for axis, axis_value in zip(machine.axes, values, strict=True):
        if name == "play" and not given and axis.name == "z":
            # the weight takes up the play of an accuracy class
            continue
        if name in OF_GUIDES:
            applies = axis.name in placing and (name != "yaw" or axis.name != "z")
        else:
            applies = axis.unit == "mm" or (name == "play" and listed)
        if axis_value and applies:
            columns[f"{name}_{axis.name}"] = float(axis_value)
        elif axis_value and (listed or (name in OF_GUIDES and not placing)):
            raise refusal(machine, name, axis.name)
    if given and np.any(value) and not columns:
        raise refusal(machine, name)
    return columns


def refusal(machine: RigidMachine, error: str, axis: str = "") -> InputError:
    """Return the refusal of an error that a machine, or one of its axes, cannot have."""
    of_axis = f" of axis {axis}" if axis else ""
    axes = ", ".join(f"{machine_axis.name} [{machine_axis.unit}]" for machine_axis in machine.axes)
    return InputError(
        f"geometry: machine {machine.name} with the axes {axes} can have no {error}{of_axis}: "
        "errors of guides and frame need axes x, y and z in series, those of screws an axis in mm; give others alone"
    )


# Which axes carry which, for the levers of yaws.

GUIDE_ARM = "guide_arm"  # custom numeric, see `Geometry` [mm]


class Levers(NamedTuple):
    """The chain of a machine whose axes x, y and z place the nozzle, for the levers of yaws.

    Attributes:
        carried: names of the axes that each axis carries.
        movers_of_work: names of the axes that move the work; the others move the nozzle.
        guide_arm: along each axis, from the middle of its guide blocks to the nozzle with the axes at zero, (axes,)
            [mm].
    """

    carried: Mapping[str, Sequence[str]]
    movers_of_work: Collection[str]
    guide_arm: Sequence[float]

    @classmethod
    def of(cls, model: mujoco.MjModel, axes: Sequence[str], work: int) -> Levers:
        """Return the levers of a compiled model.

        Args:
            model: the compiled model.
            axes: names of the axes, in the order of the actuators.
            work: index of the body.
        """
        bodies = model.jnt_bodyid[model.actuator_trnid[:, 0]].tolist()
        carried: dict[str, list[str]] = {name: [] for name in axes}
        for name, body in zip(axes, bodies, strict=True):
            for ancestor in _ancestors(model, body):
                if ancestor in bodies:
                    carried[axes[bodies.index(ancestor)]].append(name)
        # an axis moves the work where its body is the work's or carries it
        chain_of_work = [work, *_ancestors(model, work)]
        movers_of_work = [name for name, body in zip(axes, bodies, strict=True) if body in chain_of_work]
        guide_arm = [fact(model, GUIDE_ARM, actuator, 0.0) for actuator in range(len(axes))]
        return cls(carried, movers_of_work, guide_arm)

    def moves_nozzle_from(self, axis: str, body: str) -> bool:
        """Whether an axis moves the nozzle against the body of another, or of itself."""
        if body in self.movers_of_work:
            return axis not in self.carried[body]
        return axis in self.carried[body]


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the bodies above a body in the tree, from its parent up, without the world."""
    ancestors = []
    parent = int(model.body_parentid[body])
    while parent:
        ancestors.append(parent)
        parent = int(model.body_parentid[parent])
    return ancestors


PRESLIDING = 0.02  # motion over which a bridge racks at a reversal; an assumption [mm]
_INTERVAL = 300.0  # of the travel error [mm]
_PER_MM = 1e-3  # of an angle in mm/m


class KinematicErrors:
    """The errors of a machine's geometry.

    Args:
        machine: the rigid machine.
        geometry: its errors.
        levers: the chain; None where the axes do not place the nozzle by x, y and z.
        factors: on single errors, by their column name, see `columns`.

    Raises:
        InputError: an error that the machine cannot have, or a list with another number of axes.
    """

    def __init__(
        self,
        machine: RigidMachine,
        geometry: Geometry,
        levers: Levers | None,
        factors: Mapping[str, float],
    ) -> None:
        self._tip = machine.tip
        names = tuple(axis.name for axis in machine.axes)
        self._names = names
        check_lengths(geometry, names)
        slides = np.array([axis.unit == "mm" for axis in machine.axes])
        self._columns = {name: names.index(name) for name in "xyz" if name in names and levers is not None}
        carried = {} if levers is None else levers.carried
        # a ram carries the nozzle alone; a z that carries x or y is a column or a table
        has_ram = "z" in self._columns and not {"x", "y"} & set(carried.get("z", ()))
        values = error_values(machine, geometry, self._columns, has_ram)
        self.values = {column: value * factors.get(column, 1.0) for column, value in values.items()}
        if (geometry.warming or geometry.scale_warming) and not slides.any():
            raise refusal(machine, "growth by warming")
        self._lead = np.array([2 * np.pi * axis.scale for axis in machine.axes])
        self._growth = geometry.expansion * geometry.warming * factors.get("warming", 1.0) * slides
        self._fixed = np.broadcast_to(np.asarray(geometry.fixed_end, float), len(names))
        self._scale_growth = geometry.scale_expansion * geometry.scale_warming * factors.get("warming", 1.0) * slides
        self._scale_fixed = np.broadcast_to(np.asarray(geometry.scale_fixed, float), len(names))
        self._ram = geometry.ram
        self._power = LOADS[geometry.bending_load]
        self._abbe = np.broadcast_to(np.asarray(geometry.abbe, float), len(names))
        low, high = np.array([axis.travel for axis in machine.axes]).T
        limited = np.isfinite(low) & np.isfinite(high)
        self._middle = 0.5 * np.where(limited, low + np.where(limited, high, 0.0), 0.0)
        self._half = np.where(limited, high - self._middle, 1.0)
        # the axis that carries the bridge, and the one on it
        self._bridge = "x" if "y" in carried.get("x", ()) else "y"
        self._beam = "y" if self._bridge == "x" else "x"
        self._check_travel(machine, limited)
        self._levers = levers
        arms = geometry.guide_arm
        if arms is None:
            arms = tuple(levers.guide_arm) if levers is not None else 0.0
        self._guide_arm = np.broadcast_to(np.asarray(arms, float), len(names))

    def _check_travel(self, machine: RigidMachine, limited: NDArray[np.bool_]) -> None:
        """Refuse errors over the travel of an axis that has no limited one."""
        for name, a in self._columns.items():
            errors = [f"{error}_{name}" for error in OF_GUIDES]
            if name == self._beam:
                errors.append("sag")
            if name == "z":
                errors.extend(BENDING)
            if not limited[a] and any(error in self.values for error in errors):
                raise InputError(
                    f"geometry: axis {name} of machine {machine.name} has no limited travel, over which its "
                    "straightness, yaw, sag and bending could be: give its joint a range"
                )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the errors that are not 0, such as "play_x" or "squareness_xy"."""
        return tuple(self.values)

    def tips(self, motors: Iterable[Floats], scales: ArrayLike = False) -> Iterator[Floats]:
        """Yield the nozzle at the motors' positions, (n, 3) [mm], for consecutive blocks of ticks.

        Args:
            motors: positions of the motors, (n, axes) [mm or deg], all of a run from its begin.
            scales: whether the servo has each axis' position from a scale on its load, (axes,) or one for all.
        """
        on_load = np.broadcast_to(np.asarray(scales, bool), len(self._names))
        play = np.zeros(len(self._names))
        last = None
        racked = 0.0
        # a loop that is closed on the load takes the play out
        width = np.where(on_load, 0.0, self._per_axis("play"))
        for motor in motors:
            previous = motor[0] if last is None else last
            lost = np.empty_like(motor)
            for a in range(motor.shape[1]):
                _play(motor[:, a], previous[a], play[a], width[a], lost[:, a])
            racking = np.zeros(len(motor))
            if self.values.get("racking"):
                bridge = self._columns[self._bridge]
                _play(motor[:, bridge], previous[bridge], racked, PRESLIDING, racking)
            play = lost[-1].copy()
            racked = float(racking[-1])
            last = motor[-1].copy()
            moved = motor + np.where(on_load, self._of_scales(motor), self._of_screws(motor)) + lost
            yield self._tip(moved) + self._of_frame(motor, racking / PRESLIDING)

    def _of_screws(self, x: Floats) -> Floats:
        """Return the errors that screws add to the positions of their axes, (n, axes) [u]."""
        travel = self._per_axis("travel_error")
        periodic = self._per_axis("periodic_error")
        error = travel * x / _INTERVAL + periodic * np.sin(2 * np.pi * x / self._lead)
        return error + self._growth * (x - self._fixed)

    def _of_scales(self, x: Floats) -> Floats:
        """Return the errors that scales on the load add instead, (n, axes) [u]."""
        return self._scale_growth * (x - self._scale_fixed)

    def _of_frame(self, motor: Floats, racked: Floats) -> Floats:
        """Return the displacement of the nozzle by guides and frame, (n, 3) [mm]."""
        shift = np.zeros((len(motor), 3))
        position = {name: motor[:, a] for name, a in self._columns.items()}
        for name in SQUARENESS:
            square = self.values.get(name)
            if square:
                towards, leaning = sorted(name[-2:])
                shift[:, "xyz".index(towards)] += _PER_MM * square * position[leaning]
        for name in BENDING:
            bend = self.values.get(name)
            if bend:
                shift[:, "xyz".index(name[-1])] += bend * self._bending(position["z"])
        for name, x in position.items():
            self._add_of_guide(shift, name, x, position, racked)
        return shift

    def _bending(self, z: Floats) -> Floats:
        """Return the ram's deflection relative to the longest, zero where z is zero, (n,)."""
        a = self._columns["z"]
        upper = self._middle[a] + self._half[a]
        longest = self._ram + 2 * self._half[a]
        length = (self._ram + upper - z) / longest
        length_at_zero = (self._ram + upper) / longest
        return length**self._power - length_at_zero**self._power

    def _add_of_guide(
        self, shift: Floats, name: str, x: Floats, position: Mapping[str, Floats], racked: Floats
    ) -> None:
        """Add the displacement by the guide of one axis, and by the beam or bridge that it is, to (n, 3) [mm]."""
        a = self._columns[name]
        u = (x - self._middle[a]) / self._half[a]
        u0 = -self._middle[a] / self._half[a]
        for error, towards in (("straightness", "yxx"), ("straightness_vertical", "zzy")):
            bow = self.values.get(f"{error}_{name}")
            if bow:
                shift[:, "xyz".index(towards["xyz".index(name)])] += bow * (u**2 - u0**2)
        yaw = self.values.get(f"yaw_{name}", 0.0) * (u - u0)
        if name == self._bridge:
            yaw = yaw + self.values.get("racking", 0.0) * racked
        if name in "xy":
            across, along = self._lever(name, position)
            sense = -1.0 if name == "x" else 1.0
            shift[:, "xy".index(name)] += sense * _PER_MM * yaw * across
            shift[:, "yx".index(name)] -= sense * _PER_MM * yaw * along
        sag = self.values.get("sag")
        if name == self._beam and sag:
            shift[:, 2] -= sag * ((1 - u**2) ** 2 - (1 - u0**2) ** 2)

    def _lever(self, name: str, position: Mapping[str, Floats]) -> tuple[Floats | float, Floats | float]:
        """Return the nozzle's place from the centre of an axis' yaw, across the axis and along it, (n,) [mm]."""
        assert self._levers is not None
        a = self._columns[name]
        across = self._abbe[a]
        along = self._guide_arm[a]
        other = "y" if name == "x" else "x"
        if other in position and self._levers.moves_nozzle_from(other, name):
            across = across + position[other]
        if self._levers.moves_nozzle_from(name, name):
            along = along + position[name]
        return across, along

    def _per_axis(self, error: str) -> Floats:
        return np.array([self.values.get(f"{error}_{name}", 0.0) for name in self._names])


@jit
def _play(motor: Floats, previous: float, lost: float, width: float, lost_motion: Floats) -> None:
    """Fill in the load's lag behind the motor after its reversals, (n,), see the module's docstring."""
    for k in range(motor.size):
        lost = min(max(lost - (motor[k] - previous), 0.0), width)
        previous = motor[k]
        lost_motion[k] = lost
