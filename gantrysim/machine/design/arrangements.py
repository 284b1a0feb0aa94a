"""Arrangements of axes: each function turns a table into the bodies, joints and motors of a machine."""

from __future__ import annotations

import math
from typing import NamedTuple
from xml.etree.ElementTree import Element

from gantrysim.machine.design.mjcf import Load, M, Numbers, TableMjcf, add, include
from gantrysim.machine.design.table import Drive, Guides, MachineTable, Slide

# of the arm of a cantilever in yaw, and of a bridge in skew (assumption)
_DAMPING_RATIO = 0.03

_PULLEY_TURNS = 1.05  # travel of the motors over that which the corners need

X = (1, 0, 0)
Y = (0, 1, 0)
Z = (0, 0, 1)
BEAM = 0.125, 0.13  # y and z of the beam behind and above the nozzle [m]
_RAIL = -0.095  # z of the rails on the frame [m]
_GYRATION = 0.04  # radius of a nut, carriage or ram (assumption) [m]
_SIDE = 0.1  # from the travel to the legs of the bridge [m]


def bridge(table: MachineTable) -> TableMjcf:
    """Return a machine whose bridge moves along y and bears the carriage."""
    extent = Extent.of(table)
    mjcf = TableMjcf(table, "serial", 2 * extent.half_width)
    frame(mjcf, extent)
    bench(mjcf, extent)
    work(mjcf.frame, table, extent)
    body = _y_axis(mjcf, mjcf.frame, "bridge", 1, on_bridge(table))
    mjcf.guide_arms["y"] = -BEAM[0] / M
    _bridge_mass(body, table, extent)
    beam(body, extent)
    motor_of_x(body, extent)
    x_axis(mjcf, body)
    return mjcf


def cantilever(table: MachineTable) -> TableMjcf:
    """Return a machine whose arm is guided at its left end and yaws there on its stiffness."""
    extent = Extent.of(table)
    mjcf = TableMjcf(table, "serial", 2 * extent.half_width)
    frame(mjcf, extent)
    bench(mjcf, extent)
    work(mjcf.frame, table, extent)
    load = on_bridge(table)
    root = _y_axis(mjcf, mjcf.frame, "guide", 1, load)
    mjcf.guide_arms["y"] = -BEAM[0] / M
    # the arm's mass is behind its hinge
    point_mass(root, 1e-3, (extent.x - extent.half_width, *BEAM))
    arm = add(root, "body", name="bridge")
    stiffness = table.arm_stiffness or 0.0
    mass = table.masses.bridge or 0.0
    inertia = mass * (2 * extent.half_width) ** 2 / 3 + carried_mass(table) * (extent.x - extent.half_width) ** 2
    add(
        arm,
        "joint",
        name="yaw",
        class_="flex",
        type="hinge",
        axis=Z,
        pos=(extent.x - extent.half_width, BEAM[0], BEAM[1]),
        stiffness=stiffness,
        damping=2 * _DAMPING_RATIO * math.sqrt(stiffness * inertia),
    )
    _bridge_mass(arm, table, extent)
    beam(arm, extent, legs=(-1,))
    motor_of_x(arm, extent)
    x_axis(mjcf, arm)
    return mjcf


def moving_table(table: MachineTable) -> TableMjcf:
    """Return a machine whose work moves along y under a beam that stands still."""
    extent = Extent.of(table)
    mjcf = TableMjcf(table, "serial", 2 * extent.half_width)
    frame(mjcf, extent, rails=False)
    for side in (-1, 1):
        x = extent.x + side * 0.5 * extent.half_width
        geom(mjcf.frame, "", (x, extent.y, -0.14), (0.02, extent.half_length + 0.02, 0.035))
        geom(mjcf.frame, "rail", (x, extent.y, -0.1), (0.0075, extent.half_length, 0.005))
    mass = table.masses.table or 0.0
    body = _y_axis(mjcf, mjcf.frame, "table", -1, mass)
    mjcf.guide_arms["y"] = -extent.y / M
    point_mass(body, mass, (extent.x, extent.y, -0.02))
    for side in (-1, 1):
        geom(body, "block", (extent.x + side * 0.5 * extent.half_width, extent.y, -0.055), (0.02, 0.06, 0.04))
    add(
        body,
        "geom",
        material="table",
        pos=(extent.x, extent.y, -1e-3 * table.gap - 0.0141),
        size=(extent.half_width - 0.06, 0.5e-3 * (table.y.travel[1] - table.y.travel[0]) + 0.02, 0.006),
    )
    work(body, table, extent)
    beam(mjcf.frame, extent)
    motor_of_x(mjcf.frame, extent)
    x_axis(mjcf, mjcf.frame)
    return mjcf


