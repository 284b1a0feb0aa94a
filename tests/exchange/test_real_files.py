"""Files of controllers as people have them: units, axes, drives and limits of LinuxCNC's INI files, Trio's DAC."""

import tomllib

import pytest

from gantrysim import InputError, Machine, Servo
from gantrysim.exchange.gains import export_gains, import_gains, read_gains, sign_of_velocity_drives
from gantrysim.exchange.linuxcnc import IniFile, ini_text
from gantrysim.exchange.printer_config import PrinterConfig

from support.tables import EXAMPLES

# a mill in inches with velocity drives, whose third axis is no linear one
MILL = """
[EMCMOT]
SERVO_PERIOD = 1000000
[KINS]
KINEMATICS = trivkins
[TRAJ]
COORDINATES = Y X A     # not in the machine's order
LINEAR_UNITS = inch
[AXIS_X]
MAX_VELOCITY = 2.0
[JOINT_0]
TYPE = LINEAR
P = 40
FF1 = 1.000   ; as every velocity drive
FF2 = 0.002
DEADBAND = 0.0001
MAX_VELOCITY = 3
MAX_ACCELERATION = 20
[JOINT_1]
TYPE = LINEAR
P = 50
D = 0.5
FF1 = 1
P = 99
BIAS = 0.0
MAX_VELOCITY = 4
MAX_ACCELERATION = 10
FERROR = 0.05
[JOINT_2]
TYPE = ANGULAR
P = 60
MAX_VELOCITY = 360
"""


@pytest.fixture(scope="module")
def servos():
    axes = Machine("xy").axes
    return {mode: Servo.derive(axes, mode=mode, frequency=10.0, notch_frequency=0.0) for mode in ("torque", "velocity")}


def test_gains_of_velocity_drives_do_not_depend_on_the_unit_of_length(xy, servos):
    """An error of 1 inch demands P inches per second: P is in 1/s, whatever the unit."""
    servo, notes = read_gains("linuxcnc-ini", MILL, xy.axes, servos["velocity"])
    metric = import_gains("linuxcnc-ini", MILL.replace("inch", "mm"), xy.axes, servos["velocity"])
    assert servo == metric
    assert [gains.kp for gains in servo.gains] == [50, 40]  # by letters, the first P of a section
    assert [gains.kd for gains in servo.gains] == [0.5, 0]
    assert [gains.acceleration_ff for gains in servo.gains] == [0, 0.002]
    assert notes[0] == (
        "not taken over for axis x: FERROR = 1.27, servo.following_error_limit of the job; MAX_VELOCITY = 101.6, set "
        "by the job's program: axis_speeds, acceleration; MAX_ACCELERATION = 254, set by the job's program: "
        "axis_speeds, acceleration"
    )
    (note,) = [note for note in notes if "DEADBAND" in note]
    assert note.startswith("DEADBAND of axis y = 0.00254 mm = 2.5 encoder counts: left out")


def test_another_servo_period_is_named(xy, servos):
    _, notes = read_gains("linuxcnc-ini", MILL.replace("1000000", "200000"), xy.axes, servos["velocity"])
    (note,) = [note for note in notes if "PERIOD" in note]
    assert note.startswith("SERVO_PERIOD = 0.2 ms: the job's servo has 1 ms;")
    assert note.endswith("--set servo.period=0.0002")


def test_gains_of_torque_drives_are_per_unit_of_length(xy, servos):
    """An error of 25.4 mm is one of 1 inch: both demand the torque P."""
    servo = import_gains("linuxcnc-ini", MILL, xy.axes, servos["torque"])
    assert 25.4 * servo.gains[0].kp == pytest.approx(50)
    assert 25.4 * servo.gains[0].velocity_ff == pytest.approx(1)
    for unit, length in (("mm", 1), ("cm", 10), ("0.5", 2)):
        other = import_gains("linuxcnc-ini", MILL.replace("inch", unit), xy.axes, servos["torque"])
        assert length * other.gains[1].kp == pytest.approx(40)
    with pytest.raises(InputError, match=r"LINEAR_UNITS = furlong: must be one of mm, metric, cm, inch, in, imperial"):
        import_gains("linuxcnc-ini", MILL.replace("inch", "furlong"), xy.axes, servos["torque"])


