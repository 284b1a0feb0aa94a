"""What was computed of runs, kept as long as there is room for it."""

from __future__ import annotations

from typing import Generic, TypeVar

from gantrysim.base import memory

ROOM = memory.LONG  # [kB]: a tick of a record with its analysis takes one

_Value = TypeVar("_Value")


class Recent(Generic[_Value]):
    """Values by a key; of those used last, as many as there is `ROOM` for."""

    def __init__(self) -> None:
        self._values: dict[str, tuple[_Value, float]] = {}  # with their sizes [kB]; that used last at the end

    def get(self, key: str) -> _Value | None:
        """Return the value of a key, None where it is not kept."""
        entry = self._values.pop(key, None)
        if entry is None:
            return None
        self._values[key] = entry
        return entry[0]

    def keep(self, key: str, value: _Value, size: float) -> None:
        """Keep a value of a size [kB], and drop those for which there is no room then."""
        self._values.pop(key, None)
        self._values[key] = value, size
        total = sum(stored for _, stored in self._values.values())
        while total > ROOM:
            oldest = next(iter(self._values))
            total -= self._values.pop(oldest)[1]
