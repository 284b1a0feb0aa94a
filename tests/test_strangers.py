"""What a stranger does first, each in a fresh process that has imported nothing of gantrysim before."""

import dataclasses

import pytest

from gantrysim import Job
from gantrysim.job.loading import builtin_jobs

TICKS = 200
LOADED = """
import sys
import gantrysim as gs
run = gs.Run.load(sys.argv[1])
print(type(run.requested).__name__, repr(run.requested.length), len(run.time), run.machine, *run.injected)
"""


@pytest.mark.parametrize("name", builtin_jobs())
def test_a_record_of_every_built_in_job_is_loaded(fresh, tmp_path, name):
    job = Job.load(name)
    record = job.follow()
    short = {
        field.name: getattr(record, field.name)[:TICKS]
        for field in dataclasses.fields(record)
        if hasattr(getattr(record, field.name), "shape")
    }
    dataclasses.replace(record, **short).save(tmp_path / "run.npz")
    done = fresh.run(LOADED, tmp_path, tmp_path / "run.npz")
    path = record.requested
    assert done.error == ""
    assert done.output.split() == [type(path).__name__, repr(path.length), str(TICKS), record.machine]
