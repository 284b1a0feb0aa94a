"""Records of the built-in jobs, each made once in a process."""

from functools import cache

from gantrysim import Job


@cache
def job_run(name):
    """The record of a built-in job; its arrays are read-only."""
    return Job.load(name).run()
