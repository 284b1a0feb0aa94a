"""The report of a machine study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import PER_CENT, number_text
from gantrysim.machine.tolerances import in_words
from gantrysim.report.document import Column, Table
from gantrysim.report.plots.style import sheet
from gantrysim.results.colours import BAD, GOOD, INK, RUNS
from gantrysim.study.acceptance import Acceptance, Criterion, JobCriterion, improve_command
from gantrysim.study.cases import OK, Row
from gantrysim.study.machine.study import MachineStudy
from gantrysim.study.study import Details, Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Statistics of many machines: the yield, and the influence of every factor.

_CONFIDENCE = 0.95
_ROUNDING = 1e-12  # of a variance


@dataclass(frozen=True)
class Yield:
    """Share of machines within a tolerance.

    Attributes:
        within: number of machines within it.
        count: number of all machines.
        low, high: bounds of the share's 95 % Wilson interval; conservative, as a Latin hypercube is more even than
            random samples.
    """

    within: int
    count: int
    low: float
    high: float

    @property
    def share(self) -> float:
        return self.within / self.count


def yield_of(within: int, count: int) -> Yield:
    """Return the yield with its Wilson interval: all shares p for which |within/n - p| <= z sqrt(p (1 - p) / n).

    Source: E. B. Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    from scipy.stats import norm  # slow to import

    z2 = float(norm.ppf(0.5 + 0.5 * _CONFIDENCE)) ** 2
    share = within / count
    middle = (share + z2 / (2 * count)) / (1 + z2 / count)
    half = math.sqrt(z2 * (share * (1 - share) / count + z2 / (4 * count**2))) / (1 + z2 / count)
    return Yield(within, count, max(middle - half, 0.0), min(middle + half, 1.0))


@dataclass(frozen=True)
class Influence:
    """Influence of a factor on a metric.

    Attributes:
        factor: name.
        coefficient: standardised rank regression coefficient, about -1 to 1.
        clear: whether it is significant: by chance any factor would be in one study of twenty.
    """

    factor: str
    coefficient: float
    clear: bool


def influences(factors: dict[str, Floats], metric: Floats) -> tuple[list[Influence], float]:
    """Return the influence of every factor, the largest first, and the share of variance that they explain together.

    The ranks of the metric are fitted by those of the factors, all of mean 0 and variance 1: y = X b + e. For
    uncorrelated factors b is Spearman's rank correlation, but tested against what the others leave unexplained:
    b / sqrt(e.e / (n - k - 1) (X'X)^-1) has Student's distribution for a factor without influence. With few machines
    for many factors hardly any freedom is left for that, and the rank correlation alone is the stronger test: a factor
    is significant by either. Of k factors without influence none is by one of the 2k tests, each at 0.05 / 2k, in 95 %
    of all studies (Bonferroni).

    Args:
        factors: values of k factors by name, (n,) with n above k + 1.
        metric: of the same machines, (n,); inf for a failed run, worse than any other.
    """
    from scipy.stats import rankdata, spearmanr, t  # slow to import

    def standardised(values: Floats) -> Floats:
        ranks = rankdata(values)
        deviation = ranks.std()
        return (ranks - ranks.mean()) / deviation if deviation > 0 else np.zeros(ranks.size)

    n = metric.size
    k = len(factors)
    x = np.column_stack([standardised(values) for values in factors.values()])
    y = standardised(metric)
    inverse = np.linalg.pinv(x.T @ x)
    b = inverse @ x.T @ y
    residual = max(float(np.sum((y - x @ b) ** 2)), _ROUNDING * n)
    error = np.sqrt(residual / (n - k - 1) * np.diag(inverse))
    level = (1 - _CONFIDENCE) / (2 * k)
    bound = float(t.ppf(1 - 0.5 * level, n - k - 1))
    alone = [bool(y.any() and column.any() and spearmanr(column, y).pvalue < level) for column in x.T]
    unsorted = [
        Influence(name, float(coefficient), bool(abs(coefficient) > bound * sigma) or by_itself)
        for name, coefficient, sigma, by_itself in zip(factors, b, error, alone, strict=True)
    ]
    explained = 1 - residual / n if y.any() else 0.0
    return sorted(unsorted, key=lambda influence: -abs(influence.coefficient)), explained


# The answer of a machine study: the yield and its lever, or that the nominal machine itself fails.

