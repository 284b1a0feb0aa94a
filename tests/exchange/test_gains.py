"""Gains in the parameters of controllers: each controller's own law gives the torque of the servo's, there and back."""

import dataclasses
import math
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.exchange.gains import BESIDE_GAINS, DIALECTS, THROUGH, export_gains, import_gains, read_gains
from gantrysim.exchange.shaper import SHAPERS, first_mode, klipper, pulses
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws import LAW_PARAMETERS
from gantrysim.servo.stability.motion import Motion

from support.runs import ramp
from support.soaked import examples

PERIOD = 5e-4
SERVO = {
    "integral_time": 0.03,
    "output_velocity": -1e-4,
    "notch_frequency": 0.0,
    "resolution": [5e-4, 2e-3],
}
AGAIN = 1e-12  # relative


def history(seed=1, ticks=40):
    """Commanded and measured positions of an axis, from rest."""
    rng = np.random.default_rng(seed)
    commanded = np.concatenate([np.zeros(2), np.cumsum(rng.normal(size=ticks))])
    return commanded, commanded - np.concatenate([np.zeros(2), rng.normal(size=ticks)])


def servo_torque(servo, a, commanded, measured, period=PERIOD):
    """The law in the time domain, written once more."""
    kp, ki, kd, vff, aff, ov = (servo.per_axis(name)[a] for name in GAIN_NAMES)
    e = commanded - measured
    d, dd = np.diff(commanded), np.diff(commanded, 2)
    return (
        kp * e[2:]
        + ki * period * np.cumsum(e)[2:]
        + kd * np.diff(e)[1:] / period
        + vff * d[1:] / period
        + aff * dd / period**2
        + ov * np.diff(measured)[1:] / period
    )


def words_of(name, servo, machine):
    text, _ = export_gains(name, machine.axes, servo)
    return [
        {word: float(value) for word, value in one.items()} for one in DIALECTS[name].read(text, list(machine.axes))
    ]


@pytest.fixture(scope="module")
def servo():
    return Servo.derive(Machine("xy").axes, PERIOD, **SERVO)


def test_trio_s_own_law_gives_the_servo_s_torque_in_dac_units(xy, servo):
    plain = Servo.derive(xy.axes, PERIOD, **SERVO, acceleration_ff=0.0)
    for a, words in enumerate(words_of("trio", plain, xy)):
        commanded, measured = history(a)
        edges = 1 / plain.drives[a].resolution
        demand, actual = commanded * edges, measured * edges
        e = demand - actual
        dac = (
            words["P_GAIN"] * e[2:]
            + words["I_GAIN"] * np.cumsum(e)[2:]
            + words["D_GAIN"] * np.diff(e)[1:]
            + words["VFF_GAIN"] * np.diff(demand)[1:]
            + words["OV_GAIN"] * np.diff(actual)[1:]
        )
        torque = dac / 2048 * plain.drives[a].torque_limit
        assert torque == pytest.approx(servo_torque(plain, a, commanded, measured), rel=1e-10, abs=1e-12)


@pytest.mark.validates(
    "gains in a controller's words: torque of its own law",
    "the servo's law, stepped in the test",
    "1e-9 relative",
)
@pytest.mark.parametrize("name", ["linuxcnc", "linuxcnc-ini"])
def test_linuxcnc_s_own_law_gives_the_servo_s_torque(xy, servo, name):
    keys = ("Pgain", "Igain", "Dgain") if name == "linuxcnc" else ("P", "I", "D")
    for a, words in enumerate(words_of(name, servo, xy)):
        commanded, measured = history(a)
        output, total, last_e, last_c, last_d = [], 0.0, 0.0, 0.0, 0.0
        for c, m in zip(commanded, measured, strict=True):
            e = c - m
            total += e * PERIOD
            d = (c - last_c) / PERIOD
            p, i, kd = (words[key] for key in keys)
            output.append(
                p * e + i * total + kd * (e - last_e) / PERIOD + words["FF1"] * d + words["FF2"] * (d - last_d) / PERIOD
            )
            last_e, last_c, last_d = e, c, d
        assert output[2:] == pytest.approx(servo_torque(servo, a, commanded, measured).tolist(), rel=1e-9, abs=1e-9)


