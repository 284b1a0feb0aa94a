"""Every value of the machines' drives and bodies against the page that documents it, models/README.md."""

import math
import re
from functools import cache
from importlib.resources import files

import mujoco
import pytest

from gantrysim import Machine

from support.distinct import numbers, same

PAGE = (files("gantrysim.models") / "README.md").read_text(encoding="utf-8")
GANTRIES = {"x": ("xy", "xyz", "xyzr"), "y": ("xy", "xyz", "xyzr"), "z": ("xyz", "xyzr")}
AXES = {name: [(machine, name) for machine in machines] for name, machines in GANTRIES.items()}
AXES |= {
    "stage: x": [("stage", "x")],
    "stage: y": [("stage", "y")],
    "x, y": [("stage", "x"), ("stage", "y")],
    "th": [("stage", "th")],
    "r": [("xyzr", "r"), ("delta", "r")],
    "arm": [("delta", f"a{k}") for k in (1, 2, 3)],
}
SLIDES = "xyz"


@cache
def model(name):
    return Machine(name).model


def rows(section):
    """Rows of the tables of a section of the page: quantity, and by column its cell."""
    heading = re.search(rf"^#+ {re.escape(section)}$", PAGE, re.M)
    text = re.split(r"^#", PAGE[heading.end() :], maxsplit=1, flags=re.M)[0]
    for table in re.findall(r"(?:^\|.*\n)+", text, re.M):
        heads, _, *lines = (
            [cell.replace("**", "").strip() for cell in line.strip("|\n").split("|")] for line in table.splitlines()
        )
        for line in lines:
            yield line[0], dict(zip(heads[1:], line[1:], strict=True))


def actuator(field, index=None):
    def value(name, axis):
        m = model(name)
        row = getattr(m, f"actuator_{field}")[m.actuator(axis).id]
        return float(row if index is None else row[index])

    return value


def damping(suffix=""):
    return lambda name, axis: float(model(name).dof_damping[model(name).joint(axis + suffix).dofadr[0]])


def stiffness(name, axis):
    value = float(model(name).joint(f"{axis}_flex").stiffness[0])
    return value * 1e-6 if axis in SLIDES else value  # [N/um] of a slide


def reflected(name, axis):
    return actuator("armature")(name, axis) * actuator("gear", 0)(name, axis) ** 2


def counts(name, axis):
    return float(model(name).sensor(axis).user[0])


def speed(name, axis):
    value = float(model(name).joint(axis).user[0])
    return value if axis in SLIDES else math.degrees(value)


BY_ROW = {
    "`armature`": actuator("armature"),
    "reflected": reflected,
    "declared speed": speed,
    "Coulomb": actuator("biasprm", 3),
    "static": actuator("biasprm", 4),
    "Stribeck speed": actuator("biasprm", 5),
    "bristle stiffness": actuator("dynprm", 5),
    "bristle damping": actuator("dynprm", 6),
    "guides, viscous": damping(),
    "viscous at the axis": damping(),
    "series": stiffness,
}
SHOWN = {  # by section, the rows that are held to the models
    "Screws": ("`armature`", "reflected", "declared speed"),
    "Drives of the stage": ("`armature`", "reflected", "declared speed"),
    "Stiffness of the drive trains": ("series",),
    "Friction": (
        "Coulomb",
        "static",
        "Stribeck speed",
        "bristle stiffness",
        "bristle damping",
        "guides, viscous",
        "viscous at the axis",
    ),
}
CASES = [
    pytest.param(quantity, column, cell, id=f"{quantity}, {column}")
    for section, names in SHOWN.items()
    for quantity, cells in rows(section)
    for column, cell in cells.items()
    if any(re.fullmatch(rf"{re.escape(name)}( mass)?( \[.*\])?", quantity) for name in names)
    and column != "source"
    and cell
]


def test_the_page_has_every_row_for_every_axis():
    seen = {(re.sub(r"( mass)? \[.*", "", one.values[0]), one.values[1]) for one in CASES}
    gantry, stage = ("x", "y", "z"), ("stage: x", "stage: y", "th", "r")
    friction = ("Coulomb", "static", "Stribeck speed", "bristle stiffness", "bristle damping")
    expected = {(name, axis) for name in friction for axis in (*gantry, *stage)}
    expected |= {("guides, viscous", axis) for axis in gantry} | {("viscous at the axis", axis) for axis in stage}
    expected |= {("series", axis) for axis in (*gantry, "x, y", "th", "r")}
    expected |= {(name, axis) for name in SHOWN["Screws"] for axis in (*gantry, "x, y", "th")}
    assert seen == expected


