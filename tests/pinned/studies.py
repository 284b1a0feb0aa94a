"""Small studies: their question, answer, table and notes; what they compute; and runs with their engine's limits."""

import tempfile
from dataclasses import fields
from pathlib import Path
from unittest.mock import patch

import numpy as np

from gantrysim import InputError, Job, Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.study.circle import CircleStudy
from gantrysim.study.laws import LawsStudy, reversals
from gantrysim.study.loop import LoopStudy
from gantrysim.study.loop.trends import Convergence, crossing, knee, power
from gantrysim.study.machine import MachineStudy, Tolerances
from gantrysim.study.machine.report import influences, yield_of
from gantrysim.study.repeat import RepeatStudy
from gantrysim.study.repeat.study import targets_of
from gantrysim.study.run import run_study
from gantrysim.study.speed import SpeedStudy, next_speeds
from gantrysim.study.speed.study import Grade, answer_of, next_speeds_of_grades, speed_changes
from gantrysim.study.tuning import TuningStudy

from support.blank_pictures import save_blank
from support.remedies import SIDES, lines_job

SHORT = "G21 G90 G64 P0.02\nF12000\nM62 P0\nG1 X4\nG1 X0 Y3\nM63 P0\nM2\n"
SPIRAL = {
    "controller": "trio.MoveSpiral",
    "diameter": 30.0,
    "turns": 1,
    "thickness": 5.0,
    "speed": 100.0,
    "loop_period": 0.02,
    "acceleration": 2000.0,
}


def refusal(answer):
    try:
        return answer()
    except InputError as error:
        return str(error)


def spiral(**tables):
    content = {"name": "spiral", "program": SPIRAL, "dispenser": {"flow": 200.0}, "simulation": {"settle": 0.05}}
    return Job.of_content(content | tables, "job spiral")


STUDIES = {
    "speed": lambda: SpeedStudy(lines_job(SIDES), 60.0),
    "speed, too tight": lambda: SpeedStudy(lines_job(SIDES, servo={"frequency": 5.0}), 1.0),
    "speed, verdict": lambda: SpeedStudy(lines_job(SIDES, dispenser={"flow": 200.0})),
    "machine": lambda: MachineStudy(lines_job(SIDES), 25.0, None, 12, Tolerances.parse("payload=0.4,friction=0.5"), 3),
    "laws": lambda: LawsStudy(lines_job(SHORT, simulation={"settle": 0.02}), 0.3, 1.4),
    "repeat": lambda: RepeatStudy(lines_job(SIDES), repeats=3, friction=0.05, seed=2),
    "loop": lambda: LoopStudy(
        spiral(),
        loop_periods=(0.02, 0.1),
        interpreter_times=(0.0, 2e-3),
        servo_periods=(1e-3, 2e-3),
        resolutions=(1e-3,),
        halvings=1,
    ),
}


def study_answer(name):
    def answer():
        study = STUDIES[name]()
        with tempfile.TemporaryDirectory() as folder, patch("matplotlib.figure.Figure.savefig", save_blank):
            outcome = run_study(study, Path(folder) / "out", workers=1)
        report = outcome.report
        table = [] if report.table is None else [report.table.caption or "", report.table.heads, *report.table.cells]
        return {
            "question": report.question,
            "answer": report.answer,
            "table": [row if isinstance(row, str) else " | ".join(row) for row in table],
            "cases": [len(outcome.rows), sum(row["status"] == "ok" for row in outcome.rows)],
        }

    return refusal(answer)


def speeds():
    """Speeds that a search tries next, and what it has found."""
    tried = {}
    rounds = []
    while found := next_speeds(tried, 80.0, 0.05):
        rounds.append(found)
        tried |= {speed: speed <= 123.0 for speed in found}
    grades = {10.0: Grade.CLEAN, 20.0: Grade.CLEAN, 40.0: Grade.WARNED, 80.0: Grade.FAILED, 160.0: Grade.WARNED}
    return {
        "rounds": rounds,
        "good": answer_of(grades, Grade.CLEAN),
        "warned": answer_of(grades, Grade.WARNED),
        "next": next_speeds_of_grades(grades, 20.0, 0.05),
        "changes": [speed_changes(lines_job(SIDES), 50.0), speed_changes(spiral(), 50.0)],
    }


def trends():
    x = np.array([0.001, 0.002, 0.004, 0.008, 0.016])
    errors = np.array([5.0, 5.1, 6.0, 11.0, 40.0])
    halved = [Convergence.of(x[::-1], values) for values in (5.0 + x[::-1], 5.0 + x[::-1] ** 2, errors)]
    return {
        "crossing": [crossing(x, errors, level) for level in (5.05, 8.0, 60.0, 1.0)],
        "only touched": crossing(x, [1.0, 2.0, 1.0, 2.0, 2.0], 2.0),
        "knee": [knee(x, errors, floor) for floor in (5.0, 2.0, 100.0)],
        "power": [power(x, 3.0 * x**2), power(x, errors)],
        "convergence": [[each.order, each.limit, each.deviation] for each in halved],
    }


def yields():
    rng = np.random.default_rng(4)
    factors = {name: rng.uniform(0.5, 1.5, 40) for name in ("friction", "payload")}
    metric = 3.0 * factors["friction"] ** 2 + 0.01 * rng.standard_normal(40)
    found, share = influences(factors, metric)
    return {
        "yields": [yield_of(within, count) for within, count in ((8, 8), (0, 8), (5, 8), (97, 128))],
        "influences": [vars(each) for each in found],
        "share": share,
        "targets": [targets_of((-100.0, 100.0)), targets_of((0.0, 7.0))],
        "reversals": reversals(np.array([[0.0, 1.0, 1.0, 0.5, 2.0], [0.0, 0.0, 1.0, 0.5, 0.5]]).T),
    }


