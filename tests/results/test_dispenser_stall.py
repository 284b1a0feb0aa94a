"""A driven dispenser whose motor stalls or is left behind: the run fails, and says when, where and by how much."""

import json
import math

import numpy as np
import pytest

from gantrysim import Job, Verdict
from gantrysim.glue.dispenser.command import Material
from gantrysim.glue.dispenser.driven import Load, loads
from gantrysim.results.verdict import _stall

AREA = 0.8  # [mm²]
SPEED = 100.0  # [mm/s]
VISCOSITY = 8.0  # [Pa·s]
BORE = 0.84
LENGTH = 12.0  # [mm]
PLUNGER = 16.0  # [mm]
COMPLIANCE = 0.02  # [mm³/kPa]
SEAL = 5.0  # [N]
LINE = "G21 G17 G90 G94 G64\nG0 X-80 Y0\nM62 P0\nG1 X0 F6000\nG1 X80\nM63 P0\nM2\n"
NEEDLE = {"bore": BORE, "length": LENGTH, "consistency": VISCOSITY, "index": 1.0}
# Hagen and Poiseuille [kPa·s/mm³]
RESISTANCE = 8 * VISCOSITY * LENGTH * 1e-3 / (math.pi * (0.5 * BORE * 1e-3) ** 4) * 1e-9 / 1e3
SECTION = math.pi * PLUNGER**2 / 4  # [mm²]
FORCE = SEAL + SECTION * RESISTANCE * AREA * SPEED * 1e-3  # of the steady flow [N]


def line_job(program=None, **dispenser):
    return Job.of_content(
        {
            "name": "line",
            "machine": "xyz",
            "program": program or {"controller": "linuxcnc.Program", "text": LINE},
            "dispenser": {"area": AREA, "needle": NEEDLE, **dispenser},
        },
        "job line",
    )


def piston(**values):
    table = {"plunger": PLUNGER, "compliance": COMPLIANCE, "charge": math.inf, "seal_friction": SEAL, **values}
    return {"kind": "piston", "piston": table}


def checks_of(verdict):
    return {check.name: check for check in verdict["machine"].checks}


def pressures(run):
    """The pressure after each period: a resistance and a capacity, exactly over a constant flow [kPa]."""
    decay = math.exp(-run.period / (RESISTANCE * COMPLIANCE))
    pressure = np.zeros(len(run.time))
    now = 0.0
    for k, flow in enumerate(run.flow_demand):
        now = RESISTANCE * flow + (now - RESISTANCE * flow) * decay
        pressure[k] = now
    return pressure


@pytest.mark.parametrize("share", [0.5, 0.9, 1.3, math.inf])
def test_a_motor_without_the_force_for_its_flow_fails_where_it_stalls(share):
    force = share * FORCE
    job = line_job(**piston(force=force))
    run = job.follow()
    verdict = Verdict.of(job, run)
    check = checks_of(verdict).get("dispenser_force")
    if share == math.inf:
        assert check is None
        assert verdict.stall == ""
        return
    needed = SEAL + SECTION * pressures(run) * 1e-3
    assert check.value == pytest.approx(needed.max(), rel=1e-3)
    assert check.value == pytest.approx(FORCE, rel=1e-2)
    assert (check.limit, check.unit, check.at_least, check.source) == (force, "N", False, "given")
    if share > 1:
        assert (check.state, verdict.stall) == ("pass", "")
        assert verdict.content()["dispenser_stall"] is None
        assert "motor" not in verdict.headline
        return
    first = int(np.argmax(needed > force))
    assert check.state == verdict.state == "fail"
    assert check.place.time == pytest.approx(run.time[first], abs=2 * run.period)
    assert check.place.point == pytest.approx(tuple(run.nozzle[first]), abs=2 * SPEED * run.period)
    assert check.place.line in (4, 5)
    asked = f"force {check.value:.4g} N, limit {force:.4g} N"
    assert verdict.stall == f"the dispenser's motor stalls at t = {check.place.time:.4f} s: {asked}"
    assert verdict.headline.startswith(f"✗ fail: {verdict.stall}; ")
    assert "machine" in verdict.headline
    assert verdict.content()["dispenser_stall"] == verdict.stall
    assert f"force of the dispenser's motor {check.value:.4g} N, at most {force:.4g} N (given): t = " in str(verdict)


