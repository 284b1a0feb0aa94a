"""Renaming of elements of an MJCF to the names that a machine needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco

from gantrysim.base.errors import InputError, unknown

_OBJECT = mujoco.mjtObj


def rename(spec: mujoco.MjSpec, names: Mapping[str, str]) -> None:
    """Rename elements of an MJCF before its compilation, with what refers to them.

    Args:
        spec: changed in place.
        names: from the name that is needed to the one in the MJCF: "nozzle" of a site, "work" of a body, "needle" of a
            geom, any other of an actuator, whose joint and encoder take it too.

    Raises:
        InputError: an element that the MJCF lacks, a name that is taken, or a joint that a tendon names.
    """
    for new, old in names.items():
        if new in ("nozzle", "work", "needle"):
            kind, elements = {
                "nozzle": (_OBJECT.mjOBJ_SITE, spec.sites),
                "work": (_OBJECT.mjOBJ_BODY, spec.bodies),
                "needle": (_OBJECT.mjOBJ_GEOM, spec.geoms),
            }[new]
            _rename(spec, kind, elements, new, old)
        else:
            _rename_axis(spec, new, old)


def _rename_axis(spec: mujoco.MjSpec, new: str, old: str) -> None:
    actuator = _element(spec.actuators, "actuator", new, old)
    joint = actuator.target
    if actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT:
        raise InputError(
            f'names.{new}: actuator {old!r} drives no joint, but {joint!r}: give it joint="...", a slide or hinge'
        )
    # a path element of a tendon keeps the name that it was made with
    for tendon in spec.tendons:
        if any(getattr(wrap.target, "name", None) == joint for wrap in tendon.path):
            raise InputError(
                f"names.{new}: joint {joint!r} is part of tendon {tendon.name!r}: rename joint and actuator "
                f"in the MJCF to {new!r}"
            )
    for sensor in spec.sensors:
        if sensor.type == mujoco.mjtSensor.mjSENS_ACTUATORPOS and sensor.objname == old:
            _free(spec.sensors, "sensor", new, sensor)
            sensor.name = new
    _rename(spec, _OBJECT.mjOBJ_JOINT, spec.joints, new, joint)
    _rename(spec, _OBJECT.mjOBJ_ACTUATOR, spec.actuators, new, old)


def _rename(spec: mujoco.MjSpec, kind: mujoco.mjtObj, elements: Sequence[Any], new: str, old: str) -> None:
    label = {"SITE": "site", "BODY": "body", "GEOM": "geom", "JOINT": "joint", "ACTUATOR": "actuator"}
    element = _element(elements, label[kind.name.rpartition("_")[2]], new, old)
    element.name = new
    for sensor in spec.sensors:
        if sensor.objtype == kind and sensor.objname == old:
            sensor.objname = new
        if sensor.reftype == kind and sensor.refname == old:
            sensor.refname = new
    for equality in spec.equalities:
        # only other equalities state the kind of the elements that they join
        joins_joints = equality.type == mujoco.mjtEq.mjEQ_JOINT
        if (kind == _OBJECT.mjOBJ_JOINT and joins_joints) or (not joins_joints and equality.objtype == kind):
            for end in ("name1", "name2"):
                if getattr(equality, end) == old:
                    setattr(equality, end, new)
    if kind == _OBJECT.mjOBJ_JOINT:
        for actuator in spec.actuators:
            if actuator.target == old:
                actuator.target = new
    if kind == _OBJECT.mjOBJ_BODY:
        for camera_or_light in (*spec.cameras, *spec.lights):
            if camera_or_light.targetbody == old:
                camera_or_light.targetbody = new
        for pair in spec.excludes:
            for end in ("bodyname1", "bodyname2"):
                if getattr(pair, end) == old:
                    setattr(pair, end, new)


def _element(elements: Sequence[Any], label: str, new: str, old: str) -> Any:
    """Return an element by its name, or raise InputError; the new name must be free."""
    for element in elements:
        if element.name == old:
            _free(elements, label, new, element)
            return element
    if not any(element.name for element in elements):
        raise InputError(f'names.{new}: the MJCF names no {label}: add <{label} name="{old}"/>, or a name to one')
    try:
        raise unknown(label, old, [element.name for element in elements if element.name])
    except InputError as error:
        raise InputError(f"names.{new}: {error}") from None


def _free(elements: Sequence[Any], label: str, new: str, element: Any) -> None:
    if any(other.name == new and other is not element for other in elements):
        raise InputError(f"names.{new}: the MJCF has another {label} {new!r}: rename that one in the MJCF")