@pytest.mark.parametrize(("quantity", "column", "cell"), CASES)
def test_a_value_of_an_axis_is_the_documented_one(quantity, column, cell):
    name = next(name for name in BY_ROW if quantity.startswith(name))
    for machine, axis in AXES[column]:
        value = BY_ROW[name](machine, axis)
        assert same(numbers(cell)[0], repr(value)), (machine, axis, value)


def facts(section):
    return {name: cells["value"] for name, cells in rows(section)}


def test_the_motors_are_the_documented_ones():
    both = facts("Motor and drive (all axes but r)"), facts("Motor and drive of r")
    (resistance, inductance), milli = numbers(both[1]["resistance, inductance"])[:2], 1e-3
    expected = (
        (
            float(numbers(both[0]["resistance, terminals"])[0]),
            milli * float(numbers(both[0]["inductance, terminals"])[0]),
            float(numbers(both[0]["of it viscous"])[0]),
        ),
        (float(resistance), milli * float(inductance), float(numbers(both[1]["of it Coulomb and viscous"])[1])),
    )
    for name, m in ((name, model(name)) for name in ("xy", "xyz", "xyzr", "stage", "delta")):
        for i in range(m.nu):
            axis = m.actuator(i).name
            of_r = axis == "r"
            table, (ohm, henry, viscous) = both[of_r], expected[of_r]
            constant = float(numbers(table["torque constant, back-EMF constant"])[0])
            amperes = float(numbers(table["peak current"])[0])
            assert m.actuator_gainprm[i, 0] == ohm
            assert m.actuator_gainprm[i, 1] == constant
            assert m.actuator_dynprm[i, 0] == pytest.approx(henry / ohm)
            assert m.actuator_damping[i] == viscous
            assert m.actuator_ctrlrange[m.actuator_ctrladr[i]].tolist() == pytest.approx(
                [-constant * amperes, constant * amperes]
            )
            assert m.actuator_gainprm[i, 7] == 24.0
            assert counts(name, axis) == 10000
    r = both[1]
    for name in ("xyzr", "delta"):
        assert actuator("gear", 0)(name, "r") == 5
        assert actuator("armature")(name, "r") == float(numbers(r["`armature`"])[0])
        assert speed(name, "r") == pytest.approx(float(numbers(r["declared speed"])[0]))


@pytest.mark.parametrize("name", ["xy", "xyz", "xyzr", "stage", "delta"])
def test_an_axis_has_the_friction_of_its_motor_and_its_guides(name):
    """At the motor's shaft: Coulomb friction, and the torque that a speed of the axis takes."""
    machine = Machine(name)
    for axis in machine.axes:
        i = model(name).actuator(axis.name).id
        gear = float(model(name).actuator_gear[i, 0])
        motor = 4.3e-7 if axis.name == "r" else 2.57e-6  # [N·m·s/rad]
        speed = 0.1 * axis.speed_limit
        si = 1e-3 * speed if axis.unit == "mm" else math.radians(speed)
        assert axis.viscous * speed == pytest.approx(damping()(name, axis.name) * si / gear + motor * gear * si)
        assert axis.coulomb == actuator("biasprm", 3)(name, axis.name)


def test_the_arms_of_the_delta_robot_are_the_documented_ones():
    table = {name: cells["arm"] for name, cells in rows("Drives of the delta robot") if "arm" in cells}
    rad = {
        "`armature` [kg·m²]": (actuator("armature"),),
        "reflected inertia": (reflected,),
        "declared speed": (speed,),
        "series [N·m/rad]": (stiffness,),
        "its damping [N·m·s/rad]": (damping("_flex"),),
        "Coulomb friction [N·m]": (actuator("biasprm", 3),),
        "static [N·m], Stribeck speed [rad/s]": (actuator("biasprm", 4), actuator("biasprm", 5)),
        "bristle stiffness [N·m/rad], damping": (actuator("dynprm", 5), actuator("dynprm", 6)),
        "viscous at the arm [N·m·s/rad]": (damping(),),
    }
    for quantity, values in rad.items():
        shown = numbers(table[quantity])
        for machine, axis in AXES["arm"]:
            for text, value in zip(shown, values, strict=False):
                assert same(text, repr(value(machine, axis))), (quantity, axis)
    assert actuator("gear", 0)("delta", "a1") == 50


