"""A saved run for the view, short as can be."""

from gantrysim.job.job import Job

SHORT = """
name = "short"
machine = "xy"
[program]
controller = "trio.MoveSpiral"
diameter = 80.0
turns = 1
thickness = 10.0
speed = 200.0
[dispenser]
flow = 800.0
"""


def write_run(folder):
    """Write a job and its record into a folder, and return it."""
    (folder / "job.toml").write_text(SHORT)
    Job.load(folder / "job.toml").run().save(folder / "run.npz")
    return folder
