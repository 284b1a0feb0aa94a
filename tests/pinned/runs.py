"""Runs of small jobs with their causes, changes and wording; environments; and sentences that further runs give."""

from functools import cache

import numpy as np

from gantrysim.glue.bead import Bead
from gantrysim.job.causes import causes_of
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.improve import improve
from gantrysim.remedy.report import found_changes
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults

from support.remedies import AREA, DOTS, FLOW, LAG, SIDES, lines_job, sliced_job, spiral_job

# no clock, path or version
# errors of links stand beside errors of the whole
LEFT_OUT = (
    "servo",
    "versions",
    "sections",
    "changes",
    "verdict",
    "error_budget",
    "causes",
    "glue_causes",
    "job",
    "machine",
)


JOBS = {
    "fixed flow": lambda: lines_job(SIDES, dispenser={"flow": FLOW, **LAG}),
    "soft": lambda: lines_job(SIDES, servo={"frequency": 6.0}, tolerance={"path_max": 0.02, "path_p95": 0.01}),
    "dots": lambda: lines_job(DOTS, dispenser={"flow": FLOW, **LAG}),
    "sliced": sliced_job,
    "spiral": lambda: spiral_job(loop_period=0.2),
    "geometry": lambda: lines_job(
        SIDES, geometry={"squareness_xy": 0.2}, dispenser={"area": AREA, "closing": 0.1}, tolerance={"stop_length": 0.5}
    ),
}
# the rest of a run: drives, laws, faults
RUNS = {
    "load encoders": {"servo": {"feedback": "load"}},
    "velocity drives, late": {"servo": {"mode": "velocity", "delay": 0.0005, "feedback_delay": 1}},
    "noise": {"servo": {"encoder_noise": 0.001, "interpolation_error": 0.0005, "signal_period": 0.02}},
    "friction, observer, contour": {"servo": {"law": ["pid", "friction", "observer", "contour"]}},
    "cascade, preview, zv": {"servo": {"law": ["p-pi", "preview", "zv"]}},
    "class C5, warm": {"geometry": {"accuracy": "C5", "warming": 3.0}},
    "stuck": {"faults": [{"kind": "stuck axis", "axis": "y", "time": 0.5, "duration": 0.01}]},
    "dropout": {"faults": [{"kind": "encoder dropout", "axis": "x", "time": 0.3, "duration": 0.004}]},
    "sag": {"faults": [{"kind": "bus sag", "time": 0.3, "duration": 0.2, "share": 0.3}]},
    "clogged": {"faults": [{"kind": "clogged nozzle", "time": 0.3, "duration": 0.3, "share": 0.3}]},
    "too much torque": {"servo": {"torque_limit": 0.02, "following_error_limit": 0.5}},
}


def digits(value, count=4):
    """Numbers of a run: counts and friction amplify the last bit of a setpoint, so that four digits are meant."""
    if isinstance(value, dict):
        return {key: digits(item, count) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [digits(item, count) for item in value]
    return float(f"{value:.{count}g}") if isinstance(value, float) and np.isfinite(value) else value


def without_nulls(value):
    if not isinstance(value, dict):
        return value
    return {name: item for name, item in value.items() if item is not None}


def results_of(job, causes=None):
    run = job.run()
    analysis = Analysis(run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis), causes)


def run_answer(tables):
    job = lines_job(SIDES, **tables)
    run = job.run()
    if run.fault is not None:
        return {
            "fault": str(run.fault),
            "verdict": str(RunResults(job, job.built_machine, Budget(Analysis(run))).verdict),
        }
    results = results_of(job)
    found = summary(results)
    kept = {key: found[key] for key in found if key not in LEFT_OUT and found[key]}
    kept = {key: without_nulls(value) for key, value in kept.items()}
    return digits({"verdict": str(results.verdict), **kept})


@cache
def improvement_of(name):
    return improve(JOBS[name](), workers=1, fastest=False, by_place=name == "fixed flow")


def improve_answer(name):
    """What each lever gives, what is not tried and why, the lines to paste, and all sentences."""
    improvement = improvement_of(name)
    changes = found_changes(improvement)
    return {
        "text": str(improvement),
        "by place": improvement.by_place_sentence,
        "untried": improvement.untried_levers,
        "rows": [" | ".join(row) for row in improvement.rows],
        "outcome": changes.remedy.outcome,
        "remains": changes.remedy.sentence,
    }


def cause_answer(name):
    job = JOBS[name]()
    causes = causes_of(job)
    found = summary(results_of(job, causes))
    return {"text": str(causes), **{key: found[key] for key in ("headline", "spoilt", "notes")}}


CASES = {f"run, {name}": lambda tables=tables: run_answer(tables) for name, tables in RUNS.items()}
CASES |= {f"causes, {name}": lambda name=name: cause_answer(name) for name in ("soft", "geometry")}
CASES |= {f"improve, {name}": lambda name=name: improve_answer(name) for name in JOBS}
