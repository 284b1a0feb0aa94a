"""The assembler of a program, to which its statements add themselves."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.controllers.basic.assembler import Assembler
from gantrysim.controllers.trio.basic.process import Process
from gantrysim.controllers.trio.basic.raw import Raw


class ProcessAssembler(Assembler[Process]):
    """Assembles a program.

    Attributes:
        assigned: variables that a statement assigns.
        arrays: names that DIM has given to arrays.
        include: assembles the statements of an included program, by its name.
    """

    def __init__(self, include: Callable[[ProcessAssembler, str], None]) -> None:
        super().__init__()
        self.assigned: set[str] = set()
        self.arrays: set[str] = set()
        self.include = include


Handler = Callable[[ProcessAssembler, Raw], None]
