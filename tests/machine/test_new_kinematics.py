"""A kinematics is one file and its line in the list."""

import ast
import json
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import gantrysim
from gantrysim.machine.kinematics import KINEMATICS

PACKAGE = Path(gantrysim.__file__).parent
ARCHITECTURE = Path(__file__).parent.parent.parent / "docs" / "architecture.md"

SCARA = '''"""Two arms in series that turn about parallel hinges, and carry the nozzle in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.kinematics.base import DEG, MM, Coordinate, Kinematics, UnreachableError


@dataclass(frozen=True, eq=False, kw_only=True)
class Scara(Kinematics):
    """From the shoulder at s: p = s + L1 e(p1 + a1) + L2 e(p2 + a1 + a2), with e(a) = (cos a, sin a).

    Attributes:
        coordinates: x and y of the nozzle in the work frame.
        shoulder: s, (2,) [mm].
        length: L1 and L2, (2,) [mm].
        direction: p1 and p2, of the arms with all axes at zero, (2,) [rad].
    """

    coordinates: tuple[Coordinate, ...]
    shoulder: Floats
    length: Floats
    direction: Floats

    @classmethod
    def of(cls, model: mujoco.MjModel, driven: Sequence[int], nozzle: int, work: int) -> Scara:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        frame = data.xmat[work].reshape(3, 3)
        points = np.array([*data.xanchor[list(driven)], data.site_xpos[nozzle]])
        places = MM * (points - data.xpos[work]) @ frame
        arms = np.diff(places[:, :2], axis=0)
        return cls(
            coordinates=tuple(Coordinate(name, "mm", (-np.inf, np.inf)) for name in "xy"),
            shoulder=places[0, :2],
            length=np.linalg.norm(arms, axis=1),
            direction=np.arctan2(arms[:, 1], arms[:, 0]),
        )

    def forward(self, axes: Floats) -> Floats:
        angle = self.direction + np.cumsum(axes, axis=1) / DEG
        arms = np.stack([np.cos(angle), np.sin(angle)], axis=2) * self.length[:, None]
        return self.shoulder + arms.sum(axis=1)

    def inverse(self, position: Floats) -> Floats:
        reach = position - self.shoulder
        first, second = self.length
        cosine = (np.sum(reach**2, axis=1) - first**2 - second**2) / (2 * first * second)
        out = np.abs(cosine) > 1
        if out.any():
            row = int(out.argmax())
            raise UnreachableError(f"{self.position_text(position[row])}: out of reach", row)
        elbow = np.sign(np.sin(self.direction[1] - self.direction[0])) * np.arccos(cosine)
        towards = np.arctan2(reach[:, 1], reach[:, 0])
        shoulder = towards - np.arctan2(second * np.sin(elbow), first + second * np.cos(elbow))
        axes = np.stack([shoulder - self.direction[0], elbow - self.direction[1] + self.direction[0]], axis=1)
        return DEG * np.arctan2(np.sin(axes), np.cos(axes))
'''

MODEL = """
<mujoco>
  <size nuser_jnt="1" nuser_sensor="1"/>
  <compiler angle="degree" autolimits="true"/>
  <option timestep="0.00025" integrator="Euler" gravity="0 0 0"><flag contact="disable"/></option>
  <custom><text name="kinematics" data="scara"/></custom>
  <default>
    <joint range="-170 170" user="30" damping="0.01"/>
    <dcmotor gear="100" input="ff" controller="0 0 0 0 0 48" motorconst="0.05 0.05" resistance="0.5"
      inductance="5e-4" saturation="0 20 0" armature="2e-5"/>
  </default>
  <worldbody>
    <body name="work" pos="0.1 0.2 0.3" euler="0 0 20"/>
    <body name="upper" pos="-0.1 0.1 0.3" euler="0 0 20">
      <joint name="a1" type="hinge" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="2"/>
      <body name="fore" pos="0.25 0 0" euler="0 0 70">
        <joint name="a2" type="hinge" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="1"/>
        <site name="nozzle" pos="0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <dcmotor name="a1" joint="a1"/>
    <dcmotor name="a2" joint="a2"/>
  </actuator>
  <sensor>
    <actuatorpos name="a1" actuator="a1" user="100000"/>
    <actuatorpos name="a2" actuator="a2" user="100000"/>
  </sensor>
</mujoco>
"""

