"""Speed by place: every stretch of the program as fast as the tolerances of path and glue allow there.

The job runs at the program's speeds, and once more with all of them changed alike: that gives each stretch its errors
as powers of its speed. Then each stretch runs as fast as uses 78 % of its limits, the steps between stretches included,
and every further run corrects what the runs before expected of it, see `gantrysim.remedy.speed_model`. Where that fails
at first, another run starts and stops its beads slowly: the errors of a spiral whose loop does not wait for the ramp of
its start, for one, lie further on. The limit of 95 % of the contour error is one of the whole path: the level that each
stretch may use follows from what the path has used.

Every run is that of the program as it would be written: with speeds of few digits, and few changes of the speed. Where
the program sets the flow by an output, each line states the set point that keeps the section at its speed; where that
is no better, or there is no such output, the flow follows the speed by itself.

It is written to two files: a job, and the program for the controller.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError, InputError
from gantrysim.base.files import replaced_file
from gantrysim.base.quantity import counted
from gantrysim.controllers.speeds import Stretches
from gantrysim.engine.recording import dispensed_otherwise
from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.lever import State
from gantrysim.remedy.levers.dispenser import PROPORTIONAL_FLOW
from gantrysim.remedy.outcome import Motion, Outcome, least_burden
from gantrysim.remedy.speed_model import TARGET, LocalUsage, SpeedModel, few_speeds, local_usage
from gantrysim.results.verdict import PATH

RUNS = 8
BY_PLACE = "by-place"  # end of the names of the written files
_WORTH_OF_SLOW_ENDS = 0.7  # share of the burden that is left at most where slow starts and stops help
_SECOND_FACTORS = (0.5, 0.85, 1.2, 1.4)  # bounds of the second run's factor, below and above 1
_SLOWEST_SHARE = 0.05  # of the programmed speed
_FASTEST_SHARE = 4.0  # of the programmed speed
_COMPENSATIONS = 7  # times of the lag compensation that are tried; they need no run of their own
_NEAR_SHORTEST = 1.03  # times the shortest time, among which the fewest changes of the speed count
_ENOUGH_TIME = 0.005  # share of the time by which another run would have to be shorter
_READ_BACK = 1e-6  # relative
_AS_GOOD = 1e-6  # of a burden
_FLOW_DIGITS = 4  # of a set point


@dataclass(frozen=True)
class PlaceSpeed:
    """The speed of a stretch.

    Attributes:
        place: line of the program's text, or number of the stretch.
        before: programmed path speed [mm/s].
        after: path speed of the rewritten program [mm/s].
        flow: set point of the flow there, of the program's output; None where the flow follows otherwise.
    """

    place: int
    before: float
    after: float
    flow: float | None = None


@dataclass(frozen=True)
class SpeedByPlace:
    """A program whose stretches have speeds of their own.

    Attributes:
        job: with the rewritten program.
        outcome: of its run in MuJoCo.
        note: how far that is from the run of the search; empty where they agree.
        speeds: of the stretches, in the program's order.
        other: time of the run with the levers that act everywhere [s].
        runs: that were simulated.
        glue: values of the dispenser that differ from those of the best combination, by their keys in a job file.
    """

    job: Job
    outcome: Outcome
    note: str
    speeds: tuple[PlaceSpeed, ...]
    other: float
    runs: int
    glue: Mapping[str, Any] = field(default_factory=dict)

    @property
    def heads(self) -> tuple[str, ...]:
        """Heads of the table of speeds."""
        return ("from", "to", "speed [mm/s]", *([self.job.controller.flow_output] if self._has_flows else []))

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """The table of speeds, a row for each stretch of one speed, with its lines or numbers."""
        flows = {speed.place: f"{speed.flow:g}" for speed in self.speeds if speed.flow is not None}
        return [
            (str(first), str(last), f"{speed:.4g}", *([flows.get(first, "")] if self._has_flows else []))
            for first, last, speed in self.rows
        ]

    @property
    def _has_flows(self) -> bool:
        """Whether stretches have set points of the flow of their own."""
        return any(speed.flow is not None for speed in self.speeds)

    @property
    def changes(self) -> int:
        """Number of places at which the speed changes along the program, with the start."""
        return len(self.rows)

    @property
    def rows(self) -> list[tuple[int, int, float]]:
        """First place, last place and path speed of the stretches of one speed [mm/s]."""
        rows: list[tuple[int, int, float]] = []
        for speed in self.speeds:
            if rows and rows[-1][2] == speed.after:
                rows[-1] = (rows[-1][0], speed.place, speed.after)
            else:
                rows.append((speed.place, speed.place, speed.after))
        return rows

    def __str__(self) -> str:
        slowest = min(speed.after for speed in self.speeds)
        fastest = max(speed.after for speed in self.speeds)
        glue = "".join(f", {key} = {value:g}" for key, value in self.glue.items())
        if self._has_flows:
            glue = f", {self.job.controller.flow_output} by line{glue}"
        times = f"{self.outcome.duration:.2f} s instead of {self.other:.2f} s"
        if all(speed.after == speed.before for speed in self.speeds):
            return f"{self.outcome.state} with the program's own speeds: {times}{glue}"
        spread = f"from {slowest:.4g} to {fastest:.4g} mm/s"
        if self.changes == 1:
            spread = f"of {fastest:.4g} mm/s"
        return (
            f"{self.outcome.state} with a speed by place: {times}, with {counted(self.changes, 'speed')} {spread}{glue}"
        )


def speed_by_place(base: Job, other: Outcome, bench: Bench) -> SpeedByPlace | str:
    """Return the program with the speeds that path and glue allow place by place, or why there is none.

    Args:
        base: the job at the program's speed, with all other changes.
        other: what the job shows that is changed everywhere alike.
        bench: simulates.
    """
    try:
        stretches = base.controller.stretches(base.servo.period)
    except InputError as error:
        return str(error)
    by_line = _line_flow(base, stretches, bench)
    if by_line is not None:
        result = _best_of(_Search(base, stretches, _compensations(base, {}), bench, by_line), other, bench)
        if isinstance(result, SpeedByPlace):
            return result
    try:
        glue = _glue_changes(base, bench)
    except InputError as error:
        return str(error)
    return _best_of(_Search(base, stretches, glue, bench), other, bench)


def _best_of(search: _Search, other: Outcome, bench: Bench) -> SpeedByPlace | str:
    """Return the best of a search, or why there is none; arguments as of `speed_by_place`."""
    base = search.job
    search.run()
    better = [trial for trial in search.trials if not trial.outcome.failure and _is_better(trial.outcome, other)]
    for trial in _in_order(better):
        if not _is_read_back(trial, base.servo.period):
            return "the program, written with other speeds and read again, does not state them"
        outcome, note = bench.confirm(trial.job)
        if not outcome.failure and _is_better(outcome, other):
            speeds = tuple(
                PlaceSpeed(place, search.programmed_speeds[place], speed, trial.flows.get(place))
                for place, speed in sorted(trial.speeds.items())
            )
            changed = _changed_glue(base, trial.job)
            return SpeedByPlace(trial.job, outcome, note, speeds, other.duration, len(search.trials), changed)
    return f"no speeds by place are as good in less time, in {len(search.trials)} runs"


def _changed_glue(base: Job, job: Job) -> dict[str, Any]:
    """Return the values of the dispenser that changed, by their keys in a job file."""
    names = ("flow", "pressure", "area", "advance")
    values = {name: getattr(job.dispenser, name) for name in names}
    return {f"dispenser.{name}": value for name, value in values.items() if value != getattr(base.dispenser, name)}


def _in_order(trials: Sequence[_Trial]) -> list[_Trial]:
    """Return runs by time, but first those that take little longer with fewer changes of the speed."""
    by_time = sorted(trials, key=lambda trial: trial.outcome.duration)
    near = [trial for trial in by_time if trial.outcome.duration <= _NEAR_SHORTEST * by_time[0].outcome.duration]
    near.sort(key=lambda trial: sum(a != b for a, b in pairwise(trial.speeds.values())))
    return near + by_time[len(near) :]


def _is_better(outcome: Outcome, other: Outcome) -> bool:
    if outcome.burden > other.burden:
        return False
    return outcome.burden < other.burden or outcome.duration < (1 - _ENOUGH_TIME) * other.duration


def _glue_changes(job: Job, bench: Bench) -> list[Mapping[str, Any]]:
    """Return changes of the glue with which the flow follows the speed; a fixed one would lay another section by place.

    A flow that lags is late with every change of the speed, so that its compensation is tried too.

    Raises:
        InputError: there is no such flow.
    """
    if not bench.measure(job).nominal:
        return [{}]
    flow: Mapping[str, Any] = {}
    if not (job.dispenser.area or job.dispenser.per_e):
        settings = PROPORTIONAL_FLOW.settings(State(job, bench.measure))
        if isinstance(settings, str):
            raise InputError(settings)
        flow = settings[0].changes
    return _compensations(job, flow)


def _compensations(job: Job, flow: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return changes of the flow without and with a compensation of its lag."""
    dispenser = job.dispenser
    shortest = min(dispenser.opening, dispenser.closing)
    longest = max(dispenser.opening, dispenser.closing) + dispenser.dead_time
    times = {float(f"{time:.3g}") for time in np.linspace(shortest, longest, _COMPENSATIONS).tolist() if time > 0}
    return [flow, *({**flow, "dispenser.advance": time} for time in sorted(times))]


