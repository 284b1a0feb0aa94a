"""The repeat study: path accuracy and repeatability after ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, whole_number
from gantrysim.base.quantity import UM
from gantrysim.engine.simulate import simulate
from gantrysim.job.job import Job, check_job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics import Positioning, RepeatedPath, interpolated, offset_over_length
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.study.cases import OK, Case, Row, judged_row, verdict_row
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds, Study

# Test of the positioning of a machine's linear axes, each approaching its targets from below and from above.

CYCLES = 5
TARGETS = 11
_TRAVEL_SHARE = 0.9  # of the travel that the targets span
_OVERRUN = 0.02  # of the travel, beyond the outer targets
# mean speed between targets, at most [mm/s], and of the axis' limit
_SPEED = 100.0
_SHARE_OF_LIMIT = 0.5
# of a motion and of a stop [s]
_SHORTEST_TIME = 0.2
_DWELL = 0.2
_GOLDEN = 0.6180339887498949


def linear_axes(job: Job) -> tuple[str, ...]:
    """Return the names of the axes in mm with a bounded travel."""
    return tuple(a.name for a in job.built_machine.axes if a.unit == "mm" and np.isfinite(a.travel).all())


def targets_of(travel: tuple[float, float]) -> Floats:
    """Return the targets, each at another place within its interval so that they meet all phases of a screw's turn."""
    low, high = travel
    edge = 0.5 * (1 - _TRAVEL_SHARE) * (high - low)
    step = (high - low - 2 * edge) / TARGETS
    return low + edge + step * (np.arange(TARGETS) + (_GOLDEN * np.arange(TARGETS)) % 1.0)


def positioning(job: Job, axis: str, perturbations: Sequence[Perturbation]) -> Positioning:
    """Return the deviations of an axis with the others at zero, at the job's servo.

    Deviations are those of the nozzle from the commanded position, along the axis, at the end of a stop.

    Args:
        job: of the machine and servo.
        axis: name of one of `linear_axes`.
        perturbations: of the machine in each cycle.

    Raises:
        InputError: a cycle ends in a fault.
    """
    machine = job.built_machine
    servo = job.built_servo
    moved_axis = machine.axes[machine.axis_names.index(axis)]
    targets = targets_of(moved_axis.travel)
    over = _OVERRUN * (moved_axis.travel[1] - moved_axis.travel[0])
    # the outer targets too are approached from both sides
    ends = np.array([targets[0] - over, targets[-1] + over])
    stops = np.concatenate([ends[:1], targets, ends[1:], targets[::-1]])
    speed = min(_SPEED, _SHARE_OF_LIMIT * moved_axis.speed_limit)
    position, stopped = _motion(stops, speed, servo.period)
    named = {name: np.zeros(position.size) for name in machine.axis_names} | {axis: position}
    rows = np.stack(list(named.values()), axis=1)
    first, last = machine.tip(rows[stopped[[0, TARGETS + 1]]])
    along = (last - first) / np.linalg.norm(last - first)
    setpoints = Setpoints(
        period=servo.period,
        axes=machine.axis_names,
        position=rows,
        dispense=np.zeros(position.size, bool),
        requested=Chain([Line(tuple(first.tolist()), tuple(last.tolist()))]),
    )
    # deviations at all stops, in the order of the motion
    cycles = []
    for perturbation in perturbations:
        run = simulate(
            machine.perturbed(perturbation),
            servo,
            setpoints,
            physics_step=job.simulation.physics_step,
            engine=job.engine_of_searches,
        )
        if run.fault is not None:
            raise InputError(f"positioning of {axis}: {run.fault}")
        cycles.append((run.nozzle[stopped] - run.commanded_tip[stopped]) @ along)
    deviation = np.array(cycles)
    return Positioning(targets, deviation[:, 1 : TARGETS + 1], deviation[:, TARGETS + 2 :][:, ::-1])


def _motion(stops: Floats, speed: float, period: float) -> tuple[Floats, Floats]:
    """Return positions that stop at some, and the index at the end of each stop.

    Between stops d apart they follow x = d (10 s^3 - 15 s^4 + 6 s^5) over the share s of the time.
    """
    pieces = [np.full(round(_DWELL / period), stops[0])]
    stopped = [pieces[0].size - 1]
    for begin, end in pairwise(stops.tolist()):
        count = max(round(max(abs(end - begin) / speed, _SHORTEST_TIME) / period), 1)
        s = np.arange(1, count + 1) / count
        pieces += [begin + (end - begin) * s**3 * (10 - 15 * s + 6 * s**2), np.full(round(_DWELL / period), end)]
        stopped.append(sum(piece.size for piece in pieces) - 1)
    return np.concatenate(pieces), np.array(stopped)


