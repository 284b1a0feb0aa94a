"""Motors that share axes: CoreXY and a bridge with a motor on either side."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

from gantrysim.machine.design.arrangements.parts import (
    BEAM,
    Extent,
    X,
    Y,
    Z,
    beam,
    bench,
    carriage,
    carried_mass,
    drive_of,
    frame,
    motor_of_x,
    on_bridge,
    point_mass,
    tube,
    work,
    x_axis,
)
from gantrysim.machine.design.mjcf import Load, M, TableMjcf, add
from gantrysim.machine.design.table import Drive, Guides, MachineTable, Slide

_DAMPING_RATIO = 0.03  # of a bridge in skew (assumption)
_PULLEY_TURNS = 1.05  # travel of the motors over that which the corners need


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