def _is_read_back(trial: _Trial, period: float) -> bool:
    """Return whether the rewritten program states the speeds that it was given."""
    again = trial.job.controller.stretches(period)
    stated = dict(zip(again.places.tolist(), again.speeds.tolist(), strict=True))
    return all(
        math.isclose(stated.get(place, 0.0), speed, rel_tol=_READ_BACK) for place, speed in trial.speeds.items()
    ) and _flows_are_read_back(trial, period)


def _flows_are_read_back(trial: _Trial, period: float) -> bool:
    """Return whether the rewritten program sets the flow of each stretch that lays glue as it was given."""
    if not trial.flows:
        return True
    setpoints = trial.job.controller.setpoints(period)
    assert setpoints.analogue is not None
    line = trial.job.controller.lines_at(setpoints.time)
    change = np.diff(line) != 0
    # where the line changes, either holds
    is_inside = setpoints.dispense & ~np.append(change, False) & ~np.append(False, change)
    wanted = np.array([trial.flows.get(number, math.nan) for number in line[is_inside].tolist()])
    return bool(np.isclose(setpoints.analogue[is_inside], wanted, rtol=_READ_BACK).all())


def _line_flow(job: Job, stretches: Stretches, bench: Bench) -> float | None:
    """Return the set point of the flow for each mm/s of the path speed, where lines can state it; else None."""
    dispenser = job.dispenser
    nominal = bench.measure(job).nominal
    if not dispenser.per_output or not nominal:
        return None
    try:
        job.controller.with_stretch_flows(dict.fromkeys(stretches.places.tolist(), 1.0))
    except InputError:
        return None
    return nominal / dispenser.per_output


