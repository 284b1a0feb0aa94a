"""A part of a drive is its file, its line in the list, and the key of the table that states it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gantrysim

from support.tables import SCREW, ideal

WEAR = '''"""Coulomb friction that grows with the distance from the middle of a worn guide."""

from __future__ import annotations

import numpy as np

from gantrysim.engine.drives.part import DrivePart

_PRESLIDING = 5e-6  # [m]


def _entry(driven):
    wear = driven.stated("wear", 0.0)
    return {"wear": 1e3 * wear} if wear else {}


def _rub(row, tape, axis, drive):
    worn = drive.worn
    if worn.wear > 0.0:
        speed = row.joint_speed[axis]
        row.applied[axis] -= worn.wear * abs(row.joint_place[axis]) * worn.slid
        side = np.sign(speed)
        worn.slid = side + (worn.slid - side) * np.exp(-abs(speed) * row.period / row.substeps / _PRESLIDING)


WORN = DrivePart(
    "worn",
    [("wear", np.float64), ("slid", np.float64)],
    _entry,
    (("drive", _rub),),
    lambda servo, entries: bool(entries["wear"].any()),
)
'''

# What is asked of the package with that part: at 50 mm/s a worn screw of 20 mm per turn takes 0.05 N per mm more.
ASKED = """
import math
import sys
import numpy as np
from gantrysim import Machine, Servo, simulate
from support.runs import ramp

worn, plain = (Machine(path) for path in sys.argv[1:])
runs = [simulate(machine, Servo.derive(machine.axes, resolution=0.0), ramp(50.0)) for machine in (worn, plain)]
moving = slice(1600, 2700)  # from 10 to 65 mm
more = runs[0].torque[moving, 0] - runs[1].torque[moving, 0]
place = np.abs(runs[0].motor[moving, 0])
expected = 0.05 * place * 0.020 / (2 * math.pi)
assert expected.max() > 2 * expected.min()
assert np.abs(more - expected).max() < 0.02 * expected.max(), (more, expected)
"""


@pytest.mark.soak  # compiles the servo tick anew
def test_position_dependent_friction_is_added_by_three_files(tmp_path):
    """In a copy of the package, compiled anew: a table states the friction, and the motor gives its torque."""
    package = tmp_path / "gantrysim"
    shutil.copytree(Path(gantrysim.__file__).parent, package, ignore=shutil.ignore_patterns("*.tmp*", "*.pyc*"))
    drives = package / "engine" / "drives"
    (drives / "worn.py").write_text(WEAR)
    _insert(
        drives / "__init__.py",
        "from gantrysim.engine.native.functions",
        "from gantrysim.engine.drives.worn import WORN\n",
    )
    _insert(drives / "__init__.py", "DRIVE = np.dtype(", "PARTS = (*PARTS, WORN)\n\n")
    keys = package / "machine" / "design" / "table.py"
    _insert(keys, "    friction: NotNegative", '    wear: NotNegative = key("friction of worn guides [N/mm]", 0.0)\n')
    _insert(keys, '            "efficiency": self.efficiency', '            "wear": self.wear,\n')
    tables = [tmp_path / "worn.toml", tmp_path / "plain.toml"]
    for table, wear in zip(tables, ("wear = 0.05\n", ""), strict=True):
        table.write_text(ideal(SCREW.replace("damping_ratio = 0", wear + "damping_ratio = 0.5")))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])}
    asked = subprocess.run(
        [sys.executable, "-P", "-c", ASKED, *tables], env=environment, capture_output=True, text=True, check=False
    )
    assert asked.returncode == 0, asked.stderr


def _insert(file: Path, line: str, text: str) -> None:
    lines = file.read_text().splitlines(keepends=True)
    (place,) = (number for number, content in enumerate(lines) if content.startswith(line))
    lines.insert(place, text)
    file.write_text("".join(lines))
