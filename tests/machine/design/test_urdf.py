"""A URDF with its table: directions, travel, inertia and modes against its own numbers, and what is missing."""

import math
import re
import struct

import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh

from gantrysim import InputError, Machine, simulate
from gantrysim.machine.checks import notes
from gantrysim.machine.design.build import modes
from gantrysim.machine.design.library import motor_of

from support.runs import plain, ramp

LEAD = 5.0  # [mm]
STIFFNESS = 40.0  # [N/µm]
SCREW = 2e-6  # [kg·m²]
NUT = 0.15  # [kg], the default
MASS = {"x": 3.0 + NUT, "y": 4.0, "z": 1.0}  # that each joint carries: carriage with ram and its nut, bed, ram [kg]
INERTIAL = """<inertial><mass value="{}"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""
# bed on y under a carriage that looks the other way: both joints count against their axes
URDF = f"""
<robot name="printer">
  <link name="frame"/>
  <link name="bed">{INERTIAL.format(4)}
    <visual><geometry><mesh filename="package://printer/meshes/bed.dae"/></geometry></visual>
    <collision><geometry><mesh filename="package://printer/meshes/bed.stl"/></geometry></collision></link>
  <link name="carriage">{INERTIAL.format(2)}<visual><geometry><box size="0.06 0.06 0.1"/></geometry></visual></link>
  <link name="ram">{INERTIAL.format(1)}</link>
  <link name="tool"/>
  <joint name="jy" type="prismatic"><parent link="frame"/><child link="bed"/>
    <origin xyz="0.3 0.2 0.1" rpy="0 0 {math.pi / 2!r}"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.15" effort="100" velocity="0.2"/></joint>
  <joint name="jx" type="prismatic"><parent link="frame"/><child link="carriage"/>
    <origin xyz="0.3 0.2 0.3" rpy="0 0 {math.pi!r}"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.2" effort="100" velocity="9"/><dynamics damping="7" friction="3"/></joint>
  <joint name="jz" type="prismatic"><parent link="carriage"/><child link="ram"/>
    <origin xyz="0 0 -0.05"/><axis xyz="0 0 1"/><limit lower="-0.001" upper="0.08" effort="1" velocity="9"/></joint>
  <joint name="mount" type="fixed"><parent link="ram"/><child link="tool"/><origin xyz="0 0.01 -0.03"/></joint>
