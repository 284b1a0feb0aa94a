"""Every public name with arguments that are likely to be given by mistake: one sentence, no error from inside.

A path for an object, an object for a path, a text for a number, the arguments exchanged, a list, None.
"""

import inspect
import traceback
import warnings
from pathlib import Path

import pytest

import gantrysim as gs
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.study import SpeedStudy

PACKAGE = str(Path(gs.__file__).parent)
# functions of the caller's, and switches that anything turns
LEFT_OUT = {"progress", "law", "coordinates", "causes", "improve"}
WRITTEN = {"Run.save", "Run.report", "Run.film"}  # to any path
PATHS = {"text", "path", "number as text"}
SEARCHES = {"causes_of", "improve"}  # with a right job they simulate for minutes


@pytest.fixture(scope="module")
def right(xy):
    """What the arguments of these names should be."""
    servo = gs.Servo.derive(xy.axes)
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(servo.period)
    run = gs.simulate(xy, servo, setpoints, dispenser=gs.Dispenser(flow=100))
    job = gs.Job.load("an225")
    values = {"machine": xy, "servo": servo, "setpoints": setpoints, "run": run, "job": job, "axes": xy.axes}
    return values | {"of": run, "path": setpoints.requested, "speed": 80.0, "period": 1e-3, "folder": "out"}


@pytest.fixture(scope="module")
def mistakes(right):
    given = {name: right[name] for name in ("machine", "servo", "setpoints", "run", "job")}
    plain = {
        "text": "an225",
        "path": Path("a.xml"),
        "number as text": "200",
        "number": 5,
        "None": None,
        "list": [1, 2],
        "mapping": {"x": 1},
    }
    return given | plain


def calls(right):
    """The public functions and classes, and the methods that are called most, by name."""
    public = {name: getattr(gs, name) for name in gs.__all__}
    plain = {
        name: value
        for name, value in public.items()
        if callable(value) and not (isinstance(value, type) and issubclass(value, Exception))
    }
    machine, servo, job, run = (right[name] for name in ("machine", "servo", "job", "run"))
    methods = (gs.Job.load, gs.Run.load, gs.SavedRun.load, gs.Servo.derive, gs.Verdict.of, gs.Setpoints.along)
    methods += (machine.perturbed, machine.with_geometry, job.changed, job.with_overrides, job.at_speed)
    methods += (servo.with_values, run.save, run.report, run.film, run.__getitem__)
    return (
        plain
        | {method.__qualname__: method for method in methods}
        | {
            "SpeedStudy": SpeedStudy,
            "path_speed": gs.metrics.path_speed,
            "following_error": gs.metrics.following_error,
            "torque_ripple": gs.metrics.torque_ripple,
        }
    )


def attempts(name, function, right, mistakes):
    """Each parameter with each mistake, the others right; only what the signature admits."""
    parameters = inspect.signature(function).parameters
    for parameter in parameters.values():
        if parameter.name in LEFT_OUT or parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        if name in SEARCHES and parameter.name != "job":
            continue
        required = {
            other.name
            for other in parameters.values()
            if other.default is other.empty and other.kind not in (other.VAR_KEYWORD, other.VAR_POSITIONAL)
        } - {parameter.name}
        if not required <= right.keys():
            continue
        given = {other: right[other] for other in required}
        for kind, value in mistakes.items():
            # the right one is no mistake, and would run
            is_right = kind == parameter.name or (parameter.name == "of" and kind == "run")
            if not is_right and not (name in WRITTEN and kind in PATHS):
                yield kind, parameter.name, given | {parameter.name: value}


def complaint(function, arguments):
    """What is wrong with what a call raises; empty for nothing, an error of the domain, or one of the signature."""
    try:
        with warnings.catch_warnings(action="error"):
            function(**arguments)
    except gs.GantryError as error:
        return "" if str(error) and "\n" not in str(error) else f"not one line: {error}"
    except Exception as error:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename.startswith(PACKAGE)]
        return f"{type(error).__name__}: {error} in {frames[-1].filename}" if frames else ""
    return ""


def test_a_likely_mistake_is_answered_in_a_sentence(right, mistakes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tried = 0
    wrong = []
    for name, function in calls(right).items():
        for kind, parameter, arguments in attempts(name, function, right, mistakes):
            tried += 1
            said = complaint(function, arguments)
            if said:
                wrong.append(f"{name}({parameter}={kind}): {said}")
    assert tried > 500
    assert not wrong, "\n".join(wrong)


EXAMPLES = (
    (lambda right: gs.Dispenser(flow="200"), "flow = '200': must be a number"),
    (
        lambda right: gs.improve("an225"),
        "job is of type str: must be a Job; write gantrysim.Job.load('an225')",
    ),
    (
        lambda right: gs.Budget(right["machine"]),
        "run is of type Machine: must be a Run; gantrysim.simulate(machine, servo, setpoints) and "
        "gantrysim.Job.load(file).run() return one",
    ),
    (
        lambda right: gs.Verdict.of(right["run"], right["job"]),
        "job is of type Run: must be a Job; gantrysim.Job.load(file) returns one",
    ),
    (
        lambda right: gs.Rig("xy", right["servo"]),
        "machine is of type str: must be a Machine; write gantrysim.Machine('xy')",
    ),
    (
        lambda right: gs.Job.load("an225", servo=right["servo"]),
        "servo is of type Servo: must be a TOML file; give values as overrides, such as {'servo.kp': 0.5}",
    ),
    (
        lambda right: gs.Run.load(right["run"]),
        "file is of type Run: must be a path, as text or pathlib.Path",
    ),
    (
        lambda right: right["machine"].perturbed(1.5),
        "perturbation is of type float: must be a Perturbation; write Perturbation(payload=0.3)",
    ),
    (
        lambda right: gs.Servo.derive(["x", "y"]),
        "axis is of type str: must be an axis of a machine; write Servo.derive(machine.axes)",
    ),
)


@pytest.mark.parametrize(("call", "text"), EXAMPLES)
def test_what_to_write_instead(right, call, text):
    with pytest.raises(gs.InputError) as error:
        call(right)
    assert str(error.value) == text
