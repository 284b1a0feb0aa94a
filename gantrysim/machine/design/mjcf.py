"""Writing an MJCF: the elements that every machine has, with the classes and looks of the built-in ones."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from importlib.resources import files
from typing import NamedTuple
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

from gantrysim.machine.design.table import Drive, Guides, MachineTable, Slide
from gantrysim.servo.stability.motion import MODES

M = 1e-3  # metres per millimetre

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


class Load(NamedTuple):
    """Load of a motor on its slide.

    Attributes:
        mass: that it moves [kg].
        guides: of the slide.
        share: of the guides' friction that this motor bears.
    """

    mass: float
    guides: Guides
    share: float = 1.0


def add(parent: Element, tag: str, **attributes: str | float | Numbers) -> Element:
    """Append an element; numbers are written in full, and an underscore ends an attribute that is a word of Python."""
    return ET.SubElement(parent, tag, {name.rstrip("_"): _text(value) for name, value in attributes.items()})


def _text(value: str | float | Numbers) -> str:
    if isinstance(value, str):
        return value
    numbers = value if isinstance(value, Sequence) else [value]
    return " ".join(f"{float(number)!r}".removesuffix(".0") for number in numbers)


def _part(name: str) -> Element:
    return ET.fromstring((files("gantrysim.models") / "parts" / f"{name}.xml").read_text(encoding="utf-8"))


def include(parent: Element, name: str) -> None:
    """Append the elements of a part of the built-in machines."""
    parent.extend(copy.deepcopy(child) for child in _part(name) if isinstance(child.tag, str))


class Mjcf:
    """An MJCF that grows.

    Attributes:
        root: the element `mujoco`.
        world: its worldbody.
        frame: body of everything that stands or moves on the bench.
        size: width of the frame relative to the built-in ones.
    """

    def __init__(self, name: str, kinematics: str, width: float) -> None:
        self.root = Element("mujoco", model=name)
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
        self._facts: dict[str, dict[str, float]] = {}
        # from the guide blocks of an axis to the nozzle, along it [mm]
        self.guide_arms: dict[str, float] = {}

    def _only(self, tag: str) -> Element:
        element = self.root.find(tag)
        assert element is not None
        return element

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
            position = [float(number) for number in view.get("pos", "").split()]
            # away from what it looks at, as the machine is larger
            moved = [centre + self.size * (p - centre) for p, centre in zip(position, _CENTRE, strict=True)]
            view.set("pos", _text(moved))

    def text(self, timestep: float | None = None) -> str:
        """Return the MJCF as text.

        Args:
            timestep: physics step, by default as in the built-in machines [s].
        """
        if timestep is not None:
            self._only("option").set("timestep", _text(timestep))
        custom = self._only("custom")
        if not custom.findall("numeric"):
            # axes are in the order of the actuators, whatever the order in which an arrangement adds them
            for group in (self.actuator, self.sensor):
                group[:] = sorted(group, key=lambda element: element.get("name", ""))
            axes = sorted(self._facts)
            for fact in dict.fromkeys(name for axis in axes for name in self._facts[axis]):
                add(custom, "numeric", name=fact, data=[self._facts[axis].get(fact, 0.0) for axis in axes])
            if self.guide_arms:
                add(custom, "numeric", name="guide_arm", data=[self.guide_arms.get(axis, 0.0) for axis in axes])
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def slide(self, body: Element, name: str, axis: Numbers, slide: Slide) -> None:
        """Give a body a slide, motor side of an axis or a coordinate."""
        speed = slide.speed
        efficiency = 1.0
        if slide.drive is not None:
            efficiency = slide.drive.transmission.efficiency
            if speed is None:
                speed = slide.drive.highest_speed / (M * slide.drive.transmission.gear)
        low, high = slide.travel
        # the motor overcomes friction of the guides through the transmission's loss
        attributes = {"damping": slide.guides.viscous / efficiency} if slide.guides.viscous else {}
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
        """Give a body its slide on the stiffness of a transmission, for a load [kg]; none where that is rigid."""
        if drive.transmission.stiffness == "rigid":
            return
        stiffness = drive.transmission.spring
        add(
            body,
            "joint",
            name=name,
            class_="flex",
            axis=axis,
            stiffness=stiffness,
            damping=2 * drive.transmission.damping_ratio * math.sqrt(stiffness * load),
        )

    def motor(self, name: str, drive: Drive, gear: float, slide_gear: float, load: Load) -> None:
        """Add motor and encoder of an axis.

        Args:
            name: of the axis and of its joint.
            drive: its motor.
            gear: of the joint [rad/m or 1].
            slide_gear: motor angle per travel of the slide [rad/m].
            load: mass and friction that it moves.
        """
        motor = drive.known_motor
        transmission = drive.transmission
        coulomb_of_motor, viscous = motor.friction
        guide_friction = load.share * load.guides.friction / (slide_gear * transmission.efficiency)
        coulomb = coulomb_of_motor + transmission.friction + guide_friction
        inertia = drive.armature + load.mass / slide_gear**2
        attributes: dict[str, str | float | Numbers] = {}
        if coulomb > 0:
            stiffness = min(_STATIC * coulomb / (_PRESLIDING * slide_gear), inertia * (2 * math.pi * _BRISTLES) ** 2)
            damping = 2 * _BRISTLE_DAMPING * math.sqrt(stiffness * inertia)
            attributes["lugre"] = (stiffness, damping, coulomb, _STATIC * coulomb, _STRIBECK * slide_gear)
        if motor.detent_torque:
            # four times per electrical period, with its phase so that the rotor rests at full steps
            attributes["cogging"] = (motor.detent_torque, max(4 * motor.pole_pairs, 1), math.pi)
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
        # custom numerics, a value per actuator [N·m, kg·m², 1, H, those of the transmission, 1, place in MODES]
        self._facts[name] = {
            "continuous_torque": motor.continuous,
            "rotor_inertia": motor.rotor_inertia,
            "pole_pairs": motor.pole_pairs,
            "inductance": motor.inductance,
            **transmission.facts,
            "microsteps": drive.fine_steps,
            "drive_mode": MODES.index(drive.used_mode),
        }


class TableMjcf(Mjcf):
    """The MJCF of one of the arrangements.

    Attributes:
        table: of the machine.
    """

    def __init__(self, table: MachineTable, kinematics: str, width: float) -> None:
        super().__init__(table.name, kinematics, width)
        self.table = table