def _y_axis(mjcf: TableMjcf, parent: Element, name: str, sign: int, load: float) -> Element:
    """Append the nut of y and the body behind its stiffness, which is returned."""
    table = mjcf.table
    drive = drive_of(mjcf.table.y)
    gear = drive.transmission.gear
    along = (0, sign * Y[1], 0)
    nut = add(parent, "body", name=f"{name}_nut")
    point_mass(nut, drive.nut_mass, (0, BEAM[0], -0.1))
    mjcf.slide(nut, "y", along, table.y)
    tube(nut, "nut", (0, BEAM[0] - 0.025, -0.115, 0, BEAM[0] + 0.025, -0.115))
    geom(nut, "block", (0, BEAM[0], -0.094), (0.02, 0.012, 0.014))
    body = add(nut, "body", name=name)
    mjcf.spring(body, "y_flex", along, drive, load)
    mjcf.motor("y", drive, gear, gear, Load(drive.nut_mass + load, table.y.guides))
    return body


def _bridge_mass(body: Element, table: MachineTable, extent: Extent) -> None:
    """Give the bridge its mass with the motor of x, as a slender beam as long as the distance of the legs."""
    mass = (table.masses.bridge or 0.0) + drive_of(table.x).known_motor.mass
    inertia = mass * (2 * extent.half_width) ** 2 / 12
    point_mass(body, mass, (extent.x, *BEAM), (0.5 * inertia, inertia, inertia))


def corexy(table: MachineTable) -> TableMjcf:
    """Return a machine whose motors a and b stand on the frame and pull the carriage: r a = x + y, r b = x - y."""
    extent = Extent.of(table)
    belts = table.belts
    assert belts is not None  # the table is checked
    mjcf = TableMjcf(table, "coupled", 2 * extent.half_width)
    frame(mjcf, extent)
    bench(mjcf, extent)
    work(mjcf.frame, table, extent)
    on_x = carried_mass(table) + belts.nut_mass
    on_y = on_x + (table.masses.bridge or 0.0)
    k = belts.transmission.spring
    radius = M * belts.transmission.travel_per_turn * _ratio(belts) / (2 * math.pi)  # of the pulleys [m]
    for side, name in ((-1, "a"), (1, "b")):
        _add_pulley(mjcf, extent, side, name, radius)
        # with the other motor at rest, x and y move by half the belt
        load = (on_x + on_y) / 4
        mjcf.motor(name, belts, _ratio(belts), _ratio(belts) / radius, Load(load, Guides()))
    bridge = add(mjcf.frame, "body", name="bridge")
    mjcf.slide(bridge, "y", Y, table.y)
    _add_friction(bridge[-1], table.y)
    point_mass(bridge, table.masses.bridge or 0.0, (extent.x, *BEAM))
    beam(bridge, extent)
    clamp = add(bridge, "body", name="carriage_clamp")
    mjcf.slide(clamp, "x", X, table.x)
    _add_friction(clamp[-1], table.x)
    point_mass(clamp, belts.nut_mass, (0, 0.085, 0.13))
    carriage(mjcf, add(clamp, "body", name="carriage"))
    # of 2 k against the carriage
    damping = belts.transmission.damping_ratio * math.sqrt(2 * k * on_x)
    for name, sign in (("a", -1), ("b", 1)):
        belt = _spring(mjcf, f"belt_{name}", k, damping)
        for joint, coefficient in ((name, radius), ("x", -1), ("y", sign)):
            add(belt, "joint", joint=joint, coef=coefficient)
    return mjcf


