"""From a URDF and the table beside it to an MJCF: MuJoCo reads the bodies, the table adds drives, nozzle and work."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, NamedTuple, Self
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import model_validator

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.input_files import read_text, read_toml, validated_model
from gantrysim.machine.design.arrangements import X, Y, Z, point_mass
from gantrysim.machine.design.mjcf import Load, M, Mjcf, add, include
from gantrysim.machine.design.settings import Positive, Table, key
from gantrysim.machine.design.table import Drive, Guides, Slide

_HEIGHT = 0.2  # of the nozzle above the floor with all axes at zero, as of the other machines [m]
_DIRECTIONS = {"x": X, "y": Y, "z": Z}
_MESHES = (".stl", ".obj", ".msh")  # that MuJoCo reads
_THICKNESS = 0.004  # half that of the plate of the work [m]
_PLATE_MARGIN = 0.01  # of that plate beyond the travel [m]
_PREFIX = "urdf/"  # of the bodies of the URDF
_PART_OF_NEEDLE = ("needle", "nozzle")

SUFFIX = ".urdf"
_SLIDE = "prismatic"
_MOVING_JOINTS = (_SLIDE, "revolute", "continuous", "planar", "floating")
_NAMED = 12  # links or joints that a message lists


class _Motion(NamedTuple):
    """An axis of the URDF at its zero.

    Attributes:
        name: x, y or z.
        settings: of the table.
        sign: 1, or -1 where the joint counts against the axis.
        travel: of the axis [mm].
        load: mass of the links that the joint carries, with the nuts of their axes [kg].
    """

    name: str
    settings: UrdfAxis
    sign: int
    travel: tuple[float, float]
    load: float


def urdf_mjcf(table: UrdfTable, urdf: Path, root: Element) -> Mjcf:
    """Return the MJCF of a machine whose bodies a URDF gives.

    Every named joint becomes the motor side of its axis, a nut, which carries the joint's link on the stiffness of the
    transmission. An axis counts in the direction in which the nozzle moves along +x, +y or +z of the work.

    Raises:
        InputError: a URDF that MuJoCo rejects, or an axis that does not move the nozzle against its work.
    """
    bodies, model = _compiled_urdf(urdf, root)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    link = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, table.nozzle.link)
    tip = data.xpos[link] + data.xmat[link].reshape(3, 3) @ (M * np.array(table.nozzle.position))
    motions = [_motion(table, name, axis, model, data) for name, axis in table.axes.items()]
    mjcf = Mjcf(bodies.get("model", "urdf"), "serial", float(model.stat.extent))
    assets = bodies.find("asset")
    if assets is not None:
        add(mjcf.root, "asset").extend(assets)
    machine = add(mjcf.world, "body", name="urdf", pos=(*-tip[:2], _HEIGHT - float(tip[2])))
    worldbody = bodies.find("worldbody")
    machine.extend(() if worldbody is None else worldbody)
    _rename(machine)
    for motion in motions:
        _drive(mjcf, machine, motion, root)
    _nozzle(_body(machine, table.nozzle.link), table)
    _work(machine, table, motions, model, data, tip)
    return mjcf


def _compiled_urdf(urdf: Path, root: Element) -> tuple[Element, mujoco.MjModel]:
    """Return the bodies of a URDF as MJCF, and their model, all links and the visual geometry among them."""
    prepared = copy.deepcopy(root)
    for link in prepared.findall("link"):
        _choose_geometry(link, urdf.parent)
    settings = prepared.find("mujoco")
    if settings is None:
        settings = add(prepared, "mujoco")
    compiler = settings.find("compiler")
    if compiler is None:
        compiler = add(settings, "compiler")
    compiler.set("discardvisual", "false")
    # the nozzle's link is often fixed to another
    compiler.set("fusestatic", "false")
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(prepared, encoding="unicode"))
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"urdf {urdf}: {' '.join(str(error).split())}") from None
    return ElementTree.fromstring(spec.to_xml()), model


def _choose_geometry(link: Element, folder: Path) -> None:
    """Keep of a link what is drawn where MuJoCo can read it, else what collides; a run has no contacts."""
    readable = [element for element in link if _readable(element, folder)]
    drawn = [element for element in readable if element.tag == "visual"]
    has_inertia = link.find("inertial") is not None
    for element in list(link):
        unread = element.tag == "visual" and element not in drawn
        # a link without inertia has that of what collides
        hidden = element.tag == "collision" and has_inertia and (bool(drawn) or element not in readable)
        if unread or hidden:
            link.remove(element)


def _readable(shape: Element, folder: Path) -> bool:
    """Whether MuJoCo reads the geometry of a shape; a mesh that is found gets its path."""
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return True
    # package://robot/meshes/bed.stl lies in the folder of the URDF or in one of the package beside it
    parts = mesh.get("filename", "").rpartition("://")[2].split("/")
    for first in range(len(parts)):
        for parent in (folder, folder.parent):
            file = parent.joinpath(*parts[first:])
            if file.suffix.lower() in _MESHES and file.is_file():
                mesh.set("filename", str(file.resolve()))
                return True
    return False


def _motion(table: UrdfTable, name: str, axis: UrdfAxis, model: mujoco.MjModel, data: mujoco.MjData) -> _Motion:
    """Return direction and travel of an axis of the table."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, axis.joint)
    moved = int(model.jnt_bodyid[joint])
    carries_nozzle = moved in _ancestors(model, table.nozzle.link)
    carries_work = moved in _ancestors(model, table.work)
    if carries_nozzle == carries_work:
        problem = "both nozzle and work" if carries_nozzle else "neither nozzle nor work"
        raise InputError(f"{name}.joint = {axis.joint!r}: carries {problem}, must carry one of them")
    direction = data.xaxis[joint] if carries_nozzle else -data.xaxis[joint]
    sign = -1 if direction @ np.array(_DIRECTIONS[name]) < 0 else 1
    travel = axis.travel
    if travel is None:
        if not model.jnt_limited[joint]:
            raise InputError(f"{name}.travel is missing, joint {axis.joint!r} has no limits")
        ends = sorted(sign * 1e3 * float(end) for end in model.jnt_range[joint])
        travel = (ends[0], ends[1])
    nuts = sum(
        other.drive.nut_mass for other in table.axes.values() if other is not axis and _carries(model, moved, other)
    )
    return _Motion(name, axis, sign, travel, float(model.body_subtreemass[moved]) + nuts)


