"""The answer of a loop study: the longest period and the coarsest resolution that keep the job's limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gantrysim.report.document import Column, Table
from gantrysim.study.acceptance import Acceptance, Scope, improve_command, settings_text
from gantrysim.study.cases import Row
from gantrysim.study.loop.study import AS_IT_IS, SWEEPS, LoopStudy
from gantrysim.study.verdict_columns import LIMIT_USE


@dataclass(frozen=True)
class Lever:
    """A swept setting of the job.

    Attributes:
        key: of the job, dotted.
        noun: in the answer.
        largest: adjective of its largest value.
        text: returns a value with its unit.
    """

    key: str
    noun: str
    largest: str
    text: Callable[[float], str]


def milliseconds(seconds: float) -> str:
    """Return a time as text."""
    return f"{1e3 * seconds:.4g} ms"


def _micrometres(millimetres: float) -> str:
    return f"{1e3 * millimetres:.4g} µm"


LEVERS = {
    "loop_period": Lever("program.loop_period", "loop period", "longest", milliseconds),
    "interpreter_time": Lever("program.interpreter_time", "interpreter time", "longest", milliseconds),
    "servo_period": Lever("servo.period", "servo period", "longest", milliseconds),
    "encoder_resolution": Lever("servo.resolution", "encoder resolution", "coarsest", _micrometres),
}


@dataclass(frozen=True)
class SweepVerdicts:
    """The verdicts on the unchanged job over a swept value.

    Attributes:
        lever: the swept setting.
        verdicts: by its value, ascending; None for a case without a run that was judged.
        scope: the limits that count.
    """

    lever: Lever
    verdicts: dict[float, Acceptance | None]
    scope: Scope

    @property
    def kept(self) -> list[float]:
        """The values that keep the limits, ascending."""
        return [value for value, verdict in self.judged.items() if verdict.keeps(self.scope.aspects)]

    @property
    def judged(self) -> dict[float, Acceptance]:
        """The verdicts of the runs that were judged."""
        return {value: verdict for value, verdict in self.verdicts.items() if verdict is not None}

    @property
    def nearest(self) -> float:
        """The value with the smallest use of a limit; the largest of equal ones."""
        return min(reversed(self.judged), key=lambda value: self.judged[value].use(self.scope.aspects))

    @property
    def kept_text(self) -> str:
        """The values that keep the limits, as text."""
        if not self.kept:
            return "none"
        stretches: list[list[float]] = [[]]
        for value in self.verdicts:
            if value in self.kept:
                stretches[-1].append(value)
            elif stretches[-1]:
                stretches.append([])
        text = self.lever.text
        ranges = (f"{text(s[0])} to {text(s[-1])}" if len(s) > 1 else text(s[0]) for s in stretches if s)
        return ", ".join(ranges)


def question(study: LoopStudy) -> str:
    """Return the question, by whether the program has a loop."""
    if study.job.controller.loop_line() is not None:
        return f"Which {LEVERS['loop_period'].noun} does this job need?"
    return f"Which {LEVERS[main_sweep(study)].noun} does this job need?"


def main_sweep(study: LoopStudy) -> str:
    """Return the sweep that answers the question."""
    return "servo_period" if study.theory is None else "loop_period"


def sweep_verdicts(rows: Sequence[Row]) -> dict[str, SweepVerdicts]:
    """Return the verdicts on the unchanged job by sweep, for the sweeps with a run that was judged."""
    by_sweep: dict[str, dict[float, Acceptance | None]] = {}
    for row in rows:
        if row["variant"] == AS_IT_IS and row["sweep"] in LEVERS:
            by_sweep.setdefault(str(row["sweep"]), {})[float(row["value"])] = Acceptance.of(row)  # type: ignore[arg-type]
    scope = Scope.of(verdict for verdicts in by_sweep.values() for verdict in verdicts.values())
    return {
        sweep: SweepVerdicts(LEVERS[sweep], dict(sorted(by_sweep[sweep].items())), scope)
        for sweep in LEVERS
        if any(verdict is not None for verdict in by_sweep.get(sweep, {}).values())
    }


def loop_answer(study: LoopStudy, rows: Sequence[Row], knees: dict[str, str]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of all cases.
        knees: of the contour error, by sweep and variant in words.
    """
    sweeps = sweep_verdicts(rows)
    main = main_sweep(study)
    clauses = [_main(study, sweeps, main)] if main in sweeps else ["Too few cases were judged by the job's tolerance"]
    clauses += [
        f"{sweep.lever.key} alone keeps them at {sweep.kept_text}"
        for name, sweep in sweeps.items()
        if name != main and sweep.kept
    ]
    if knees:
        texts = [f"{name} {value}" for name, value in knees.items()]
        clauses.append(f"the contour error has knees at {', '.join(texts)}")
    return f"{_text_loop(study)}{'; '.join(clauses)}."


