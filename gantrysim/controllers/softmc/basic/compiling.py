"""From a text to code."""

from __future__ import annotations

from gantrysim.controllers.basic.code import Code
from gantrysim.controllers.softmc.basic.execution import RoutineFrame
from gantrysim.controllers.softmc.basic.statement_table import BLOCKS, COMMANDS
from gantrysim.controllers.softmc.basic.syntax import parse
from gantrysim.controllers.softmc.basic.tree import Node, trees
from gantrysim.controllers.softmc.basic.tree_assembler import TreeAssembler


def code_of(statements: list[Node], line: int | None = None) -> Code[RoutineFrame]:
    """Return the code of statements, each at its own line or all at one."""
    assembler = TreeAssembler(COMMANDS.handlers, BLOCKS.handlers, line)
    for tree in statements:
        assembler.add(tree)
    return assembler.finish()


def interpreted(text: str, line: int) -> Code[RoutineFrame]:
    """Return the code of a text within the program's line."""
    return code_of(trees(parse(text.strip())), line)