def test_the_cascade_of_softmc_gives_the_servo_s_torque(xy, servo):
    for a, words in enumerate(words_of("softmc", servo, xy)):
        axis = xy.axes[a]
        commanded, measured = history(a)
        e = commanded - measured
        speed = (
            words["KPP"] * e[2:]
            + words["KPI"] * PERIOD * np.cumsum(e)[2:]
            + words["KPVFR"] * np.diff(commanded)[1:] / PERIOD
        )
        rad = 1 / axis.scale  # of the motor per mm
        current = words["KVP"] * rad * (speed - np.diff(measured)[1:] / PERIOD)
        current += words["KPAFR"] * rad * np.diff(commanded, 2) / PERIOD**2
        assert axis.motor_constant * current == pytest.approx(
            servo_torque(servo, a, commanded, measured), rel=1e-9, abs=1e-9
        )


built = cache(partial(Machine, "xy"))
gains = st.floats(-10, 10).map(lambda x: round(x, 6))


@pytest.mark.validates(
    "gains exported and read back: torque",
    "that of the gains before",
    "1e-12 of the largest",
)
@pytest.mark.parametrize("name", ["trio", "linuxcnc", "linuxcnc-ini", "softmc"])
@given(values=st.lists(gains, min_size=10, max_size=10))
@examples(25)
def test_exported_and_imported_gains_give_the_same_torque(name, values):
    machine = built()
    some = iter(values)
    own = {gain: [next(some), next(some)] for gain in ("kp", "ki", "velocity_ff", "acceleration_ff", "output_velocity")}
    if name == "trio":
        own["acceleration_ff"] = [0.0, 0.0]
    own["kd"] = [20.0, 30.0]
    before = Servo.derive(machine.axes, PERIOD, frequency=10.0, notch_frequency=0.0, **own)
    text, lost = export_gains(name, machine.axes, before)
    assert not any(gain in line for line in lost for gain in GAIN_NAMES)
    after = import_gains(name, text, machine.axes, before)
    for a in range(2):
        commanded, measured = history(a)
        torque = [servo_torque(one, a, commanded, measured) for one in (before, after)]
        assert np.abs(torque[1] - torque[0]).max() <= AGAIN * np.abs(torque[0]).max()
    assert (after.period, after.per_axis("torque_limit"), after.per_axis("resolution")) == (
        before.period,
        before.per_axis("torque_limit"),
        before.per_axis("resolution"),
    )


@cache
def around_velocity_drives():
    """A servo of both axes around velocity loops in the drives, that follows the speed in full."""
    return Servo.derive(built().axes, PERIOD, mode="velocity", resolution=[5e-4, 2e-3], integral_time=0.05)


@pytest.mark.parametrize("name", ["trio", "linuxcnc", "linuxcnc-ini", "softmc"])
@given(values=st.lists(gains, min_size=10, max_size=10))
@examples(15)
def test_gains_of_velocity_drives_come_back(name, values):
    machine = built()
    some = iter(values)
    names = ["kp", "ki", "velocity_ff"]
    names += {"trio": ["kd", "output_velocity"], "softmc": []}.get(name, ["kd", "acceleration_ff"])
    before = around_velocity_drives().with_values(**{gain: [next(some), next(some)] for gain in names})
    text, _ = export_gains(name, machine.axes, before)
    after = import_gains(name, text, machine.axes, before)
    assert after.modes == ("velocity", "velocity")
    for gain in (*GAIN_NAMES, "velocity_gain", "velocity_time"):
        assert after.per_axis(gain) == pytest.approx(before.per_axis(gain), rel=AGAIN, abs=1e-12), gain


