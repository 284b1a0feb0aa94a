"""Values that no key of a job should fall over, and what a job with one of them must do."""

import warnings

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.glue.bead import Bead
from gantrysim.job.job import Job

VALUES = (
    "1e308",
    "-1e308",
    "1e-308",
    "1e300",
    "1e15",
    "1e-15",
    "1e-99",
    "inf",
    "-inf",
    "nan",
    "0",
    "-1",
    "1" + "0" * 400,
    "true",
    '""',
    '"a"',
    "[]",
    "[nan, inf]",
    "[[1, 2], [3, 4]]",
    "{}",
    "1979-05-27",
)


def attempt(job: str, base: Job, key: str, value: str) -> bool:
    """Whether a job with a value is planned; an InputError of one line is the only other outcome.

    Raises:
        AssertionError: a number of the plan is not finite.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            changed = Job.load(job, [f"{key}={value}"])
            changed = changed if key == "machine" else changed.sharing(base)
            changed.plan()
            run = changed.follow()
            if key.startswith("bead"):
                assert np.isfinite(Bead(run, changed.bead).width).all()
            assert changed.toml()
        except InputError as error:
            text = str(error)
            assert "\n" not in text
            assert len(text) < 2000
            return False
    for name in ("time", "commanded", "nozzle", "flow", "flow_demand"):
        assert np.isfinite(getattr(run, name)).all(), name
    return True
