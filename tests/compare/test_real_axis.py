"""A measured axis beside the right machine, one without friction and a guessed one, where its data are."""

import os
import runpy
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gantrysim import Machine, Servo, simulate
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.measured import Assignment, Trace
from gantrysim.compare.page import headline
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints
from gantrysim.tables.reading import read_table

from support.doc_pages import ROOT

FILE = ROOT / "scripts" / "real_axis.py"
SCRIPT = runpy.run_path(str(FILE))
PERIOD = SCRIPT["PERIOD"]
DATA = os.environ.get("GANTRYSIM_REAL_DATA", "")


@pytest.fixture(scope="module")
def lap():
    if not DATA:
        pytest.skip("GANTRYSIM_REAL_DATA does not name the folder of the measurements")
    return SCRIPT["Lap"].read(Path(DATA) / "emps_1.mat")


def simulated(lap, slide, file):
    """The machine of a slide, and its record under the lap's command as a path along x."""
    file.write_text(SCRIPT["mjcf"](slide))
    machine = Machine(file)
    command = 1e3 * lap.command
    turns = [0, *(np.flatnonzero(np.diff(np.sign(np.diff(command))) != 0) + 1).tolist(), len(command) - 1]
    path = Chain([Line((command[a], 0.0, 0.0), (command[b], 0.0, 0.0)) for a, b in pairwise(turns)])
    progress = np.minimum(np.concatenate([[0.0], np.cumsum(np.abs(np.diff(command)))]), path.length)
    glue = np.ones(len(command), bool)
    setpoints = Setpoints(PERIOD, ("x",), command[:, None], glue, path, progress=progress)
    # the frequency is of gains that the law does not use
    return machine, simulate(machine, Servo.derive(machine.axes, PERIOD, frequency=20, law=f"{FILE}:law"), setpoints)


def test_the_right_machine_is_told_from_wrong_ones_along_the_path(lap, tmp_path):
    """What the axis does lies along its path: across it nothing is measured, and nothing may be claimed of it."""
    published = SCRIPT["PUBLISHED"]
    slides = {
        "published": published,
        "guessed": SCRIPT["GUESSED"],
        "frictionless": published._replace(viscous=1e-3, coulomb=1e-3),
    }
    log = SCRIPT["lap_log"](tmp_path / "lap.csv", lap)
    records = {name: simulated(lap, slide, tmp_path / f"{name}.xml") for name, slide in slides.items()}
    following = {}
    torque = {}
    for name, (machine, run) in records.items():
        trace = Trace.of(read_table(log), Assignment({}), run)
        found = Comparison.of(trace, run, machine, frictionless=records["frictionless"][1])
        sizes = {row.quantity: row.difference.rms for row in found.over_time}
        following[name] = 1e3 * sizes["following error"]
        torque[name] = 1e3 * sizes["torque"]
        text = headline(found)
        assert "no difference is left" not in text
        assert "there is no error across the path" in text
        assert ("does not tell the machine from one without friction for x" in text) == (name == "frictionless")
    # the run starts at rest, 42 µm ahead of the lap
    assert following["published"] < 2.5  # [µm]
    assert following["guessed"] > 2.5 * following["published"]
    assert following["frictionless"] > 10 * following["published"]
    assert torque["guessed"] > 2.5 * torque["published"]
    assert torque["frictionless"] > 10 * torque["published"]