def test_a_velocity_drive_takes_a_speed_in_every_controller_s_units(xy):
    """At 40 mm/s with an error of 0.1 mm each controller's output is the speed kp 0.1 mm + 40 mm/s."""
    servo = around_velocity_drives().with_values(ki=0.0)
    speed, error = 40.0, 0.1
    words = {name: words_of(name, servo, xy) for name in DIALECTS}
    for a, axis in enumerate(xy.axes):
        kp = servo.gains[a].kp
        expected = kp * error + speed
        edge = servo.drives[a].resolution
        trio = words["trio"][a]
        dac = trio["P_GAIN"] * error / edge + trio["VFF_GAIN"] * speed * PERIOD / edge
        volts = 10 * dac / 2048
        rpm_per_volt = 60 * axis.speed_limit / (2 * math.pi * axis.scale) / 10
        assert volts * rpm_per_volt / 60 * 2 * math.pi * axis.scale == pytest.approx(expected)
        ini, softmc, fanuc = (words[name][a] for name in ("linuxcnc-ini", "softmc", "fanuc"))
        assert (ini["P"] * error + ini["FF1"] * speed, ini["FF1"]) == (pytest.approx(expected), 1)
        assert softmc["KPP"] * error + softmc["KPVFR"] * speed == pytest.approx(expected)
        assert abs(fanuc["1825"] / 100 - kp) <= 0.005 * (1 + 1e-9)
        assert fanuc["2092"] == 10_000
        amperes = softmc["KVP"] * (expected - speed) / axis.scale
        assert axis.motor_constant * amperes == pytest.approx(servo.drives[a].velocity_gain * (expected - speed))
        assert 1 / softmc["KVI"] == pytest.approx(servo.drives[a].velocity_time)