# A repeat of a job: a case that may start between two servo ticks, and its nozzle's offset from the path.

PHASES = 8  # of a servo period, in which a program may start
ALL_VARIATIONS = "all"  # name of the variation of everything


@dataclass(frozen=True)
class RepeatCase(Case):
    """A case whose program starts between two servo ticks.

    Attributes:
        phase: lead over a servo tick, in 1/`PHASES` of a servo period.
    """

    phase: int = 0

    @property
    def key(self) -> str:
        """Identity of the case, with its phase."""
        return f"{super().key}-{self.phase}"


def has_phase(job: Job) -> bool:
    """Return whether a job's program may start anywhere between two servo ticks."""
    return job.controller.free_running


def phased_setpoints(job: Job, phase: int) -> Setpoints:
    """Return the setpoints of a job whose program starts before a servo tick, every `PHASES`-th of a finer period.

    Args:
        job: whose program is not bound to servo ticks.
        phase: lead over the tick, in 1/`PHASES` of a servo period.
    """
    if not phase:
        return job.setpoints
    period = job.built_servo.period
    fine = job.controller.setpoints(period / PHASES)
    last = len(fine.position) - 1
    sent = np.concatenate([[0], np.arange(phase, last, PHASES), [last]])
    coarse = replace(
        fine,
        period=period,
        position=fine.position[sent],
        dispense=fine.dispense[sent],
        progress=None if fine.progress is None else fine.progress[sent],
    )
    return job.dispenser.held_back(coarse).hold(job.simulation.settle)


def places_along(analysis: Analysis, count: int) -> Floats:
    """Return at most `count` evenly spaced places on the requested path where glue is laid, by arc length [mm]."""
    s = analysis.commanded.s
    # a place counts if a tick of dispensing lies as near as ticks lie to each other within a stretch
    first = np.diff(analysis.ticks, prepend=analysis.ticks[0] - 2) > 1
    step = float(np.abs(np.diff(s))[~first[1:]].max(initial=0.0))
    even = np.linspace(s.min(), s.max(), count)
    ascending = np.sort(s)
    after = np.clip(np.searchsorted(ascending, even), 1, s.size - 1)
    distance = np.minimum(np.abs(even - ascending[after - 1]), np.abs(even - ascending[after]))
    return even[distance <= step]


def measure_repeat(case: Case, places: Sequence[float]) -> Row:
    """Run a repeat and return the nozzle's offset from the path at some places, as curves.

    Args:
        case: a `RepeatCase`.
        places: on the requested path by arc length [mm].
    """
    return judged_row(partial(_repeated_run, case), lambda run: {**_row(run, places), **verdict_row(case, run)})


def _repeated_run(case: Case) -> Run:
    assert isinstance(case, RepeatCase)
    job = case.job()
    machine = job.built_machine
    return simulate(
        machine if case.perturbation is None else machine.perturbed(case.perturbation),
        job.built_servo,
        phased_setpoints(job, case.phase),
        physics_step=job.simulation.physics_step,
        dispenser=job.dispenser,
        faults=job.faults,
        engine=job.engine_of_searches,
    )


def _row(run: Run, places: Sequence[float]) -> Row:
    s, offset = offset_over_length(run.requested, run.nozzle[run.dispense])
    offsets = interpolated(np.array(places), s, offset)
    row: Row = {"contour_max_um": UM * float(np.linalg.norm(offsets, axis=1).max()), "s_mm": list(places)}
    return row | {f"offset_{name}_um": np.round(UM * offsets[:, i], 6).tolist() for i, name in enumerate("xyz")}


_MOST_REPEATS = 10_000  # repeats
_WIDEST_SCATTER = 1.0  # standard deviation of the logarithm of a friction factor


