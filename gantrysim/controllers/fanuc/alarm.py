"""The controller's alarms."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.base.errors import InputError

TITLES = {
    3: "TOO MANY DIGITS",
    4: "ADDRESS NOT FOUND",
    5: "NO DATA AFTER ADDRESS",
    6: "ILLEGAL USE OF NEGATIVE SIGN",
    7: "ILLEGAL USE OF DECIMAL POINT",
    9: "ILLEGAL ADDRESS INPUT",
    10: "IMPROPER G-CODE",
    11: "NO FEEDRATE COMMANDED",
    20: "OVER TOLERANCE OF RADIUS",
    21: "ILLEGAL PLANE AXIS COMMANDED",
    22: "NO CIRCLE RADIUS",
    34: "NO CIRC ALLOWED IN ST-UP/EXT BLK",
    37: "CAN NOT CHANGE PLANE IN CRC",
    41: "INTERFERENCE IN CUTTER COMPENSATION",
    50: "CHF/CNR NOT ALLOWED IN THIS BLOCK",
    51: "MISSING MOVE AFTER CNR/CHF",
    55: "MISSING MOVE VALUE IN CNR/CHF",
    76: "ADDRESS P NOT DEFINED",
    77: "SUB PROGRAM NESTING ERROR",
    78: "NUMBER NOT FOUND",
    114: "FORMAT ERROR IN MACRO",
    124: "MISSING END STATEMENT",
    5122: "ILLEGAL COMMAND IN SPIRAL",
    5123: "OVER TOLERANCE OF END POINT",
    5124: "CAN NOT COMMAND SPIRAL",
}

_DETAIL_LENGTH = 200  # characters of a detail


class Alarm(InputError):  # noqa: N818 - the controller's own word
    """A program that the controller refuses before any motion.

    Attributes:
        number: of the alarm.
        title: the controller's own text for it.
        block: name of the block, as "N10" or "block 3".
        line: of the program's text, from 1; 0 for a program of values.
        detail: the cause.
    """

    def __init__(self, number: int, block: str, line: int, detail: str) -> None:
        self.number = number
        self.title = TITLES[number]
        self.block = block
        self.line = line
        self.detail = detail if len(detail) <= _DETAIL_LENGTH else f"{detail[:_DETAIL_LENGTH]}..."
        where = block if block.startswith("block ") else f"block {block}"
        where += f" (line {line})" if line else ""
        super().__init__(f"alarm {number:03} {self.title} in {where}: {self.detail}")

    def __reduce__(self) -> tuple[type[Alarm], tuple[int, str, int, str]]:
        return Alarm, (self.number, self.block, self.line, self.detail)


@dataclass(frozen=True)
class BlockSource:
    """Where a block comes from: its name and its line, as in `Alarm`."""

    name: str
    line: int

    def fail(self, number: int, detail: str) -> Alarm:
        """Return an alarm of this block."""
        return Alarm(number, self.name, self.line, detail)