@pytest.mark.parametrize("forward", [1.0, 0.0])
def test_linuxcnc_s_gains_leave_v_over_p_without_ff1_and_nothing_with_it(rigid, forward):
    """A loop P around a velocity loop follows a constant speed v by (1 - FF1) v / P."""
    machine = rigid()
    servo = Servo.derive(machine.axes, 1e-3, mode="velocity", resolution=0.0)
    text = "".join(f"[JOINT_{a}]\nP = 50\nFF1 = {forward}\nDEADBAND = 0\n" for a in range(2))
    run = simulate(machine, import_gains("linuxcnc-ini", text, machine.axes, servo), ramp(40.0, 40.0))
    cruise = slice(len(run.time) // 2, len(run.time) // 2 + 20)
    steady = (run.commanded - run.encoder)[cruise, 0]
    speed = np.diff(run.commanded[cruise, 0]).mean() / run.period
    assert steady == pytest.approx((1 - forward) * speed / 50, abs=2e-3 * speed / 50)


def test_a_drive_that_takes_positions_has_no_gains_in_the_controller(xy):
    servo = Servo.derive(xy.axes, PERIOD, mode=["velocity", "position"])
    with pytest.raises(InputError, match="the drive of axis y is in mode 'position', takes positions and closes its"):
        export_gains("trio", xy.axes, servo)
    text, notes = export_gains(
        "linuxcnc", xy.axes, Servo.derive(xy.axes, PERIOD, mode=["torque", "velocity"], feedforward=0)
    )
    assert "# Drive of axis x: torque mode, full scale 0.906 N·m" in text
    assert "# Drive of axis y: velocity mode, full scale 1000 mm/s = 6000 rpm of the motor" in text
    assert any(
        note.startswith("not among these parameters, set it separately: mode = torque, velocity") for note in notes
    )


def test_fanuc_s_loop_gain_is_rounded_to_a_hundredth_and_scales_kp(xy):
    servo = Servo.derive(xy.axes, PERIOD, feedforward=0.0, notch_frequency=0.0)
    text, notes = export_gains("fanuc", xy.axes, servo)
    assert any("torque_limit" in note for note in notes)
    after = import_gains("fanuc", text, xy.axes, servo)
    for a in range(2):
        assert abs(after.gains[a].kp - servo.gains[a].kp) / servo.gains[a].kd <= 0.005 * (1 + 1e-9)
        assert f"A{a + 1}P{round(100 * servo.gains[a].kp / servo.gains[a].kd)}" in text
    assert (after.per_axis("kd"), after.per_axis("ki")) == (servo.per_axis("kd"), servo.per_axis("ki"))
    doubled = import_gains("fanuc", "N01825 A1 P4000 A2 P1000", xy.axes, servo)
    assert doubled.gains[0].kp / servo.gains[0].kd == pytest.approx(40)


def test_a_loop_gain_beyond_what_a_fanuc_control_takes_is_noted(xy):
    """Parameter 1825 has 1 to 9999 hundredths per second."""
    velocity = Servo.derive(xy.axes, PERIOD, mode="velocity", notch_frequency=0.0, integral_time=math.inf)
    for kp, noted in (((99.99, 0.01), 0), ((100.0, 0.0), 2)):
        _, notes = export_gains("fanuc", xy.axes, velocity.with_values(kp=kp))
        assert sum("a control takes 1 to 9999" in note for note in notes) == noted


def test_what_a_file_leaves_to_the_job_or_to_a_default_is_noted(xy, servo):
    read, notes = read_gains("fanuc", "N01825 A1 P4000 A2 P1000", xy.axes, servo)
    assert read.per_axis("ki") == servo.per_axis("ki")
    # once, of all axes
    (note,) = notes
    values = ", ".join(f"{axis} {gains.ki:g}" for axis, gains in zip("xy", servo.gains, strict=True))
    assert note.startswith(f"no parameter of fanuc states ki ({values}), velocity_ff (")
    assert note.endswith("): kept from the job's servo")
    read, notes = read_gains("softmc", "x.KPP=40\nx.KVP=0.1\ny.KPP=40\ny.KVP=0.1\ny.KPVFR=1", xy.axes, servo)
    assert read.gains[0].velocity_ff == -read.gains[0].kd
    assert read.gains[1].velocity_ff == 0
    assert notes == ["KPVFR of axis x is not given: read as 0, without velocity feed-forward"]


def test_what_a_controller_has_no_word_for_is_refused(xy, servo):
    with pytest.raises(InputError) as refused:
        export_gains("trio", xy.axes, servo)
    text = str(refused.value)
    assert "\n" not in text
    for part in (
        f"trio has no parameter for acceleration_ff (x {servo.gains[0].acceleration_ff:g}, "
        f"y {servo.gains[1].acceleration_ff:g})",
        "--set servo.acceleration_ff=0; or export to linuxcnc, linuxcnc-ini, softmc",
    ):
        assert part in text
    with pytest.raises(InputError, match=r"fanuc has no parameter for ki \(x [\d.]+, y [\d.]+\), velocity_ff .*: the "):
        export_gains("fanuc", xy.axes, servo)
    resonant = Servo.derive(xy.axes, PERIOD, notch_frequency=[0.0, 120.0])
    with pytest.raises(
        InputError, match=r"softmc has no parameter for notch_frequency \(y 120\): .*notch_frequency=0$"
    ):
        export_gains("softmc", xy.axes, resonant)


# values that act, of the fields of a servo that the derived one does not have, with what they need beside; a field that
# the package gets needs its line here
ACTING = {
    "delay": {"delay": 1e-4},
    "feedback_delay": {"feedback_delay": 1},
    "current_bandwidth": {"current_bandwidth": 900.0},
    "encoder_noise": {"encoder_noise": 1e-4},
    "interpolation_error": {"interpolation_error": 1e-4, "signal_period": 0.02},
    "interpolation_error_twice": {"interpolation_error_twice": 1e-4, "signal_period": 0.02},
    "signal_period": {"signal_period": 0.02},
    "feedback": {"feedback": ["load", "motor"]},
    "encoder_seed": {"encoder_seed": 7},
    "mode": {"mode": "velocity", "kd": 0.0},
    "velocity_gain": {"mode": "velocity", "kd": 0.0, "velocity_gain": 0.01},
    "velocity_time": {"mode": "velocity", "kd": 0.0, "velocity_time": 0.01},
    "drive_period": {"mode": "velocity", "kd": 0.0, "drive_period": 2.5e-4},
    "notch_frequency": {"notch_frequency": 120.0},
    "notch_width": {"notch_frequency": 120.0, "notch_width": 0.3},
    "notch_depth": {"notch_frequency": 120.0, "notch_depth": 0.2},
    "law": {"law": ["pid", "observer"]},
    "learning_repeats": {"law": ["pid", "learning"], "learning_repeats": 3},
    "motions": {"law": ["pid", "preview"]},
    **{one.name: {"law": ["pid", one.name.split("_")[0]]} for one in LAW_PARAMETERS if "shaper" not in one.name},
    "shaper_frequency": {"law": ["pid", "zv"]},
    "shaper_damping": {"law": ["pid", "zvd"]},
    "period": {"period": 2.5e-4},
    "torque_limit": {"torque_limit": 0.5},
    "resolution": {"resolution": 2e-4},
    "following_error_limit": {"following_error_limit": 2.0},
    **{gain: {gain: 1e-3} for gain in GAIN_NAMES},
}


@pytest.mark.parametrize("name", DIALECTS)
@pytest.mark.parametrize("field", sorted(ACTING))
def test_every_field_of_the_servo_is_exported_or_listed_or_refused(field, name):
    """A servo that differs in one field gives another text, or none."""
    machine = built()
    plain = {"kp": 0.5, "kd": 6e-3, "ki": 0.0, "feedforward": 0.0, "notch_frequency": 0.0}
    before, _ = export_gains(name, machine.axes, Servo.derive(machine.axes, PERIOD, frequency=10.0, **plain))
    changes = {"period": PERIOD, **plain, **ACTING[field]}
    other = Servo.derive(machine.axes, changes.pop("period"), frequency=10.0, **changes)
    try:
        after, _ = export_gains(name, machine.axes, other)
    except InputError as refusal:
        text = str(refusal)
        assert "\n" not in text
        assert field in text or THROUGH.get(field, field) in text
    else:
        assert after != before
        carried = field in DIALECTS[name].carried_fields(other.modes[0])
        assert carried or f"{field} = " in after


def test_the_groups_of_fields_hold_each_field_once(servo):
    refused = {*GAIN_NAMES, "notch_frequency", "law"}
    groups = [refused, set(BESIDE_GAINS), set(THROUGH)]
    assert sum(map(len, groups)) == len(set().union(*groups))
    assert set().union(*groups) == set(servo.values()) == ACTING.keys()
    assert all(through in refused for through in THROUGH.values())


def test_a_gain_that_the_package_gets_is_refused_until_a_dialect_carries_it(monkeypatch, xy, servo):
    plain = Servo.derive(xy.axes, PERIOD, feedforward=0.0, notch_frequency=0.0)

    monkeypatch.delitem(THROUGH, "notch_width")  # as if it were a gain
    for name in DIALECTS:
        with pytest.raises(InputError, match=rf"^{name} has no parameter for notch_width \(x 0\.\d+, y 0\.\d+\)"):
            export_gains(name, xy.axes, plain)


def test_gains_that_cannot_be_converted_are_refused(xy, servo):
    exact = Servo.derive(xy.axes, PERIOD, resolution=0.0, acceleration_ff=0.0, notch_frequency=0.0)
    with pytest.raises(InputError, match="resolution of axis x = 0: must be finite and greater than 0"):
        export_gains("trio", xy.axes, exact)
    soft = Servo.derive(xy.axes, PERIOD, kd=0.0, notch_frequency=0.0, feedforward=0.0)
    with pytest.raises(InputError, match="kd - output_velocity of axis x = 0"):
        export_gains("fanuc", xy.axes, soft)
    with pytest.raises(InputError, match="did you mean trio"):
        export_gains("trioo", xy.axes, servo)
    with pytest.raises(InputError, match="for axis y, in the parameters of trio"):
        import_gains("trio", "P_GAIN AXIS(0)=1", xy.axes, servo)
    with pytest.raises(InputError, match=r"bias of axis x = 0\.01: must be 0"):
        import_gains("linuxcnc", "setp pid.x.Pgain 1\nsetp pid.x.bias 0.01\nsetp pid.1.Pgain 2", xy.axes, servo)


def test_trio_s_text_as_a_person_writes_it_is_read(xy, servo):
    text = "BASE(1): P_GAIN = 2.5 ' stiff\np_gain AXIS(0)=1e0\nD_GAIN=0.5\nSPEED=100\n"
    found = import_gains("trio", text, xy.axes, servo)
    r, limit = servo.per_axis("resolution"), servo.per_axis("torque_limit")
    assert found.per_axis("kp") == pytest.approx([1 / 2048 * limit[0] / r[0], 2.5 / 2048 * limit[1] / r[1]])
    assert found.per_axis("kd") == pytest.approx([0, 0.5 * PERIOD / 2048 * limit[1] / r[1]])


def left_swinging(amplitudes, times, frequency, damping):
    """Amplitude of an oscillator after impulses, of that after one at the end of the last."""
    w, root = 2 * math.pi * frequency, math.sqrt(1 - damping**2)
    ages = times[-1] - times
    sums = [(amplitudes * np.exp(-damping * w * ages) * trig(w * root * ages)).sum() for trig in (np.cos, np.sin)]
    return math.hypot(*sums)


@pytest.mark.validates(
    "input shapers for Klipper",
    "oscillator after impulses",
    "1e-9",
)
@given(frequency=st.floats(5, 500), damping=st.floats(0, 0.3), kind=st.sampled_from(SHAPERS))
def test_shapers_leave_the_mode_at_rest(frequency, damping, kind):
    amplitudes, times = pulses(kind, frequency, damping)
    assert amplitudes.sum() == pytest.approx(1, abs=1e-12)
    rest = left_swinging(amplitudes, times, frequency, damping)
    undamped = left_swinging(*pulses(kind, frequency, 0.0), frequency, 0.0)
    assert undamped == pytest.approx(0.05 if kind == "ei" else 0.0, abs=1e-9)
    assert rest <= (0.06 if kind == "ei" else 1e-9)


def test_the_first_mode_is_that_of_the_mass_behind_the_held_motor(xy):
    # x: 1 kg on 13.1 N/um with 250 N.s/m; y: 4.75 kg on 13.5 N/um with 480 N.s/m
    for axis, mass, stiffness, damping in zip(xy.axes, (1.0, 4.75), (13.1e6, 13.5e6), (250.0, 480.0), strict=True):
        mode = first_mode(axis)
        assert mode.frequency == pytest.approx(math.sqrt(stiffness / mass) / (2 * math.pi), rel=1e-6)
        assert mode.damping == pytest.approx(damping / (2 * math.sqrt(stiffness * mass)), rel=1e-5)


def test_a_rigid_machine_needs_no_shaper(rigid):
    with pytest.raises(InputError, match="axis x: no mode swings"):
        klipper(rigid().axes)


def test_klipper_gets_frequency_damping_and_pulses(xy):
    text, notes = klipper(xy.axes)
    assert not notes
    mode = first_mode(xy.axes[1])
    assert f"shaper_freq_y: {mode.frequency:.4f}" in text
    sizes, times = pulses("zv", mode.frequency, mode.damping)
    assert f"# y: zv {sizes[0]:.4f} at 0.000 ms, {sizes[1]:.4f} at {1e3 * times[1]:.3f} ms" in text


@pytest.mark.parametrize("name", [*DIALECTS, "klipper"])
def test_the_command_writes_what_it_reads(gantrysim_command, tmp_path, name):
    file = tmp_path / "gains"
    sayable = ("--set", "servo.notch_frequency=0", "--set", "servo.feedforward=0", "--set", "servo.ki=0")
    status, _, err = gantrysim_command("gains", "fanuc-spiral", *sayable, "--export", name, "--out", file)
    assert status == 0, err
    if name == "klipper":
        assert "shaper_type_x: mzv" in file.read_text()
        return
    tuned = tmp_path / "servo.toml"
    status, _, err = gantrysim_command("gains", "fanuc-spiral", *sayable, "--from", name, file, "--out", tuned)
    assert status == 0
    assert f"assumed of {name}: " in " ".join(err.split())
    status, out, err = gantrysim_command("gains", "fanuc-spiral", "--servo", tuned, "--export", name)
    assert status == 0, err
    axes = built().axes
    first, again = (DIALECTS[name].read(text, axes) for text in (file.read_text(), out))
    assert len(first) == 2
    assert all(one and other == pytest.approx(one, rel=AGAIN) for one, other in zip(first, again, strict=True))


def test_the_command_shows_all_words_and_refuses_bad_ones(gantrysim_command):
    status, out, _ = gantrysim_command("gains", "an225")
    assert status == 0
    assert all(word in out for word in ("P_GAIN", "Pgain", "KPP", "1825"))
    assert "no export: no parameter for ki, velocity_ff, acceleration_ff" in " ".join(out.split())
    status, out, err = gantrysim_command("gains", "an225", "--export", "trio")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("error: trio has no parameter for acceleration_ff (x ")
    status, _, err = gantrysim_command("gains", "an225", "--export", "siemens")
    assert (status, "unknown controller 'siemens'" in err) == (2, True)
    status, _, err = gantrysim_command("gains", "an225", "--from", "trio", "absent.bas")
    assert (status, "cannot be read" in err) == (2, True)


@pytest.mark.parametrize("creep", [0.0, 3.0])
def test_masses_that_creep_back_are_no_mode_of_an_axis(xy, creep):
    """A motor m carries one mass on a spring that swings, and another on one that is damped beyond swinging."""
    m, swinging, creeping = 2.0, (0.8, 8e4, 20.0), (0.5, 2e2, 200.0 * creep)
    A, B, C = np.zeros((6, 6)), np.zeros((6, 1)), np.zeros((1, 6))  # noqa: N806
    A[[0, 2, 4], [1, 3, 5]] = 1.0
    for at, (mass, k, c) in ((2, swinging), (4, creeping)):
        for row, inertia, sign in ((1, m, 1), (at + 1, mass, -1)):
            A[row, [at, at + 1, 0, 1]] += sign * np.array([k, c, -k, -c]) / inertia
    B[1, 0], C[0, 0] = 1 / m, 1.0
    mode = first_mode(dataclasses.replace(xy.axes[0], motion=Motion(A, B, C)))
    mass, k, c = swinging if creep else creeping
    assert mode.frequency == pytest.approx(math.sqrt(k / mass) / (2 * math.pi), rel=1e-6)
    assert mode.damping == pytest.approx(c / (2 * math.sqrt(k * mass)), abs=1e-6)


def test_joints_and_sections_beyond_the_axes_of_the_machine_are_left_alone(xy, servo):
    """An INI of a larger machine: the gains of its third joint, its spindle and of no section at all are not read."""
    text, _ = export_gains("linuxcnc-ini", xy.axes, servo)
    more = f"P = 99\n[EMC]\nP = 98\n{text}\n[JOINT_2]\nP = 97\nFF1 = 3\n[SPINDLE_0]\nP = 96\n[AXIS_Z]\nP = 95\n"
    plain, found = (import_gains("linuxcnc-ini", one, xy.axes, servo) for one in (text, more))
    assert [found.per_axis(name) for name in GAIN_NAMES] == [plain.per_axis(name) for name in GAIN_NAMES]


def test_axes_of_softmc_that_the_machine_lacks_are_left_alone(xy, servo):
    text, _ = export_gains("softmc", xy.axes, servo)
    plain, found = (
        import_gains("softmc", one, xy.axes, servo) for one in (text, f"{text}\nA9.KPP = 97\nspare.KVP = 3\n")
    )
    assert [found.per_axis(name) for name in GAIN_NAMES] == [plain.per_axis(name) for name in GAIN_NAMES]