def _add_pulley(mjcf: TableMjcf, extent: Extent, side: int, name: str, radius: float) -> None:
    """Append a pulley of CoreXY on its hinge, at the end of the rail on the left, -1, or on the right, 1."""
    table = mjcf.table
    belts = table.belts
    assert belts is not None
    place = (extent.x + side * extent.half_width, BEAM[0] + extent.y + extent.half_length, 0)
    body = add(mjcf.frame, "body", name=f"pulley_{name}", pos=place)
    # its inertia is in the armature
    point_mass(body, 0.01, (0, 0, 0), (1e-9, 1e-9, 1e-9))
    # a corner of the travel takes both slides' positions together
    farthest = max(abs(end) for slide in (table.x, table.y) for end in slide.travel)
    turn = _PULLEY_TURNS * 2 * M * farthest / radius
    speed = _motor_speed(belts, (table.x, table.y)) / _ratio(belts)
    add(body, "joint", name=name, class_="axis", type="hinge", axis=Z, range=(-turn, turn), user=speed)
    tube(body, "motor", (0, 0, -0.1, 0, 0, -0.03), f"{name}_motor")


def tandem(table: MachineTable) -> TableMjcf:
    """Return a machine whose bridge is driven by y1 on its left and y2 on its right, and can skew."""
    extent = Extent.of(table)
    drive = drive_of(table.y)
    span = M * (table.span or 0.0)
    mjcf = TableMjcf(table, "coupled", 2 * extent.half_width)
    frame(mjcf, extent)
    bench(mjcf, extent)
    work(mjcf.frame, table, extent)
    load = on_bridge(table)
    k = drive.transmission.spring
    gear = drive.transmission.gear
    for side, name in ((-1, "y1"), (1, "y2")):
        x = extent.x + 0.5 * side * span
        nut = add(mjcf.frame, "body", name=f"nut_{name}")
        mjcf.slide(nut, name, Y, table.y.model_copy(update={"guides": Guides(viscous=0.5 * table.y.guides.viscous)}))
        point_mass(nut, drive.nut_mass, (x, BEAM[0], -0.1))
        tube(nut, "nut", (x, BEAM[0] - 0.025, -0.115, x, BEAM[0] + 0.025, -0.115))
        mjcf.motor(name, drive, gear, gear, Load(drive.nut_mass + 0.5 * load, table.y.guides, share=0.5))
    bridge = add(mjcf.frame, "body", name="bridge")
    mjcf.slide(bridge, "y", Y, Slide(travel=table.y.travel))
    bridge_mass = (table.masses.bridge or 0.0) + drive_of(table.x).known_motor.mass
    inertia = bridge_mass * (2 * extent.half_width) ** 2 / 12
    guides: dict[str, float] = {"damping": 0.0}
    if table.skew_stiffness:
        guides = {
            "stiffness": table.skew_stiffness,
            "damping": 2 * _DAMPING_RATIO * math.sqrt(table.skew_stiffness * inertia),
        }
    ratio = drive.transmission.damping_ratio
    add(
        bridge,
        "joint",
        name="skew",
        type="hinge",
        axis=Z,
        pos=(extent.x, *BEAM),
        **guides,
    )
    point_mass(bridge, bridge_mass, (extent.x, *BEAM), (0.5 * inertia, inertia, inertia))
    beam(bridge, extent)
    motor_of_x(bridge, extent)
    x_axis(mjcf, bridge)
    for name, sign in (("y1", 1), ("y2", -1)):
        mount = _spring(mjcf, f"mount_{name}", k, ratio * math.sqrt(2 * k * load))
        for joint, coefficient in ((name, 1), ("y", -1), ("skew", 0.5 * sign * span)):
            add(mount, "joint", joint=joint, coef=coefficient)
    return mjcf


def _ratio(belts: Drive) -> float:
    return getattr(belts.transmission, "ratio", 1.0)


def _motor_speed(belts: Drive, slides: tuple[Slide, ...]) -> float:
    """Return the speed limit of a motor: of both slides at theirs, at most what motor and bus leave [rad/s]."""
    speeds = [slide.speed for slide in slides if slide.speed is not None]
    if len(speeds) < len(slides):
        return belts.highest_speed
    return min(belts.highest_speed, sum(speeds) * M * belts.transmission.gear)


def _add_friction(joint: Element, slide: Slide) -> None:
    """Give a slide that no motor drives its dry friction."""
    if slide.guides.friction:
        joint.set("frictionloss", repr(slide.guides.friction))


def _spring(mjcf: TableMjcf, name: str, stiffness: float, damping: float) -> Element:
    assert mjcf.tendon is not None
    return add(mjcf.tendon, "fixed", name=name, stiffness=stiffness, damping=damping, springlength=0)


