"""The inward spiral of AN-225: its parameters, the requested path, and the path that its loop commands."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, finite, plane_point, positive, whole_number
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.speeds import Stretches
from gantrysim.controllers.trio.listing import SpiralListing
from gantrysim.controllers.trio.loop import MAX_PASSES, RATIO_BITS, EndlessError, Loop, Passes, RatioTooSmallError
from gantrysim.controllers.trio.theory import SpiralTheory
from gantrysim.paths.lengths import arc_length
from gantrysim.paths.path import Path
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import Setpoints

# The differences between AN-225's published listing and the method it describes.

LITERAL_CIRCLES = 4  # to which the listing compares its turn counter


def differences(passes: Passes, turns: int, height: float) -> tuple[str, ...]:
    """Return the differences, each with its effect on this spiral.

    Args:
        passes: of the listing's loop.
        turns: programmed number of circles.
        height: climbed over them, 0 for two axes [mm].
    """
    notes = [
        "listing: a BASE statement names an axis that does not exist; the virtual axes are used instead",
        _turn_counter(turns),
        _guard(passes),
        "listing: a trailing comma in the first MOVECIRC is a syntax error; it is ignored",
    ]
    if height:
        notes.append("listing: MHELIX is not a command of the controller; MHELICAL is used instead")
    return tuple(notes)


def _turn_counter(turns: int) -> str:
    effect = "no effect" if turns == LITERAL_CIRCLES else f"{LITERAL_CIRCLES} circles are run instead of {turns}"
    return f"listing: the turn counter is compared with a literal 4, not with the number of turns: {effect}"


def _guard(passes: Passes) -> str:
    flaw = "listing: the guard accepts x = 0 and negative x"
    ratio = passes.ratio
    time = passes.time
    negative = np.flatnonzero(ratio < 0)
    if passes.halted:
        return (
            f"{flaw}: x is 0 on pass {ratio.size + 1}, SPEED = V / x divides by zero, the program stops and "
            f"the axes continue with x = {ratio[-1]:.4g}"
        )
    if negative.size:
        first = int(negative[0])
        return (
            f"{flaw}: from pass {first + 1}, at {time[first]:.3f} s, the real axes run backwards, "
            f"down to x = {ratio[-1]:.4g}, and WA of a negative time does not wait"
        )
    return f"{flaw}: no effect, x ends at {ratio[-1]:.4g}"


# What to change in a spiral that the controller refuses, as ends of messages.


def fewer_turns(diameter: float, thickness: float) -> str:
    """Return the advice to use fewer turns, up to which the inner diameter is positive; empty where none are."""
    turns = math.ceil(diameter / (2 * thickness)) - 1
    return f"turns at most {turns} or " if turns >= 1 else ""


def for_late_axes(*, has_ramps: bool, rounds_waits: bool, speed_in_space: bool) -> str:
    """Return what makes the virtual axes faster, so that their circles end before the ratio is zero."""
    remedies = {
        "a greater acceleration, ": has_ramps,
        "a loop_period longer against wait_resolution, ": rounds_waits,
        "mhelical_mode 1, ": speed_in_space,
    }
    helpful = "".join(remedy for remedy, helps in remedies.items() if helps)
    return f"the virtual axes are late, use {helpful}fewer turns or a smaller thickness"


# one path for all jobs of a search that differ elsewhere, as it holds the tables by which feet are found
_involute = lru_cache(maxsize=8, typed=True)(Involute)
_ROUNDING = 1e-12
_TURN_PARTS = 16  # of a turn, at whose ends the speed is given where it is set by place


@dataclass(frozen=True)
class MoveSpiral(Controller):
    """An inward spiral by the loop method of AN-225.

    Two virtual axes run circles of the outer diameter. CONNECT(x, virtual axis) links each real axis to its virtual
    axis; a program loop lowers the ratio x and raises the virtual SPEED to V / x, so that the real path speed stays V.
    Between two passes the real axes run an arc of radius x R; consecutive arcs are tangent.

    The k-th pass sets x_k = 1 - k change, with change = 2 thickness V T / (pi D^2), and waits WA(1000 T x_k) ms.
    A pass lasts T x_k + d and, at SPEED, turns the virtual circle by V (T x_k + d) / (x_k R). As T and d go to
    zero the path tends to the involute of a circle of radius thickness / 2 pi, whose normal pitch is exactly
    `thickness`: that is the requested path.

    The defaults give the method without the controller's limits. With ACCEL and DECEL, x keeps falling while the
    virtual axes brake, so that the end of the spiral curls in. At every servo tick, CONNECT adds the ratio times the
    virtual axis' step; if the ratio changes at ticks only (`servo_period`), the real axes lie exactly on the arcs.

    With a height, MHELICAL adds a third virtual axis that climbs evenly with the circles and drives the real one
    directly. In mode 1, SPEED is the speed on the circle; in mode 0 it is the speed in space, so that the circle is
    slower, x falls too far by its end and the turns are too far apart.

    Source: Trio Motion Technology, application note AN-225 (2008), and the Motion BASIC manual for CONNECT,
    MOVECIRC, MHELICAL, WA.

    Args:
        diameter: outer diameter D of the virtual circles [mm].
        turns: number of circles, a whole number.
        thickness: distance between neighbouring turns [mm].
        speed: path speed V of the real axes [mm/s].
        loop_period: duration T of one pass of the program loop at x = 1; 0 is the continuous limit [s].
        interpreter_time: time d that the interpreter adds to each pass [s].
        start: first point (x, y) [mm].
        clockwise: direction of rotation; the motion starts towards +y, with the centre at +x if clockwise, otherwise at
            -x.
        height: height climbed evenly over all circles, 0 for a flat spiral on two axes [mm].
        mhelical_mode: what SPEED means on a spiral with a height: 0 for the speed in space, 1 for that of the circle.
        acceleration: ACCEL of the virtual axes [mm/s²].
        deceleration: DECEL of the virtual axes; by default ACCEL [mm/s²].
        wait_resolution: WA truncates its time to a multiple of this; 0.001 on the controller, 0 for exact waits [s].
        ratio_bits: fractional bits of CONNECT's ratio, 16 on the controller; None for an exact ratio.
        servo_period: SERVO_PERIOD, at whose ticks commands take effect: 0.0005, 0.001 or 0.002 on the controller; 0 for
            a program that acts between ticks [s].
        as_published: whether to run the published listing as it is, errors included; `notes` lists the differences.
        speeds: path speeds by place, pairs of a number of turns from the start and the path speed v there, the turns
            ascending [turns, mm/s]. From `speed` at the start, v is linear from one to the next, and stays after the
            last. The program takes v by the ratio x with which a pass begins, and lowers x by
            2 thickness v T / (pi D^2).

    Raises:
        InputError: a value out of bounds, a negative inner diameter, or a ratio x that would fall to zero or
            below before the axes brake at the end.
    """

    ramp_arguments: ClassVar[tuple[str, ...]] = ("acceleration", "deceleration")
    diameter: float
    turns: int
    thickness: float
    speed: float
    loop_period: float = 0.1
    interpreter_time: float = 0.0
    start: tuple[float, float] = (0.0, 0.0)
    clockwise: bool = True
    height: float = 0.0
    mhelical_mode: int = 1
    acceleration: float = math.inf
    deceleration: float | None = None
    wait_resolution: float = 0.0
    ratio_bits: int | None = None
    servo_period: float = 0.0
    as_published: bool = False
    speeds: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        checked = {
            "diameter": positive("diameter", self.diameter, "mm"),
            "turns": whole_number("turns", self.turns, 1),
            "thickness": positive("thickness", self.thickness, "mm"),
            "speed": positive("speed", self.speed, "mm/s"),
            "loop_period": at_least("loop_period", self.loop_period, 0, "s"),
            "interpreter_time": at_least("interpreter_time", self.interpreter_time, 0, "s"),
            "start": plane_point("start", self.start),
            "height": finite("height", self.height, "mm"),
            "wait_resolution": at_least("wait_resolution", self.wait_resolution, 0, "s"),
            "servo_period": at_least("servo_period", self.servo_period, 0, "s"),
        }
        for name in ("acceleration", "deceleration"):
            limit = getattr(self, name)
            if limit is not None and limit != math.inf:
                checked[name] = positive(name, limit, "mm/s²")
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "speeds", self._checked_speeds())
        if self.speeds and self.as_published:
            raise InputError(
                f"speeds of {len(self.speeds)} places: must be none with as_published, whose listing has one"
            )
        if self.mhelical_mode not in (0, 1):
            raise InputError(f"mhelical_mode = {self.mhelical_mode}: must be 0 (SPEED in space) or 1 (of the circle)")
        if self.ratio_bits is not None and not 8 <= whole_number("ratio_bits", self.ratio_bits, 8) <= 52:
            raise InputError(f"ratio_bits = {self.ratio_bits}: must be at most 52, or none for an exact ratio")
        if self.inner_diameter < -_ROUNDING * self.diameter:
            remedy = fewer_turns(self.diameter, self.thickness)
            raise InputError(
                f"inner_diameter = {self.inner_diameter:g} mm (diameter {self.diameter:g} - 2 x turns {self.turns} x "
                f"thickness {self.thickness:g}): must be at least 0 mm; "
                f"use {remedy}thickness below {self.diameter / (2 * self.turns):g} mm"
            )
        if self.loop_period == 0:
            self._check_continuous()
        else:
            # raises where the ratio would reach zero
            _ = self.passes

    def _checked_speeds(self) -> tuple[tuple[float, float], ...]:
        pairs = []
        reached = 0.0
        for k, pair in enumerate(self.speeds, 1):
            if not hasattr(pair, "__iter__") or isinstance(pair, str) or len(tuple(pair)) != 2:
                raise InputError(f"speeds {k} = {pair!r}: must be two numbers, turns and a speed in mm/s")
            turn, speed = pair
            if not reached < finite(f"speeds {k}, turns", turn) <= self.turns:
                raise InputError(
                    f"speeds {k}, turns = {turn:g}: must be above {reached:g} and at most turns, {self.turns:g}"
                )
            reached = float(turn)
            pairs.append((reached, positive(f"speeds {k}", speed, "mm/s")))
        return tuple(pairs)

    def _check_continuous(self) -> None:
        needs_a_loop = {
            "interpreter_time": (self.interpreter_time, 0.0, "s"),
            "acceleration": (self.acceleration, math.inf, "mm/s²"),
            "deceleration": (math.inf if self.deceleration is None else self.deceleration, math.inf, "mm/s²"),
            "wait_resolution": (self.wait_resolution, 0.0, "s"),
            "servo_period": (self.servo_period, 0.0, "s"),
        }
        limit = "where loop_period is 0 s, the continuous limit"
        for name, (value, free, unit) in needs_a_loop.items():
            if value != free:
                raise InputError(f"{name} = {value:g} {unit}: must be {free:g} {unit} {limit}")
        if self.ratio_bits is not None:
            raise InputError(f"ratio_bits = {self.ratio_bits}: must be none {limit}")
        if self.speeds:
            raise InputError(f"speeds of {len(self.speeds)} places: must be none {limit}")
        if self.as_published or (self.height and self.mhelical_mode == 0):
            what = "as_published = true" if self.as_published else "mhelical_mode = 0"
            raise InputError(f"{what}: must have a loop_period greater than 0 s")

    @property
    def radius(self) -> float:
        """Radius R of the virtual circles [mm]."""
        return 0.5 * self.diameter

    @property
    def inner_diameter(self) -> float:
        """Outer diameter minus twice the thickness per turn [mm]."""
        return self.diameter - 2 * self.turns * self.thickness

    @property
    def virtual_length(self) -> float:
        """Length of the virtual circles, pi D turns [mm]."""
        return math.pi * self.diameter * self.turns

    @property
    def virtual_time(self) -> float:
        """Time of the virtual circles at the path speed [s]."""
        return self.virtual_length / self.speed

    @property
    def change(self) -> float:
        """Decrease of the ratio x per pass."""
        return 2 * self.thickness * self.speed * self.loop_period / (math.pi * self.diameter**2)

    @property
    def _all_speeds(self) -> tuple[tuple[float, float], ...]:
        """The speeds by place with that of the start."""
        return ((0.0, self.speed), *self.speeds)

    def _ratio_after(self, turns: float) -> float:
        """Return the ratio x after so many turns."""
        return 1 - 2 * self.thickness * turns / self.diameter

    @property
    def circles(self) -> int:
        """Number of circles executed."""
        return LITERAL_CIRCLES if self.as_published else self.turns

    @cached_property
    def passes(self) -> Passes:
        """Passes of the program loop; undefined in the continuous limit."""
        # with interpreter time the passes are fewer
        due = self.virtual_time / self.loop_period - 1e-9
        if due > MAX_PASSES:
            raise InputError(
                f"loop_period = {self.loop_period:g} s: makes {due:.8g} passes, at most {MAX_PASSES} are run; "
                f"use 0 s for the continuous limit or at least {self.virtual_time / MAX_PASSES:.3g} s"
            )
        # SPEED and ACCEL of the circle, where they are those of the motion in space
        share = 1 / math.hypot(1.0, self.height / self.virtual_length) if self.mhelical_mode == 0 else 1.0
        loop = Loop(
            length=math.pi * self.diameter * self.circles,
            speed=self.speed * share,
            change=self.change,
            period=self.loop_period,
            interpreter_time=self.interpreter_time,
            acceleration=self.acceleration * share,
            deceleration=share * (self.acceleration if self.deceleration is None else self.deceleration),
            wait_resolution=self.wait_resolution,
            ratio_bits=self.ratio_bits,
            servo_period=self.servo_period,
            guarded=not self.as_published,
            speeds=tuple((self._ratio_after(turn), share * speed) for turn, speed in self._all_speeds)
            if self.speeds
            else (),
        )
        try:
            return loop.passes()
        except RatioTooSmallError as error:
            remedy = self._remedy(late=error.number > due + 1)
            raise InputError(
                f"ratio x = {error.ratio:.4g} on pass {error.number} of {max(1, math.ceil(due))}: "
                f"must be at least 2^-{RATIO_BITS}, the resolution of CONNECT; {remedy}"
            ) from None
        except EndlessError as error:
            raise InputError(
                f"ratio x = {error.ratio:.4g} at {error.time:.4g} s: the circles must end within {MAX_PASSES} passes; "
                "use a smaller thickness or a greater acceleration"
            ) from None

    def _remedy(self, late: bool) -> str:
        if not late:
            return (
                f"inner_diameter {self.inner_diameter:g} mm is too small for loop_period {self.loop_period:g} s, "
                "use fewer turns, a smaller thickness or a shorter loop_period"
            )
        return for_late_axes(
            has_ramps=math.isfinite(self.acceleration),
            rounds_waits=self.wait_resolution > 0,
            speed_in_space=self.height != 0 and self.mhelical_mode == 0,
        )

    @property
    def ratios(self) -> Floats:
        """Ratio x of every pass, (passes,); empty in the continuous limit."""
        return self.passes.ratio if self.loop_period > 0 else np.zeros(0)

    @cached_property
    def requested(self) -> Involute:
        """The continuous limit: the involute with normal pitch `thickness`."""
        return _involute(
            self.radius, self.thickness, self.turns, self.start, 0.5 * math.pi, self.clockwise, self.height
        )

    @cached_property
    def generated(self) -> Path:
        """The commanded path: an arc, or a helix, per pass of the loop."""
        if self.loop_period == 0:
            return self.requested
        return self.passes.path((*self.start, 0.0), self.radius, self._climb, self.clockwise)

    @property
    def _climb(self) -> float:
        """Height per radian of the virtual circles [mm/rad]."""
        return self.height / (2 * math.pi * self.turns)

    @property
    def duration(self) -> float:
        return self._flat.length / self.speed if self.loop_period == 0 else self.passes.profile.duration

    @cached_property
    def _flat(self) -> Involute:
        """The requested path in the XY plane."""
        return replace(self.requested, height=0.0)

    @property
    def axes(self) -> tuple[str, ...]:
        return ("x", "y", "z") if self.height else ("x", "y")

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences of the published listing, if it is run."""
        return differences(self.passes, self.turns, self.height) if self.as_published else ()

    def stretches(self, period: float) -> Stretches:
        """As `Controller.stretches`: around places evenly spaced on the turns, whose speeds the key `speeds` gives."""
        if self.loop_period == 0 or self.as_published:
            raise InputError(
                "trio.MoveSpiral: speeds by place need the program's own loop, with a loop_period above 0 s and "
                "without as_published"
            )
        turns, speeds = np.array(self._all_speeds).T
        nodes = np.arange(_TURN_PARTS * self.turns + 1)
        # a stretch is the way to which a node is nearest
        ends = self._progress(2 * math.pi * np.minimum(nodes + 0.5, nodes[-1]) / _TURN_PARTS)
        return Stretches(ends, nodes + 1, np.interp(nodes / _TURN_PARTS, turns, speeds))

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_speeds`."""
        nodes = [speeds[place] for place in sorted(speeds)]
        # what lies on the line between its neighbours, as where the speed stays, follows from them
        last = len(nodes) - 1
        needed = [k for k in range(1, last + 1) if nodes[k] != nodes[k - 1] or (k < last and nodes[k] != nodes[k + 1])]
        return {"speed": nodes[0], "speeds": [[k / _TURN_PARTS, nodes[k]] for k in needed]}

    @property
    def program_text(self) -> str:
        """The program in Trio BASIC; empty in the continuous limit, and for the published listing."""
        if self.loop_period == 0 or self.as_published:
            return ""
        names = {item.name for item in fields(SpiralListing)} - {"speeds"}
        speeds = tuple((self._ratio_after(turn), speed) for turn, speed in self._all_speeds)
        return SpiralListing(**{name: getattr(self, name) for name in names}, speeds=speeds).text

    @property
    def program_suffix(self) -> str:
        return ".bas"

    @classmethod
    def loop_theory(cls, arguments: Mapping[str, Any]) -> SpiralTheory | None:
        # the closed forms are those of one speed
        return None if arguments.get("speeds") else SpiralTheory(arguments)

    @property
    def free_running(self) -> bool:
        return self.servo_period == 0

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        changed: dict[str, Any] = {"speed": change(self.speed)}
        if self.speeds:
            changed["speeds"] = [[turn, change(speed)] for turn, speed in self.speeds]
        return changed

    def setpoints(self, period: float) -> Setpoints:
        if self.servo_period > 0 and abs(period - self.servo_period) > 1e-12:
            raise InputError(
                f"servo_period = {self.servo_period:g} s of the controller: must be that of the servo, {period:g} s, "
                "or 0 s for a program that acts between ticks"
            )
        if self.loop_period == 0:
            setpoints = Setpoints.along(
                self._flat, self.speed, period, requested=self.requested, axes=self.axes, coordinates=self._climbing
            )
            s = np.minimum(setpoints.time * self.speed, self._flat.length)
            return replace(setpoints, progress=self._progress(self._flat.phi(s)))
        lengths = (
            np.hypot(self.passes.connected * self.radius, self._climb) * np.diff(self.passes.distance) / self.radius
        )
        # within a pass the ratio is constant, and the real axes advance as the virtual ones
        profile = self.passes.connect(lengths)
        setpoints = Setpoints.along(self.generated, profile, period, requested=self.requested, axes=self.axes)
        virtual = self.passes.profile.position(setpoints.time)
        return replace(setpoints, progress=np.maximum.accumulate(self._progress(virtual / self.radius)))

    def _progress(self, angle: Floats) -> Floats:
        """Arc lengths of the requested path where its tangent has turned by the angles of the virtual circles, (n,)."""
        path = self.requested
        return arc_length(path.radius, -path.a, abs(self._climb), np.clip(angle, 0.0, path.angle))

    def _climbing(self, s: Floats) -> Floats:
        """The axes at arc lengths of the flat path: SPEED is that of the circle."""
        points = self._flat.position(s)
        points[:, 2] = self._climb * self._flat.phi(s)
        return points[:, : len(self.axes)]
