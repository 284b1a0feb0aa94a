"""A recorded command sent to the simulated machine again: a run repeats itself."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gantrysim import InputError, Machine, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.exchange.tables import export
from gantrysim.identify.log import Log
from gantrysim.identify.replay import CommandedLog, near_reversals, read_commanded_log, replay
from gantrysim.identify.replay_output import content, sentences
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line

MACHINE = Machine("xy")
NO_PATH = Chain([Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))])
SERVO = Servo.derive(MACHINE.axes)


@pytest.fixture(scope="module")
def spiral():
    return simulate(MACHINE, SERVO, MoveSpiral(24, 1, 5, 80))


def part(recorded, rows):
    """A stretch of a log, with nothing of what was before it."""
    log = recorded.log
    return CommandedLog(
        Log(log.axes, log.period, log.position[rows], log.torque[rows], log.held), recorded.command[rows]
    )


def test_a_run_repeats_itself_to_the_last_digit(spiral):
    found = replay(MACHINE, CommandedLog.of(spiral), SERVO)
    assert found.notes == ()
    assert np.array_equal(found.run.encoder, spiral.encoder)
    for axis in "xy":
        for quantity, values in (("following", found.following), ("torque", found.torque)):
            sizes = found.compared(axis, quantity)
            without = values(axis) - values(axis, found.frictionless)
            assert sizes["all"].frictionless.rms == pytest.approx(np.sqrt(np.mean(without**2)), rel=1e-9)
            assert sizes["all"].difference.max == 0
            assert sizes["all"].frictionless.rms > 0.3 * sizes["all"].measured.rms
            assert sizes["all"].rows == sizes["reversals"].rows + sizes["elsewhere"].rows
    # once "6.06e+09 times as much"
    assert not any("times as much" in sentence for sentence in sentences(found))


def test_a_log_that_begins_in_motion_is_followed_from_its_first_velocity(spiral):
    """Without it, the axes would start at rest, far behind the command."""
    begin = len(spiral) // 2
    speed = np.abs(np.gradient(spiral.encoder[:, 0], spiral.period))[begin]
    assert speed > 20
    found = replay(MACHINE, part(CommandedLog.of(spiral), slice(begin, None)), SERVO)
    for axis in "xy":
        assert found.compared(axis, "following")["all"].difference.max < 0.0031
        late = np.abs(found.following(axis) - found.following(axis, found.run))[200:]
        assert late.max() <= 0.0021


def test_a_known_disturbance_is_added_to_the_motor_s_torque():
    """A constant one on a stiff loop without an integral is answered by kp times the error that it makes."""
    count = 400
    servo = SERVO.with_values(ki=0.0)
    still = Log(("x",), 1e-3, np.zeros((count, 1)), np.zeros((count, 1)), held=True)
    pushed = np.full((count, 1), 0.2)
    found = replay(MACHINE, CommandedLog(still, np.zeros((count, 1)), pushed), servo)
    # what friction holds, at most 0.0208 N·m, the error need not
    assert abs(-servo.per_axis("kp")[0] * found.following("x", found.run)[-1] - 0.2) < 0.0209
    assert found.torque("x", found.run)[0] == pytest.approx(0.2)


@pytest.mark.parametrize(("dwell", "noise"), [(0, 0.0), (40, 0.0), (40, 0.002)])
def test_reversals_are_where_the_command_turns_back(dwell, noise):
    ramp = np.linspace(0, 20, 1001)
    command = np.concatenate([ramp, np.full(dwell, 20.0), ramp[::-1], ramp])
    command += noise * np.random.default_rng(1).standard_normal(command.size)
    near = near_reversals(command, 1e-3, 0.05)
    edges = np.flatnonzero(np.diff(near.astype(int)))
    turns = np.array([1000 + dwell, 2001 + dwell])
    expected = np.stack([turns - 21, turns + 100], axis=1).ravel()
    assert np.abs(edges - expected).max() <= (42 if noise else 2)


def table(tmp_path, heads, *columns):
    file = tmp_path / "log.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=heads, comments="", fmt="%.9g")
    return file


def test_command_and_disturbance_are_read_by_their_names_or_as_told(tmp_path):
    k = np.arange(200.0)
    position, command, torque, pulse = np.sin(k / 30), np.sin(k / 30) + 0.01, 0.1 * np.cos(k / 30), 0.05 * (k > 100)
    file = table(
        tmp_path,
        "time [ms],x position [um],x command [um],x torque [N·m],x disturbance [mN·m]",
        k,
        1e3 * position,
        1e3 * command,
        torque,
        1e3 * pulse,
    )
    found = read_commanded_log(file, MACHINE)
    assert found.log.axes == ("x",)
    assert not found.log.held
    np.testing.assert_allclose(found.log.position[:, 0], position, atol=1e-8)
    np.testing.assert_allclose(found.command[:, 0], command, atol=1e-8)
    np.testing.assert_allclose(found.log.torque[:, 0], torque, atol=1e-8)
    np.testing.assert_allclose(found.disturbance[:, 0], pulse, atol=1e-8)
    file = table(tmp_path, "t,q,r,u", k, position / 1e3, command / 1e3, torque)
    told = {"time": "t [ms]", "x position": "q [m]", "x demand": "u*2 N·m", "x command": "r [m]"}
    found = read_commanded_log(file, MACHINE, told)
    assert found.log.held
    np.testing.assert_allclose(found.command[:, 0], command, atol=1e-8)
    np.testing.assert_allclose(found.log.torque[:, 0], 2 * torque, atol=1e-8)
    assert found.disturbance is None
    del told["x command"]
    with pytest.raises(InputError, match="has the command of no axis with position and torque: must have a column"):
        read_commanded_log(file, MACHINE, told)


def test_a_table_that_export_writes_can_be_replayed(tmp_path, spiral):
    export(spiral, tmp_path / "run.csv", "csv")
    found = replay(MACHINE, read_commanded_log(tmp_path / "run.csv", MACHINE), SERVO)
    assert max(found.compared(axis, "following")["all"].difference.max for axis in "xy") < 1e-9


def test_held_out_rows_are_those_to_which_nothing_was_fitted(spiral):
    recorded = CommandedLog.of(spiral)
    found = replay(MACHINE, recorded, SERVO, fitted=slice(0, 300))
    sizes = found.compared("x", "following")
    assert (sizes["held out"].rows, sizes["fitted"].rows) == (len(spiral) - 300, 300)
    measured = spiral.commanded[300:, 0] - spiral.encoder[300:, 0]
    assert sizes["held out"].measured.rms == pytest.approx(np.sqrt(np.mean(measured**2)))
    assert "Rows 1 to 300 are those to which the machine was fitted" in list(sentences(found))[-1]
    for rows, words in ((slice(0, None), "No row is held out"), (slice(0, 0), "All rows are held out")):
        again = replay(MACHINE, recorded, SERVO, fitted=rows)
        assert words in list(sentences(again))[-1]
        assert content(again)["fitted_rows"] == (None if rows.stop == 0 else [1, len(spiral)])


def test_a_log_that_counts_from_another_zero_is_moved_into_the_travel(spiral):
    recorded = CommandedLog.of(spiral)
    far = CommandedLog(replace(recorded.log, position=recorded.log.position + 5000), recorded.command + 5000)
    found = replay(MACHINE, far, SERVO)
    assert "lies outside of the travel" in found.notes[0]
    assert found.compared("x", "following")["all"].difference.max < 0.005


def test_a_servo_of_another_period_and_a_fault_are_refused(spiral):
    recorded = CommandedLog.of(spiral)
    with pytest.raises(InputError, match=r"servo period = 0\.002 s: must be the period of the log, 0\.001 s"):
        replay(MACHINE, recorded, Servo.derive(MACHINE.axes, 2e-3))
    with pytest.raises(InputError, match="does not follow the log to its end: following error"):
        replay(MACHINE, recorded, SERVO.with_values(following_error_limit=0.05))


def test_the_command_prints_and_writes_all(tmp_path, spiral, gantrysim_command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    export(spiral, tmp_path / "run.csv", "csv")
    (tmp_path / "servo.toml").write_text("[servo]\nintegral_time = 0.02\n")
    status, out, err = gantrysim_command(
        "replay", "run.csv", "--machine", "xy", "--servo", "servo.toml", "--rows", "101:", "--fitted", "1:400"
    )
    assert (status, err) == (0, "")
    assert "following error [µm], measured and simulated" in out
    words = " ".join(out.split())
    assert "Without friction the same machine differs by" in words
    assert "Rows 101 to 400 are those to which the machine was fitted" in words
    content = json.loads((tmp_path / "replayed" / "replay.json").read_text())
    assert (Path(content["machine"]).stem, content["rows"], content["period_s"]) == ("xy", len(spiral) - 100, 0.001)
    assert content["fitted_rows"] == [101, 400]
    found = content["axes"]["x"]["following_error"]["held out"]
    assert found["rows"] == len(spiral) - 400
    assert found["difference_rms_um"] > 0
    assert found["explained_percent"] > found["explained_frictionless_percent"]
    assert "measured less simulated" in (tmp_path / "replayed" / "report.html").read_text()
    for arguments, message in (
        (("--fitted", "4"), "--fitted 4: must be FIRST:LAST"),
        (("--column", "x command"), "must be NAME=COLUMN"),
        (("--servo", "missing.toml"), "missing.toml"),
    ):
        status, _, err = gantrysim_command("replay", "run.csv", "--machine", "xy", *arguments)
        assert status == 2
        assert message in " ".join(err.split())


def test_a_log_that_begins_in_motion_hands_the_engine_what_was_before_its_first_row(spiral, monkeypatch):
    """Velocity of the command over the period before, and the torque that flows."""
    begun = []

    def simulated(*arguments, start, **options):
        begun.append(start)
        return simulate(*arguments, start=start, **options)

    monkeypatch.setattr("gantrysim.identify.replay.simulate", simulated)
    begin = len(spiral) // 2
    replay(MACHINE, part(CommandedLog.of(spiral), slice(begin, begin + 100)), SERVO)
    before = (spiral.commanded[begin] - spiral.commanded[begin - 1]) / spiral.period
    after = (spiral.commanded[begin + 1] - spiral.commanded[begin]) / spiral.period
    assert np.abs(after - before).min() > 0.2
    for start in begun:
        np.testing.assert_array_equal(start.torque, spiral.demand[begin])
        np.testing.assert_allclose(start.commanded_velocity, before, atol=0.02)