def usual_values():
    """What the studies take where a value is not given."""
    job = lines_job(SIDES)
    studies = [
        LawsStudy(job),
        RepeatStudy(job),
        MachineStudy(job),
        LoopStudy(spiral()),
        CircleStudy(),
        TuningStudy(job),
    ]
    return {
        type(study).__name__: {
            item.name: str(getattr(study, item.name))
            for item in fields(study)
            if item.init and item.name not in ("job", "measure")
        }
        for study in studies
    }


SPREADS = (
    "",
    "payload=1",
    "friction=0.3,stiffness=0",
    "payload=-1",
    "friction=a",
    "mass=1",
    "friction",
    "friction=0.2=3",
)


def spreads():
    return {text: refusal(lambda text=text: vars(Tolerances.parse(text))) for text in SPREADS}


def study_refusals():
    job = lines_job(SIDES)
    given = {
        "tolerance of 0": lambda: SpeedStudy(job, 0.0),
        "unknown metric": lambda: SpeedStudy(job, 10.0, "glory"),
        "metric alone": lambda: SpeedStudy(job, None, "contour_max_um"),
        "no machines": lambda: MachineStudy(job, None, None, 0),
        "one machine": lambda: MachineStudy(job, None, None, 1),
        "one repeat": lambda: RepeatStudy(job, repeats=1),
        "friction of -1": lambda: RepeatStudy(job, friction=-1.0),
        "a negative payload": lambda: LawsStudy(job, -0.1),
        "no friction": lambda: LawsStudy(job, 0.1, 0.0),
    }
    return {name: refusal(lambda make=make: type(make()).__name__) for name, make in given.items()}


# servos, dispensers and faults of a short run, with what the compiled loop cannot step
HINDERED = {
    "plain": {},
    "velocity drives": {"servo": {"mode": "velocity"}},
    "current loop": {"servo": {"current_bandwidth": 300.0}},
    "a law of additions": {"servo": {"law": ["pid", "friction", "zv"]}},
    "learning": {"servo": {"law": ["pid", "learning"]}},
    "noise": {"servo": {"encoder_noise": 0.001}},
    "late": {"servo": {"delay": 0.0004, "feedback_delay": 1}},
    "a fault": {"faults": [{"kind": "stuck axis", "axis": "x", "time": 0.1, "duration": 0.05}]},
    "a dispenser's fault": {"faults": [{"kind": "clogged nozzle", "time": 0.1, "duration": 0.1, "share": 0.5}]},
    "geometry": {"geometry": {"squareness_xy": 0.1}},
    "a turning machine": {"machine": "xyzr"},
    "a coarse step": {"simulation": {"settle": 0.05, "physics_step": 5e-4}},
    "a step too long": {"simulation": {"settle": 0.05, "physics_step": 5e-3}},
    "a step of 0": {"simulation": {"settle": 0.05, "physics_step": 0.0}},
    "an unstable servo": {"servo": {"frequency": 200.0}},
}


def engine_answer(tables):
    def answer():
        tables_of_job = {"simulation": {"settle": 0.05, "engine": "loop"}} | tables
        if "engine" not in tables_of_job["simulation"]:
            tables_of_job["simulation"]["engine"] = "loop"
        job = lines_job("G21\nF6000\nG1 X5\nG1 Y5\nM2\n", **tables_of_job)
        run = job.run()
        other = job.run(engine="mujoco")
        return {
            "hindrance": job.prepared_simulation().hindrance,
            "notes": [note for note in job.notes if "engine" in note],
            "ends": [run.nozzle[-1], run.encoder[-1], float(run.time[-1])],
            "same": bool(np.abs(run.motor - other.motor).max() < 1e-5),
            "fault": str(run.fault),
        }

    return refusal(answer)


def argument_answers():
    """What is said of arguments of a wrong type."""
    machine = Machine("xy")
    servo = Servo.derive(machine.axes)
    program = MoveSpiral(diameter=30.0, turns=1, thickness=5.0, speed=100.0, loop_period=0.02, acceleration=2000.0)
    given = {
        "a machine's name": ("xy", servo, program),
        "no servo": (machine, None, program),
        "a file": (machine, servo, "part.ngc"),
        "a class": (machine, servo, MoveSpiral),
        "a path": (machine, servo, program.requested),
        "a job": (machine, servo, spiral()),
        "a number": (machine, servo, 3),
    }
    answers = {name: refusal(lambda values=values: simulate(*values)) for name, values in given.items()}
    more = {
        "a step in words": {"physics_step": "1e-4"},
        "a flow": {"dispenser": 20.0},
        "a dispenser in words": {"dispenser": "valve"},
        "a fault": {"faults": "stuck axis"},
        "an engine": {"engine": "gpu"},
    }
    answers |= {
        name: refusal(lambda values=values: simulate(machine, servo, program, **values))
        for name, values in more.items()
    }
    return {name: answer if isinstance(answer, str) else "runs" for name, answer in answers.items()}


CASES = {f"study, {name}": lambda name=name: study_answer(name) for name in STUDIES}
CASES |= {f"engine, {name}": lambda tables=tables: engine_answer(tables) for name, tables in HINDERED.items()}
CASES |= {
    "speeds": speeds,
    "trends": trends,
    "yields": yields,
    "spreads": spreads,
    "usual values": usual_values,
    "refusals": study_refusals,
    "arguments": argument_answers,
}