class Extent(NamedTuple):
    """Horizontal extent of the machine [m].

    Attributes:
        x, y: centre of the travel.
        half_width: half of the distance of the legs.
        half_length: half of the length of the rails along y.
    """

    x: float
    y: float
    half_width: float
    half_length: float

    @classmethod
    def of(cls, table: MachineTable) -> Extent:
        """Return the extent for the travel of a table's axes."""
        x0, x1 = table.x.travel
        y0, y1 = table.y.travel
        half_width = 0.5 * M * (x1 - x0) + _SIDE
        if table.span is not None:
            half_width = max(half_width, 0.5 * M * table.span)
        return cls(0.5 * M * (x0 + x1), 0.5 * M * (y0 + y1), half_width, 0.5 * M * (y1 - y0) + 0.085)


def drive_of(slide: Slide) -> Drive:
    """Return the drive of an axis that has one."""
    assert slide.drive is not None  # the table is checked
    return slide.drive


def geom(parent: Element, kind: str, pos: Numbers, size: Numbers, name: str = "") -> None:
    """Append a visual geom of a class."""
    names = {"name": name} if name else {}
    kinds = {"class": kind} if kind else {}
    add(parent, "geom", pos=pos, size=size, **names, **kinds)


def tube(parent: Element, kind: str, ends: Numbers, name: str = "") -> None:
    """Append a visual cylinder of a class between two points."""
    names = {"name": name} if name else {}
    add(parent, "geom", class_=kind, fromto=ends, **names)


def point_mass(body: Element, mass: float, pos: Numbers, inertia: Numbers | None = None) -> None:
    """Give a body its mass [kg, m, kg·m²]; its inertia, by default of 40 mm, matters where it yaws or skews."""
    add(body, "inertial", pos=pos, mass=mass, diaginertia=inertia or 3 * (mass * _GYRATION**2,))


def frame(mjcf: TableMjcf, extent: Extent, rails: bool = True) -> None:
    """Draw feet, profiles, table and the rails along y."""
    body = mjcf.frame
    y = extent.y + BEAM[0]
    for side in (-1, 1):
        x = extent.x + side * extent.half_width
        geom(body, "", (x, y, -0.14), (0.02, extent.half_length + 0.04, 0.04))
        for end in (-1, 1):
            geom(body, "cap", (x, y + end * (extent.half_length + 0.01), -0.19), (0.02, 0.01))
        if rails:
            geom(body, "rail", (x, y, _RAIL), (0.0075, extent.half_length, 0.005))
    for end in (-1, 1):
        geom(body, "", (extent.x, y + end * (extent.half_length + 0.02), -0.16), (extent.half_width - 0.02, 0.02, 0.02))


def work(parent: Element, table: MachineTable, extent: Extent) -> Element:
    """Append the body `work`: a plate one gap below the nozzle, larger than the travel."""
    body = add(parent, "body", name="work")
    x0, x1 = table.x.travel
    y0, y1 = table.y.travel
    half = 0.5 * M * (x1 - x0) + 0.01, 0.5 * M * (y1 - y0) + 0.01
    top = -M * table.gap
    add(body, "geom", name="piece", material="piece", pos=(extent.x, extent.y, top - 0.004), size=(*half, 0.004))
    return body


def bench(mjcf: TableMjcf, extent: Extent) -> None:
    """Draw the table that carries the work on machines whose work stands still."""
    half = extent.half_width - 0.05, extent.half_length
    z = -M * mjcf.table.gap - 0.0081 - 0.006
    add(mjcf.frame, "geom", material="table", pos=(extent.x, extent.y, z), size=(*half, 0.006))
    for x in (-1, 1):
        for y in (-1, 1):
            leg = extent.x + x * (half[0] - 0.025), extent.y + y * (half[1] - 0.02), 0.5 * (z - 0.006 - 0.14)
            geom(mjcf.frame, "", leg, (0.016, 0.016, 0.5 * (0.14 + z - 0.006)))


def beam(body: Element, extent: Extent, legs: tuple[int, ...] = (-1, 1)) -> None:
    """Draw a beam along x with its rails, and legs on one or both sides."""
    y, z = BEAM
    geom(body, "", (extent.x, y, z), (extent.half_width - 0.005, 0.02, 0.04), "beam")
    for rail in (-1, 1):
        geom(body, "rail", (extent.x, y - 0.024, z + 0.024 * rail), (extent.half_width - 0.035, 0.004, 0.006))
    for side in legs:
        x = extent.x + side * extent.half_width
        geom(body, "plate", (x, y, 0.04), (0.005, 0.056, 0.12))
        geom(body, "block", (x, y - 0.04, -0.087), (0.017, 0.022, 0.007))
        geom(body, "block", (x, y + 0.04, -0.087), (0.017, 0.022, 0.007))