@dataclass(frozen=True)
class _Trial:
    """A run of the program with speeds by place."""

    job: Job
    speeds: Mapping[int, float]
    outcome: Outcome
    usage: LocalUsage | None
    flows: Mapping[int, float] = field(default_factory=dict)


class _Search:
    """The runs of a search.

    Args:
        job: at the program's speed.
        stretches: of its program.
        glue: changes of the job's glue, of which each run takes the best.
        bench: simulates.
        by_line: set point of the flow for each mm/s of the path speed, stated by line; None where the flow follows the
            speed by itself.

    Attributes:
        trials: runs so far.
        job: at the program's speed.
    """

    def __init__(
        self,
        job: Job,
        stretches: Stretches,
        glue: Sequence[Mapping[str, Any]],
        bench: Bench,
        by_line: float | None = None,
    ) -> None:
        self.trials: list[_Trial] = []
        self.job = job
        self._glue = glue
        self._by_line = by_line
        self._stretches = stretches
        self._bench = bench
        self._model = SpeedModel(stretches)

    @property
    def programmed_speeds(self) -> dict[int, float]:
        """Programmed path speeds by place [mm/s]."""
        rows = zip(self._stretches.places.tolist(), self._stretches.speeds.tolist(), strict=True)
        return {place: speed for place, speed in rows if speed > 0}

    def run(self) -> None:
        """Simulate until the speeds stay or cannot win any more, at most `RUNS` times."""
        first = self._trial(self.programmed_speeds)
        if first.usage is None:
            return
        self._model.add_even_run(first.usage, 1.0)
        factor = self._second_factor(first)
        second = self._trial({place: factor * speed for place, speed in self.programmed_speeds.items()})
        if second.usage is not None:
            self._model.add_even_run(second.usage, factor)
        is_first = True
        while len(self.trials) < RUNS:
            speeds = self._next_speeds()
            if any(trial.speeds == speeds for trial in self.trials) or self._is_too_slow(speeds):
                return
            trial = self._trial(speeds)
            fails = first.outcome.burden > 0 and not trial.outcome.passes
            least = min(first.outcome.burden, second.outcome.burden, trial.outcome.burden)
            is_slow_better = is_first and fails and self._slow_ends_are_better(least)
            if trial.usage is not None and not is_slow_better:
                self._model.add_run(trial.usage, self._by_stretch(speeds), _p95_usage(trial.outcome))
            is_first = False

    def _is_too_slow(self, speeds: Mapping[int, float]) -> bool:
        """Return whether a run has passed in less time than the program takes at speeds by place."""
        passing = [trial.outcome.duration for trial in self.trials if trial.outcome.passes]
        try:
            shortest = self._bench.family.member(self._job_at(speeds)).setpoints.duration
        except GantryError:  # its trial tells why
            return False
        return bool(passing) and shortest > _NEAR_SHORTEST * min(passing)

    def _slow_ends_are_better(self, burden: float) -> bool:
        """Run slowly where glue starts and stops, as the errors of a path may come from there; keep that if it helps.

        Args:
            burden: least of the runs so far, with faster starts and stops.
        """
        trial = self._trial(self._written_speeds(self._model.slow_ends()))
        if trial.usage is None or trial.outcome.burden >= _WORTH_OF_SLOW_ENDS * burden:
            return False
        self._model.add_slow_ends(trial.usage, self._by_stretch(trial.speeds))
        return True

    def _second_factor(self, first: _Trial) -> float:
        """Return the factor of the second run, all of whose speeds are changed alike."""
        assert first.usage is not None
        worst = float(first.usage.shares.max())
        factor = math.sqrt(TARGET / worst) if worst > 0 else 1.0
        if factor >= 1:
            return min(max(factor, _SECOND_FACTORS[2]), _SECOND_FACTORS[3])
        return min(max(factor, _SECOND_FACTORS[0]), _SECOND_FACTORS[1])

    def _next_speeds(self) -> dict[int, float]:
        """Return the speeds that the model allows; after a run that fails, half way to them from the best pass."""
        allowed = self._model.speeds(_SLOWEST_SHARE, _FASTEST_SHARE)
        passing = [trial for trial in self.trials if trial.outcome.passes]
        if passing and not self.trials[-1].outcome.passes:
            best = min(passing, key=lambda trial: trial.outcome.duration)
            allowed = np.sqrt(allowed * self._by_stretch(best.speeds))
        return self._written_speeds(allowed)

    def _written_speeds(self, speeds: Floats) -> dict[int, float]:
        """Return the speeds of the stretches, (m,) [mm/s], as they are written, by place."""
        wanted: dict[int, float] = {}
        places = self._stretches.places[self._model.judged].tolist()
        # a line that runs several times is as fast as its slowest pass
        for place, speed in zip(places, speeds[self._model.judged].tolist(), strict=True):
            wanted[place] = min(speed, wanted.get(place, math.inf))
        few = few_speeds(wanted, self._stretches)
        return {place: few.get(place, speed) for place, speed in self.programmed_speeds.items()}

    def _by_stretch(self, speeds: Mapping[int, float]) -> Floats:
        return np.array([speeds.get(place, 0.0) for place in self._stretches.places.tolist()])

    def _job_at(self, speeds: Mapping[int, float]) -> Job:
        """Return the job at speeds by place."""
        return _with_program(self.job, self.job.controller.with_stretch_speeds(speeds)) if self.trials else self.job

    def _trial(self, speeds: Mapping[int, float]) -> _Trial:
        job = self._job_at(speeds)
        flows: dict[int, float] = {}
        if self._by_line is not None:
            flows = {place: float(f"{self._by_line * speed:.{_FLOW_DIGITS}g}") for place, speed in speeds.items()}
            job = _with_program(job, job.controller.with_stretch_flows(flows))
        usage = None
        try:
            # another glue does not change the motion
            motion = self._bench.motion(job)
            job, outcome = self._with_best_glue(job)
            if not outcome.failure:
                usage = self._usage(job, motion, outcome)
        except GantryError as error:
            outcome = Outcome(None, failure=str(error))
        trial = _Trial(job, speeds, outcome, usage, flows)
        self.trials.append(trial)
        return trial

    def _with_best_glue(self, job: Job) -> tuple[Job, Outcome]:
        jobs = [job.changed(changes) for changes in self._glue]
        # one that is as good is no better
        outcomes = self._bench.promising(jobs, lambda known: least_burden(known) - _AS_GOOD)
        known = {k: outcome for k, outcome in enumerate(outcomes) if outcome is not None}
        k = min(known, key=lambda k: known[k].burden)
        return jobs[k], known[k]

    def _usage(self, job: Job, motion: Motion, outcome: Outcome) -> LocalUsage:
        assert motion.budget is not None
        assert outcome.verdict is not None
        assert outcome.verdict.tolerance is not None
        analysis = motion.budget.analysis
        # of another glue than that which ran
        run = dispensed_otherwise(motion.run, job.dispenser)
        return local_usage(analysis, Bead(run, job.bead, analysis), outcome.verdict.tolerance, self._stretches)


