"""Programs on machines that they do not fit, and values that are no numbers, are refused with the reason."""

import pytest

from gantrysim import InputError, Job

LINES = {
    "work frame": (
        ("fanuc-spiral", (), "stage"),
        r"fanuc\.Program: on machine stage .* mm off .* positions in the work frame, but machine stage turns its work",
    ),
    "axes": (
        ("stage-outline", (), "xyzr"),
        r"stage\.OutlineTrace gives positions of the axes .* machine xyzr does not: use machine stage",
    ),
    "other way round": (
        ("stage-outline", ("sigma=1",), None),
        r"put the nozzle up to 3\d\d mm off the requested path: its sigma",
    ),
    "other needle": (("stage-outline", ("program.needle=[-150, 3]",), None), r"put the nozzle up to .* mm off"),
}


@pytest.mark.parametrize(("job", "line"), LINES.values(), ids=LINES.keys())
def test_a_program_of_another_machine_is_refused(job, line):
    name, settings, machine = job
    loaded = Job.load(name, settings, machine)
    for refused in (loaded.check_fit, loaded.plan):
        with pytest.raises(InputError, match=line):
            refused()


def test_the_command_refuses_it_before_it_simulates(gantrysim_command, tmp_path):
    status, _, errors = gantrysim_command("run", "stage-outline", "--set", "sigma=1", "--out", tmp_path / "out")
    assert status == 2
    assert "mm off the requested path: its sigma" in errors
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["stage-outline", "an225", "softmc-helical"])
def test_the_built_in_jobs_fit_their_machines(name):
    assert Job.load(name).plan().length > 0


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("speed=true", "speed = true: true and false are not numbers"),
        ("servo.kp=[true, 1]", r"servo\.kp = \[true, 1\]: true and false are not numbers"),
        ("settle=false", r"simulation\.settle = false"),
        ("needle.bore=true", r"dispenser\.needle\.bore = true"),
        ("bead.cell=true", r"bead\.cell = true"),
    ],
)
def test_true_and_false_are_no_numbers(setting, line):
    with pytest.raises(InputError, match=line):
        Job.load("an225", [setting])


def test_true_and_false_stay_what_they_are_where_they_belong():
    job = Job.load("an225", ["squashed=false", "as_published=false"])
    assert job.bead.squashed is False
    assert job.program["as_published"] is False
