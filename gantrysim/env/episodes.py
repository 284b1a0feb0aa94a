"""Episodes: a random spiral, or the path of a job, on a random machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, finite, positive, unknown, whole_number
from gantrysim.engine.linear import Engine
from gantrysim.engine.positions import axis_positions
from gantrysim.engine.simulation import Simulation
from gantrysim.env.look_ahead import LookAhead
from gantrysim.env.ranges import RandomValue, machine_ranges, task_ranges
from gantrysim.env.settings import LEAST_DIAMETER, PathSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.job.loading import builtin_jobs
from gantrysim.machine.geometry import ERRORS
from gantrysim.machine.machine import Machine
from gantrysim.machine.tolerances import Tolerances
from gantrysim.paths.feet import assigned_progress
from gantrysim.paths.nearest import Table
from gantrysim.paths.path import Path
from gantrysim.paths.profile import PointToPoint, Profile
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import Setpoints, periods
from gantrysim.servo.laws import LEARNING
from gantrysim.servo.laws.selection import words
from gantrysim.servo.servo import Servo

TUNED_GAINS = ("kp", "kd", "velocity_ff", "acceleration_ff")  # set by the agent, in the order of the action
SCALED = ("ki", *TUNED_GAINS)  # scaled by the action: ki with kp, so that the integral time stays
SCALED_BY = [TUNED_GAINS.index("kp"), *range(len(TUNED_GAINS))]  # of `TUNED_GAINS`, each gain of `SCALED`

SPIRAL = ("diameter", "thickness", "speed", "turns")
_BEAD = 2.0  # cross-section of the bead on a spiral [mm²]
_PLANS = 8  # paths kept, for spirals that do not vary and for copies of an episode
# Points along a spiral. Distances are measured to the chords between them, and so may differ by the sagitta.
_SPACING = 0.5  # at most [mm]
_SAGITTA = 2e-5  # [mm]
_ROUNDING = 1e-9
_NEAR_PLANE = 1e-3  # height that counts as that of the plane of the spirals [mm]


def gain_factors(action: Floats, gain_range: float) -> dict[str, Floats]:
    """Return the factor on each gain of `SCALED`, of the shape of its action.

    Args:
        action: one row per gain of `TUNED_GAINS`, from -1 to 1, (gains, ...).
        gain_range: largest factor.
    """
    factors = gain_range ** np.asarray(action)
    return {name: factors[k] for name, k in zip(SCALED, SCALED_BY, strict=True)}


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode, ready to run.

    Attributes:
        simulation: its setpoints on its machine.
        plan: path of the episode.
        progress: arc length for which each setpoint stands, (n,) [mm].
        drawn: values drawn for the path and the machine, by name.
    """

    simulation: Simulation
    plan: Plan
    progress: Floats
    drawn: dict[str, float]

    @property
    def table(self) -> Table:
        """Points along the requested path."""
        return self.plan.table

    @property
    def look(self) -> LookAhead:
        """Look-ahead along the path."""
        return self.plan.look

    def parts(self) -> dict[str, Any]:
        """Return the attributes by name, for a task's own kind of episode that has them too."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


class Chosen(NamedTuple):
    """Values of an episode that are chosen, not drawn.

    Attributes:
        spiral: diameter, thickness, speed and turns, as in `PathSettings`, or some of them.
        machine: values by the names that `info` has, such as payload_kg and friction_x, or some of them.
        task: what the task draws, or some of it.
    """

    spiral: Mapping[str, float]
    machine: Mapping[str, float]
    task: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Plan:
    """The path of an episode.

    Attributes:
        setpoints: along the path.
        dispenser: of the glue.
        drawn: values drawn for a spiral by name; none for the path of a job.
    """

    setpoints: Setpoints
    dispenser: Dispenser
    drawn: dict[str, float]

    @cached_property
    def table(self) -> Table:
        """Points along the requested path, fewer on a spiral, of which each episode has its own."""
        path = self.setpoints.requested
        return path.table_with(_SPACING, _SAGITTA) if self.drawn else path.table

    @cached_property
    def look(self) -> LookAhead:
        return LookAhead(self.table.points)


class Source:
    """Source of random episodes; a task's own derives from it.

    Args:
        settings: settings of the environment.
        detune: divisor of the nominal gains.

    Attributes:
        machine: the nominal machine.
        servo: the servo at the start of an episode.
        ticks: servo periods between decisions; None for one decision per episode.
        task: ranges of the values that the task draws for an episode.
        engine: what makes the physics steps; MuJoCo where a fault or a law of the user's own asks for it.

    Raises:
        InputError: an unknown job, machine or random value, a range out of its limits, spirals that the machine cannot
            run, or a decision interval that is not a multiple of the servo period.
    """

    values: ClassVar[Mapping[str, RandomValue]] = {}  # that a task draws for an episode
    looks_ahead: ClassVar[bool] = False  # whether the task observes what lies ahead

    def __init__(self, settings: PathSettings, detune: float = 1.0) -> None:
        self.settings = settings
        self._tolerances = settings.tolerances
        self._spiral = lru_cache(_PLANS)(self._planned_spiral)
        self._job = Job.load(settings.job) if isinstance(settings.job, str) else settings.job
        if self._job is None:
            self.machine = Machine(settings.machine)
            servo = Servo.derive(self.machine.axes, **dict(settings.servo))
        else:
            self.machine = self._job.built_machine
            servo = self._job.built_servo
        servo.check_torque("environment")
        names = servo.laws.names
        if LEARNING.name in names:
            raise InputError(f"environment: servo law = {words(names)}: leave out learning, which needs whole runs")
        lower = {name: tuple(gain / detune for gain in servo.per_axis(name)) for name in SCALED}
        self.servo = servo.with_values(**lower)
        self.ticks = self._ticks()
        self.task = task_ranges(self.values, settings.preset, settings.ranges)
        self._machine_ranges = machine_ranges(self._machine_columns, self.values, settings.ranges)
        asks = self.servo.laws.user is not None or (self._job is not None and self._job.faults)
        self.engine: Engine = "mujoco" if asks else settings.engine
        # a simulation, whose servo and drives are those of all
        self._first: Simulation | None = None
        self._fixed = None if self._job is None else Plan(self._job.setpoints, self._job.dispenser, {})
        if self._job is None:
            self._check_room()

    def draw(self, random: np.random.Generator, chosen: Chosen | None = None) -> Episode:
        """Return a random episode; it depends on the random numbers alone, and on what is chosen instead.

        Raises:
            InputError: an unknown name, or a value out of bounds.
        """
        spiral = self._drawn_spiral(random)
        machine = {}
        if self._tolerances is not None:
            machine = self._tolerances.sample(random, self.machine)
        task = {name: float(random.uniform(*bounds)) for name, bounds in self.task.items()}
        if self._machine_ranges:
            given = {name: float(random.uniform(*bounds)) for name, bounds in self._machine_ranges.items()}
            machine = {**self._nominal_machine, **machine, **given}
        if chosen is not None:
            spiral, machine = self._chosen_values(spiral, machine, chosen)
            for name in chosen.task:
                if name not in task:
                    raise unknown("value of the task", name, task)
            task |= {
                name: at_least(name, value, self.values[name].limits[0], "", self.values[name].limits[1])
                for name, value in chosen.task.items()
            }
        return self.episode({**spiral, **machine, **task})

    def episode(self, drawn: Mapping[str, float]) -> Episode:
        """Return the episode with the values drawn for its path and machine."""
        spiral = {name: drawn[name] for name in SPIRAL if name in drawn}
        task = {name: drawn[name] for name in self.task}
        values = {name: value for name, value in drawn.items() if name not in {*SPIRAL, *task}}
        plan = self._fixed or self._spiral(**spiral, **task)
        machine = self.machine
        if values:
            machine = self._perturbed_machine(values)
        simulation = self._simulation(machine, plan)
        if len(simulation.position) > memory.LONG_RUN:
            raise InputError(
                f"an episode of {len(simulation.position)} servo ticks: must have at most {memory.LONG_RUN}, which are "
                "kept in memory; use a shorter or faster path"
            )
        setpoints = simulation.setpoints
        progress = setpoints.progress
        if progress is None:
            tip = machine.tip(axis_positions(machine, setpoints))
            progress = assigned_progress(setpoints.requested, tip)
        drawn_values = {**plan.drawn, **values, **task}
        return Episode(simulation, plan, progress, drawn_values)

    def _perturbed_machine(self, values: Mapping[str, float]) -> Machine:
        return self.machine.perturbed(Tolerances.perturbation(values, self.machine))

    def _simulation(self, machine: Machine, plan: Plan) -> Simulation:
        if self._first is None:
            self._first = Simulation.of(
                machine,
                self.servo,
                plan.setpoints,
                physics_step=None if self._job is None else self._job.simulation.physics_step,
                dispenser=plan.dispenser,
                faults=() if self._job is None else self._job.faults,
            )
        return self._first.with_program(machine, plan.setpoints, plan.dispenser)

    def _chosen_values(
        self, spiral: dict[str, float], machine: dict[str, float], chosen: Chosen
    ) -> tuple[dict[str, float], dict[str, float]]:
        if chosen.spiral:
            if self._job is not None:
                raise InputError("option spiral: the path comes from the job; give a spiral without a job")
            for name in chosen.spiral:
                if name not in SPIRAL:
                    raise unknown("value of the spiral", name, SPIRAL)
            spiral = {**spiral, **{name: positive(name, value) for name, value in chosen.spiral.items()}}
            spiral["turns"] = whole_number("turns", spiral["turns"], 1)
            if spiral["diameter"] < LEAST_DIAMETER * spiral["thickness"]:
                raise InputError(
                    f"diameter = {spiral['diameter']:g} mm: must be at least {LEAST_DIAMETER} times the thickness, "
                    f"{LEAST_DIAMETER * spiral['thickness']:g} mm, for one turn to fit in"
                )
        if chosen.machine:
            for name in chosen.machine:
                if name not in self._machine_columns:
                    raise unknown("value of the machine", name, self._machine_columns)
            given = {name: finite(name, value) for name, value in chosen.machine.items()}
            machine = {**self._nominal_machine, **machine, **given}
        return spiral, machine

    @cached_property
    def _machine_columns(self) -> dict[str, float]:
        """All values that may vary between machines, as the columns of `Tolerances`."""
        return Tolerances(1.0, 1.0, 1.0, 1.0, 1.0).columns(self.machine)

    @cached_property
    def _nominal_machine(self) -> dict[str, float]:
        return {name: 0.0 if name == "payload_kg" or name.startswith(ERRORS) else 1.0 for name in self._machine_columns}

    @property
    def slowest(self) -> float:
        """Path speed of a task between its ramps, at least, over the one drawn."""
        return 1.0

    def _drawn_spiral(self, random: np.random.Generator) -> dict[str, float]:
        if self._job is not None:
            return {}
        bounds = {name: self.settings.between(name) for name in SPIRAL}
        if all(low == high for low, high in bounds.values()):
            return {**{name: low for name, (low, _) in bounds.items()}, "turns": int(bounds["turns"][0])}
        diameter = float(random.uniform(*bounds["diameter"]))
        thickness = float(random.uniform(*bounds["thickness"]))
        speed = float(random.uniform(*bounds["speed"]))
        fewest, most = bounds["turns"]
        turns = int(random.integers(int(fewest), int(most) + 1))
        return {"diameter": diameter, "thickness": thickness, "speed": speed, "turns": turns}

    def _planned_spiral(self, diameter: float, thickness: float, speed: float, turns: int, **task: float) -> Plan:
        path = self._path(diameter, thickness, turns)
        setpoints = Setpoints.along(path, self._profile(path, speed, **task), self.servo.period)
        drawn = {"diameter": diameter, "thickness": thickness, "speed": speed, "turns": round(path.turns)}
        return Plan(setpoints, Dispenser(flow=_BEAD * speed), drawn)

    def _path(self, diameter: float, thickness: float, turns: int) -> Involute:
        """Return a spiral, of fewer turns if they would not leave a radius of one thickness inside."""
        turns = min(turns, int(0.5 * diameter / thickness - 1 + _ROUNDING))
        return Involute(0.5 * diameter, thickness, turns, start=(-0.5 * diameter, 0.0))

    def _profile(self, path: Path, speed: float, **_task: float) -> Profile:
        """Return the speed profile along a spiral."""
        return PointToPoint(path.length, speed, self.settings.acceleration)

    def _check_room(self) -> None:
        """Raise InputError unless the machine can run the largest and fastest spirals: training must not stop later."""
        machine = self.machine
        home = dict(zip(machine.kinematics.names, machine.home.tolist(), strict=True))
        height = home.get("z", 0.0)
        unfit = ""
        if machine.turns_work:
            unfit = "turns its work, but spirals need a work that does not turn"
        elif abs(height) > _NEAR_PLANE:
            unfit = f"has its nozzle at z = {height:g} mm with all axes at zero, but spirals are drawn at z = 0 mm"
        if unfit:
            jobs = [f"job = {name!r}" for name in builtin_jobs() if Job.load(name).machine == self.settings.machine]
            raise InputError(
                f"machine = {self.settings.machine!r}: {unfit}; use a job of this machine"
                f"{f', such as {jobs[0]}' if jobs else ''}, or machine = 'xy', 'xyz' or 'xyzr'"
            )
        largest = {name: self.settings.between(name)[1] for name in SPIRAL}
        middle = {name: 0.5 * (low + high) for name, (low, high) in self.task.items()}
        for thickness in self.settings.between("thickness"):
            plan = self._spiral(largest["diameter"], thickness, largest["speed"], int(largest["turns"]), **middle)
            try:
                self._simulation(machine, plan)
            except InputError as error:
                given = f"diameter = {largest['diameter']:g} mm, speed = {largest['speed']:g} mm/s"
                text = f"the largest and fastest spiral, {given}, does not fit the machine"
                raise InputError(f"{text}: {error}") from None

    @cached_property
    def most_ticks(self) -> int:
        """Largest number of servo ticks of an episode, but for spirals chosen at its reset."""
        if self._fixed is not None:
            return self._fixed.setpoints.most_ticks
        settings = self.settings
        # n turns are pi n (diameter - n thickness) long, which more turns or a smaller thickness make longer
        path = self._path(
            settings.between("diameter")[1], settings.between("thickness")[0], int(settings.between("turns")[1])
        )
        slowest = PointToPoint(path.length, self.slowest * settings.between("speed")[0], settings.acceleration)
        return periods(slowest.duration, self.servo.period) + 1

    def _ticks(self) -> int | None:
        interval = self.settings.decision_interval
        period = self.servo.period
        if interval == np.inf:
            return None
        ticks = round(interval / period)
        if ticks < 1 or abs(ticks * period - interval) > _ROUNDING:
            raise InputError(
                f"decision_interval = {interval:g} s: must be a multiple of the servo period, {period:g} s"
            )
        return ticks
