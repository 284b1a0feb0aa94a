"""A printer's configuration as a source of limits, steps and input shapers."""

import json
import re
import tomllib

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.exchange.printer_config import PrinterConfig

PRINTER = """
[include parts/*.cfg]
[printer]
kinematics: cartesian
max_velocity: 50      # mm/s
max_accel = 800
max_z_velocity: 4
max_z_accel: 90
square_corner_velocity: 8
[gcode_macro START]
gcode:
    SET_FAN speed=1
    [printer]
"""
X = """[stepper_x]
microsteps: 16
rotation_distance: 40
gear_ratio: 80:16, 3:2
"""
SAVED = """
#*# <- SAVE_CONFIG ->
#*# [input_shaper]
#*# shaper_type_x = zv
#*# shaper_freq_x = 60.5
#*# damping_ratio_x = 0.05
#*# shaper_type_y = zv
#*# shaper_freq_y = 41
"""


@pytest.fixture
def printer(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "x.cfg").write_text(X)

    def write(text):
        file = tmp_path / "printer.cfg"
        file.write_text(text)
        return file

    return write


def test_steps_follow_from_the_rotation_distance_and_the_gears(printer):
    """A turn of the motor is 200 x 16 microsteps; 5 x 1.5 of them move 40 mm."""
    config = PrinterConfig.load(printer(PRINTER))
    assert config.steps("x") == pytest.approx(200 * 16 * 5 * 1.5 / 40)
    x, y, z = config.limits
    assert (x.speed, x.acceleration, y.steps, z.speed, z.acceleration) == (50, 800, 0, 4, 90)


def test_a_move_under_the_limits_takes_the_time_of_its_trapezoid(printer):
    """60 mm at 50 mm/s and 800 mm/s²: L / v + v / a."""
    text, notes = PrinterConfig.load(printer(PRINTER)).tables("xyz", ["torque"] * 3)
    (planner,) = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# SET_VELOCITY_LIMIT")]
    program = tomllib.loads(text)["program"]
    assert program["axis_speeds"] == [50.0, 50.0, 4.0]
    assert sum("is not simulated" in note for note in notes) == 2  # cruise ratio, acceleration of z
    for lines in (planner, ""):
        job = Job.load(
            "slicer-square",
            [
                f"program.text={json.dumps(lines + chr(10) + 'M83' + chr(10) + 'G1 F9000 X60 E1')}",
                *(f"program.{key}={value}" for key, value in program.items()),
            ],
        )
        setpoints = job.setpoints
        moving = np.count_nonzero(np.abs(np.diff(setpoints.position[:, 0])) > 0) * setpoints.period
        assert moving == pytest.approx(60 / 50 + 50 / 800, abs=2.1 * setpoints.period)


def test_shapers_that_are_laws_become_the_servo_s(printer, tmp_path, gantrysim_command):
    file = printer(PRINTER + SAVED)
    out = tmp_path / "limits.toml"
    status, _, err = gantrysim_command("gains", "slicer-square", "--from", "klipper", file, "--out", out)
    assert (status, "note: no gains: the motors are steppers in open loop" in " ".join(err.split())) == (0, True)
    servo = Job.load("slicer-square", servo=out).built_servo
    assert servo.laws.names == ("pid", "zv")
    assert servo.per_axis("shaper_frequency") == (60.5, 41.0, 0.0)
    assert servo.per_axis("shaper_damping") == (0.05, 0.1, 0.0)


def test_an_axis_own_shaper_goes_before_the_common_one(printer):
    """As Klipper reads it: shaper_type is the default of shaper_type_x and shaper_type_y."""
    config = PrinterConfig.load(printer(PRINTER + SAVED.replace("#*# shaper_type_y = zv", "#*# shaper_type = ei")))
    assert [config.shaper(letter).kind for letter in "xy"] == ["zv", "ei"]