FLEX = {
    ("xy", "xyz", "xyzr"): {"x": "250", "y": "480", "z": "190"},
    ("stage",): {"x": "630", "y": "290", "th": "13"},
    ("xyzr", "delta"): {"r": "0.0031"},
}


def test_the_damping_of_the_drive_trains_is_the_documented_one():
    text = " ".join(PAGE.split())
    assert "Damping of the flex joints, 250, 480 and 190 N·s/m" in text
    assert "Damping, 630 and 290 N·s/m, 13 and 0.0031 N·m·s/rad" in text
    for machines, values in FLEX.items():
        for machine in machines:
            for axis, value in values.items():
                if axis in [model(machine).actuator(i).name for i in range(model(machine).nu)]:
                    assert damping("_flex")(machine, axis) == float(value)


def test_the_masses_are_the_documented_ones():
    gantry, stage, delta = {}, {}, {}
    for body, cells in rows("Masses"):
        (gantry if "xy [kg]" in cells else stage)[body] = cells
    for body, cells in rows("Drives of the delta robot"):
        if "mass [kg]" in cells:
            delta[body] = cells["mass [kg]"]

    def mass(machine, body):
        return repr(float(model(machine).body(body).mass[0]))

    for body in ("bridge", "carriage"):
        for machine, column in (("xy", "xy [kg]"), ("xyz", "xyz, xyzr [kg]"), ("xyzr", "xyz, xyzr [kg]")):
            assert same(gantry[f"`{body}`"][column], mass(machine, body))
    column = "xyz, xyzr [kg]"
    assert same(gantry["`ram`"][column], mass("xyz", "ram"))
    for body in ("ram", "head", "belt"):
        assert same(gantry[f"`{body}` of xyzr"][column], mass("xyzr", body))
    nuts = gantry["`bridge_nut`, `carriage_nut`, `ram_nut`"]
    for machine, shown in (("xy", nuts["xy [kg]"]), ("xyz", nuts[column]), ("xyzr", nuts[column])):
        for body, value in zip(("bridge_nut", "carriage_nut", "ram_nut"), numbers(shown), strict=False):
            assert same(value, mass(machine, body))
    for bodies, cells in stage.items():
        for body in re.findall(r"`(\w+)`", bodies):
            assert same(cells["mass [kg]"], mass("stage", body))
    for body in ("hub1", "hub2", "hub3", "arm1", "arm2", "arm3", "platform", "belt", "head"):
        shown = next(value for name, value in delta.items() if body.rstrip("123") in name)
        value = numbers(shown)[1 if body == "head" else 0]
        assert same(value, mass("delta", body))


def travel(machine, joint, per=1e3):
    return [per * end for end in model(machine).joint(joint).range.tolist()]


TRAVEL = (
    ("300 x 300 mm of travel", [(name, axis, -150, 150) for name in ("xy", "xyz", "xyzr") for axis in "xy"]),
    ("z up, travel 80 mm", [("xyz", "z", -0.4, 80), ("xyzr", "z", -0.4, 80)]),
    ("Travel: 220 mm to either side", [("stage", "x", -220, 220), ("stage", "y", -220, 220)]),
    ("their ranges are the workspace", [("delta", f"platform_{axis}", -160, 160) for axis in "xy"]),
    ("at zero the tip is at (0, 0, 426) mm", [("delta", "platform_z", -0.4, 100)]),
)
TURNS = (("ten turns to either side, 3600 deg", "xyzr", "r", 3600), ("th 450 deg to either side", "stage", "th", 450))


def test_the_travel_is_the_documented_one():
    text = " ".join(PAGE.split())
    for words, joints in TRAVEL:
        assert words in text
        for machine, joint, low, high in joints:
            assert travel(machine, joint) == pytest.approx([low, high], abs=1e-9)
    for words, machine, joint, turn in TURNS:
        assert words in text
        assert travel(machine, joint, 180 / math.pi) == pytest.approx([-turn, turn])


def test_the_simulation_options_are_the_documented_ones():
    options = facts("Simulation options")
    for machine in ("xy", "xyz", "xyzr", "stage", "delta"):
        opt = model(machine).opt
        assert same(numbers(options["timestep"])[0], repr(1e3 * opt.timestep))
        assert options["integrator"] == "`Euler`"
        assert opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
        assert opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
        assert opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET
