"""The parameters of a program: numbered and named, local to a subroutine or global."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError, unknown
from gantrysim.controllers.macro.scanner import Target

_MOST_PARAMETERS = 100_000  # parameters in use

System = Callable[[float | str], float | None]  # a parameter that the controller provides; None for others


@dataclass
class LocalParameters:
    """The parameters of one call of a subroutine."""

    numbered: dict[int, float] = field(default_factory=dict)
    named: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Numbering:
    """The numbered parameters of a dialect.

    Attributes:
        local: number up to which a parameter belongs to one call of a subprogram.
        highest: largest number.
    """

    local: int
    highest: int


class Parameters:
    """Numbered parameters, of which the first are local, and named ones, global if they begin with `_`.

    Args:
        system: values that the controller provides.
        numbering: of the dialect.

    Attributes:
        scope: the local parameters of the call that runs.
    """

    def __init__(self, system: System, numbering: Numbering) -> None:
        self._system = system
        self._local = numbering.local
        self._highest = numbering.highest
        self._common = LocalParameters()
        self.scope = LocalParameters()

    def numbered(self, number: float) -> float:
        """Return a parameter; 0 where it was never set."""
        k = self._checked_number(number)
        if k <= self._local:
            return self.scope.numbered.get(k, 0.0)
        provided = self._system(k)
        return self._common.numbered.get(k, 0.0) if provided is None else provided

    def vacant(self, number: float) -> bool:
        """Return whether a numbered parameter was never set."""
        k = self._checked_number(number)
        return k not in self._scope_of(k).numbered and self._system(k) is None

    def named(self, name: str) -> float:
        """Return a named parameter.

        Raises:
            InputError: it was never set.
        """
        names = self._names(name)
        if name in names:
            return names[name]
        provided = self._system(name)
        if provided is None:
            raise unknown("parameter", f"#<{name}>", [f"#<{known}>" for known in names])
        return provided

    def exists(self, key: float | str) -> bool:
        """Return whether a named parameter was set, or a number is one."""
        if isinstance(key, str):
            try:
                return key in self._names(key) or self._system(key) is not None
            except InputError:  # a value that must be given first
                return False
        return 1 <= key <= self._highest

    def set(self, target: Target, value: float) -> None:
        """Set a parameter."""
        if not math.isfinite(value):
            raise InputError(f"parameter = {value:g}: must be finite")
        if isinstance(target, str):
            self._names(target)[target] = value
        else:
            k = self._checked_number(target(self))
            self._scope_of(k).numbered[k] = value
        if len(self._common.numbered) + len(self._common.named) + len(self.scope.named) > _MOST_PARAMETERS:
            raise InputError(f"more than {_MOST_PARAMETERS} parameters")

    def _names(self, name: str) -> dict[str, float]:
        return (self._common if name.startswith("_") else self.scope).named

    def _scope_of(self, number: int) -> LocalParameters:
        return self.scope if number <= self._local else self._common

    def _checked_number(self, number: float) -> int:
        k = round(number) if math.isfinite(number) else 0
        if not 1 <= k <= self._highest or abs(number - k) > 1e-4:
            raise InputError(f"parameter #{number:g}: must be a whole number from 1 to {self._highest}")
        return k