def motor_of_x(body: Element, extent: Extent) -> None:
    """Draw the motor of x at the end of the beam."""
    x = extent.x + extent.half_width
    geom(body, "plate", (x + 0.02, 0.087, 0.13), (0.017, 0.024, 0.024))
    tube(body, "motor", (x + 0.037, 0.087, 0.13, x + 0.11, 0.087, 0.13), "x_motor")


def carried_mass(table: MachineTable) -> float:
    """Return the mass on the stiffness of x: carriage and, with a z axis, its motor, nut and ram [kg]."""
    if table.z is None:
        return table.masses.carriage
    z = drive_of(table.z)
    return table.masses.carriage + z.known_motor.mass + z.nut_mass + (table.masses.ram or 0.0)


def carriage(mjcf: TableMjcf, body: Element) -> None:
    """Fill the body of the carriage: without z it bears nozzle and syringe, else the z axis that does."""
    table = mjcf.table
    half = 0.052 if table.z is None else 0.088
    geom(body, "plate", (0, 0.067, 0.078 + half), (0.045, 0.004, half), "carriage")
    for height in (0.106, 0.154):
        geom(body, "block", (0, 0.082, height), (0.04, 0.011, 0.0125))
    if table.z is None:
        point_mass(body, table.masses.carriage, (0, 0.055, 0.12))
        geom(body, "", (0, 0.035, 0.112), (0.009, 0.028, 0.011))
        _nozzle(body)
        return
    z = drive_of(table.z)
    carriage_mass = table.masses.carriage + z.known_motor.mass
    gear = z.transmission.gear
    ram_mass = table.masses.ram or 0.0
    point_mass(body, carriage_mass, (0, 0.06, 0.19))
    geom(body, "plate", (0, 0.05, 0.271), (0.024, 0.024, 0.023))
    tube(body, "motor", (0, 0.05, 0.294, 0, 0.05, 0.365), "z_motor")
    nut = add(body, "body", name="ram_nut", gravcomp=1)
    point_mass(nut, z.nut_mass, (0, 0.045, 0.125))
    mjcf.slide(nut, "z", Z, table.z)
    tube(nut, "nut", (0, 0.05, 0.107, 0, 0.05, 0.143))
    ram = add(nut, "body", name="ram", gravcomp=1)
    point_mass(ram, ram_mass, (0, 0.025, 0.11))
    mjcf.spring(ram, "z_flex", Z, z, ram_mass)
    mjcf.motor("z", z, gear, gear, Load(z.nut_mass + ram_mass, table.z.guides))
    geom(ram, "", (0, 0.03, 0.112), (0.009, 0.02, 0.011))
    _nozzle(ram)


def _nozzle(body: Element) -> None:
    geom(body, "accent", (0, 0, 0.112), (0.0155, 0.0145, 0.0075))
    include(body, "syringe")
    directions = "0.8396 0.5433 0 -0.1424 0.2201 0.965"
    add(body, "camera", name="nozzle", pos=(0.055, -0.085, 0.032), xyaxes=directions, fovy=21)


def x_axis(mjcf: TableMjcf, body: Element) -> None:
    """Append the driven carriage on a bridge or beam."""
    table = mjcf.table
    drive = drive_of(table.x)
    gear = drive.transmission.gear
    load = carried_mass(table)
    nut = add(body, "body", name="carriage_nut")
    point_mass(nut, drive.nut_mass, (0, 0.085, 0.13))
    mjcf.slide(nut, "x", X, table.x)
    tube(nut, "nut", (-0.022, 0.087, 0.13, 0.022, 0.087, 0.13))
    tool = add(nut, "body", name="carriage")
    mjcf.spring(tool, "x_flex", X, drive, load)
    mjcf.motor("x", drive, gear, gear, Load(drive.nut_mass + load, table.x.guides))
    carriage(mjcf, tool)


def on_bridge(table: MachineTable) -> float:
    """Return the mass that a bridge with its driven carriage puts on the stiffness of y [kg]."""
    x = drive_of(table.x)
    return (table.masses.bridge or 0.0) + x.known_motor.mass + x.nut_mass + carried_mass(table)
