"""Published figures at the default physics step against those at 12.5 us: 1 % or 0.3 um.

Encoder counts amplify the last bit of a run to micrometres, see tests/reference. So figures are means over runs whose
kp and counts differ by up to 1e-4, which moves no figure by more than that, and these may differ by three standard
deviations of the means if that is more. A maximum or 95th percentile of counted positions is held to a count, if that
is more, one of an angle to two counts, the lengths of a bead to a tenth of a cell of its map, and the ripple of the
torque to 4 %.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from gantrysim import Budget, Job, simulate_batch
from gantrysim.glue.bead import Bead
from gantrysim.job.loading import builtin_jobs
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults

from support.soaked import suite_runs

FINE = 12.5e-6  # [s]
RELATIVE = 0.01
MICROMETRES = 0.3
PER_TICK = 0.3  # the same as a speed, of one tick's way [mm/s]
TORQUE = 0.04
BEAD = 0.01  # [mm]
COUNTS_OF_AN_ANGLE = 2  # its largest following error, where friction lets go, is 0.4 mdeg smaller at the default step
STEADY = 3.0  # standard deviations
RUNS = 16
DIFFER = 1e-4  # of kp and the counts, to both sides

# Not sizes of errors: places, shares of a whole, and what belongs to the machine and its servo alone.
_LEFT_OUT = ("at_max", "share", "verdict", "motion.end", "versions")


def numbers(content: object, key: str = "") -> Iterator[tuple[str, float]]:
    """All numbers of a summary by their dotted keys."""
    if isinstance(content, dict):
        for name, value in content.items():
            yield from numbers(value, f"{key}.{name}")
    elif isinstance(content, list):
        for k, value in enumerate(content):
            yield from numbers(value, f"{key}.{k}")
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield key, float(content)


def figures(job: Job, step: float | None, runs: int = RUNS) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the mean of each figure."""
    shares = np.linspace(1 - DIFFER, 1 + DIFFER, runs) if runs > 1 else [1.0]
    servo = job.built_servo
    servos = [
        servo.with_values(
            kp=tuple(share * kp for kp in servo.per_axis("kp")),
            resolution=tuple(
                share * count for count in servo.per_axis("resolution")
            ),  # an axis stops anywhere within a count
        )
        for share in shares
    ]
    all_of = {}
    for run in simulate_batch(job.built_machine, servos, job.setpoints, physics_step=step, dispenser=job.dispenser):
        assert run.fault is None
        budget = Budget(run)
        bead = Bead(run, job.bead, budget.analysis) if run.flow.any() else None
        for key, value in numbers(summary(RunResults(job, job.built_machine, budget, bead))):
            all_of.setdefault(key, []).append(value)
    return {
        key: (float(np.mean(values)), float(np.std(values)) / np.sqrt(max(len(values) - 1, 1)))
        for key, values in all_of.items()
        if not any(word in key for word in _LEFT_OUT)
    }


def allowed(key: str, value: float, scatter: float, job: Job) -> float:
    *_, last = key.split(".")
    micrometre = {"um": 1.0, "mm": 1e-3}
    unit = next((size for name, size in micrometre.items() if f"_{name}" in key and f"{name}2" not in key), 0.0)
    least = PER_TICK if "mm_s" in key else MICROMETRES * unit
    if {"max", "p95"} & set(last.split("_")) and "um" in key:  # also where the quantity is named first: lag_max_um
        least = max(least, 1e3 * max(job.built_servo.per_axis("resolution")))
    if "mdeg" in key and "max" in last.split("_"):
        least = COUNTS_OF_AN_ANGLE * 1e3 * rotary_resolution(job)
    if ".bead." in key and unit:
        least = BEAD
    relative = TORQUE if "ripple" in key else RELATIVE
    return max(relative * abs(value), least, STEADY * scatter)


def rotary_resolution(job: Job) -> float:
    """Coarsest resolution of the rotary axes [deg]."""
    axes = zip(job.built_machine.axes, job.built_servo.per_axis("resolution"), strict=True)
    return max(resolution for axis, resolution in axes if axis.unit == "deg")


@pytest.mark.validates(
    "every figure of every job at the default physics step",
    "the job at 12.5 µs, means over 16 runs",
    "1 % or 0.3 µm",
)
@pytest.mark.soak
@pytest.mark.parametrize("name", builtin_jobs())
def test_every_figure_of_a_job_is_that_of_fine_steps(name):
    job = Job.load(name)
    coarse, fine = figures(job, None), figures(job, FINE)
    assert coarse.keys() == fine.keys()
    off = {
        key: (value, expected)
        for (key, (value, one)), (expected, other) in zip(coarse.items(), fine.values(), strict=True)
        if abs(value - expected) > allowed(key, expected, float(np.hypot(one, other)), job)
    }
    assert not off, "\n".join(f"{key}: {pair}" for key, pair in off.items())
    for link in (*job_links(fine), "contour"):  # without any allowance for scatter
        key = f".error_budget.{link}.rms_um"
        assert coarse[key][0] == pytest.approx(fine[key][0], rel=RELATIVE, abs=MICROMETRES)


def job_links(found: dict[str, tuple[float, float]]) -> list[str]:
    keys = (key.split(".") for key in found if key.startswith(".error_budget.") and key.endswith(".rms_um"))
    return [parts[2] for parts in keys if len(parts) == 4]


@pytest.mark.parametrize("name", suite_runs(["softmc-arc", "fanuc-conical"], 0))
def test_root_mean_squares_of_a_single_run_are_those_of_steps_a_quarter_as_long(name):
    job = Job.load(name)
    coarse, fine = figures(job, None, runs=1), figures(job, 6.25e-5, runs=1)
    for link in job_links(fine):
        key = f".error_budget.{link}.rms_um"
        assert coarse[key][0] == pytest.approx(fine[key][0], rel=RELATIVE, abs=MICROMETRES)
