"""A value of the servo that each axis has: its key in a job file, its unit and its meaning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias, get_type_hints

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
