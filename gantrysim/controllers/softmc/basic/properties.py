"""Properties of groups, axes and the system: their names, and which of them have an effect here."""

from __future__ import annotations

import math
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

from gantrysim.base.errors import at_least, positive, unknown, whole_number
from gantrysim.controllers.softmc.basic.values import Element, Value, number
from gantrysim.controllers.softmc.commands import SoftMCError
from gantrysim.controllers.softmc.group import PROFILE_TYPES, Group

_LONG_NAMES = {
    "velocitycruise": "vcruise",
    "velocitytranslation": "vtran",
    "velocitymax": "vmax",
    "acceleration": "acc",
    "accelerationmax": "amax",
    "deceleration": "dec",
    "decelerationmax": "dmax",
    "decelerationstop": "decstop",
    "jerkmax": "jmax",
    "profiletype": "prftype",
    "smoothfactor": "smooth",
    "absolute": "abs",
    "positionerrormax": "pemax",
    "pesettle": "positionerrorsettle",
    "velocityfactor": "vfac",
    "accelerationfactor": "afac",
    "jerkfactor": "jfac",
    "positionfactor": "pfac",
    "velocityoverride": "vord",
    "velocityoverspeed": "vospd",
    "enable": "en",
    "positioncommand": "pcmd",
    "positionfeedback": "pfb",
    "positionerror": "pe",
    "velocitycommand": "vcmd",
    "velocityfeedback": "vfb",
    "name": "elementname",
}

# of a single motion, where its command names them
NODAL = frozenset(
    (
        "vcruise",
        "vtran",
        "vmax",
        "acc",
        "amax",
        "dec",
        "dmax",
        "jerk",
        "jmax",
        "prftype",
        "smooth",
        "abs",
        "starttype",
        "dispense",
    )
)
# of a group; those of a length also hold for the system's and the axes' own values, which have no effect
EFFECTIVE = NODAL | frozenset(
    (
        "pemax",
        "positionerrordelay",
        "positionerrorsettle",
        "timesettle",
        "velocitysafetylimit",
        "vfac",
        "afac",
        "jfac",
        "vord",
        "en",
        "blendingmethod",
    )
)
IDLE = frozenset(
    (
        "fmode",
        "pfac",
        "vospd",
        "simulated",
        "decstop",
        "motion",
        "elementname",
        "doubleformat",
        "numberaxes",
        "positionrollover",
    )
)
RECORDED = ("pcmd", "pfb", "pe", "vcmd", "vfb", "setpoint")
READ_ONLY = frozenset(("pcmd", "pfb", "setpoint", "ismoving", "issettled", "clock", "time"))
NAMES = EFFECTIVE | IDLE | READ_ONLY | frozenset(RECORDED)
_STARTS = (2, 3)  # in position, generator completed
# units of those that are bounded; lengths are in the user's
_ABOVE_ZERO = {
    "vcruise": "",
    "vtran": "",
    "acc": "",
    "dec": "",
    "jerk": "",
    "vord": "%",
    "pemax": "",
    "positionerrorsettle": "",
    "velocitysafetylimit": "",
}
_FROM_ZERO = {"timesettle": "ms", "positionerrordelay": ""}


def canonical(name: str) -> str:
    """Return the short name of a property, in lower case."""
    return _LONG_NAMES.get(name.lower(), name.lower())


def is_property(name: str) -> bool:
    """Return whether a name is that of a property."""
    return canonical(name) in NAMES


def checked_property(element: Element, name: str, value: Value) -> tuple[str, Value]:
    """Return the canonical name of a property that may be assigned, and its value.

    Raises:
        SoftMCError: an unknown property, one that cannot be assigned, or a value out of its bounds.
    """
    short = canonical(name)
    if short not in NAMES:
        raise unknown("property", name, EFFECTIVE | IDLE)
    if short not in EFFECTIVE | IDLE:
        raise SoftMCError(f"{name}: can be read only")
    # the override of the system is in effect, too
    if short in EFFECTIVE and (element.kind == "group" or short == "vord"):
        value = number(name, value)
        _check(name, short, value)
    return short, value