QUESTION = "How many machines of this build will meet the tolerance?"


def machine_answer(study: MachineStudy, rows: Sequence[Row], influence: Influence, halves: tuple[float, float]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of the nominal machine and all others.
        influence: of the factor with the largest.
        halves: yield of the machines above and below the median of that factor [%].
    """
    nominal = rows[0]
    criterion = study.criterion_of(nominal)
    estimate = yield_of(sum(criterion.within(row) for row in rows[1:]), len(rows) - 1)
    share = _share(estimate, criterion, nominal)
    if failure := nominal_failure(criterion, nominal):
        return (
            f"The nominal machine itself fails ({failure}), so tolerances of the build are not the lever: first run "
            f"{improve_command(study.job)}; as it is, {share}."
        )
    if estimate.within == estimate.count:
        return f"{share}; nothing of the build needs to change."
    return f"{share}; {_lever(influence, halves)}."


def nominal_failure(criterion: Criterion, nominal: Row) -> str:
    """Return what the nominal machine fails; empty where it keeps the tolerance.

    By the job's own limits it must keep all of them, though the others are compared by those of the motion alone.
    """
    acceptance = Acceptance.of(nominal)
    if isinstance(criterion, JobCriterion) and acceptance is not None:
        return acceptance.failures()
    return "" if criterion.within(nominal) else criterion.failure(nominal)


def _share(estimate: Yield, criterion: Criterion, row: Row) -> str:
    low = PER_CENT * estimate.low
    high = PER_CENT * estimate.high
    return (
        f"{estimate.within} of {estimate.count} machines keep {criterion.limit(row)}, a yield of "
        f"{PER_CENT * estimate.share:.1f} % (95 % confidence: {low:.1f} to {high:.1f} %)"
    )


def _lever(influence: Influence, halves: tuple[float, float]) -> str:
    if not influence.clear:
        return "no factor of the build has a significant influence, so none is known to be a lever"
    above, below = halves
    side = "low" if influence.coefficient > 0 else "high"
    return (
        f"the lever is {in_words(influence.factor)}, to be kept {side}: {below:.0f} % of the machines below its median "
        f"keep the limit, {above:.0f} % above"
    )


_BINS = (12, 40)
_WORST_MACHINES = 5
_AXIS_MARGIN = 12  # beyond 0 and 100 %, for the label of the yield [%]


def report(study: MachineStudy, rows: Sequence[Row]) -> Report:
    """Return the yield, the distribution of the metric over the machines, and the influence of every factor."""
    nominal = rows[0]
    good = [row for row in rows if row["status"] == OK]
    if not good:
        text = f"Not known: none of the {len(rows)} machines gives a run with values: {nominal['status']}."
        return Report(QUESTION, text)
    criterion = study.criterion_of(nominal)
    label = criterion.axis_label(good[0])
    values = np.array([criterion.value(row) for row in rows[1:]])
    within = np.array([criterion.within(row) for row in rows[1:]])
    factors, explained = influences(study.machines, values)
    halves = _yields_of_halves(study.machines[factors[0].factor], within)
    answer = machine_answer(study, rows, factors[0], halves)
    influence = _influence_table(study, factors, explained, within)
    tables = [_distribution_table(criterion.value(nominal), values, label), _variation_table(study)]
    notes = _notes(rows, factors)
    if not np.isfinite(values).any():
        return Report(QUESTION, answer, None, influence, Details(notes, tables))
    chart = Plot(
        "yield",
        "Distribution over the machines",
        "Above, the share of machines up to a value; below, their number at it. Failed machines are beyond the "
        "right end.",
        _draw_yield(values, criterion.value(nominal), criterion.tolerance, label),
        tables=[_worst_table(study, values, label)],
    )
    most = {in_words(influence.factor): study.machines[influence.factor] for influence in factors[:4]}
    plots = [
        Plot(
            "influence",
            "Influence of the factors",
            "Coefficients of a linear regression of the metric's rank on the ranks of all factors, all scaled to unit "
            "variance: near 1 where more of a factor always increases the metric, near -1 where it decreases it. Pale "
            "bars are not significant.",
            _draw_influence(factors),
        ),
        Plot(
            "scatter",
            "Metric over the most influential factors",
            "Each point is a machine.",
            _draw_scatter(most, values, criterion.tolerance, label),
        ),
    ]
    return Report(QUESTION, answer, chart, influence, Details(notes, tables, plots))


def _notes(rows: Sequence[Row], factors: list[Influence]) -> list[str]:
    notes = []
    if not factors[0].clear:
        notes.append("No factor has a significant influence.")
    if rows[0]["status"] != OK:
        notes.append(f"The nominal machine has no values: {rows[0]['status']}.")
    if failed := [row for row in rows[1:] if row["status"] != OK]:
        notes.append(f"{len(failed)} runs failed, such as machine {failed[0]['sample']}: {failed[0]['status']}.")
    return [*notes, "Every machine runs with the servo gains of the nominal machine."]


def _yields_of_halves(factor: Floats, within: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the yield of the machines above and below the median of a factor [%]."""
    above = factor > np.median(factor)
    return 100 * float(within[above].mean()), 100 * float(within[~above].mean())


def _distribution_table(nominal: float, values: Floats, label: str) -> Table:
    low, median, high = np.percentile(values, [5, 50, 95], method="inverted_cdf")
    worst = int(values.argmax())
    sizes = {"nominal": nominal, "5 % quantile": low, "median": median, "95 % quantile": high}
    sizes[f"worst, number {worst + 1}"] = values[worst]
    rows = [[name, float(size) if np.isfinite(size) else None] for name, size in sizes.items()]
    return Table(["machine", label], rows, caption="Distribution over the machines.")


def _influence_table(
    study: MachineStudy, factors: list[Influence], explained: float, within: NDArray[np.bool_]
) -> Table:
    rows = []
    for influence in factors:
        shares = _yields_of_halves(study.machines[influence.factor], within)
        rows.append([in_words(influence.factor), influence.coefficient, "yes" if influence.clear else "no", *shares])
    columns: list[str | Column] = [
        "factor",
        Column("rank coefficient", "+.2f"),
        "significant",
        Column("yield above [%]", ".0f"),
        Column("below [%]", ".0f"),
    ]
    caption = (
        f"Influence, with the yield of the machines above and below the median of each factor. Together the factors "
        f"explain {100 * explained:.0f} % of the variance of the ranks; {len(factors)} factors without influence would "
        f"explain {100 * len(factors) / (within.size - 1):.0f} % of it on {within.size} machines."
    )
    return Table(columns, rows, caption=caption)


def _variation_table(study: MachineStudy) -> Table:
    rows = []
    for name, spread in asdict(study.spread).items():
        if not spread:
            continue
        factors = f"{1 / (1 + spread):.3g} to {1 + spread:.3g}"
        rows.append([in_words(name), f"0 to {spread:g} kg" if name == "payload" else factors])
    errors = study.job.built_machine.kinematic_errors
    for name, size in {} if errors is None else errors.values.items():
        one_sided = name.startswith(("play", "racking"))
        unit = "mm/m" if name.startswith(("yaw", "squareness", "racking")) else "mm"
        rows.append([in_words(name), f"{0 if one_sided else -abs(size):.3g} to {abs(size):.3g} {unit}"])
    caption = f"Variation, per axis: payload, and factors of the nominal values; Latin hypercube, seed {study.seed}."
    return Table(["quantity", "range"], rows, caption=caption)


def _worst_table(study: MachineStudy, values: Floats, label: str) -> Table:
    order = np.argsort(-values, kind="stable")[:_WORST_MACHINES]
    columns: list[str | Column] = ["machine", label]
    columns += [Column(in_words(name) + (" [kg]" if name == "payload_kg" else ""), ".3f") for name in study.machines]
    cells: list[list[Any]] = []
    for k in order.tolist():
        value = float(values[k]) if np.isfinite(values[k]) else None
        cells.append([k + 1, value, *(float(factor[k]) for factor in study.machines.values())])
    return Table(columns, cells, caption="The worst machines; factors multiply the nominal machine's values.")


def _draw_yield(values: Floats, nominal: float, tolerance: float, label: str) -> Figure:
    """Draw the distribution of a metric over machines, (n,), inf if failed: cumulative above, a histogram below."""
    finite = np.sort(values[np.isfinite(values)])
    share = 100 * np.arange(1, finite.size + 1) / values.size
    within = 100 * float(np.mean(values <= tolerance))
    with sheet(9.0, 6.4) as drawing:
        above, below = drawing.subplots(2, sharex=True, height_ratios=(3, 2))
        above.step(np.concatenate([finite[:1], finite]), np.concatenate([[0], share]), where="post", color=INK, lw=1.8)
        above.plot([tolerance], [within], "o", ms=7, color=BAD, zorder=4)
        # the curve rises to the right: the label fits above it on the left and below it on the right
        beyond_middle = tolerance > 0.5 * (finite[0] + finite[-1])
        above.annotate(
            f"yield {within:.1f} %",
            (tolerance, within),
            xytext=(-8, 6) if beyond_middle else (8, -6),
            textcoords="offset points",
            ha="right" if beyond_middle else "left",
            va="bottom" if beyond_middle else "top",
            color=BAD,
            weight="bold",
        )
        bins = int(np.clip(np.sqrt(finite.size) * 1.5, *_BINS))
        low = min(finite[0], tolerance)
        high = max(finite[-1], tolerance)
        width = max((high - low) / bins, 1e-9 * abs(high))
        edges = tolerance + width * np.arange(
            np.floor((low - tolerance) / width), np.ceil((high - tolerance) / width) + 1
        )
        counts, edges = np.histogram(finite, np.append(edges, edges[-1] + width))
        colours = [GOOD if edge < tolerance - 1e-9 * width else BAD for edge in edges[:-1]]
        below.bar(edges[:-1], counts, np.diff(edges), align="edge", color=colours, alpha=0.75, edgecolor="w", lw=0.6)
        for axes in (above, below):
            axes.axvline(tolerance, color=BAD, lw=1.2, ls="--", label=f"tolerance {tolerance:g}")
            if np.isfinite(nominal):
                axes.axvline(nominal, color=RUNS[0], lw=1.2, ls=":", label=f"nominal machine {nominal:.4g}")
        above.set(ylabel="share of machines [%]", ylim=(-_AXIS_MARGIN, 100 + _AXIS_MARGIN), yticks=range(0, 101, 20))
        below.set(ylabel="machines", xlabel=label)
        below.yaxis.get_major_locator().set_params(integer=True)
        drawing.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return drawing


def _draw_influence(factors: list[Influence]) -> Figure:
    """Draw the coefficients of all factors as bars, the largest on top, pale where they are not significant."""
    with sheet(9.0, 1.4 + 0.32 * len(factors)) as drawing:
        axes = drawing.add_subplot()
        for k, influence in enumerate(factors):
            coefficient = influence.coefficient
            colour = BAD if coefficient > 0 else GOOD
            axes.barh(k, coefficient, color=colour, alpha=0.9 if influence.clear else 0.25, height=0.7)
            end = coefficient + (0.015 if coefficient >= 0 else -0.015)
            side = "left" if coefficient >= 0 else "right"
            axes.text(end, k, number_text(coefficient, "+.2f"), va="center", ha=side, fontsize=9)
        axes.axvline(0, color=INK, lw=0.8)
        axes.set_yticks(range(len(factors)), [in_words(influence.factor) for influence in factors])
        axes.invert_yaxis()
        axes.set(xlim=(-1.12, 1.12), xlabel="standardised rank coefficient")
        axes.grid(visible=False, axis="y")
    return drawing


def _draw_scatter(factors: dict[str, Floats], metric: Floats, tolerance: float, label: str) -> Figure:
    """Draw a metric, (n,), over some factors, (n,) each by name, with a panel each; failed machines are left out."""
    finite = np.isfinite(metric)
    columns = min(len(factors), 2)
    rows = -(-len(factors) // columns)
    with sheet(9.0, 0.6 + 2.9 * rows) as drawing:
        panels = drawing.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for panel, (name, values) in zip(panels, factors.items(), strict=False):
            for within, colour in ((True, GOOD), (False, BAD)):
                chosen = finite & ((metric <= tolerance) == within)
                panel.plot(values[chosen], metric[chosen], "o", ms=4, mew=0, alpha=0.75, color=colour)
            panel.axhline(tolerance, color=BAD, lw=1.0, ls="--")
            panel.set_xlabel("payload [kg]" if name == "payload" else f"{name}, factor")
        for panel in panels[len(factors) :]:
            panel.set_visible(False)
        drawing.supylabel(label, fontsize="medium")
    return drawing