@pytest.mark.parametrize(
    ("change", "modes", "said"),
    [
        (
            ("shaper_type_x = zv", "shaper_type_x = mzv"),
            ["torque"] * 3,
            "x mzv 60.5 Hz, y zv 41 Hz are not simulated: the",
        ),
        (("", ""), ["torque", "torque", "stepper"], "are not simulated: laws need drives in mode 'torque'"),
    ],
)
def test_shapers_that_are_no_laws_are_named(printer, change, modes, said):
    text, notes = PrinterConfig.load(printer(PRINTER + SAVED.replace(*change))).tables("xyz", modes)
    assert "[servo]" not in text
    assert any(said in note for note in notes)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("[stepper_x]\n", r"has no section \[printer\]$"),
        ("[printer]\nmax_velocity: 9\n", r"\[printer\] has no max_accel$"),
        ("[printer]\nmax_velocity: fast\n", r"max_velocity = fast: must be a number$"),
        ("[printer]\nmax_velocity: -1\n", r"max_velocity = -1: must be finite and at least 0$"),
        ("[printer]\nmax_velocity: 9\nmax_accel: 0\n", r"max_accel = 0: must be greater than 0$"),
        ("[include absent.cfg]\n", r"absent\.cfg: cannot be read: No such file"),
        ("[include ~nosuch/a.cfg]\n", r"^~nosuch/a\.cfg: no such home folder$"),
        ("[include a\0b]\n", r"^'a\\x00b': has a zero character, which no path can have$"),
        ("[include a**b*]\n[stepper_x]\n", r"has no section \[printer\]$"),
        ("[include nosuch/*]\n[stepper_x]\n", r"has no section \[printer\]$"),
        ("[include printer.cfg]\n", r"nested more than 16 deep: does a file include itself\?$"),
    ],
)
def test_configurations_that_give_no_limits_are_refused_in_a_line(printer, gantrysim_command, text, error):
    with pytest.raises(InputError, match=error) as refused:
        PrinterConfig.load(printer(text))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("ratio", ["80:0", "80", "80:16, 3", "80:-16", "a:b"])
def test_a_gear_ratio_is_teeth_against_teeth(printer, ratio):
    text = PRINTER.replace("[include parts/*.cfg]", X.replace("80:16, 3:2", ratio))
    with pytest.raises(InputError, match=rf"\[stepper_x\] gear_ratio = {ratio}: must be as 80:16, 3:1$"):
        PrinterConfig.load(printer(text)).tables("xyz", ["stepper"] * 3)


def test_of_an_included_text_at_most_40_characters_reach_the_output(tmp_path):
    """A configuration may include any file of its reader, on purpose or not, and its values are sent on."""
    (tmp_path / "own.cfg").write_text(
        f"[printer]\nkinematics: {'my own ' * 20}\n  my = own\n[my own]\nmy_own: my own\n"
    )
    folder = tmp_path / "theirs"
    folder.mkdir()
    text = "[include ../own.cfg]\n[printer]\nmax_velocity: 300\nmax_accel: 3000\n[input_shaper]\n"
    file = folder / "printer.cfg"
    file.write_text(f"{text}shaper_type_x: {'x' * 300}\nshaper_freq_x: 50\n")
    tables, notes = PrinterConfig.load(file).tables("xyz", ["torque"] * 3)
    assert tables.count("my own") <= 6
    assert "\n  my" not in tables
    assert max(map(len, re.findall("x+", "".join([tables, *notes])))) == 40
    for name in (str(tmp_path / "own.cfg"), "own.cfg"):
        (folder / "own.cfg").unlink(missing_ok=True)
        (folder / "own.cfg").symlink_to(tmp_path / "own.cfg")
        file.write_text(f"[include {name}]\n[printer]\nmax_velocity: 300\nmax_accel: 3000\n")
        assert "max_velocity" in PrinterConfig.load(file).sections["printer"]


def test_a_printer_that_is_refused_is_so_as_an_argument_of_the_command(printer, gantrysim_command):
    file = printer("[printer]\nmax_velocity: 0\nmax_accel: 3000\n")
    status, out, err = gantrysim_command("gains", "slicer-square", "--from", "klipper", file)
    assert (status, out) == (2, "")
    assert err == f"error: --from klipper: {file}: [printer] max_velocity = 0: must be greater than 0\n"
