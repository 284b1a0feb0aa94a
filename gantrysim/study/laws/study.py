"""The laws study: the servo's laws on one job, each against PD."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least, positive
from gantrysim.base.quantity import UM, Quantity
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import torque_ripple
from gantrysim.record.run import Run
from gantrysim.servo.laws import LEARNING, PD
from gantrysim.study.cases import OK, Case, Row, judged_row, simulated, values_row, verdict_row
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds, Study


class Rung(NamedTuple):
    """A law of the ladder, with the job's integral time or a share of it."""

    law: tuple[str, ...]
    integral: float = 1.0

    @property
    def name(self) -> str:
        """The law's names, and the share where there is one."""
        return "+".join(self.law) + ("" if self.integral == 1 else f" (Ti/{1 / self.integral:g})")


LADDER = (
    Rung(("pd",)),
    Rung(("pid",)),
    Rung(("pid",), 1 / 3),
    Rung(("p-pi",)),
    Rung(("pid", "contour")),
    Rung(("pid", "observer")),
    Rung(("pid", "friction")),
    Rung(("pid", "friction", "observer")),
    Rung(("pid", "friction", "preview")),
    Rung(("pid", "learning")),
    Rung(("pid", "friction", "preview", "learning")),
    Rung(("pid", "friction", "zvd")),
)
# values of a row besides those of every case
FOLLOWING_TOGETHER = Quantity[Any](
    "following_rms",
    label="following error, rms",
    unit="µm",
    form=".3g",
    meaning="Commanded less encoder position of the linear axes together, or of all where none is linear: root mean "
    "square",
    path=(),
    factor=1e3,
)
REVERSAL = Quantity[Any](
    "reversal_max",
    label="largest after a reversal",
    unit="µm",
    form=".3g",
    meaning="Largest following error of an axis within 0.1 s after it reverses",
    path=(),
    factor=1e3,
)
REPEATS = (1, 2, 3, 5, 10)  # of learning
NOMINAL = "nominal"
EXACT_ENCODER = "exact encoder"
LOADED = "payload"
MORE_FRICTION = "friction"
REPEATED_RUNS = "repeats"
AFTER_REVERSAL = 0.1  # time after a reversal in which its peak is sought [s]


def laws_row(case: Case) -> Row:
    """Return the row of a case: status, margins of the nominal machine, and values of its run.

    Besides the values of `values_row`: following_rms_um of the linear axes together, and without them of all;
    reversal_max_um, their largest error within 0.1 s after a reversal; torque_ripple_Nm of the axis with the largest;
    and the smallest gain_margin and phase_margin_deg and largest sensitivity of all axes, None where unknown.
    """

    def values(run: Run) -> Row:
        job = case.job()
        # rotary axes count only where there are no others: degrees and millimetres have no common sum
        error = UM * (run.commanded - run.encoder)[:, _linear(run)]
        turned = reversals(run.commanded[:, _linear(run)])
        window = round(AFTER_REVERSAL / run.period)
        peaks = [float(np.abs(error[k : k + window, a]).max()) for k, a in turned]
        row: Row = {
            FOLLOWING_TOGETHER.key: float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
            "reversals": len(peaks),
            REVERSAL.key: max(peaks) if peaks else None,
            "torque_ripple_Nm": float(torque_ripple(run).max()),
            "gain_margin": None,
            "phase_margin_deg": None,
            "sensitivity": None,
        }
        if job.margins is not None:
            row["gain_margin"] = _number(min(margins.least_gain for margins in job.margins))
            row["phase_margin_deg"] = min(margins.phase for margins in job.margins)
            row["sensitivity"] = _number(max(margins.sensitivity for margins in job.margins))
        return {**row, **values_row(run, job.bead), **verdict_row(case, run)}

    return judged_row(lambda: simulated(case), values)


