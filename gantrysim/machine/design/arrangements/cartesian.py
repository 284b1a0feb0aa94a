"""Axes in series: moving bridge, cantilever, moving table."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

from gantrysim.machine.design.arrangements.parts import (
    BEAM,
    Extent,
    Y,
    Z,
    beam,
    bench,
    carried_mass,
    drive_of,
    frame,
    geom,
    motor_of_x,
    on_bridge,
    point_mass,
    tube,
    work,
    x_axis,
)
from gantrysim.machine.design.mjcf import Load, M, TableMjcf, add
from gantrysim.machine.design.table import MachineTable

_DAMPING_RATIO = 0.03  # of the arm of a cantilever in yaw (assumption)


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