def _text_loop(study: LoopStudy) -> str:
    """Return that the loop in the program's text cannot be varied, and what can; empty without such a loop."""
    loop = study.job.controller.loop_line()
    if loop is None:
        return ""
    number, line = loop
    return (
        f"Not known: the program's own loop, line {number}, {line}, stands in its text, and no key of the job sets the "
        "time of its passes. Change the text and compare the runs: gantrysim compare. What can be varied is "
        f"{LEVERS['servo_period'].key} and {LEVERS['encoder_resolution'].key}. "
    )


def _main(study: LoopStudy, sweeps: dict[str, SweepVerdicts], main: str) -> str:
    sweep = sweeps[main]
    lever = sweep.lever
    scope = sweep.scope
    if sweep.kept:
        largest = sweep.kept[-1]
        present = _present(study, main)
        value = largest if present is None or present not in sweep.kept else present
        verdict = sweep.judged[value]
        verb = "Keep" if value == present else "Set"
        change = f"{verb} {settings_text({lever.key: value})}"
        usage = f"keeps {scope.words}, with {scope.usage(verdict)}"
        longest = f"{lever.text(largest)} is the {lever.largest} {lever.noun} tried that"
        if value == largest:
            return f"{change}: {longest} {usage}{scope.remark(verdict)}"
        return f"{change}, which {usage}; {longest} does{scope.remark(verdict)}"
    verdict = sweep.judged[sweep.nearest]
    first = next(iter(sweep.verdicts))
    last = next(reversed(sweep.verdicts))
    text = (
        f"No {lever.noun} tried, {lever.text(first)} to {lever.text(last)}, keeps {scope.words}: "
        f"{lever.text(sweep.nearest)} comes nearest, at {scope.excess(verdict)}"
    )
    if any(other.kept for other in sweeps.values()):
        return text
    best = min(sweeps.values(), key=lambda other: other.judged[other.nearest].use(scope.aspects))
    if best is not sweep:
        change = settings_text({best.lever.key: best.nearest})
        text += f", {change} nearer, at {scope.excess(best.judged[best.nearest])}"
    return f"{text}; {improve_command(study.job)} tries other levers"


def answer_table(study: LoopStudy, sweeps: dict[str, SweepVerdicts], knees: dict[str, str]) -> Table | None:
    """Return the table of what each swept setting needs; None without a run that was judged."""
    if not sweeps:
        return None
    cells: list[list[Any]] = []
    for name, sweep in sweeps.items():
        verdict = sweep.judged[sweep.nearest]
        use = verdict.use(sweep.scope.aspects)
        knee = ", ".join(
            f"{value} ({variant})" for (title, variant), value in _split(knees) if title == sweep.lever.noun
        )
        present = _present(study, name)
        job_value = "–" if present is None else sweep.lever.text(present)
        nearest = sweep.lever.text(sweep.nearest)
        cells.append([SWEEPS[name], sweep.lever.key, job_value, sweep.kept_text, nearest, use, knee or "–"])
    scope = next(iter(sweeps.values())).scope
    caption = (
        f"Values tried that keep {scope.words}, the one with the least use of its closest limit, and the knee of the "
        "contour error: the largest value up to which the setting has no effect."
    )
    columns: list[str | Column] = [
        "setting",
        "key",
        "job",
        "keeps the limits",
        "least use at",
        Column(f"closest limit [{LIMIT_USE.unit}]", LIMIT_USE.form),
        "knee",
    ]
    return Table(columns, cells, caption)


def _split(knees: dict[str, str]) -> list[tuple[tuple[str, str], str]]:
    """Return the knees with their sweep and variant apart."""
    parts = []
    for name, value in knees.items():
        sweep, _, variant = name.partition(" (")
        parts.append(((sweep, variant.rstrip(")")), value))
    return parts


def _present(study: LoopStudy, sweep: str) -> float | None:
    """Return the job's value of a swept setting; None where it has none of its own."""
    if sweep == "servo_period":
        return float(study.job.built_servo.period)
    if sweep == "encoder_resolution":
        axes = zip(study.job.built_machine.axes, study.job.built_servo.per_axis("resolution"), strict=True)
        return next((resolution for axis, resolution in axes if axis.unit == "mm"), None)
    value = study.job.program.get(sweep)
    return float(value) if isinstance(value, float | int) else None
