"""Blocks of a program's text that are not ended yet."""

from __future__ import annotations

from dataclasses import dataclass, field

from gantrysim.controllers.basic.code import Target

ENDS = {"IF": "ENDIF", "WHILE": "WEND", "REPEAT": "UNTIL", "FOR": "NEXT", "DO": "LOOP"}  # of the blocks


@dataclass
class OpenBlock:
    """A block of which the end is not reached yet.

    Attributes:
        kind: its keyword.
        line: at which it begins.
        first: index of its first instruction.
        past: where its test jumps to, past its branch; None where nothing does.
        exits: targets of the jumps to its end.
        variable: of a FOR loop.
    """

    kind: str
    line: int
    first: int
    past: Target | None = None
    exits: list[Target] = field(default_factory=list)
    variable: str = ""
