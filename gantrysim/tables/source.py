"""Where a quantity stands in a table, as a user writes it: COLUMN, COLUMN[UNIT], COLUMN*FACTOR UNIT."""

from __future__ import annotations

import re
from typing import NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.base.heads import name_and_unit
from gantrysim.base.patterns import NUMBER

_FORMS = "COLUMN, COLUMN[UNIT], COLUMN*FACTOR, COLUMN/DIVISOR or COLUMN*FACTOR UNIT"
# the blanks are not at the end of a repetition, so that the time is linear in the text's length
_SCALED = re.compile(rf"([*/])\s*({NUMBER})\s*([^\s*/\d][^*/]*)?")


class Source(NamedTuple):
    """Where a quantity stands in a table.

    Attributes:
        column: name, or number from 1.
        scale: factor on the values, besides their unit.
        unit: of the values; empty for that in the column's name, or the quantity's own.
    """

    column: str
    scale: float = 1.0
    unit: str = ""

    @classmethod
    def parse(cls, key: str, text: str) -> Source:
        """Return the source that a text gives, as "I*0.0302 N·m" of a current and the torque constant of its motor.

        Args:
            key: quantity, for errors.
            text: name of a column, a factor or a divisor, a unit; the unit may stand in brackets.

        Raises:
            InputError: no column, or a factor that is 0 or not finite.
        """
        column, unit = name_and_unit(text)
        if not text.rstrip().endswith("]"):  # brackets other than these belong to the name, as in MPOS AXIS(0)
            column = text.strip()
            unit = ""
        factor = 1.0
        place = max(column.rfind("*"), column.rfind("/"))
        scaled = _SCALED.fullmatch(column[place:].rstrip()) if place >= 0 else None
        if scaled:
            column = column[:place]
            factor = float(scaled[2])
            if scaled[1] == "/":
                factor = 1 / factor if factor else 0.0
            unit = unit or (scaled[3] or "").strip()
        if not column.strip():
            raise InputError(f"{key}={text}: must be {_FORMS}")
        if not 0 < abs(factor) < float("inf"):
            raise InputError(f"{key}={text}: factor of {factor:g}: must be finite and other than 0")
        return cls(column.strip(), factor, unit)
