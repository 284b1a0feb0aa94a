# Types of what a record offers through the rooms above it, which the module imports only at their first use.
import os
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from gantrysim.job.job import Job
from gantrysim.metrics.budget import Budget
from gantrysim.record.run_file import Fault
from gantrysim.results.verdict import Verdict

class Conveniences:
    job: Job | None
    fault: Fault | None
    dispense: Any
    @cached_property
    def budget(self) -> Budget: ...
    @cached_property
    def verdict(self) -> Verdict: ...
    @property
    def verdict_headline(self) -> str: ...
    def plot(self) -> Figure: ...
    def report(
        self,
        folder: str | os.PathLike[str],
        *,
        causes: bool = True,
        improve: bool = True,
        progress: Callable[[float], None] | bool | None = None,
    ) -> Path: ...
    def film(self, file: str | os.PathLike[str], **options: Any) -> int: ...