# half a circle of 30 mm about (60, 150)
JOB = """
name = "scara"
machine = "scara.xml"

[program]
controller = "softmc.Program"
start = [90.0, 150.0]
program = "Circle G1 CirclePoint={60, 180} TargetPoint={30, 150}"

[program.group]
velocity = 60.0
acceleration = 1500.0
profile = "sine"

[servo]
law = "pid"

[dispenser]
area = 2.5
"""

RUN = """
import json, sys
sys.path.insert(0, sys.argv[1])
import gantrysim
from gantrysim.job.causes import causes_of

job = gantrysim.Job.load("job.toml")
machine = job.built_machine
run = job.run()
effects = causes_of(job, run).effects
try:
    job.changed({"servo.law": ["pid", "contour"]}).run()
except gantrysim.base.errors.InputError as refusal:
    refused = str(refusal)
print(json.dumps({
    "package": gantrysim.__file__,
    "axes": machine.axis_names,
    "coordinates": machine.kinematics.names,
    "home": machine.home.tolist(),
    "tip": machine.tip([0.0, 0.0]).tolist(),
    "nozzle": run.nozzle.tolist(),
    "fault": str(run.fault),
    "causes": [effect.cause.name for effect in effects],
    "refused": refused,
}))
"""


def _copied_if_there(source, target):
    """Copy a file, but for one that goes meanwhile: other tests write compiled code beside it under passing names."""
    with suppress(FileNotFoundError):
        shutil.copy2(source, target)


@pytest.mark.soak
def test_a_kinematics_is_added_by_its_file_and_its_line(fresh, tmp_path):
    """In a copy of the package: machine, checks, run, budget and causes ask it through its interface."""
    recipe = "**Kinematics** are a class in a file of `machine/kinematics/` and its line in `KINEMATICS` there"
    assert recipe in " ".join(ARCHITECTURE.read_text(encoding="utf-8").split())
    copy = shutil.copytree(PACKAGE, tmp_path / "gantrysim", copy_function=_copied_if_there)
    (copy / "machine" / "kinematics" / "scara.py").write_text(SCARA, encoding="utf-8")
    registry = copy / "machine" / "kinematics" / "__init__.py"
    text = registry.read_text(encoding="utf-8")
    line = "KINEMATICS: dict[str, type[Kinematics]] = {"
    assert text.count(line) == 1
    imported = "from gantrysim.machine.kinematics.scara import Scara\n"
    registry.write_text(text.replace(line, f'{imported}{line}"scara": Scara, '), encoding="utf-8")
    (tmp_path / "scara.xml").write_text(MODEL, encoding="utf-8")
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    done = fresh.run(RUN, tmp_path, tmp_path)
    assert (done.status, done.error) == (0, "")
    shown = json.loads(done.output)
    assert Path(shown["package"]).parent == copy
    assert (shown["axes"], shown["coordinates"]) == (["a1", "a2"], ["x", "y"])
    assert shown["fault"] == "None"
    assert shown["tip"] == pytest.approx([*shown["home"], 0.0])
    nozzle = np.array(shown["nozzle"])
    assert np.abs(np.hypot(nozzle[:, 0] - 60, nozzle[:, 1] - 150) - 30).max() < 0.02
    assert nozzle[-1] == pytest.approx([30, 150, 0], abs=1e-2)
    assert {"program", "sampling"} <= set(shown["causes"])
    assert "law 'contour' on machine scara: its axes are not coordinates of its nozzle" in shown["refused"]


def test_nobody_asks_for_one_kinematics():
    """A question by the class of one kinematics has no answer for the next."""
    for file in PACKAGE.rglob("*.py"):
        if file.parent.name == "kinematics":
            continue
        text = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "machine.kinematics" in text else ():
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gantrysim.machine.kinematics"):
                names = {alias.name for alias in node.names}
                assert not names & {kinematics.__name__ for kinematics in KINEMATICS.values()}, file


def test_axes_in_series_alone_are_coordinates():
    assert [name for name, kinematics in KINEMATICS.items() if kinematics.axes_are_coordinates] == ["serial"]