def test_velocity_drives_are_recognised_by_what_a_torque_drive_could_not_do(xy, servos):
    torque = servos["torque"]
    assert sign_of_velocity_drives(xy.axes, torque) == ""
    undamped = torque.with_values(kd=0.0, velocity_ff=0.0)
    assert "axis x has P without D, which would not damp" in sign_of_velocity_drives(xy.axes, undamped)
    beyond = torque.with_values(velocity_ff=[0.0, 0.01])  # 10 N·m at 1000 mm/s
    assert "feed-forward of axis y would take 10 N·m of 0.906 N·m" in sign_of_velocity_drives(xy.axes, beyond)


@pytest.mark.parametrize(("share", "grows"), [(1.98, False), (2.02, True)])
def test_a_d_that_would_be_unstable_is_no_torque(xy, servos, share, grows):
    """An inertia under a held torque against the difference of its last two positions."""
    inertia = xy.axes[1].inertia
    damping = share * inertia / 1e-3
    position, last, speed = 1e-3, 0.0, 1.0
    speeds = []
    for _ in range(2000):
        acceleration = -damping * (position - last) / 1e-3 / inertia
        last = position
        position += speed * 1e-3 + acceleration * 1e-3**2 / 2
        speed += acceleration * 1e-3
        speeds.append(abs(speed))
    assert (max(speeds[-10:]) > max(speeds[:10])) == grows
    gains = servos["torque"].with_values(kd=[1e-3, damping])
    assert ("as a torque, D would make the loop of axis y unstable" in sign_of_velocity_drives(xy.axes, gains)) == grows


def test_a_step_generator_s_own_loop_is_no_gain(tmp_path, gantrysim_command):
    file = tmp_path / "mill.ini"
    file.write_text(MILL.replace("TYPE = LINEAR", "STEPGEN_MAXVEL = 5\nSCALE = 4000").replace("[JOINT_2]", "[EXTRA]"))
    status, out, err = gantrysim_command("gains", "an225", "--from", "linuxcnc-ini", file)
    assert (status, "[servo]" in out, "assumed of" in err) == (0, False, False)
    assert f"{4000 / 25.4:.6g} steps/mm" in out


def test_drives_that_take_steps_or_positions_get_scale_and_limits():
    """200 full steps of 16 microsteps move a screw's lead of 10 mm; a closed loop is told its encoder's counts."""
    machine = Machine(EXAMPLES / "stepper.toml")
    servo = Servo.derive(machine.axes)
    assert servo.modes == ("stepper", "position", "stepper")
    text, (note,) = export_gains("linuxcnc-ini", machine.axes, servo)
    assert note.startswith("no gains: the drives take positions or steps")
    limits = IniFile.of(text).limits
    assert [limit.name for limit in limits] == [axis.name for axis in machine.axes] == ["x", "y", "z"]
    assert limits[0].steps == pytest.approx(200 * 16 / 10)
    assert limits[1].steps == pytest.approx(1 / servo.drives[1].resolution)
    assert [limit.speed for limit in limits] == [axis.speed_limit for axis in machine.axes]
    # a generator of steps is faster than the planner, so that it can catch up; a drive that takes positions has none
    for number, (joint, axis) in enumerate(zip(text.split("[JOINT_")[1:], machine.axes, strict=True)):
        assert joint.startswith(f"{number}]")
        assert (f"STEPGEN_MAXVEL = {1.25 * axis.speed_limit!r}" in joint) == (number != 1)
        assert ("STEPGEN_MAXVEL" in joint) == (number != 1)
        assert f"FERROR = {servo.following_error_limit[number]!r}" in joint
    program, _ = export_gains("trio", machine.axes, servo)
    assert f"UNITS={limits[0].steps!r}" in program
    assert "P_GAIN" not in program
    with pytest.raises(
        InputError, match=r"^fanuc has no parameters for drives in mode 'stepper', 'position', 'stepper': "
    ):
        export_gains("fanuc", machine.axes, servo)


def test_an_axis_without_a_joint_and_a_joint_that_turns_are_refused(xy, servos):
    without = MILL.replace("Y X A", "X Z A")
    with pytest.raises(
        InputError,
        match=r"has none of P, .* for axis y, in the parameters of linuxcnc-ini; no section is the joint of y$",
    ):
        import_gains("linuxcnc-ini", without, xy.axes, servos["torque"])
    steps = MILL.replace("[JOINT_0]\n", "[JOINT_0]\nSTEPGEN_MAXACCEL = 900\n")
    with pytest.raises(
        InputError,
        match=r"for axis y, in the parameters of linuxcnc-ini; \[JOINT_0\] is a drive that takes steps "
        r"\(STEPGEN_MAXACCEL\): a P there is the step generator's own$",
    ):
        import_gains("linuxcnc-ini", steps, xy.axes, servos["torque"])
    for value in ("nan", "1e999", "[JOINT_1]P"):
        with pytest.raises(InputError, match=r"\[JOINT_0\] P = .*: must be a finite number"):
            import_gains("linuxcnc-ini", MILL.replace("P = 40", f"P = {value}"), xy.axes, servos["torque"])
    turning = MILL.replace("[JOINT_0]\nTYPE = LINEAR", "[JOINT_0]\nTYPE = ANGULAR")
    with pytest.raises(InputError, match=r"\[JOINT_0\] TYPE = ANGULAR: axis y of the machine is in mm"):
        import_gains("linuxcnc-ini", turning, xy.axes, servos["torque"])


