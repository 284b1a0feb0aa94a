"""How a loop study's runs keep the job's limits over each swept setting: in numbers, and drawn."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gantrysim.base.quantity import PER_CENT
from gantrysim.report.plots.style import COLOURS, sheet
from gantrysim.results.colours import BAD, GOOD, INK
from gantrysim.study.acceptance import Acceptance, Scope
from gantrysim.study.cases import LIMIT_USE
from gantrysim.study.drawing import logarithmic
from gantrysim.study.loop.study import LoopStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    """Return a length as text."""
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
        return [value for value, verdict in self.judged.items() if self.scope.keeps(verdict)]

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


def present_value(study: LoopStudy, sweep: str) -> float | None:
    """Return the job's value of a swept setting; None where it has none of its own."""
    if sweep == "servo_period":
        return float(study.job.built_servo.period)
    if sweep == "encoder_resolution":
        axes = zip(study.job.built_machine.axes, study.job.built_servo.per_axis("resolution"), strict=True)
        return next((resolution for axis, resolution in axes if axis.unit == "mm"), None)
    value = study.job.program.get(sweep)
    return float(value) if isinstance(value, float | int) else None


def draw_limits(study: LoopStudy, sweeps: Mapping[str, SweepVerdicts]) -> Figure:
    """Draw the largest use of a limit over each swept setting, with the limit and the job's own value."""
    with sheet(10.7, 4.4) as figure:
        panels = figure.subplots(1, len(sweeps), sharey=True, squeeze=False)[0]
        uses = [
            _draw_use(panel, sweep, present_value(study, name))
            for panel, (name, sweep) in zip(panels, sweeps.items(), strict=True)
        ]
        logarithmic(panels[0], "y", [PER_CENT, *(use for some in uses for use in some)])
        panels[0].set_ylabel(f"{LIMIT_USE.label} [{LIMIT_USE.unit}]")
        handles: dict[str, Any] = {}
        for panel in panels:
            drawn, labels = panel.get_legend_handles_labels()
            handles |= dict(zip(labels, drawn, strict=True))
        figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=len(handles))
    return figure


def _draw_use(axes: Axes, sweep: SweepVerdicts, present: float | None) -> list[float]:
    """Draw the use of the closest limit over a swept setting; return the values [%]."""
    uses = {value: verdict.use(sweep.scope.aspects) for value, verdict in sweep.judged.items()}
    shown = {value: use for value, use in uses.items() if value > 0 and 0 < use < math.inf}
    axes.plot(list(shown), list(shown.values()), color=INK, lw=1.0, alpha=0.5)
    for label, chosen, colour in (("keeps the limits", True, GOOD), ("does not", False, BAD)):
        values = [value for value in shown if (value in sweep.kept) is chosen]
        axes.plot(values, [shown[value] for value in values], "o", ms=5, ls="none", color=colour, label=label)
    endless = [value for value, use in uses.items() if value > 0 and use == math.inf]
    if endless:
        top = axes.get_xaxis_transform()
        axes.plot(
            endless, [0.98] * len(endless), "^", color=BAD, ls="none", transform=top, label="fails without a share"
        )
    axes.axhline(PER_CENT, color=BAD, lw=1.2, ls="--", label="limit")
    if present is not None and present > 0:
        axes.axvline(present, color=COLOURS["requested"], lw=1.4, ls=":", label="the job's own value")
    if shown or endless:
        logarithmic(axes, "x", sorted([*shown, *endless, *([present] if present else [])]))
        axes.xaxis.set_major_formatter(lambda value, _: sweep.lever.text(value))
        axes.tick_params(axis="x", labelrotation=40, labelsize=8)
    # a logarithmic axis has no place for zero
    axes.set_xlabel(f"{sweep.lever.noun}, the job's own 0" if present == 0 else sweep.lever.noun)
    return list(shown.values())
