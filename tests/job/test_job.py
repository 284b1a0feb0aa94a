"""Job files: loading, overrides, and invalid input."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gantrysim import InputError, Job, Machine, simulate
from gantrysim.job.content import content_digest
from gantrysim.job.loading import builtin_jobs, job_text
from gantrysim.job.overrides import override

SHORT = ["diameter=40", "turns=1", "settle=0.05"]


def test_builtin_jobs_load_and_are_written_with_every_default():
    assert "an225" in builtin_jobs()
    for name in builtin_jobs():
        job = Job.load(name)
        assert job.name == name
        assert Job(**tomllib.loads(job.toml())) == job


def test_the_written_job_repeats_the_run_to_the_last_bit(tmp_path):
    job = Job.load("an225", [*SHORT, "interpreter_time=0.001", "servo.delay=0.00025", "kp=[0.2, 0.3]"])
    file = tmp_path / "job.toml"
    file.write_text(job.toml())
    first, second = job.run(), Job.load(file).run()
    for name in ("commanded", "encoder", "nozzle", "demand", "current", "flow"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_overrides_take_dotted_keys_and_unique_last_parts():
    job = Job.load(
        "an225", ["program.diameter=100", "loop_period=0.5", "servo.kp=[1, 2]", "name=mine", "frequency = 12"]
    )
    assert job.program["diameter"] == 100.0
    assert job.program["loop_period"] == 0.5
    assert job.servo.kp == [1.0, 2.0]
    assert job.name == "mine"
    assert job.servo.frequency == 12.0


def test_infinity_survives_the_file():
    job = Job.load("an225", ["integral_time=inf"])
    assert math.isinf(tomllib.loads(job.toml())["servo"]["integral_time"])


def test_a_relative_machine_is_found_and_written_as_an_absolute_path(rigid, tmp_path, monkeypatch):
    rigid()
    file = tmp_path / "mine.toml"
    file.write_text(Job.load("an225", SHORT).toml().replace('machine = "xy"', 'machine = "rigid.xml"'))
    monkeypatch.chdir(tmp_path.parent)
    job = Job.load(f"{tmp_path.name}/mine.toml")
    assert job.machine == str(tmp_path / "rigid.xml")
    assert Job.load("an225", [f"machine={tmp_path.name}/rigid.xml"]).machine == job.machine
    assert Job.load("an225", machine=f"{tmp_path.name}/rigid.xml").machine == job.machine
    assert job.built_machine.name == "rigid"
    assert job.run().machine == "rigid"


def test_the_digest_of_a_job_is_that_of_its_values_in_any_order():
    values = {"name": "a", "servo": {"kp": 1.0, "kd": 2.0}}
    turned = {"servo": {"kd": 2.0, "kp": 1.0}, "name": "a", "machine": "elsewhere"}
    assert content_digest(values) == content_digest(turned)
    assert content_digest(values) != content_digest({**values, "name": "b"})


def test_the_longest_physics_step_reaches_the_run():
    job = Job.load("an225", [*SHORT, "physics_step=0.0001"])
    run, default = job.run(), Job.load("an225", SHORT).run()
    alone = simulate(job.built_machine, job.built_servo, job.setpoints, physics_step=1e-4, dispenser=job.dispenser)
    np.testing.assert_array_equal(run.nozzle, alone.nozzle)
    assert np.abs(run.nozzle - default.nozzle).max() > 0


@pytest.mark.parametrize("known", [("a.end", "b.end"), ("a.end", "b.end", "c.d.end")])
def test_a_key_that_two_or_more_settings_end_with_is_ambiguous(known):
    with pytest.raises(InputError, match=f"^--set end=1: 'end' is ambiguous: {', '.join(known)}$"):
        override({}, "end=1", known)


def test_settings_reach_the_run():
    job = Job.load("an225", [*SHORT, "period=0.0005", "flow=33", "physics_step=0.0001"])
    run = job.run()
    assert run.period == 0.0005
    assert run.flow_demand.max() == 33.0
    assert run.flow.max() == pytest.approx(33.0)
    assert len(run.time) == len(job.setpoints.position)
    assert (~run.dispense).sum() == 100


BAD = {
    "inner diameter": (
        ["turns=8"],
        r"inner_diameter = -40 mm .*must be at least 0 mm; use turns at most 5 or thickness below 7.5 mm",
    ),
    "nan": (["speed=nan"], "speed = nan mm/s: must be finite"),
    "zero turns": (["turns=0"], "turns = 0: must be at least 1"),
    "text": (["diameter=wide"], "program.diameter = 'wide': must be a number"),
    "key": (
        ["loop_perod=1"],
        "unknown key 'loop_perod': did you mean program.loop_period.*\\? all keys",
    ),
    "no value": (["turns"], "--set turns: must be key=value"),
    "ambiguous": (["controller=trio.Spiral"], "unknown controller 'trio.Spiral': did you mean trio.MoveSpiral"),
    "servo": (["damping=-1"], "damping = -1: must be 0.001 to 1000"),
    "per axis": (["kp=[1.0]"], "kp has 1 values: must be one or 2, one per axis"),
    "settle": (["settle=-1"], "settle = -1 s: must be at least 0 s"),
    "huge speed": (["speed=1e300"], r"speed = 1e\+300: must be 0 or from 1e-100 to 1e\+12 in magnitude"),
    "tiny period": (["servo.period=1e-9"], "servo period = 1e-09 s: must be at least 1e-07 s"),
    "short period": (["servo.period=1.5e-7"], "10.1527 s in periods of 1.5e-07 s: makes 6.77e.07 ticks, at most 5e.07"),
    "endless settling": (["settle=1e9"], "1e.09 s in periods of 0.001 s: makes 1e.12 ticks"),
    "reported once": (["kp=abc"], "^job an225: servo.kp = 'abc': must be a number[^;]*$"),
    "machine": (["machine=xyq"], "unknown model 'xyq': did you mean xy"),
}


@pytest.mark.parametrize(("overrides", "text"), BAD.values(), ids=BAD.keys())
def test_bad_values_are_refused_in_one_line(overrides, text):
    with pytest.raises(InputError, match=text) as caught:
        Job.load("an225", overrides).run()
    assert "\n" not in str(caught.value)


FILES = {
    "no TOML": ("name = ", "is not TOML"),
    "no program": ('name = "a"', "program is missing"),
    "unknown section": (
        'name = "a"\n[program]\ncontroller="trio.MoveSpiral"\n[sevro]\n',
        "unknown key sevro|diameter is missing",
    ),
    "missing argument": ('name = "a"\n[program]\ncontroller="trio.MoveSpiral"\ndiameter=100\n', "turns is missing"),
    "unknown argument": (
        'name = "a"\n[program]\ncontroller="trio.MoveSpiral"\ndiameter=100\nturns=1\nthickness=5\nspeed=9\npitch=3\n',
        "unknown key .*pitch",
    ),
    "controller in a list": ('name = "a"\n[program]\ncontroller=["trio.MoveSpiral"]\n', "unknown controller"),
    "a long text for a table": (
        'name = "a"\nservo = "' + 900 * "x" + '"\n[program]\n',
        r"servo = 'x{59}: must be a table",
    ),
    "no table": ('name = "a"\nservo = 3\n[program]\n', r"servo = 3: must be a table, \[servo\]"),
    "name": ('name = "../../a"\n[program]\ncontroller="trio.MoveSpiral"\n', "name = '../../a': must be of letters"),
    "no controller": ('name = "a"\n[program]\ndiameter=100\n', "program.controller is missing: must be one of trio"),
}


@pytest.mark.parametrize(("content", "text"), FILES.values(), ids=FILES.keys())
def test_bad_files_are_refused_in_one_line(tmp_path, content, text):
    file = tmp_path / "job.toml"
    file.write_text(content)
    with pytest.raises(InputError, match=text) as caught:
        Job.load(file)
    assert "\n" not in str(caught.value)


def test_a_key_inside_a_value_that_is_not_a_table_is_refused(tmp_path):
    file = tmp_path / "job.toml"
    file.write_text(job_text("an225").replace("[program]", "[program]\ngroup = 3"))
    changes = ["program.controller=softmc.Program", "velocity=30"]
    with pytest.raises(InputError, match=r"^--set velocity=30: group is not a table in this job$"):
        Job.load(file, changes)


@pytest.mark.parametrize("key", ["dispenser.needle.length", "dispenser.syringe.fill"])
def test_a_key_of_a_table_that_is_a_list_is_refused(key):
    table = key.rpartition(".")[0]
    with pytest.raises(InputError, match=rf"^--set {key}=1: {table.rpartition('.')[2]} is not a table in this job$"):
        Job.load("an225", [f"{table}=[1, 2, 3]", f"{key}=1"])


@pytest.mark.parametrize("value", ["x" * 3000, f"x{' ' * 3000}"])
def test_a_long_value_is_shortened_in_the_refusal(tmp_path, value):
    job = tmp_path / "job.toml"
    job.write_text(f'name = "j"\n[program]\ncontroller = "{value}"\n')
    for refused in (lambda: Job.load(value), lambda: Job.load(job), lambda: Machine(value)):
        with pytest.raises(InputError) as error:
            refused()
        assert "..." in str(error.value)
        assert len(str(error.value).replace(str(job), "")) < 600


def test_unknown_jobs_are_refused_with_the_alternatives():
    with pytest.raises(InputError, match=r"job seel.ngc: no such file; built-in jobs: an225, "):
        Job.load("seel.ngc")
    with pytest.raises(InputError, match="unknown job 'an224': did you mean an225"):
        Job.load("an224")


def test_a_changed_job_shares_what_is_built_and_equal():
    job = Job.load("an225", SHORT)
    faster = job.changed({"program.speed": 150.0}).sharing(job)
    assert faster == job.changed({"program.speed": 150.0})
    assert faster.built_machine is job.built_machine
    assert faster.controller.speed == 150.0
    softer = job.changed({"servo.kp": 0.3, "machine": "xyz"}).sharing(job)
    assert softer.controller is job.controller
    assert softer.built_machine.name == "xyz"
    wider = job.changed({"dispenser.flow": 100.0})
    assert wider.controller is job.controller
    servo = job.built_servo
    assert wider.sharing(job).built_servo is servo
    assert job.changed({"servo.kp": 0.3}).sharing(job).built_servo.gains != servo.gains


def test_many_problems_of_a_file_are_named_in_one_short_line(tmp_path):
    file = tmp_path / "many.toml"
    file.write_text('name = "a"\nmachine = "xy"\n' + "".join(f"wrong_key_{k} = 1\n" for k in range(30)))
    with pytest.raises(InputError, match=r"unknown key wrong_key_0.*and \d+ more; all keys: [^;]*$") as refused:
        Job.load(file)
    assert len(str(refused.value)) < 500
    assert str(refused.value).count("known:") == 1


def test_overrides_may_be_a_mapping():
    texts = Job.load("an225", ["tolerance.path_max=0.05", "loop_period=0.02", "program.turns=2"])
    values = Job.load("an225", {"tolerance.path_max": 0.05, "loop_period": 0.02, "program.turns": 2})
    assert values == texts
    text = Job.load("linuxcnc-flanges", {"program.text": "G1  X10 F600\nM2\n"})
    assert text.program["text"] == "G1  X10 F600\nM2\n"
    again = values.with_overrides({"tolerance.path_max": None})
    assert again.tolerance is None or again.tolerance.path_max is None


def test_overrides_are_not_one_text():
    with pytest.raises(InputError, match=r"^overrides = 'turns=2': must be texts in a list, or a mapping of keys"):
        Job.load("an225", "turns=2")
    for setting in (3, (), ("program.turns",), (3, 2), b"turns=2"):
        with pytest.raises(InputError, match=r'^overrides.*: must be a text "key=value", or a pair of key and value'):
            Job.load("an225", [setting])


def test_an_unknown_key_of_a_mapping_is_named():
    with pytest.raises(InputError, match=r"^unknown key 'program.trns'"):
        Job.load("an225", {"program.trns": 2})


@pytest.mark.parametrize(
    ("cell", "error"), [(2.0, "cell = 2 mm: must be at most "), (1e-3, "cell = 0.001 mm: the height map of a bead ")]
)
def test_cells_that_no_map_can_have_are_refused_before_the_simulation(cell, error):
    with pytest.raises(InputError, match=f"^{error}"):
        Job.load("softmc-arc", [f"bead.cell={cell}"]).check_fit()
    Job.load("softmc-arc", ["bead.cell=0.2"]).check_fit()


def outline_job(side, **settings):
    """A square outline of a bead of glue, on a machine as large as it needs."""
    text = f"G21 G90\nG0 X0 Y0\nM3\nG1 X{side} F30000\nG1 Y{side}\nG1 X0\nG1 Y0\nM5\nM2\n"
    program = {"controller": "linuxcnc.Program", "text": text}
    machine = Path(__file__).parents[2] / "examples" / "machines" / "belt-gantry.toml"
    return Job(name="outline", machine=str(machine), program=program, dispenser={"area": 2.0}, **settings)


def test_a_part_too_large_for_the_default_cells_is_refused_before_the_simulation(tmp_path):
    """Of cells of 0.25 mm at most 2e7 lie in a square of 1,118 mm; the cell that is named is large enough."""
    table = (Path(__file__).parents[2] / "examples" / "machines" / "belt-gantry.toml").read_text()
    machine = tmp_path / "wide.toml"
    machine.write_text(table.replace("travel = [-150, 150]", "travel = [-150, 1300]"))
    large = outline_job(1200.0).model_copy(update={"machine": str(machine)})
    with pytest.raises(
        InputError, match=r"^cell = 0.25 mm: .* has 2.32e\+07 cells, at most 2e\+07; bead.cell = "
    ) as caught:
        large.check_fit()
    cell = float(str(caught.value).rpartition("bead.cell = ")[2].split()[0])
    assert cell == pytest.approx(0.3)
    large.changed({"bead.cell": cell}).check_fit()
    # without glue no map is made
    large.changed({"dispenser.area": 0.0}).check_fit()
    outline_job(120.0).check_fit()


@pytest.mark.parametrize("is_built_in", [True, False])
def test_a_controller_is_named_for_program_files_alone(tmp_path, is_built_in):
    (tmp_path / "own.toml").write_text(Job.load("an225").toml())
    name = "an225" if is_built_in else str(tmp_path / "own.toml")
    with pytest.raises(InputError) as refused:
        Job.load(name, controller="trio.Basic")
    assert str(refused.value).startswith("--controller ")
    assert str(refused.value).endswith(f": job {name} has a program of its own; it is for program files")
