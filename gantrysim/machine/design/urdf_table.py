"""The table beside a URDF: what a URDF does not state, drives of its slides, nozzle and work."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from pydantic import model_validator

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import read_text, read_toml, validated_model
from gantrysim.machine.design.settings import Positive, Table, key
from gantrysim.machine.design.table import Drive, Guides

SUFFIX = ".urdf"
_SLIDE = "prismatic"
_MOVING = (_SLIDE, "revolute", "continuous", "planar", "floating")
_NAMED = 12  # links or joints that a message lists


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
        if kind in _MOVING and joint not in driven:
            raise InputError(f"joint {joint!r} of {table.urdf} is {kind} and no axis drives it: make it fixed there")


def _names(root: Element, tag: str, accepts: Any = None) -> str:
    names = [element.get("name", "?") for element in root.findall(tag) if accepts is None or accepts(element)]
    if len(names) > _NAMED:
        names = [*names[:_NAMED], f"and {len(names) - _NAMED} more"]
    return ", ".join(names)