def _with_program(job: Job, arguments: Mapping[str, Any]) -> Job:
    """Return a job with other arguments of its program."""
    return job.changed({f"program.{name}": value for name, value in arguments.items()})


def _p95_usage(outcome: Outcome) -> float:
    assert outcome.verdict is not None
    return next((check.usage for check in outcome.verdict[PATH].checks if check.name == "path_p95"), math.nan)


def write_by_place(by_place: SpeedByPlace, stem: Path, base: Job) -> list[Path]:
    """Write STEM.toml, for `gantrysim run`, and the program in the controller's language where it has one.

    Args:
        by_place: the program.
        stem: path of the files without their suffixes.
        base: the job as it was loaded, whose files stay.

    Returns:
        The paths, that of the job first.

    Raises:
        InputError: one of them is the file from which the job was loaded.
    """
    job = by_place.job
    contents = {stem.with_name(f"{stem.name}.toml"): job.toml()}
    text = job.controller.program_text
    if text:
        contents[stem.with_name(f"{stem.name}{_suffix(base)}")] = text
    for path in contents:
        if path.exists() and any(file.exists() and path.samefile(file) for file in _files_of(base)):
            raise InputError(f"{path}: is a file of the job; give another name")
    for path, content in contents.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced_file(path) as partial:
            partial.write_text(content, encoding="utf-8")
    return list(contents)


def _files_of(job: Job) -> list[Path]:
    """Return the files from which a job was loaded: its own, and that of its program."""
    if job.given is None:
        return []
    file = Path(job.given.label.removeprefix("job "))
    source = job.given.file.get("source")
    return [file] if source is None else [file, file.parent / str(source)]


def _suffix(base: Job) -> str:
    """Return the suffix of the program's own file, else one that its controller reads."""
    suffix = Path(base.given.program_file).suffix if base.given is not None and base.given.program_file else ""
    return suffix or base.controller.program_suffix