def test_a_pump_s_torque_is_its_pressure_times_its_displacement_by_two_pi():
    displacement = 50.0
    torque = RESISTANCE * 1e3 * AREA * SPEED * displacement * 1e-9 / (2 * math.pi)
    pump = {"displacement": displacement, "compliance": COMPLIANCE, "torque": 0.6 * torque}
    job = line_job(kind="volumetric", pump=pump)
    verdict = Verdict.of(job, job.follow())
    check = checks_of(verdict)["dispenser_torque"]
    assert check.value == pytest.approx(torque, rel=1e-2)
    assert (check.unit, check.state) == ("N·m", "fail")
    assert "stalls at t = " in verdict.headline
    # what it then lays is less than what was asked, by what its pressure drives
    run = job.follow()
    assert run.flow.max() == pytest.approx(0.6 * AREA * SPEED, rel=1e-6)


FED = "M83\nG1 X-80 F6000\nG1 X80 E8 F{feed}\nG1 X-80 E2 F1200\n"


@pytest.mark.parametrize(("feed", "asked"), [(2400, 2.0), (1200, 1.0)])
def test_a_motor_that_is_sent_positions_faster_than_it_turns_fails(feed, asked):
    """E8 on 160 mm at 40 mm/s takes 4 s: 2 mm/s."""
    program = {"controller": "slicer.Program", "text": FED.format(feed=feed), "start": [-80, 0, 0]}
    job = line_job(program, area=0.0, **piston(force=math.inf), motor={"top_speed": 1.5})
    verdict = Verdict.of(job, job.follow())
    check = checks_of(verdict)["dispenser_speed"]
    assert check.value == pytest.approx(asked, rel=1e-9)
    assert (check.limit, check.unit) == (1.5, "mm/s")
    assert check.state == ("fail" if asked > 1.5 else "pass")
    assert verdict.stall.startswith("the dispenser's motor cannot follow its command at t = ") == (asked > 1.5)
    if asked > 1.5:
        assert check.place.line == 3


def test_a_peak_of_speed_shorter_than_a_rotor_s_swing_is_followed():
    """A step of 0.01 mm in a millisecond is 10 mm/s, but 1 mm/s over 10 ms."""
    job = line_job(area=0.0, **piston(), motor={"top_speed": 1.5})
    drive = job.dispenser.drive
    fed = np.where(np.arange(100) < 50, 0.0, 0.01)
    result = job.dispenser.driven(np.ones(100, bool), np.zeros(100), 1e-3, Material(fed))
    (load,) = loads(drive, result, 1e-3, by_position=True)
    assert load.value == pytest.approx(1.0)
    assert not load.exceeds
    # one that is sent speeds turns as fast as it can
    assert loads(drive, result, 1e-3, by_position=False) == ()


def test_a_stall_is_a_fault_in_command_summary_and_exit_status(gantrysim_command, tmp_path):
    for share, wanted in ((0.5, 3), (1.3, 0)):
        source = tmp_path / "line.toml"
        source.write_text(line_job(**piston(force=share * FORCE)).toml())
        out = tmp_path / f"{wanted}"
        status, _, errors = gantrysim_command(
            "run", source, "--out", out, "--no-report", "--no-video", "--no-causes", "--no-improve"
        )
        assert status == wanted
        summary = json.loads((out / "summary.json").read_text())
        stall = summary["verdict"]["dispenser_stall"]
        assert (stall is not None) == (wanted == 3)
        if stall:
            assert f"fault: {stall}" in errors.replace("\n", " ")
            assert summary["verdict"]["state"] == "fail"


def test_what_happens_first_is_told_not_what_exceeds_its_limit_most():
    run = line_job().follow()
    force = Load("force", 30.0, 10.0, "N", 500, "stalls")
    speed = Load("speed", 11.0, 10.0, "mm/s", 300, "cannot follow its command")
    text = "the dispenser's motor cannot follow its command at t = 0.3000 s: speed 11 mm/s, limit 10 mm/s"
    assert _stall([force, speed], run) == _stall([speed, force], run) == text
    assert _stall([force._replace(value=10.0)], run) == ""