def _check(name: str, short: str, value: float) -> None:
    if short in _ABOVE_ZERO:
        positive(name, value, _ABOVE_ZERO[short])
    if short in _FROM_ZERO:
        at_least(name, value, 0, _FROM_ZERO[short])
    if short in ("abs", "en", "dispense") and value not in (0, 1):
        raise SoftMCError(f"{name} = {value:g}: must be 0 or 1")
    if short == "blendingmethod" and value:
        raise SoftMCError(f"{name} = {value:g}: must be 0; motions run from rest to rest")
    if short == "starttype" and value not in _STARTS:
        raise SoftMCError(f"{name} = {value:g}: must be 2 (in position) or 3 (generator completed)")
    if short == "prftype" and value not in PROFILE_TYPES:
        known = ", ".join(f"{code} ({words})" for code, words in sorted(PROFILE_TYPES.items()))
        raise SoftMCError(f"{name} = {value:g}: must be one of {known}")


def initial(group: Group) -> dict[str, Any]:
    """Return the properties of a group before the program sets them, in mm and seconds."""
    down = group.acceleration if group.deceleration is None else group.deceleration
    return {
        "vcruise": group.velocity,
        "vmax": group.vmax,
        "acc": group.acceleration,
        "dec": down,
        "jerk": group.jerk,
        "amax": math.inf,
        "dmax": math.inf,
        "jmax": math.inf,
        "prftype": float(next(code for code, name in PROFILE_TYPES.items() if name == group.profile)),
        "smooth": float(group.smooth),
        "abs": float(group.absolute),
        "pemax": group.position_error,
        "positionerrordelay": float(group.position_error_delay),
        "positionerrorsettle": group.settle_error,
        "timesettle": 1e3 * group.settle_time,
        "velocitysafetylimit": group.velocity_safety_limit,
        "vfac": 1e-3,
        "afac": 1e-6,
        "jfac": 1e-9,
        "vord": 100.0,
        "starttype": 3.0,
        "blendingmethod": 0.0,
        "en": 1.0,
        "dispense": 1.0,
    }


def group_of(properties: dict[str, Any], group: Group, path: bool, override: float) -> Group:
    """Return the properties of a motion in mm and seconds.

    A factor converts a user's unit to mm per millisecond, so that a speed of one unit is 1000 VFac [mm/s],
    an acceleration 1e6 AFac [mm/s²] and a jerk 1e9 JFac [mm/s³].

    Args:
        properties: of the group, with those of the command.
        group: those that the language has not.
        path: whether Vtran, where given, is the speed; else it is VCruise.
        override: factor on the speed.

    Raises:
        InputError: a value out of its bounds.
    """
    p = properties
    v = p["vfac"] / 1e-3
    a = p["afac"] / 1e-6
    j = p["jfac"] / 1e-9
    speed = p["vtran"] if path and "vtran" in p else p["vcruise"]
    profile = PROFILE_TYPES[int(p["prftype"])]
    return replace(
        group,
        velocity=min(speed, p["vmax"]) * v * override,
        vmax=math.inf,
        acceleration=min(p["acc"], p["amax"]) * a,
        deceleration=min(p["dec"], p["dmax"]) * a,
        jerk=min(p["jerk"], p["jmax"]) * j,
        profile=profile,
        smooth=p["smooth"] if profile == "smooth" else 0,
        absolute=bool(p["abs"]),
        position_error=p["pemax"],
        position_error_delay=whole_number("PositionErrorDelay", p["positionerrordelay"], 0),
        settle_error=p["positionerrorsettle"],
        settle_time=1e-3 * p["timesettle"],
        settle_timeout=max(group.settle_timeout, 1e-3 * p["timesettle"]),
        velocity_safety_limit=p["velocitysafetylimit"] * v,
    )


def hint(name: str, known: set[str] | frozenset[str]) -> str:
    """Return the end of a message: the nearest known name, or what a name must be."""
    near = get_close_matches(name, sorted(known), n=1, cutoff=0.6)
    return f": did you mean {near[0]}?" if near else ": must be declared by DIM, or be a property"