def _carries(model: mujoco.MjModel, moved: int, axis: UrdfAxis) -> bool:
    """Whether the link that a joint moves carries another axis."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, axis.joint)
    body = int(model.jnt_bodyid[joint])
    return moved in _ancestors(model, mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body))


def _ancestors(model: mujoco.MjModel, link: str) -> set[int]:
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
    bodies = set()
    while body > 0:
        bodies.add(int(body))
        body = model.body_parentid[body]
    return bodies


def _rename(machine: Element) -> None:
    """Give the URDF's bodies names that no other element of a machine has."""
    for element in machine.iter():
        if element is machine or "name" not in element.attrib:
            continue
        if element.tag == "body":
            element.set("name", _PREFIX + element.get("name", ""))
        elif element.tag == "geom":
            del element.attrib["name"]


def _body(machine: Element, name: str) -> Element:
    for body in machine.iter("body"):
        if body.get("name") == _PREFIX + name:
            return body
    raise InputError(f"link {name!r} is lost: MuJoCo merges a root link named 'world', give it another name")


def _drive(mjcf: Mjcf, machine: Element, motion: _Motion, root: Element) -> None:
    """Put a nut between a link and its parent, and drive it."""
    settings = motion.settings
    joint = next(element for element in machine.iter("joint") if element.get("name") == settings.joint)
    parent, link = next(
        (above, body)
        for above in machine.iter("body")
        for body in above.findall("body")
        if joint in body.findall("joint")
    )
    drive = settings.drive
    slide = Slide(
        travel=motion.travel,
        speed=_speed(settings, root),
        guides=settings.guides or _guides(joint),
        drive=drive,
    )
    axis = tuple(motion.sign * float(part) for part in joint.get("axis", "0 0 1").split())
    place: dict[str, Any] = {key: link.attrib.pop(key) for key in ("pos", "quat") if key in link.attrib}
    nut = Element("body", name=f"{motion.name}_nut", **place)
    parent[list(parent).index(link)] = nut
    nut.append(link)
    link.remove(joint)
    # balanced weight, as of the arrangements
    if motion.name == "z":
        for body in nut.iter("body"):
            body.set("gravcomp", "1")
    point_mass(nut, drive.nut_mass, (0, 0, 0))
    mjcf.slide(nut, motion.name, axis, slide)
    mjcf.spring(link, f"{motion.name}_flex", axis, drive, motion.load)
    gear = drive.transmission.gear
    mjcf.motor(motion.name, drive, gear, gear, Load(drive.nut_mass + motion.load, slide.guides))