</robot>
"""
DRIVE = f"""
motor = "maxon-re40-48"
encoder = 10000
voltage = 48
transmission = {{ kind = "screw", lead = {LEAD}, inertia = {SCREW}, stiffness = {STIFFNESS} }}
"""
TABLE = f"""
urdf = "printer.urdf"
nozzle = {{ link = "tool", position = [0, 0, -40] }}
work = "bed"
[x]
joint = "jx"
[x.drive]{DRIVE}
[y]
joint = "jy"
[y.drive]{DRIVE}
[z]
joint = "jz"
[z.drive]{DRIVE}
"""


def written(folder, urdf=URDF, table=TABLE):
    """The path of a URDF in a package, with the table beside it and a triangular mesh in the package."""
    (folder / "robots").mkdir(exist_ok=True)
    (folder / "meshes").mkdir(exist_ok=True)
    corners = np.array([[0.1, 0.1, 0], [-0.1, 0.1, 0], [0, -0.1, 0], [0, 0, -0.02]])
    with (folder / "meshes" / "bed.stl").open("wb") as stream:
        stream.write(bytes(80) + struct.pack("<I", 4))
        for corner in ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)):
            stream.write(struct.pack("<12fH", 0, 0, 0, *corners[list(corner)].ravel(), 0))
    file = folder / "robots" / "printer.urdf"
    file.write_text(urdf)
    beside = file.with_suffix(".toml")
    beside.unlink(missing_ok=True)
    if table:
        beside.write_text(table)
    return file


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    return Machine(written(tmp_path_factory.mktemp("printer")))


def test_the_axes_count_along_the_work(machine):
    assert machine.axis_names == ("x", "y", "z")
    # x of the joint looks to -x, and a bed that moves to +y is a nozzle that moves to -y
    travel = np.array([axis.travel for axis in machine.axes])
    assert travel == pytest.approx(np.array([(-200, 100), (-150, 100), (-1, 80)]))
    positions = np.array([[0, 0, 0], [10, 20, 5], [-100, 80, 70.0]])
    assert machine.tip(positions) == pytest.approx(positions, abs=1e-9)
    assert machine.gap == pytest.approx(0.5)
    assert notes(machine) == ()
    # the joint's speed counts where it is the lower one, its effort never: the drive has its own limit
    limits = [axis.speed_limit for axis in machine.axes]
    assert limits[1] == pytest.approx(200)
    assert limits[0] == limits[2] > 300
    assert machine.axes[2].peak_torque == motor_of("maxon-re40-48").K * 15.0
    # the bed's mesh, which the package holds, is there; its drawing, in a format that MuJoCo does not read, is not
    meshes = [machine.model.mesh(k).name for k in range(machine.model.nmesh)]
    assert meshes == ["bed"]


def test_inertia_friction_and_modes_follow_from_the_urdf(machine):
    per_turn = 1e-3 * LEAD / (2 * math.pi)  # [m/rad]
    armature = motor_of("maxon-re40-48").rotor_inertia + SCREW
    for axis in machine.axes:
        reflected = armature + (MASS[axis.name] + NUT) * per_turn**2
        assert axis.inertia * axis.scale == pytest.approx(reflected, rel=1e-9)
    motor_coulomb, _ = motor_of("maxon-re40-48").friction
    x, y, _ = machine.axes
    assert x.coulomb - y.coulomb == pytest.approx(3.0 * per_turn, rel=1e-9)
    assert y.coulomb == pytest.approx(motor_coulomb, rel=1e-9)
    held = [int(dof) for dof in machine.physics.jnt_dofadr[machine.physics.actuator_trnid[:, 0]]]
    found, _ = modes(machine.physics, None, held)
    squares = [1e6 * STIFFNESS / MASS["x"], 1e6 * STIFFNESS / MASS["y"], 1e6 * STIFFNESS / MASS["z"]]
    assert found == pytest.approx(np.sort(np.sqrt(squares)) / (2 * math.pi), rel=1e-5)
    # free: two masses on a spring each
    rotor = armature / per_turn**2 + NUT
    free, _ = modes(machine.physics)
    for name in ("x", "y", "z"):
        stiffness = 1e6 * STIFFNESS * np.array([[1, -1], [-1, 1]])
        squared = eigh(stiffness, np.diag([rotor, MASS[name]]), eigvals_only=True)[-1]
        assert np.abs(free / (math.sqrt(squared) / (2 * math.pi)) - 1).min() < 1e-5


def test_it_holds_its_weight_and_runs(machine):
    data = mujoco.MjData(machine.physics)
    mujoco.mj_forward(machine.physics, data)
    z = int(machine.physics.joint("z").dofadr[0])
    assert data.qfrc_passive[z] - data.qfrc_bias[z] == pytest.approx(0, abs=1e-9)
    setpoints = ramp(50.0, 3)
    run = simulate(machine, plain(machine), setpoints)
    assert run.fault is None
    assert np.abs(run.nozzle - run.commanded)[-1].max() < 0.01


def test_a_urdf_without_a_table_is_answered_with_what_the_table_holds(tmp_path):
    file = written(tmp_path, table="")
    with pytest.raises(InputError) as error:
        Machine(file)
    text = str(error.value)
    assert "\n" not in text
    for part in (
        "printer.toml beside it",
        'urdf = "printer.urdf"',
        "prismatic joints: jy, jx, jz",
        "links: frame, bed",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            '"tool"',
            '"tol"',
            "nozzle.link = 'tol': printer.urdf has no such link; it has frame, bed, car",
        ),
        ('joint = "jx"', 'joint = "j"', "x.joint = 'j': printer.urdf has no such joint; it has jy, jx, jz, mount"),
        ('joint = "jx"', 'joint = "mount"', "x.joint = 'mount': is fixed, must be prismatic"),
        ('joint = "jx"', 'joint = "jz"', "joint 'jz' is given to two axes"),
        ('joint = "jx"', 'joint = "jx"\nguide = 1', "unknown key x.guide: did you mean guides"),
        ('work = "bed"', 'work = "ram"', "x.joint = 'jx': carries both nozzle and work"),
        ('work = "bed"', 'work = "frame"', "y.joint = 'jy': carries neither nozzle nor work"),
        ('urdf = "printer.urdf"', 'urdf = "p.urdf"', "p.urdf: cannot be read"),
        (TABLE[TABLE.index("[z]") :], "", "joint 'jz' of printer.urdf is prismatic and no axis drives it"),
    ],
)
def test_what_a_table_beside_a_urdf_may_not_hold(tmp_path, old, new, text):
    with pytest.raises(InputError, match=text.replace("[", r"\[")) as error:
        Machine(written(tmp_path, table=TABLE.replace(old, new, 1)))
    assert "\n" not in str(error.value)


def test_of_many_links_twelve_are_named_and_the_others_counted(tmp_path):
    links = re.findall(r'<link name="(\w+)"', URDF)
    for count in (12, 13, 15):
        few = "".join(f'<link name="l{k}"/>' for k in range(count - len(links)))
        urdf = URDF.replace("</robot>", f"{few}</robot>")
        with pytest.raises(InputError) as error:
            Machine(written(tmp_path, urdf=urdf, table=TABLE.replace('"tool"', '"tol"', 1)))
        named = str(error.value).partition("it has ")[2].split(", ")
        assert named[: len(links)] == links
        assert len(named) == min(count, 13)
        assert (named[-1] == f"and {count - 12} more") == (count > 12)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("<robot", "<robt", "printer.urdf: is not XML"),
        (
            '<origin xyz="0 0 -0.05"/><axis xyz="0 0 1"/><limit lower="-0.001" upper="0.08" effort="1" velocity="9"/>',
            '<origin xyz="0 0 -0.05"/><axis xyz="0 0 1"/><limit effort="1" velocity="9"/>',
            "z.travel is missing, joint 'jz' has no limits",
        ),
        ("robot", "xacro", "its root is <xacro>, that of a URDF is <robot>; convert xacro first"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1 1"/>', "axis 'z' moves the nozzle along"),
        ('lower="-0.001" upper', 'lower="0.01" upper', "must include 0"),
        ('value="1"', 'value="-1"', "printer.urdf: .*mass"),
    ],
)
def test_what_a_urdf_may_not_be(tmp_path, old, new, text):
    with pytest.raises(InputError, match=text) as error:
        Machine(written(tmp_path, urdf=URDF.replace(old, new)))
    assert "\n" not in str(error.value)
