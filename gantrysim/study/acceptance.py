"""Whether the cases of a study keep the limits of their job, as the verdict judges them, in an answer's words."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from gantrysim.job.job import Job
from gantrysim.job.loading import builtin_jobs
from gantrysim.results.checks import FAIL, UNJUDGED, WARN
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY
from gantrysim.study.cases import OK, Row
from gantrysim.study.verdict_columns import ASPECTS, check_column, state_column, use_column

MOTION_LIMITS = (PATH, STABILITY, MACHINE)  # what the motion alone decides
_JOB_FILE = "job.toml"  # in the folder of a study
_PER_CENT = 100.0


@dataclass(frozen=True)
class Acceptance:
    """The verdict on a case, from its row.

    Attributes:
        states: "pass", "warn", "fail" or "not judged" by aspect: path, glue, stability and machine.
        uses: largest use of a limit by aspect [%]; None where nothing is judged or a limit of zero is exceeded.
        checks: worst check by aspect, in words.
    """

    states: dict[str, str]
    uses: dict[str, float | None]
    checks: dict[str, str]

    @classmethod
    def of(cls, row: Row) -> Acceptance | None:
        """Return the verdict on a case; None for one without a run that was judged."""
        if row["status"] != OK or state_column(PATH) not in row:
            return None
        uses = {aspect: row[use_column(aspect)] for aspect in ASPECTS}
        return cls(
            {aspect: str(row[state_column(aspect)]) for aspect in ASPECTS},
            {aspect: use if isinstance(use, float) else None for aspect, use in uses.items()},
            {aspect: str(row[check_column(aspect)]) for aspect in ASPECTS},
        )

    def failed(self, aspects: Iterable[str] = ASPECTS) -> list[str]:
        """Return the aspects that fail."""
        return [aspect for aspect in aspects if self.states[aspect] == FAIL]

    def keeps(self, aspects: Iterable[str] = ASPECTS) -> bool:
        """Return whether none of the aspects fails."""
        return not self.failed(aspects)

    def use(self, aspects: Iterable[str] = ASPECTS) -> float:
        """Return the largest use of a limit of some aspects [%]; inf where one fails without a number."""
        uses = [0.0]
        for aspect in aspects:
            use = self.uses[aspect]
            if use is not None:
                uses.append(use)
            elif self.states[aspect] == FAIL:
                uses.append(math.inf)
        return max(uses)

    def worst(self, aspects: Iterable[str] = ASPECTS) -> str:
        """Return the worst check of some aspects, as in "path: contour error, max 809 µm, at most 82 µm"."""
        aspect = max(aspects, key=lambda name: self.use([name]))
        return f"{aspect}: {self.checks[aspect]}"

    def warnings(self, aspects: Iterable[str] = ASPECTS) -> str:
        """Return the aspects with a warning, each with its worst check."""
        return "; ".join(f"{aspect}: {self.checks[aspect]}" for aspect in aspects if self.states[aspect] == WARN)

    def failures(self, aspects: Iterable[str] = ASPECTS) -> str:
        """Return the aspects that fail, each with its worst check."""
        return "; ".join(f"{aspect}: {self.checks[aspect]}" for aspect in self.failed(aspects))


@dataclass(frozen=True)
class Scope:
    """The limits by which the cases of a study are compared.

    Attributes:
        aspects: of the verdict.
    """

    aspects: tuple[str, ...]

    @classmethod
    def of(cls, acceptances: Iterable[Acceptance | None]) -> Scope:
        """Return the whole tolerance if a case keeps it, else the limits of the motion.

        Glue that fails in all cases would hide which of them is the better motion.
        """
        is_whole = any(acceptance is not None and acceptance.keeps() for acceptance in acceptances)
        return cls(ASPECTS if is_whole else MOTION_LIMITS)

    @property
    def words(self) -> str:
        """The limits in words."""
        return "the job's tolerance" if self.aspects == ASPECTS else "the limits of path, stability and machine"

    def usage(self, acceptance: Acceptance) -> str:
        """Return how much of the closest limit a case uses, in words, with the check."""
        use = acceptance.use(self.aspects)
        return f"{use:.3g} % of the closest limit used ({acceptance.worst(self.aspects)})"

    def excess(self, acceptance: Acceptance) -> str:
        """Return how far a case is from its limits, as in "17 times the limit (path: ...)"."""
        use = acceptance.use(self.aspects)
        times = f"{use / _PER_CENT:.3g} times the limit" if math.isfinite(use) else "more than a limit of zero"
        return f"{times} ({acceptance.worst(self.aspects)})"

    def remark(self, acceptance: Acceptance) -> str:
        """Return what else a verdict says of a case within these limits: glue that fails, aspects that are not judged.

        Empty, or a clause that begins with a semicolon.
        """
        clauses = [f"; {aspect} is not judged" for aspect in self.aspects if acceptance.states[aspect] == UNJUDGED]
        if GLUE not in self.aspects and acceptance.states[GLUE] == FAIL:
            clauses.append(f"; the glue fails all the same ({acceptance.checks[GLUE]})")
        return "".join(clauses)


def improve_command(job: Job) -> str:
    """Return the command that simulates the levers of a job: by its name, or by the file in the study's folder."""
    is_built_in = job.name in builtin_jobs() and Job.load(job.name).toml() == job.toml()
    return f"gantrysim improve {job.name if is_built_in else _JOB_FILE}"


def settings_text(changes: Mapping[str, Any]) -> str:
    """Return values of a job by their dotted keys as text, as in "servo.law = ["pid"]"; None is no value."""
    return ", ".join(
        f"no {key}" if value is None else f"{key} = {json.dumps(_short(value))}" for key, value in changes.items()
    )


def _short(value: Any) -> Any:
    """Return a value with few digits."""
    if isinstance(value, list):
        return [_short(item) for item in value]
    if not isinstance(value, float):
        return value
    return int(value) if value.is_integer() else float(f"{value:.4g}")
