"""Bodies that several arrangements share: frame, work, beam, carriage with nozzle, ram."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree.ElementTree import Element

from gantrysim.machine.design.mjcf import Load, M, Numbers, TableMjcf, add, include
from gantrysim.machine.design.table import Drive, MachineTable, Slide

X = (1, 0, 0)
Y = (0, 1, 0)
Z = (0, 0, 1)
BEAM = 0.125, 0.13  # y and z of the beam behind and above the nozzle [m]
_RAIL = -0.095  # z of the rails on the frame [m]
_GYRATION = 0.04  # radius of a nut, carriage or ram (assumption) [m]
_SIDE = 0.1  # from the travel to the legs of the bridge [m]


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
