"""`gantrysim study machine`: how many of all the machines that are built to one drawing keep to a tolerance."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.controllers.path import Floats
from gantrysim.errors import InputError, at_least, unknown, whole
from gantrysim.job import Job
from gantrysim.perturbation import FACTORS, Perturbation
from gantrysim.study.cases import OK, Case, Row, measure
from gantrysim.study.criterion import Criterion
from gantrysim.study.machine_figures import draw_influence, draw_scatter, draw_yield
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds
from gantrysim.study.yields import influences, yield_of

if TYPE_CHECKING:
    from gantrysim.page import Table

__all__ = ["MachineStudy", "Spread"]

_NAMED = 2  # factors that the findings speak of after the first
_WORST = 5


@dataclass(frozen=True)
class Spread:
    """How far machines differ; what is 0 does not.

    A payload lies evenly between 0 and its spread. A factor lies between 1 / (1 + spread) and 1 + spread, evenly on a
    logarithmic scale, so that half of the machines have more than the nominal one and half have less; each axis has
    its own. The default values are assumptions: friction and its viscous part vary most from machine to machine,
    with preload, seals and grease; motor constants are of a catalogue's tolerance.

    Attributes:
        payload: [kg].
        friction: of the Coulomb and static friction, relative.
        viscous: of the viscous friction, relative.
        stiffness: of the drive trains' springs, relative.
        motor_constant: of the motors, relative.
    """

    payload: float = 0.3
    friction: float = 0.5
    viscous: float = 0.5
    stiffness: float = 0.3
    motor_constant: float = 0.1

    def __post_init__(self) -> None:
        for f in fields(self):
            at_least(f"spread of {f.name}", getattr(self, f.name), 0, "kg" if f.name == "payload" else "")

    @classmethod
    def parse(cls, text: str) -> Spread:
        """Return a spread from words, as in "payload=0.5,friction=0.3"; what is left out keeps its default.

        Raises:
            InputError: words that are none of this.
        """
        values: dict[str, float] = {}
        known = [f.name for f in fields(cls)]
        for item in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (part.strip() for part in item.partition("="))
            if name not in known:
                raise unknown("spread", name, known)
            try:
                values[name] = float(value)
            except ValueError:
                raise InputError(f"spread {item}: must be {name}= and a number") from None
        return cls(**values)


@dataclass(frozen=True)
class MachineStudy:
    """Monte Carlo over machines: the job runs on many that differ, each with the gains of the nominal one.

    The machines are drawn from a Latin hypercube: of n machines each factor has one in each n-th of its range.

    Args:
        job: to run.
        tolerance: of the figure, in its unit.
        figure: of a case's row, as contour_max.
        samples: number of machines besides the nominal one.
        spread: how far they differ.
        seed: of the random numbers; the same seed draws the same machines.
        measure: from a case to its row.
    """

    job: Job
    tolerance: float
    figure: str = "contour_max"
    samples: int = 128
    spread: Spread = field(default_factory=Spread)
    seed: int = 1
    measure: Measure = measure

    name = "machine"
    plots = ("yield", "influence", "scatter")

    def __post_init__(self) -> None:
        whole("seed", self.seed, 0)
        _ = self.criterion
        if not any(asdict(self.spread).values()):
            raise InputError("spread: must be above 0 for at least one factor")
        count = len(self._spreads)
        if whole("samples", self.samples, 1) < count + 3:
            raise InputError(f"samples = {self.samples}: must be at least {count + 3}, for {count} factors")

    @cached_property
    def criterion(self) -> Criterion:
        """The figure with its tolerance."""
        return Criterion(self.figure, self.tolerance)

    @property
    def title(self) -> str:
        """Heads the report."""
        return f"How many machines keep {self.job.name} within its tolerance?"

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does with the job."""
        return {
            "tolerance": self.tolerance,
            "figure": self.figure,
            "samples": self.samples,
            "seed": self.seed,
            "spread": asdict(self.spread),
        }

    @cached_property
    def _spreads(self) -> dict[str, float]:
        """Spread of every factor by the name of its column."""
        axes = self.job.built_machine.axis_names
        spreads = {"payload_kg": self.spread.payload} if self.spread.payload else {}
        for name in FACTORS:
            if spread := getattr(self.spread, name):
                each = self._per_axis(name)
                spreads |= {f"{name}_{axis}": spread for axis in axes} if each else {name: spread}
        return spreads

    @cached_property
    def machines(self) -> dict[str, Floats]:
        """The machines: values of every factor by the name of its column, (samples,)."""
        from scipy.stats.qmc import LatinHypercube  # slow to import, and needed by this study alone

        unit = LatinHypercube(len(self._spreads), rng=self.seed).random(self.samples)
        return {
            name: spread * unit[:, k] if name == "payload_kg" else (1 + spread) ** (2 * unit[:, k] - 1)
            for k, (name, spread) in enumerate(self._spreads.items())
        }

    def _per_axis(self, name: str) -> bool:
        """Whether every axis can have a factor of its own: a spring above all axes has none."""
        machine = self.job.built_machine
        try:
            machine.perturbed(replace(Perturbation(), **{name: tuple(1.0 + k for k in range(len(machine.axes)))}))  # type: ignore[arg-type]
        except InputError:
            return False
        return True

    def perturbation(self, sample: int) -> Perturbation:
        """Return what of a machine differs from the nominal one.

        Args:
            sample: its number, from 1.
        """
        axes = self.job.built_machine.axis_names
        values = {name: float(column[sample - 1]) for name, column in self.machines.items()}
        given: dict[str, Any] = {}
        for name in FACTORS:
            if name in values:
                given[name] = values[name]
            elif f"{name}_{axes[0]}" in values:
                given[name] = tuple(values[f"{name}_{axis}"] for axis in axes)
        return Perturbation(payload=values.get("payload_kg", 0.0), **given)

    def rounds(self) -> Rounds:
        """Yield the nominal machine, whose figures show that there is such a figure, and then all the others."""
        nothing = dict.fromkeys(self.machines, 1.0) | ({"payload_kg": 0.0} if self.spread.payload else {})
        rows = yield [Case.of(self.job).tagged(sample=0, **nothing)]
        if rows[0]["status"] == OK:
            self.criterion.key(rows[0])  # raises where there is no such figure
        yield [
            Case.of(self.job, perturbation=self.perturbation(number)).tagged(
                sample=number, **{name: float(values[number - 1]) for name, values in self.machines.items()}
            )
            for number in range(1, self.samples + 1)
        ]

    def _drawn(self, rows: list[Row]) -> tuple[Row, list[Row], Floats]:
        """The nominal machine's row, those of the others, and the figure of these, (samples,)."""
        nominal, others = rows[0], rows[1:]
        return nominal, others, np.array([self.criterion.value(row) for row in others])

    def findings(self, rows: list[Row]) -> list[str]:
        """Return the yield, what matters most, and what was varied."""
        nominal, others, figure = self._drawn(rows)
        good = [row for row in rows if row["status"] == OK]
        if not good:
            return [f"None of the {len(rows)} machines gives a run with figures: {rows[0]['status']}", self._varied()]
        criterion, unit = self.criterion, self.criterion.unit(good[0])
        found = yield_of(int(np.sum(figure <= criterion.tolerance)), figure.size)
        faults = int(np.sum(~np.isfinite(figure)))
        nominal_text = (
            f"{criterion.value(nominal):.4g} {unit}" if nominal["status"] == OK else f"no figures ({nominal['status']})"
        )
        low, median, high = np.percentile(figure, [5, 50, 95], method="inverted_cdf")
        worst = int(figure.argmax())
        text = (
            f"{found.within} of {found.count} machines keep to a {criterion.label} of {criterion.tolerance:g} {unit}: "
            f"a yield of {100 * found.share:.1f} %, with 95 % confidence {100 * found.low:.1f} to "
            f"{100 * found.high:.1f} %. The nominal machine has {nominal_text}, the median machine "
            f"{_told(median, unit)}, nine of ten lie between {_told(low, unit)} and {_told(high, unit)}, and the "
            f"worst, machine {worst + 1}, has {_told(figure[worst], unit)}."
        )
        if faults:
            reason = next(row["status"] for row in others if row["status"] != OK)
            text += f" {faults} of them did not finish, as machine {_number(others, reason)}: {reason}."
        return [text, self._what_matters(figure), self._varied()]

    def _what_matters(self, figure: Floats) -> str:
        found, explained = influences(self.machines, figure)
        clear = [influence for influence in found if influence.clear]
        if not clear:
            return "No factor by itself goes together with the figure more closely than chance would have it."
        first = clear[0]
        values = self.machines[first.factor]
        more = values > np.median(values)
        within = figure <= self.tolerance
        text = (
            f"What matters most is {_words(first.factor)} (rank coefficient {first.coefficient:+.2f}): of the machines "
            f"with more of it {100 * within[more].mean():.0f} % are within the tolerance, of those with less "
            f"{100 * within[~more].mean():.0f} %."
        )
        if others := clear[1 : 1 + _NAMED]:
            several = _listed([f"{_words(other.factor)} ({other.coefficient:+.2f})" for other in others])
            text += f" Then {'come' if len(others) > 1 else 'comes'} {several}."
        if unclear := [_words(influence.factor) for influence in found if not influence.clear]:
            text += f" No influence can be told from chance of {_listed(unclear)}."
        return f"{text} Together the factors explain {100 * explained:.0f} % of the variance of the ranks."

    def _varied(self) -> str:
        parts = []
        for name, spread in asdict(self.spread).items():
            if not spread:
                continue
            if name == "payload":
                parts.append(f"the payload by 0 to {spread:g} kg")
            else:
                parts.append(f"{_words(name)} by factors of {1 / (1 + spread):.3g} to {1 + spread:.3g}")
        return (
            f"Varied are {_listed(parts)}, of each axis by itself, drawn from a Latin hypercube with the seed "
            f"{self.seed}. The servo keeps the gains that fit the nominal machine."
        )

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the distribution of the figure, the factors' influence, and the figure over those that matter most."""
        nominal, others, figure = self._drawn(rows)
        good = [row for row in rows if row["status"] == OK]
        finite = np.isfinite(figure)
        if not good or not finite.any():
            return []
        criterion, unit = self.criterion, self.criterion.unit(good[0])
        label = f"{criterion.label} [{unit}]" if unit else criterion.label
        found, _ = influences(self.machines, figure)
        most = {_words(one.factor): self.machines[one.factor] for one in found[:4]}
        return [
            Plot(
                "yield",
                "Distribution over the machines",
                "Above the share of machines that have the figure or less, below how many have it. Machines that did "
                "not finish are beyond the right end.",
                draw_yield(figure, criterion.value(nominal), criterion.tolerance, label),
                tables=[self._worst_table(others, figure, unit)],
            ),
            Plot(
                "influence",
                "Which factor matters",
                "Coefficients of a linear regression of the figure's rank on the ranks of all factors, all scaled to "
                "one variance: near 1 where more of a factor makes the figure larger whatever the others do, near -1 "
                "where it makes it smaller. Pale bars cannot be told from chance.",
                draw_influence([(_words(one.factor), one.coefficient, one.clear) for one in found]),
            ),
            Plot(
                "scatter",
                "The figure over the factors that matter most",
                "Each point is a machine.",
                draw_scatter(most, figure, criterion.tolerance, label),
            ),
        ]

    def _worst_table(self, others: list[Row], figure: Floats, unit: str) -> Table:
        from gantrysim.page import Column, Table

        order = np.argsort(-figure, kind="stable")[:_WORST]
        columns: list[str | Column] = ["machine", Column(f"figure [{unit}]" if unit else "figure", ".4g")]
        columns += [Column(_words(name) + (" [kg]" if name == "payload_kg" else ""), ".3f") for name in self.machines]
        cells = [
            [
                int(k) + 1,
                float(figure[k]) if np.isfinite(figure[k]) else None,
                *(float(values[k]) for values in self.machines.values()),
            ]
            for k in order
        ]
        return Table(columns, cells, caption="The worst machines; factors multiply the nominal machine's values.")


def _number(others: list[Row], status: object) -> object:
    return next(row["sample"] for row in others if row["status"] == status)


def _told(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".rstrip() if math.isfinite(value) else "no figures at all"


def _words(factor: str) -> str:
    """A column's name in words."""
    words = {
        "payload_kg": "payload",
        "payload": "payload",
        "friction": "friction",
        "viscous": "viscous friction",
        "stiffness": "stiffness",
        "motor_constant": "motor constant",
    }
    for name, said in words.items():
        if factor == name:
            return said
        if factor.startswith(f"{name}_"):
            return f"{said} of {factor.removeprefix(f'{name}_')}"
    return factor


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
