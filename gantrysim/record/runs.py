"""The records of several runs, as a list and as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gantrysim.base.extras import extra
from gantrysim.record.run import Run

if TYPE_CHECKING:
    import pandas


class Runs(list[Run]):
    """The records of several runs: a list with a table of their figures."""

    def to_frame(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with a row per run, in order: its `gantrysim.figures`.

        Raises:
            InputError: pandas is not installed.
        """
        # before the figures, which take longer
        with extra("tables", "Runs.to_frame"):
            import pandas
        from gantrysim.study.figures import figures

        return pandas.DataFrame([figures(run) for run in self])
