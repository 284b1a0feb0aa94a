"""The texts of a program and its subprograms as one sequence of blocks, with the places of the programs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from gantrysim.controllers.fanuc.alarm import BlockSource
from gantrysim.controllers.fanuc.block_words import COMMENT, OF_FILE

MOST_DIGITS = 20  # of a block's or program's number
_PROGRAM = re.compile(r"(?:N[0-9]+)?O([0-9]+)")
_FILE_NUMBER = re.compile(r"O?([0-9]+)", re.IGNORECASE)


@dataclass(frozen=True)
class ProgramSource:
    """A program and how it is read.

    Attributes:
        text: the program, with subprograms.
        subprograms: texts in files of their own, by file name without its suffix.
        skip: whether blocks that begin with a slash are skipped.
        most_steps: blocks that may run.
    """

    text: str
    subprograms: Mapping[str, str] = field(default_factory=dict)
    skip: bool = False
    most_steps: int = 1_000_000


@dataclass(frozen=True)
class ProgramBlock(BlockSource):
    """A block, in capitals and without comments; line 0 in a file of subprograms, whose line its name then has."""

    text: str


class ProgramBlocks:
    """The blocks of a program and its subprograms.

    Args:
        source: their texts.

    Attributes:
        blocks: in their order, those of files of their own at the end.
        files: places of the first blocks of files of subprograms, by name, in order.
        programs: places of the blocks with the number of a program, by that number.
    """

    def __init__(self, source: ProgramSource) -> None:
        self.blocks: list[ProgramBlock] = []
        self.programs: dict[int, int] = {}
        self.files: dict[str, int] = {}
        self._skip = source.skip
        self._add(source.text)
        for name, text in source.subprograms.items():
            self.files[name] = len(self.blocks)
            number = _FILE_NUMBER.fullmatch(name.strip())
            if number and not _begins_with_number(text):
                # a call enters the block after the number
                self._add_block(f"O{number[1]}", BlockSource(f"block 0{OF_FILE}{name}", 0))
            self._add(text, name)

    def _add(self, text: str, file: str = "") -> None:
        """Add the blocks of a text, which may be that of a file of subprograms."""
        first = len(self.blocks)
        for line, written in enumerate(text.splitlines(), 1):
            for plain in _plain_blocks(written):
                if plain.startswith("/") and self._skip:
                    continue
                name = f"block {len(self.blocks) - first + 1}"
                place = BlockSource(f"{name}{OF_FILE}{file}, line {line}", 0) if file else BlockSource(name, line)
                self._add_block(plain.removeprefix("/").lstrip(), place)

    def _add_block(self, text: str, place: BlockSource) -> None:
        program = _PROGRAM.match("".join(text.split()))
        if program:
            self.programs.setdefault(numbered(program[1]), len(self.blocks))
        self.blocks.append(ProgramBlock(place.name, place.line, text))


def _plain_blocks(line: str) -> list[str]:
    """Return the blocks of a line, in capitals and without comments."""
    parts = (part.strip().upper() for part in re.sub(COMMENT, " ", line).split(";"))
    return [part for part in parts if part and not part.startswith("%")]


def _begins_with_number(text: str) -> bool:
    """Return whether the first block of a text has the number of a program."""
    for line in text.splitlines():
        for plain in _plain_blocks(line):
            return _PROGRAM.match("".join(plain.split())) is not None
    return False


def numbered(digits: str) -> int:
    """Return the number of a block or program; one of more digits than Python reads is that of no other."""
    return int(digits) if len(digits) <= MOST_DIGITS else -1
