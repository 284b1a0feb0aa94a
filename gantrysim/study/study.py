"""The base class of all studies, and the report that a study makes of its rows.

A new study is a module with a frozen dataclass derived from `Study`, which defines `rounds` and `report`; a large one
is a package: study.py with the dataclass, and report.py with a function `report(study, rows)`. A command in
gantrysim/cli/study.py runs it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, fields
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, ClassVar

from gantrysim.job.job import Job
from gantrysim.report.document import Table
from gantrysim.study.cases import Case, Row, measure
from gantrysim.study.runner import Measure
from gantrysim.study.worker import MeasureTogether

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Rounds = Generator[Sequence[Case], Sequence[Row], None]


@dataclass(frozen=True)
class Plot:
    """A plot of a study: the chart of its report, or one of its details.

    Attributes:
        name: file name in the folder of plots, without the suffix.
        title: of the section.
        text: description, one paragraph or several.
        figure: of matplotlib.
        tables: below the plot.
        viewer: content of the page's viewer, which the figure is then the print of; one plot of a report at most.
    """

    name: str
    title: str
    text: str | Sequence[str]
    figure: Figure
    tables: Sequence[Table] = ()
    viewer: str | None = None


@dataclass(frozen=True)
class Details:
    """What a report shows besides its answer, folded on the page.

    Attributes:
        notes: remarks of one line each.
        tables: further tables of results.
        plots: further plots, with a section each.
    """

    notes: Sequence[str] = ()
    tables: Sequence[Table] = ()
    plots: Sequence[Plot] = ()


@dataclass(frozen=True)
class Report:
    """The result of a study or a tuning: question, answer, chart, table and details, shown everywhere in this order.

    Attributes:
        question: that the study answers, in plain words.
        answer: in one sentence, with the numbers that it rests on and with what to change.
        chart: the plot that shows the answer; None without values to draw.
        table: the numbers behind the answer; None without values.
        details: everything else.
    """

    question: str
    answer: str
    chart: Plot | None = None
    table: Table | None = None
    details: Details = field(default_factory=Details)

    @property
    def findings(self) -> list[str]:
        """Answer and notes."""
        return [self.answer, *self.details.notes]

    @property
    def plots(self) -> list[Plot]:
        """The chart and all further plots."""
        return [*([] if self.chart is None else [self.chart]), *self.details.plots]

    @property
    def tables(self) -> list[Table]:
        """The table and all further tables, but for those below plots."""
        return [*([] if self.table is None else [self.table]), *self.details.tables]


@dataclass(frozen=True)
class Study(ABC):
    """Base class of studies; cases and report follow from the study's fields and the rows alone.

    A derived class sets `name`, and `plots` and `texts` where it has any, and defines `rounds`.

    Args:
        job: to study.

    Attributes:
        name: one word, the command's.
        plots: names of all plots that the report may hold.
        texts: names of files that the study writes besides.
    """

    job: Job

    name: ClassVar[str]
    plots: ClassVar[tuple[str, ...]] = ()
    texts: ClassVar[tuple[str, ...]] = ()

    @property
    def title(self) -> str:
        """Title of the report."""
        return f"{self.name.capitalize()} study of {self.job.name}"

    @property
    def command(self) -> str:
        """Words after `gantrysim` that run the study."""
        return f"study {self.name}"

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that repeat the study together with its job; by default all fields but job and measure."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("job", "measure")}

    @property
    def measure(self) -> Measure:
        """Function from a case to its row."""
        return measure

    @property
    def measure_together(self) -> MeasureTogether | None:
        """Function from several cases to their rows, used instead of `measure` if there is one."""
        return None

    @property
    def expected(self) -> int:
        """Estimated number of cases in all rounds, for the progress; 0 if unknown."""
        return 0

    @property
    def news(self) -> str:
        """Intermediate result in a few words, for the progress."""
        return ""

    @abstractmethod
    def rounds(self) -> Rounds:
        """Yield the cases of each round and receive their rows: `rows = yield cases`.

        A study without rounds yields once; a search chooses its next cases by the rows received. What can be refused
        without running a case is refused before the first yield, while nothing is written.
        """

    def report(self, rows: Sequence[Row]) -> Report:
        """Return the report; by default `report(study, rows)` of the module report.py beside the class or a base class.

        The module is imported on this call, so that running a study depends on no plotting.
        """
        # a study derived in a test or a user's module has its base's report
        packages = (kind.__module__.rpartition(".")[0] for kind in type(self).__mro__)
        module = next(f"{package}.report" for package in packages if package and find_spec(f"{package}.report"))
        return import_module(module).report(self, rows)

    def text(self, name: str, rows: Sequence[Row]) -> str:
        """Return the content of one of `texts`."""
        raise KeyError(name)