def test_limits_are_in_millimetres_and_the_lower_of_joint_and_axis():
    x, y = IniFile.of(MILL).limits
    assert x[:3] == ("x", pytest.approx(50.8), pytest.approx(254))
    assert y[:3] == ("y", pytest.approx(76.2), pytest.approx(508))
    assert x.following_error == pytest.approx(1.27)


STEPS = """[TRAJ]
COORDINATES = XYZ
LINEAR_UNITS = mm
#INCLUDE joints/x.inc
[JOINT_2]
MAX_VELOCITY = 5
MAX_ACCELERATION = 80
"""


def test_a_machine_of_steppers_gives_limits_that_a_job_takes(tmp_path, gantrysim_command):
    """Included files count; what is written is a table [program] that a job with G-code runs with."""
    (tmp_path / "joints").mkdir()
    (tmp_path / "joints" / "x.inc").write_text("[JOINT_0]\nMAX_VELOCITY = 20\nMAX_ACCELERATION = 100\nSCALE = -160\n")
    file = tmp_path / "mill.ini"
    file.write_text(STEPS)
    status, out, err = gantrysim_command("gains", "slicer-square", "--from", "linuxcnc-ini", file)
    assert (status, "no gains: its drives take positions or steps" in " ".join(err.split())) == (0, True)
    assert "# x: 20 mm/s, 100 mm/s², 160 steps/mm, 6.25 µm each" in out
    program = tomllib.loads(out)["program"]
    assert program == {"acceleration": 80.0, "axis_speeds": [20.0, float("inf"), 5.0]}
    settings = [part for key, value in program.items() for part in ("--set", f"program.{key}={value}")]
    status, _, err = gantrysim_command("gains", "slicer-square", *settings, "--export", "klipper")
    assert status == 0, err


def test_files_that_cannot_be_included_are_named(tmp_path):
    file = tmp_path / "mill.ini"
    file.write_text("#INCLUDE absent.inc\n")
    with pytest.raises(InputError, match=r"absent\.inc: cannot be read: No such file"):
        ini_text(file)
    file.write_text("#INCLUDE mill.ini\n")
    with pytest.raises(InputError, match="nested more than 16 deep: does a file include itself"):
        ini_text(file)


def test_files_that_include_many_are_bounded_in_number_and_length(tmp_path):
    """Fifteen files of ten inclusions each would be read 10 to the power of 14 times."""
    for k in range(15):
        (tmp_path / f"{k}.inc").write_text(f"#INCLUDE {k + 1}.inc\n[include {k + 1}.inc]\n" * 10 if k < 14 else "[A]\n")
    said = r"14\.inc: {} names more than 200 files in all: are some named repeatedly\?$"
    with pytest.raises(InputError, match=said.format("#INCLUDE")):
        ini_text(tmp_path / "0.inc")
    with pytest.raises(InputError, match=said.format(r"\[include\]")):
        PrinterConfig.load(tmp_path / "0.inc")
    (tmp_path / "long.inc").write_text("#" * (1 << 20) + "\n")
    (tmp_path / "all.ini").write_text("#INCLUDE long.inc\n" * 20)
    with pytest.raises(InputError, match=r"long\.inc: with the files before it has more than 1\.68e\+07 characters$"):
        ini_text(tmp_path / "all.ini")


@pytest.mark.parametrize("name", ["~nosuch/a", "a\0b", "/dev/zero"])
def test_inclusions_of_no_file_are_one_line(tmp_path, name):
    (tmp_path / "mill.ini").write_text(f"#INCLUDE {name}\n")
    with pytest.raises(InputError, match=r"no such home folder|zero character|is a device"):
        ini_text(tmp_path / "mill.ini")


