"""Changes in words, and comments on the lines to paste, of jobs whose values are known."""

import tomllib
from types import SimpleNamespace

import pytest

from gantrysim import Job
from gantrysim.remedy.improvement import toml_lines
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.wording import notes_of_law, words_of
from gantrysim.study.speed.study import speed_changes


def trial(name, setting, changes):
    lever = next(lever for lever in LEVERS if lever.name == name)
    return SimpleNamespace(lever=lever, setting=setting, changes=changes)


def words(job, *trials):
    improved = job.changed({key: value for one in trials for key, value in one.changes.items()})
    return words_of(trials, job, improved)


@pytest.mark.parametrize(
    ("job", "name", "setting", "changes", "text"),
    [
        ("an225", "acceleration", "× 4", {"program.acceleration": 4000.0}, "acceleration 1000 → 4000 mm/s²"),
        ("an225", "loop period", "10 ms", {"program.loop_period": 0.01}, "loop period 100 → 10 ms"),
        ("an225", "exact waits", "instead of WA", {"program.wait_resolution": 0.0}, "exact waits (instead of WA)"),
        (
            "softmc-arc",
            "lag compensation",
            "25 ms",
            {"dispenser.advance": 0.025},
            "lag compensation (advance) 0 → 25 ms",
        ),
        ("softmc-arc", "needle height", "× 1.5", {"bead.gap": 0.75}, "needle height (gap) 0.5 → 0.75 mm"),
        (
            "softmc-arc",
            "friction compensation",
            "",
            {"servo.law": ["pid", "friction"]},
            "friction compensation",
        ),
        (
            "an225",
            "flow by speed",
            "area 2 mm², 38 ms compensated",
            {"dispenser.flow": 0.0, "dispenser.area": 2.0, "dispenser.advance": 0.038},
            "flow by speed: 200 mm³/s constant → 2 mm² (area) × path speed, lag compensation 0 → 38 ms",
        ),
        (
            "fanuc-spiral",
            "leads",
            "of the dead time",
            {"dispenser.start_lead": 0.012, "dispenser.stop_lead": 0.012},
            "leads: start lead 50 → 12 ms, stop lead 45 → 12 ms",
        ),
    ],
)
def test_a_lever_is_told_with_its_values_before_and_after(job, name, setting, changes, text):
    assert words(Job.load(job), trial(name, setting, changes)) == text


def test_a_speed_is_told_whichever_values_set_it():
    """The flow that keeps the section with it, unless the flow follows the speed afterwards."""
    job = Job.load("an225")
    slower = trial("slower", "× 0.5", speed_changes(job, 50.0))
    assert words(job, slower) == "slower: speed 100 → 50 mm/s, flow 200 → 100 mm³/s"
    by_speed = trial("flow by speed", "area 2 mm²", {"dispenser.flow": 0.0, "dispenser.area": 2.0})
    assert words(job, slower, by_speed).startswith("slower: speed 100 → 50 mm/s; flow by speed: ")


def test_lines_to_paste_have_unit_former_value_and_meaning_and_the_same_content():
    job = Job.load("softmc-helical")
    values = {"program.group.acceleration": 750.0, "dispenser.flow": 0.0, "dispenser.area": 2.0}
    lines = toml_lines(job, job.changed(values))
    assert lines.splitlines() == [
        "[program.group]",
        "acceleration = 750.0  # mm/s², was 3000; acceleration along the path",
        "",
        "[dispenser]",
        "flow = 0.0  # mm³/s, was 400; 0: the flow follows the path speed, see area",
        "area = 2.0  # mm², was 0; cross-section of the bead",
    ]
    content = tomllib.loads(lines)
    assert content == {"program": {"group": {"acceleration": 750.0}}, "dispenser": {"flow": 0.0, "area": 2.0}}


def test_the_law_of_friction_comes_with_the_values_that_it_takes_from_the_machine():
    job = Job.load("softmc-arc")
    improved = job.changed({"servo.law": ["pid", "friction"]})
    lines = toml_lines(job, improved)
    assert lines.splitlines()[1] == 'law = ["pid", "friction"]  # was "pid"; control law'
    assert tomllib.loads(lines) == {"servo": {"law": ["pid", "friction"]}}
    for name in ("friction_torque", "friction_static", "friction_speed", "friction_stiffness"):
        (line,) = (line for line in lines.splitlines() if line.startswith(f"# {name} = "))
        given = tomllib.loads(line.removeprefix("# ").partition("  ")[0])[name]
        assert given == pytest.approx(improved.built_servo.per_axis(name), rel=1e-3)


@pytest.mark.parametrize(
    ("machine", "speeds", "stiffnesses"),
    [
        ("xy", "mm/s", "N·m/mm"),
        ("xyzr", "mm/s, mm/s, mm/s, deg/s", "N·m/mm, N·m/mm, N·m/mm, N·m/deg"),
    ],
)
def test_values_of_friction_have_the_units_of_their_axes(machine, speeds, stiffnesses):
    base = Job.load("an225", machine=machine)
    lines = list(notes_of_law(base, base.changed({"servo.law": ["pid", "friction"]})))
    ends = {line.partition(" = ")[0]: line.rpartition("]")[2].strip() for line in lines[1:]}
    assert (ends["friction_speed"], ends["friction_stiffness"]) == (speeds, stiffnesses)
    assert ends["friction_torque"] == "N·m"