def _linear(run: Run) -> list[int]:
    return [a for a, unit in enumerate(run.units) if unit == "mm"] or list(range(len(run.axes)))


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def reversals(commanded: Floats) -> list[tuple[int, int]]:
    """Return tick and axis of every reversal: the first tick at which an axis moves against its last motion.

    Args:
        commanded: positions, (n, axes) [mm or deg].
    """
    turns = []
    for a in range(commanded.shape[1]):
        moved = np.sign(np.diff(commanded[:, a]))
        moving: NDArray[np.intp] = np.flatnonzero(moved)
        turned = moving[1:][moved[moving[1:]] != moved[moving[:-1]]]
        turns += [(int(k) + 1, a) for k in turned]
    return turns


@dataclass(frozen=True)
class LawsStudy(Study):
    """The servo's laws on one job: nominal, with an exact encoder, with a payload, with more friction, over repeats.

    Every law keeps the derivation's margins. Payload and friction are those of the machine; gains and models of the
    laws remain those of the nominal one. Learning learns on the machine that it runs on.

    Args:
        job: whose servo gets the laws.
        payload: added to the machine [kg].
        friction: factor on its friction.
        measure: from a case to its row.
    """

    payload: float = 0.5
    friction: float = 1.5
    measure: Measure = laws_row

    name = "laws"
    plots = ("limits", "ladder", "robustness", "repeats")

    def __post_init__(self) -> None:
        at_least("payload", self.payload, 0, "kg")
        positive("friction", self.friction)

    def overrides(self, law: tuple[str, ...], integral: float = 1.0) -> dict[str, Any]:
        """Return the values that give the job a law, by their dotted keys; for PD without the gains that it lacks.

        Args:
            law: the law.
            integral: share of the job's integral time.
        """
        servo = self.job.servo
        changes: dict[str, Any] = {}
        if PD.name in law:
            changes = {f"servo.{name}": None for name in PD.unused_gains if getattr(servo, name) is not None}
        elif integral != 1 and servo.ki is not None:
            changes["servo.ki"] = (np.asarray(servo.ki) / integral).tolist()
        elif integral != 1:
            changes["servo.integral_time"] = servo.integral_time * integral
        return {"servo.law": list(law), **changes}

    @property
    def ladder(self) -> tuple[Rung, ...]:
        """The rungs that the job can have; a stronger integral term needs one to begin with."""
        integral = any(self.job.built_servo.per_axis("ki"))
        return tuple(rung for rung in LADDER if integral or rung.integral == 1)

    @property
    def expected(self) -> int:
        return 4 * len(self.ladder) + len(REPEATS)

    def rounds(self) -> Rounds:
        """Yield every law in every variation, and learning over a growing number of repeats.

        Raises:
            InputError: a job that is refused, or never dispenses.
        """
        # refused before anything is written
        values_row(simulated(Case.of(self.job, mode="perfect follower")))
        loaded = Perturbation(payload=self.payload)
        rubbing = Perturbation(friction=self.friction)
        cases = []
        for rung in self.ladder:
            overrides = self.overrides(*rung)
            name = rung.name
            cases += [
                Case.of(self.job, overrides, law=name, variation=NOMINAL),
                Case.of(self.job, {**overrides, "servo.resolution": 0.0}, law=name, variation=EXACT_ENCODER),
                Case.of(self.job, overrides, perturbation=loaded, law=name, variation=LOADED),
                Case.of(self.job, overrides, perturbation=rubbing, law=name, variation=MORE_FRICTION),
            ]
        for repeats in REPEATS:
            law = ("pid", LEARNING.name)
            overrides = {**self.overrides(law), "servo.resolution": 0.0, "servo.learning_repeats": repeats}
            cases.append(Case.of(self.job, overrides, law="+".join(law), variation=REPEATED_RUNS, repeats=repeats))
        yield cases


def chosen(rows: Sequence[Row], variation: str) -> dict[str, Row]:
    """Return the rows of a variation that have values, by law."""
    return {str(row["law"]): row for row in rows if row["variation"] == variation and row["status"] == OK}