def _joint(machine: Element, name: str) -> tuple[Element, Element, Element]:
    """Return a joint, the body that it moves and that body's parent."""
    for parent in machine.iter("body"):
        for body in parent.findall("body"):
            joint = body.find(f"joint[@name='{name}']")
            if joint is not None:
                return joint, body, parent
    raise InputError(f"joint {name!r} is lost: its child link must be one that the URDF defines")


def _speed(settings: UrdfAxis, root: Element) -> float | None:
    """Return the speed limit of the table, else the lower of the URDF's and the drive's [mm/s]."""
    if settings.speed is not None:
        return settings.speed
    limit = root.find(f"joint[@name='{settings.joint}']/limit")
    stated = 0.0 if limit is None else 1e3 * float(limit.get("velocity", "0"))
    reached = settings.drive.highest_speed / (M * settings.drive.transmission.gear)
    return min(stated, reached) if stated > 0 else None


def _guides(joint: Element) -> Guides:
    """Return the friction that the URDF's dynamics state [N, N·s/m]."""
    return Guides(friction=float(joint.get("frictionloss", "0")), viscous=float(joint.get("damping", "0")))


def _nozzle(link: Element, table: UrdfTable) -> None:
    """Give a link nozzle and needle, and a syringe where it draws nothing itself."""
    bare = link.find("geom") is None
    holder = add(link, "body", name="dispenser", childclass="visual", pos=[M * part for part in table.nozzle.position])
    if link.get("gravcomp") is not None:
        holder.set("gravcomp", "1")
    include(holder, "syringe")
    if not bare:
        for element in list(holder):
            if element.get("name") not in _PART_OF_NEEDLE:
                holder.remove(element)


