"""The gains of the servo: each one a field, with its unit and meaning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple, TypeAlias, TypedDict, get_type_hints

# A value of the servo that each axis has: its key in a job file, its unit and its meaning.

PerAxis: TypeAlias = float | Sequence[float] | None  # one value for all axes, one per axis, or as derived


class Parameter(NamedTuple):
    """A value of the servo that each axis has.

    Attributes:
        name: key of a job file's [servo].
        unit: in which u is the axis' own, mm or deg.
        meaning: in a few words.
    """

    name: str
    unit: str
    meaning: str


def parameters_of(fields: Any, prefix: str = "") -> tuple[Parameter, ...]:
    """Return the parameters that a NamedTuple declares as `Annotated[float, unit, meaning]`, in order.

    Args:
        fields: the NamedTuple.
        prefix: of their keys.
    """
    hints = get_type_hints(fields, include_extras=True)
    return tuple(Parameter(prefix + name, *hints[name].__metadata__) for name in fields._fields)


class Gains(NamedTuple):
    """The gains of one axis, each with its unit, in which u is the axis' own, mm or deg, and its meaning.

    Laws take them by name. All other lists of gains, such as the keys of a job file's [servo], follow from these
    fields. A new one is the last: laws of users know the gains by number.
    """

    kp: Annotated[float, "N·m/u", "torque per following error"] = 0.0
    ki: Annotated[float, "N·m/(u·s)", "torque per integral of the following error"] = 0.0
    kd: Annotated[float, "N·m·s/u", "torque per rate of change of the following error"] = 0.0
    velocity_ff: Annotated[float, "N·m·s/u", "torque per demand velocity"] = 0.0
    acceleration_ff: Annotated[float, "N·m·s²/u", "torque per demand acceleration"] = 0.0
    output_velocity: Annotated[float, "N·m·s/u", "torque per measured velocity, by default 0; damps if negative"] = 0.0


class GivenGains(TypedDict, total=False):
    """The gains as keywords of `Servo.derive`, for editors and type checkers."""

    kp: PerAxis
    ki: PerAxis
    kd: PerAxis
    velocity_ff: PerAxis
    acceleration_ff: PerAxis
    output_velocity: PerAxis


FEED_FORWARD = ("velocity_ff", "acceleration_ff")  # act on the demand alone, outside the loop

GAINS = parameters_of(Gains)
GAIN_NAMES = Gains._fields
