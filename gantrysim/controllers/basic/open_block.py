"""Blocks of a program's text that are not ended yet."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from gantrysim.controllers.basic.code import Frame, Instruction

FrameType = TypeVar("FrameType", bound=Frame)

ENDS = {"IF": "ENDIF", "WHILE": "WEND", "REPEAT": "UNTIL", "FOR": "NEXT", "DO": "LOOP"}  # of the blocks


@dataclass
class OpenBlock(Generic[FrameType]):
    """A block of which the end is not reached yet.

    Attributes:
        kind: its keyword.
        line: at which it begins.
        first: index of its first instruction.
        test: the instruction that jumps past its branch; None where nothing does.
        exits: jumps to its end.
        variable: of a FOR loop.
    """

    kind: str
    line: int
    first: int
    test: Instruction[FrameType] | None = None
    exits: list[Instruction[FrameType]] = field(default_factory=list)
    variable: str = ""