def _work(
    machine: Element,
    table: UrdfTable,
    motions: list[_Motion],
    model: mujoco.MjModel,
    data: mujoco.MjData,
    tip: Floats,
) -> None:
    """Append the body `work` to its link: its origin is the nozzle at zero, a plate lies one gap below."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, table.work)
    rotation = data.xmat[index].reshape(3, 3)
    origin = rotation.T @ (tip - data.xpos[index])
    turned = np.zeros(4)
    mujoco.mju_mat2Quat(turned, rotation.T.ravel())
    link = _body(machine, table.work)
    work = add(link, "body", name="work", childclass="visual", pos=origin.tolist(), quat=turned.tolist())
    reach = {motion.name: motion.travel for motion in motions}
    x0, x1 = reach.get("x", (0.0, 0.0))
    y0, y1 = reach.get("y", (0.0, 0.0))
    add(
        work,
        "geom",
        name="piece",
        pos=(0.5 * M * (x0 + x1), 0.5 * M * (y0 + y1), -M * table.gap - _THICKNESS),
        size=(0.5 * M * (x1 - x0) + _PLATE_MARGIN, 0.5 * M * (y1 - y0) + _PLATE_MARGIN, _THICKNESS),
    )


class UrdfNozzle(Table):
    """The nozzle on a link."""

    link: str = key("link that carries the nozzle")
    position: tuple[float, float, float] = key("position of the nozzle's tip in the link's frame [mm]", (0.0, 0.0, 0.0))


class UrdfAxis(Table):
    """An axis that is a prismatic joint of the URDF."""

    joint: str = key("prismatic joint of the URDF")
    travel: tuple[float, float] | None = key(
        "lowest and highest position of the axis, by default the joint's limits [mm]", None
    )
    speed: Positive | None = key("speed limit, by default the lower of the joint's and the drive's [mm/s]", None)
    guides: Guides | None = key("friction of the guides, by default the joint's dynamics", None)
    drive: Drive = key("motor, encoder, supply and transmission")


class UrdfTable(Table):
    """A machine whose bodies a URDF gives; masses and inertias of the links hold the motors, not the nuts."""

    urdf: str = key("URDF file, relative to the folder of the table")
    nozzle: UrdfNozzle = key("link and position of the nozzle's tip")
    work: str = key("link that carries the work")
    gap: Positive = key("height of the nozzle above the work piece with all axes at zero [mm]", 0.5)
    x: UrdfAxis | None = key("axis along x", None)
    y: UrdfAxis | None = key("axis along y", None)
    z: UrdfAxis | None = key("axis along z, with its weight balanced", None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.axes:
            raise InputError("x, y and z missing: name the joint and drive of at least one axis")
        joints = [axis.joint for axis in self.axes.values()]
        twice = [joint for joint in joints if joints.count(joint) > 1]
        if twice:
            raise InputError(f"joint {twice[0]!r} is given to two axes: give each its own")
        return self

    @property
    def axes(self) -> dict[str, UrdfAxis]:
        """The axes that the table has, by name."""
        axes = {"x": self.x, "y": self.y, "z": self.z}
        return {name: axis for name, axis in axes.items() if axis is not None}


def table_of_urdf(urdf: Path) -> Path:
    """Return the table beside a URDF.

    Raises:
        InputError: there is none; the message names what it must hold and the joints and links of the URDF.
    """
    file = urdf.with_suffix(".toml")
    if file.is_file():
        return file
    root = read_urdf(urdf)
    slides = _names(root, "joint", lambda joint: joint.get("type") == _SLIDE)
    links = _names(root, "link")
    raise InputError(
        f'a URDF has no drives, nozzle and work: give them in {file.name} beside it, as in urdf = "{urdf.name}", '
        f'nozzle = {{ link = "..." }}, work = "...", [x] joint = "..." and [x.drive] motor, encoder, voltage, '
        f"transmission (docs/machines.md); prismatic joints: {slides or 'none'}; links: {links or 'none'}"
    )


def read_urdf(file: Path) -> Element:
    """Return the root of a URDF.

    Raises:
        InputError: a file that cannot be read or is no URDF.
    """
    try:
        root = ElementTree.fromstring(read_text(file, label=f"urdf {file}"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"urdf {file}: cannot be read: {error}") from None
    except ElementTree.ParseError as error:
        raise InputError(f"urdf {file}: is not XML: {error}") from None
    if root.tag != "robot":
        raise InputError(f"urdf {file}: its root is <{root.tag}>, that of a URDF is <robot>; convert xacro first")
    return root


def is_urdf_table(content: dict[str, Any]) -> bool:
    """Whether the content of a TOML file is a table beside a URDF."""
    return "urdf" in content


def read_urdf_table(file: Path, content: dict[str, Any] | None = None) -> tuple[UrdfTable, Path, Element]:
    """Return a table, the path of its URDF and the URDF's root.

    Raises:
        InputError: a key that is unknown, missing or out of its bounds, a link or joint that the URDF lacks, or a
            joint that moves and that no axis drives.
    """
    label = f"machine {file}"
    table = validated_model(UrdfTable, read_toml(file, label) if content is None else content, label)
    urdf = file.parent / table.urdf
    root = read_urdf(urdf)
    try:
        _check_names(table, root)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None
    return table, urdf, root


def _check_names(table: UrdfTable, root: Element) -> None:
    links = {link.get("name") for link in root.findall("link")}
    for name, link in (("nozzle.link", table.nozzle.link), ("work", table.work)):
        if link not in links:
            raise InputError(f"{name} = {link!r}: {table.urdf} has no such link; it has {_names(root, 'link')}")
    kinds = {joint.get("name"): joint.get("type", "") for joint in root.findall("joint")}
    for name, axis in table.axes.items():
        if axis.joint not in kinds:
            raise InputError(
                f"{name}.joint = {axis.joint!r}: {table.urdf} has no such joint; it has {_names(root, 'joint')}"
            )
        if kinds[axis.joint] != _SLIDE:
            raise InputError(f"{name}.joint = {axis.joint!r}: is {kinds[axis.joint]}, must be prismatic")
    driven = {axis.joint for axis in table.axes.values()}
    for joint, kind in kinds.items():
        if kind in _MOVING_JOINTS and joint not in driven:
            raise InputError(f"joint {joint!r} of {table.urdf} is {kind} and no axis drives it: make it fixed there")


def _names(root: Element, tag: str, accepts: Any = None) -> str:
    names = [element.get("name", "?") for element in root.findall(tag) if accepts is None or accepts(element)]
    if len(names) > _NAMED:
        names = [*names[:_NAMED], f"and {len(names) - _NAMED} more"]
    return ", ".join(names)