@dataclass(frozen=True)
class RepeatStudy(Study):
    """Repeats of a job with realistic variation: their systematic error and their scatter.

    Varied from repeat to repeat, all together and each alone:

    - friction: Coulomb and viscous friction of each axis, by a log-normal factor (temperature, grease, load)
    - home offset: the zero of each axis, evenly within one count of its encoder (homing on a count)
    - phase: start of the program between two servo ticks, where the controller allows it

    Args:
        job: to repeat.
        repeats: number n of cycles; ISO 9283 has 10.
        friction: standard deviation of the logarithm of the friction factor.
        places: maximum number m of places along the path.
        seed: of the random numbers.
    """

    repeats: int = 10
    friction: float = 0.03
    places: int = 400
    seed: int = 1

    name = "repeat"
    plots = ("along", "plan")

    def __post_init__(self) -> None:
        check_job(self.job)
        if whole_number("repeats", self.repeats, 2) > _MOST_REPEATS:
            raise InputError(f"repeats = {self.repeats}: must be at most {_MOST_REPEATS}")
        whole_number("places", self.places, 2)
        whole_number("seed", self.seed, 0)
        # factors beyond e to the fourth are no friction
        at_least("friction", self.friction, 0, most=_WIDEST_SCATTER)

    @cached_property
    def s(self) -> Floats:
        """Places at which the repeats are compared, by arc length along the path, (m,) [mm]."""
        return places_along(Analysis(self.job.follow()), self.places)

    @property
    def measure(self) -> Measure:
        """From a case to its row."""
        return partial(measure_repeat, places=tuple(self.s.tolist()))

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Names of the varied sources."""
        sources = ["friction"] if self.friction else []
        sources += ["home offset"] if any(self.counts) else []
        sources += ["phase"] if has_phase(self.job) else []
        return tuple(sources)

    @property
    def counts(self) -> tuple[float, ...]:
        """Encoder counts of the axes, (axes,) [mm or deg]."""
        return self.job.built_servo.per_axis("resolution")

    def rounds(self) -> Rounds:
        """Yield the repeats with all sources varied, and with each source alone, by the same random numbers."""
        generator = np.random.default_rng(self.seed)
        axes = len(self.counts)
        friction = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        viscous = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        home = generator.uniform(-0.5, 0.5, (self.repeats, axes)) * self.counts
        phase = generator.integers(0, PHASES, self.repeats)
        cases = []
        # a single source is all that varies
        alone = self.sources if len(self.sources) > 1 else ()
        for varied in (ALL_VARIATIONS, *alone):
            for k in range(self.repeats):
                perturbation = Perturbation()
                if self.friction and varied in (ALL_VARIATIONS, "friction"):
                    perturbation = replace(perturbation, friction=tuple(friction[k]), viscous=tuple(viscous[k]))
                if varied in (ALL_VARIATIONS, "home offset"):
                    perturbation = replace(perturbation, home_offset=tuple(home[k]))
                case = RepeatCase.of(self.job, perturbation=perturbation, varied=varied, repeat=k + 1)
                if has_phase(self.job) and varied in (ALL_VARIATIONS, "phase"):
                    case = replace(case, phase=int(phase[k]))
                cases.append(case)
        yield cases

    @cached_property
    def positioning(self) -> dict[str, Positioning]:
        """The positioning of each linear axis over some cycles, on a machine with errors of its geometry, by name.

        Friction and home offset vary from cycle to cycle as they do from repeat to repeat.
        """
        if self.job.built_machine.geometry is None:
            return {}
        cases = [case for case in next(iter(self.rounds())) if ("varied", ALL_VARIATIONS) in case.tags]
        varied = [case.perturbation or Perturbation() for case in cases[:CYCLES]]
        return {name: positioning(self.job, name, varied) for name in linear_axes(self.job)}

    def paths(self, rows: Sequence[Row]) -> dict[str, RepeatedPath]:
        """Return the repeated paths by varied source, if at least two repeats have values."""
        command = self.job.controller.requested.position(self.s)
        paths = {}
        for varied in dict.fromkeys(str(row["varied"]) for row in rows):
            offsets = [_offset(row) for row in rows if row["varied"] == varied and row["status"] == OK]
            if len(offsets) > 1:
                paths[varied] = RepeatedPath(self.s, command, command + np.array(offsets))
        return paths


def _offset(row: Row) -> Floats:
    """Return the offset of the nozzle from the path at the places of a row, (m, 3) [mm]."""
    return np.stack([np.array(row[f"offset_{name}_um"], float) / UM for name in "xyz"], axis=1)
