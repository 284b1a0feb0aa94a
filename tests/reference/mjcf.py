"""The numbers of a machine's axes, read from its MJCF without MuJoCo: includes, default classes, mass on each axis."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple


@dataclass(frozen=True)
class Drive:
    """One axis: motor side, load side, winding and friction; SI units, motor values at the shaft.

    Attributes:
        name: of the joint and the motor.
        slide: whether the axis is a slide, else a hinge.
        gear: motor angle per travel [rad/m], of a hinge turns of the motor per turn.
        nut: mass or moment of inertia between the motor and the spring [kg, kg·m²].
        rotor: moment of inertia of the motor and what turns with it [kg·m²].
        load: mass behind the spring, with all that it carries; of a hinge its moment of inertia is not summed [kg].
        damping: viscous, of the guide [N·s/m, N·m·s/rad].
        rotor_damping: viscous, of the motor [N·m·s/rad].
        stiffness, flex_damping: of the spring between motor and load [N/m, N·s/m; N·m/rad, N·m·s/rad].
        constant: torque and back-EMF constant K [N·m/A].
        resistance, inductance: of the winding [ohm, H].
        bus: voltage limit [V].
        current: current limit [A].
        bristle, bristle_damping, coulomb, static, stribeck: LuGre friction
            [N·m/rad, N·m·s/rad, N·m, N·m, rad/s].
        counts: of the encoder per revolution of the motor.
    """

    name: str
    slide: bool
    gear: float
    nut: float
    rotor: float
    load: float
    damping: float
    rotor_damping: float
    stiffness: float
    flex_damping: float
    constant: float
    resistance: float
    inductance: float
    bus: float
    current: float
    bristle: float
    bristle_damping: float
    coulomb: float
    static: float
    stribeck: float
    counts: float


class Body(NamedTuple):
    """A body alone: mass [kg], centre of mass in its frame [m], moment of inertia about the vertical there [kg·m²]."""

    mass: float
    x: float
    y: float
    inertia: float


def read_bodies(file: Path) -> dict[str, Body]:
    """Return the bodies of an MJCF that have a mass, by name; their frames must not be turned."""
    root = _included(ET.parse(file).getroot(), file.parent)
    bodies = {}
    for body in root.iter("body"):
        for inertial in body.findall("inertial"):
            x, y, _ = _numbers(inertial.get("pos", "0 0 0"))
            about_z = _numbers(inertial.get("diaginertia", "0 0 0"))[2]
            bodies[body.get("name", "")] = Body(float(inertial.get("mass", "0")), x, y, about_z)
    return bodies


def read_drives(file: Path) -> list[Drive]:
    """Return the axes of an MJCF in the order of its motors."""
    root = _included(ET.parse(file).getroot(), file.parent)
    defaults: dict[str, dict[str, dict[str, str]]] = {}
    for top in root.findall("default"):
        for child in top.findall("default"):
            _read_defaults(child, {}, defaults)
    bodies = {}
    for world in root.findall("worldbody"):
        for body in world.iter("body"):
            for joint in body.findall("joint"):
                bodies[joint.get("name")] = (body, _with_defaults(joint, defaults))
    sensors = {sensor.get("actuator"): sensor for sensor in root.iter("actuatorpos")}
    drives = []
    for element in root.iter("dcmotor"):
        if element.get("name") is None:  # of a default class
            continue
        motor = _with_defaults(element, defaults)
        nut, joint = bodies[motor["joint"]]
        load, spring = bodies[motor["joint"] + "_flex"]
        assert load in nut.findall("body")
        slide = joint["type"] == "slide"
        lugre, voltage = _numbers(motor["lugre"]), _numbers(motor["controller"])[5]
        torque_constant, emf_constant = _numbers(motor["motorconst"])
        drives.append(
            Drive(
                name=motor["name"],
                slide=slide,
                gear=float(motor["gear"]),
                nut=_mass(nut) if slide else _inertia_about_z(nut),
                rotor=float(motor["armature"]),
                load=sum(_mass(body) for body in load.iter("body")),
                damping=float(joint["damping"]),
                rotor_damping=float(motor["damping"]),
                stiffness=float(spring["stiffness"]),
                flex_damping=float(spring["damping"]),
                constant=math.sqrt(torque_constant * emf_constant),
                resistance=float(motor["resistance"]),
                inductance=float(motor["inductance"].split()[0]),
                bus=voltage,
                current=_numbers(motor["saturation"])[1],
                bristle=lugre[0],
                bristle_damping=lugre[1],
                coulomb=lugre[2],
                static=lugre[3],
                stribeck=lugre[4],
                counts=float(sensors[motor["name"]].get("user", "0")),
            )
        )
    return drives


def _included(element: ET.Element, folder: Path) -> ET.Element:
    """Return an element with its includes replaced by what they hold; a file is relative to the one that names it."""
    children: list[ET.Element] = []
    for child in element:
        if child.tag == "include":
            file = folder / child.get("file", "")
            children += _included(ET.parse(file).getroot(), file.parent)
        else:
            children.append(_included(child, folder))
    element[:] = children
    return element


def _read_defaults(
    element: ET.Element, inherited: dict[str, dict[str, str]], found: dict[str, dict[str, dict[str, str]]]
) -> None:
    own = {tag: dict(attributes) for tag, attributes in inherited.items()}
    for child in element:
        if child.tag != "default":
            own.setdefault(child.tag, {}).update(child.attrib)
    found[element.get("class", "")] = own
    for child in element.findall("default"):
        _read_defaults(child, own, found)


def _with_defaults(element: ET.Element, defaults: dict[str, dict[str, dict[str, str]]]) -> dict[str, str]:
    return {**defaults[element.get("class", "")].get(element.tag, {}), **element.attrib}


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.split()]


def _mass(body: ET.Element) -> float:
    """Return the mass of a body alone; drawn shapes have none."""
    return sum(float(inertial.get("mass", "0")) for inertial in body.findall("inertial"))


def _inertia_about_z(body: ET.Element) -> float:
    """Return the moment of inertia of a body alone about the vertical through its origin."""
    total = 0.0
    for inertial in body.findall("inertial"):
        x, y, _ = _numbers(inertial.get("pos", "0 0 0"))
        total += _numbers(inertial.get("diaginertia", "0 0 0"))[2] + float(inertial.get("mass", "0")) * (x * x + y * y)
    return total
