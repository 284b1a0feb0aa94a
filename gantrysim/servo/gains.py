"""The gains of the servo: each one a field, with its unit and meaning."""

from __future__ import annotations

from dataclasses import make_dataclass
from typing import Annotated, NamedTuple, get_type_hints


class Parameter(NamedTuple):
    """A parameter of the servo that has one value per axis.

    Attributes:
        name: field of `Servo`, key of a job file's [servo].
        unit: in which u is the axis' own, mm or deg.
        meaning: in a few words.
    """

    name: str
    unit: str
    meaning: str


class Gains(NamedTuple):
    """The gains of one axis, each with its unit, in which u is the axis' own, mm or deg, and its meaning.

    Laws take them by name. All other lists of gains, such as the fields of `Servo` and the keys of a job file's
    [servo], follow from these fields. A new one is the last: laws of users know the gains by number.
    """

    kp: Annotated[float, "N·m/u", "torque per following error"] = 0.0
    ki: Annotated[float, "N·m/(u·s)", "torque per integral of the following error"] = 0.0
    kd: Annotated[float, "N·m·s/u", "torque per rate of change of the following error"] = 0.0
    velocity_ff: Annotated[float, "N·m·s/u", "torque per demand velocity"] = 0.0
    acceleration_ff: Annotated[float, "N·m·s²/u", "torque per demand acceleration"] = 0.0
    output_velocity: Annotated[float, "N·m·s/u", "torque per measured velocity, 0; damps where negative"] = 0.0


FEED_FORWARD = ("velocity_ff", "acceleration_ff")  # act on the demand alone, outside the loop

_HINTS = get_type_hints(Gains, include_extras=True)
GAINS = tuple(Parameter(name, *_HINTS[name].__metadata__) for name in Gains._fields)
GAIN_NAMES = Gains._fields

# The gains as fields of a servo, each with one value per axis
PerAxisGains = make_dataclass(
    "PerAxisGains",
    [(name, tuple[float, ...]) for name in GAIN_NAMES],
    frozen=True,
    kw_only=True,
    repr=False,
    namespace={"__doc__": "The gains of a servo: each field of `Gains` with one value per axis."},
)
PerAxisGains.__module__ = __name__