def test_the_command_reads_velocity_drives_without_being_told(tmp_path, gantrysim_command):
    file = tmp_path / "mill.ini"
    file.write_text(MILL)
    status, out, err = gantrysim_command("gains", "an225", "--from", "linuxcnc-ini", file)
    assert (status, "read as gains of velocity drives: " in " ".join(err.split())) == (0, True)
    servo = tomllib.loads(out)["servo"]
    assert (servo["mode"], servo["kp"]) == (["velocity", "velocity"], [50.0, 40.0])
    assert "# [(mm/s)/mm]" in out
    status, out, err = gantrysim_command(
        "gains", "an225", "--set", "servo.mode='torque'", "--from", "linuxcnc-ini", file
    )
    assert tomllib.loads(out)["servo"]["kp"] == pytest.approx([50 / 25.4, 40 / 25.4])


@pytest.mark.parametrize(("scale", "factor"), [(1, 1), (16, 1), (-16, 1), (32, 2), (8, 0.5)])
def test_trio_s_dac_scale_is_16_of_a_dac_of_16_bits(xy, servos, scale, factor):
    """VFF_GAIN = 2.048 per edge of 1 µm and ms is full scale at 1000 mm/s, the speed limit."""
    program = "".join(f"VFF_GAIN AXIS({a})=2.048\nP_GAIN AXIS({a})=1\nDAC_SCALE AXIS({a})={scale}\n" for a in range(2))
    servo = import_gains("trio", program, xy.axes, servos["velocity"].with_values(resolution=1e-3))
    assert servo.per_axis("velocity_ff") == pytest.approx((factor, factor))


def test_trio_s_gains_per_other_edges_or_periods_are_refused(xy, servos):
    with pytest.raises(
        InputError, match=r"UNITS of axis x = 4000 edges per mm: the servo's encoder has 1000, and gains"
    ):
        import_gains("trio", "UNITS=4000\nP_GAIN=1\nBASE(1)\nP_GAIN=1", xy.axes, servos["torque"])
    with pytest.raises(InputError, match=r"SERVO_PERIOD = 500 us: the servo's is 1000 us, .*--set servo.period=0.0005"):
        import_gains("trio", "SERVO_PERIOD=500\nP_GAIN=1\nBASE(1)\nP_GAIN=1", xy.axes, servos["torque"])


def test_settings_beside_the_gains_are_named(xy, servos):
    """What of a joint's section acts on the real loop: the correction of P is at most 200/s x 0.0005 inch."""
    joint = (
        "TYPE = LINEAR\nP = 200\nFF1 = 1\nMAX_ERROR = 0.0005\nBACKLASH = 0.002\nMIN_FERROR = 0.004\nMAX_OUTPUT = 9\n"
    )
    text = f"[TRAJ]\nLINEAR_UNITS = inch\n[JOINT_0]\n{joint}[JOINT_1]\n{joint}"
    _, notes = read_gains("linuxcnc-ini", text, xy.axes, servos["velocity"])
    assert notes[0] == (
        "not taken over for axis x: MAX_ERROR = 0.0127, a bound of the loop, which the servo lacks; MAX_OUTPUT = 228.6,"
        " the bound of the output: servo.torque_limit of torque drives; BACKLASH = 0.0508, the controller's "
        "compensation of backlash, which is not simulated; MIN_FERROR = 0.1016, the limit of the following error at "
        "low speed: the servo has one for all speeds"
    )
    assert notes[1].startswith("MAX_ERROR of axis x bounds the correction of P to P x 0.0127 = 2.54 mm/s")
    hal = "".join(f"setp pid.{axis}.Pgain 3\nsetp pid.{axis}.maxerror 0.1\n" for axis in "xy")
    assert read_gains("linuxcnc", hal, xy.axes, servos["torque"])[1][1] == (
        "not taken over for axis y: maxerror = 0.1, a bound of the loop, which the servo lacks"
    )
    trio = "".join(f"BASE({k})\nP_GAIN=1\nFE_LIMIT=7\n" for k in range(2))
    assert read_gains("trio", trio, xy.axes, servos["torque"])[1] == [
        f"not taken over for axis {axis}: FE_LIMIT = 7, servo.following_error_limit of the job" for axis in "xy"
    ]


@pytest.mark.parametrize("name", ["trio", "linuxcnc", "linuxcnc-ini"])
def test_a_file_of_the_servo_s_own_has_nothing_that_is_not_taken_over(name, xy, servos):
    servo = servos["torque"].with_values(acceleration_ff=0.0)
    text, _ = export_gains(name, xy.axes, servo)
    notes = read_gains(name, text, xy.axes, servo)[1]
    assert [note for note in notes if note.startswith("not taken")] == []
