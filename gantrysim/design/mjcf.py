"""Writing an MJCF: the elements that every machine has, in the looks and classes of the built-in ones."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from importlib.resources import files
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

from gantrysim.design.table import Drive, Guides, MachineTable, Slide
from gantrysim.stability.motion import MODES

M = 1e-3  # metres per millimetre

# custom numerics of an MJCF, a value per actuator: what verdict, transmission, geometry or drive need
# [N·m, kg·m², 1, H, 1, µm/300 mm, µm, 1, place in MODES]
FACTS = (
    "continuous_torque",
    "rotor_inertia",
    "pole_pairs",
    "inductance",
    "efficiency",
    "travel_error",
    "periodic_error",
    "microsteps",
    "drive_mode",
)

# LuGre friction, as of the built-in machines
_STATIC = 1.2  # per Coulomb friction
_STRIBECK = 5e-3  # [m/s]
_PRESLIDING = 5e-6  # [m]
_BRISTLES = 80.0  # highest frequency of an axis on its bristles, for the physics step [Hz]
_BRISTLE_DAMPING = 0.3  # of critical
_CENTRE = (0.0, 0.1, 0.22)  # that the built-in cameras look at [m]
_WIDTH = 0.62  # of the built-in gantries [m]
_FLOOR = 0.2  # below the work [m]

Numbers = Sequence[float]


def add(parent: Element, tag: str, **attributes: str | float | Numbers) -> Element:
    """Append an element; numbers are written in full."""
    return ET.SubElement(parent, tag, {name.rstrip("_"): _text(value) for name, value in attributes.items()})


def _text(value: str | float | Numbers) -> str:
    if isinstance(value, str):
        return value
    return " ".join(f"{float(one)!r}".removesuffix(".0") for one in (value if isinstance(value, Sequence) else [value]))


def _part(name: str) -> Element:
    return ET.fromstring((files("gantrysim.models") / "parts" / f"{name}.xml").read_text(encoding="utf-8"))


def include(parent: Element, name: str) -> None:
    """Append the elements of a part of the built-in machines."""
    parent.extend(copy.deepcopy(child) for child in _part(name) if isinstance(child.tag, str))


class Mjcf:
    """An MJCF that grows.

    Attributes:
        table: of the machine.
        root: the element `mujoco`.
        world: its worldbody.
        frame: body of all that stands and moves on the bench.
        size: width of the frame relative to the built-in ones.
    """

    def __init__(self, table: MachineTable, kinematics: str, width: float) -> None:
        self.table = table
        self.root = Element("mujoco", model=table.name)
        self.size = max(1.0, width / _WIDTH)
        include(self.root, "dispenser")
        include(self.root, "scene")
        self._bare_defaults()
        add(add(self.root, "custom"), "text", name="kinematics", data=kinematics)
        self.world = self._only("worldbody")
        self._views()
        self.frame = add(self.world, "body", name="frame", pos=(0, 0, _FLOOR), childclass="visual")
        self.tendon = add(self.root, "tendon") if kinematics == "coupled" else None
        self.actuator = add(self.root, "actuator")
        self.sensor = add(self.root, "sensor")
        self._facts: dict[str, tuple[float, ...]] = {}
        self.guide_arms: dict[str, float] = {}  # from the guide blocks of an axis to the nozzle, along it [mm]

    def _only(self, tag: str) -> Element:
        found = self.root.find(tag)
        assert found is not None
        return found

    def _bare_defaults(self) -> None:
        """Drop the built-in drives from the default classes; sizes of joints and sensors stay."""
        for parent in self.root.findall(".//default[@class='dispenser']"):
            for child in parent.findall("default"):
                if child.get("class") != "visual":
                    parent.remove(child)
            add(add(parent, "default", class_="axis"), "joint", type="slide", solreflimit=(0.005, 1))
            add(add(parent, "default", class_="flex"), "joint", type="slide")

    def _views(self) -> None:
        include(self.world, "views")
        directions = "0.8192 0.5736 0 -0.3371 0.4815 0.809"
        add(self.world, "camera", name="overview", pos="0.835 -1.035 1.152", xyaxes=directions, fovy=30)
        for view in (*self.world.findall("camera"), *self.world.findall("light[@name='key']")):
            at = [float(number) for number in view.get("pos", "").split()]
            moved = [c + self.size * (one - c) for one, c in zip(at, _CENTRE, strict=True)]
            view.set("pos", _text(moved))

    def text(self, timestep: float | None = None) -> str:
        """Return the MJCF as text.

        Args:
            timestep: physics step, by default that of the built-in machines [s].
        """
        if timestep is not None:
            self._only("option").set("timestep", _text(timestep))
        custom = self._only("custom")
        if not custom.findall("numeric"):
            for group in (self.actuator, self.sensor):
                group[:] = sorted(group, key=lambda one: one.get("name", ""))
            for name, values in zip(
                FACTS, zip(*(self._facts[one] for one in sorted(self._facts)), strict=True), strict=True
            ):
                add(custom, "numeric", name=name, data=values)
            if self.guide_arms:
                arms = [self.guide_arms.get(name, 0.0) for name in sorted(self._facts)]
                add(custom, "numeric", name="guide_arm", data=arms)
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def slide(self, body: Element, name: str, axis: Numbers, of: Slide) -> None:
        """Give a body a slide, motor side of an axis or a coordinate."""
        speed = of.speed
        if speed is None and of.drive is not None:
            speed = of.drive.highest_speed / (M * of.drive.transmission.gear)
        low, high = of.travel
        share = of.drive.transmission.efficiency if of.drive is not None else 1.0
        attributes = {"damping": of.guides.viscous / share} if of.guides.viscous else {}
        add(
            body,
            "joint",
            name=name,
            class_="axis",
            axis=axis,
            range=(M * low, M * high),
            user=M * (speed or 0.0),
            **attributes,
        )

    def spring(self, body: Element, name: str, axis: Numbers, drive: Drive, load: float) -> None:
        """Give a body its slide on the stiffness of a transmission, for a load [kg]."""
        k = 1e6 * drive.transmission.stiffness
        add(
            body,
            "joint",
            name=name,
            class_="flex",
            axis=axis,
            stiffness=k,
            damping=2 * drive.transmission.damping_ratio * math.sqrt(k * load),
        )

    def motor(
        self, name: str, drive: Drive, gear: float, slide_gear: float, load: float, guides: Guides, share: float = 1.0
    ) -> None:
        """Add motor and encoder of an axis.

        Args:
            name: of the axis and of its joint.
            drive: its motor.
            gear: of the joint [rad/m or 1].
            slide_gear: motor angle per travel of the slide [rad/m].
            load: mass that it moves [kg].
            guides: of the slide.
            share: of the guides' friction that this motor bears.
        """
        motor = drive.known_motor
        way = drive.transmission
        own, viscous = motor.friction
        coulomb = own + way.friction + share * guides.friction / (slide_gear * way.efficiency)
        inertia = drive.armature + load / slide_gear**2
        attributes: dict[str, str | float | Numbers] = {}
        if coulomb > 0:
            bristles = min(_STATIC * coulomb / (_PRESLIDING * slide_gear), inertia * (2 * math.pi * _BRISTLES) ** 2)
            damping = 2 * _BRISTLE_DAMPING * math.sqrt(bristles * inertia)
            attributes["lugre"] = (bristles, damping, coulomb, _STATIC * coulomb, _STRIBECK * slide_gear)
        if motor.detent_torque:
            attributes["cogging"] = (
                motor.detent_torque,
                max(4 * motor.pole_pairs, 1),
                math.pi,
            )  # at rest at full steps
        if motor.inductance:
            attributes["inductance"] = motor.resistance * drive.lag
        if viscous:
            attributes["damping"] = viscous
        peak = motor.K * drive.peak_current
        add(
            self.actuator,
            "dcmotor",
            name=name,
            joint=name,
            input="ff",
            controller=(0, 0, 0, 0, 0, drive.voltage),
            motorconst=(motor.K, motor.K),
            resistance=motor.resistance,
            saturation=(0, drive.peak_current, 0),
            ctrlrange=(-peak, peak),
            gear=gear,
            armature=drive.armature,
            **attributes,
        )
        if drive.encoder is not None:
            add(self.sensor, "actuatorpos", name=name, actuator=name, user=drive.counts)
        facts = (
            motor.continuous,
            motor.rotor_inertia,
            motor.pole_pairs,
            motor.inductance,
            way.efficiency,
            way.error(300),
            way.periodic_error,
            drive.fine_steps,
            MODES.index(drive.used_mode),
        )
        self._facts[name] = facts
