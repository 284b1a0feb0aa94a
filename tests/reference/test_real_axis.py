"""The measured axis of docs/validation.md: the script that makes its table, and the table where the data are."""

import contextlib
import io
import os
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from gantrysim.cli.main import main

from support.blank_pictures import save_blank
from support.doc_pages import ROOT, read_pages

SCRIPT = runpy.run_path(str(ROOT / "scripts" / "real_axis.py"))
PERIOD = SCRIPT["PERIOD"]
DATA = os.environ.get("GANTRYSIM_REAL_DATA", "")
NEAR = 0.1  # of a figure on the page, for other libraries' rounding where the slide sticks


def lap_of(command):
    """A lap without pulses, of which nothing but the command is known."""
    return SCRIPT["Lap"](command, np.full(command.size, command[0]), np.zeros(command.size), np.zeros(command.size))


def test_equation_follows_a_ramp_with_the_lag_of_its_friction():
    slide = SCRIPT["PUBLISHED"]
    speed = 0.02
    command = speed * PERIOD * np.arange(1500)
    positions, volts = SCRIPT["solved"](lap_of(command), slide)
    force = slide.viscous * speed + slide.coulomb + slide.offset
    assert np.mean(SCRIPT["NEWTON_PER_VOLT"] * volts[-500:]) == pytest.approx(force, rel=1e-3)
    # u = kv (kp e - v), with the command half a step on and the speed's mean half a step late
    lag = (force / SCRIPT["NEWTON_PER_VOLT"] / SCRIPT["KV"] + speed) / SCRIPT["KP"]
    assert np.mean((command - positions)[-500:]) == pytest.approx(lag, rel=1e-3)


def test_equation_sticks_where_friction_holds_the_force():
    slide = SCRIPT["GUESSED"]
    # a step of half of what moves the slide
    step = 0.5 * slide.coulomb / (SCRIPT["NEWTON_PER_VOLT"] * SCRIPT["KV"] * SCRIPT["KP"])
    command = np.full(300, step)
    command[0] = 0.0
    positions, volts = SCRIPT["solved"](lap_of(command)._replace(position=np.zeros(300)), slide)
    assert not positions.any()
    assert SCRIPT["NEWTON_PER_VOLT"] * volts[-1] == pytest.approx(0.5 * slide.coulomb)


def test_replayed_machine_is_beside_the_equation_and_far_from_it_without_friction(tmp_path):
    time = PERIOD * np.arange(1000)
    command = 0.02 * np.sin(2 * np.pi * time) ** 2
    slide = SCRIPT["GUESSED"]
    lap = lap_of(command)
    positions, volts = SCRIPT["solved"](lap, slide)
    (tmp_path / "machine.xml").write_text(SCRIPT["mjcf"](slide))
    log = SCRIPT["lap_log"](tmp_path / "log.csv", lap._replace(position=positions, volts=volts))
    own, frictionless = SCRIPT["replayed"](tmp_path, tmp_path / "machine.xml", log)
    assert own[0] < 2  # rms [µm]; the machine's bristles give way by 5 µm
    assert frictionless[0] > 10 * own[0]


def command_here(folder, *arguments):
    """Run a command as the script does, but in this process; the test above starts one of its own."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()):
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["gantrysim", *arguments])
        patch.setattr("matplotlib.figure.Figure.savefig", save_blank)
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code


@pytest.fixture(scope="module")
def measured_rows():
    if not DATA:
        pytest.skip("GANTRYSIM_REAL_DATA does not name the folder of the measurements")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SCRIPT["rows"].__globals__, "gantrysim", command_here)
        return {(row.model, row.judged): row for row in SCRIPT["rows"](Path(DATA), fit=False)}


def test_published_machine_follows_both_laps_as_the_equation_does(measured_rows):
    for judged in SCRIPT["LAPS"]:
        published = measured_rows["published", judged]
        assert published.rms < 2.2
        assert published.max < 13
        assert published.rms < 1.1 * measured_rows["equation", judged].rms
        assert measured_rows["frictionless", judged].rms > 10 * published.rms
        assert measured_rows["guessed", judged].rms > 3 * published.rms


def test_page_has_the_rows_of_the_measured_axis(measured_rows):
    page = read_pages()["validation.md"]
    for row in measured_rows.values():
        head = re.escape(" | ".join((*SCRIPT["MODELS"][row.model], SCRIPT["LAPS"][row.judged])))
        cells = re.search(rf"^\| {head} \|(.*)\|$", page, flags=re.MULTILINE)
        assert cells, f"run python scripts/real_axis.py {DATA} --write"
        assert [float(number) for number in re.findall(r"[\d.]+", cells[1])] == pytest.approx(
            row[2:], rel=NEAR, abs=0.1
        )
