"""Nodes of the parsed text."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lark import Token, Tree

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import STATEMENT, Assembler
from gantrysim.controllers.softmc.basic.execution import Action, RoutineFrame
from gantrysim.controllers.softmc.commands import SoftMCError

Node = Tree[Token]


def trees(tree: Node) -> list[Node]:
    """Return the children that are trees."""
    return [child for child in tree.children if isinstance(child, Tree)]


def word(tree: Node, k: int = 0) -> str:
    """Return a child that is a token."""
    return str(tree.children[k])


def child(tree: Node, k: int) -> Node:
    """Return a child that is a tree."""
    node = tree.children[k]
    assert isinstance(node, Tree)
    return node


def optional(tree: Node, k: int) -> Node | None:
    """Return a child that is a tree where the text has it."""
    node = tree.children[k]
    return node if isinstance(node, Tree) else None


def name_of(tree: Node) -> str | None:
    """Return the name that a tree is, or None."""
    return word(tree) if tree.data in ("name", "target") else None


def line_of(tree: Node) -> int:
    """Return the line of a tree."""
    return int(tree.meta.line)


# The assembler of a program: it hands each node to the function of its name.

_WAITING = "sleep"  # the command that only lets time pass


class LocatedError(SoftMCError):
    """An error with its line."""


class TreeAssembler(Assembler[RoutineFrame]):
    """Assembles statements.

    Args:
        commands: from a node to what it does, by the kind of the node.
        blocks: that add statements with blocks or branches, given the node and its line.
        line: of all statements; by default each has its own.
    """

    def __init__(
        self, commands: Mapping[str, CommandHandler], blocks: Mapping[str, BlockHandler], line: int | None = None
    ) -> None:
        super().__init__()
        self._commands = commands
        self._blocks_by_name = blocks
        self._line = line

    def add(self, tree: Node, cost: str | None = STATEMENT) -> None:
        """Add a statement.

        Raises:
            LocatedError: words that do not fit, with their line.
        """
        kind = str(tree.data)
        line = line_of(tree) if self._line is None else self._line
        if kind not in self._commands and kind not in self._blocks_by_name:
            raise LocatedError(f"line {line_of(tree)}: a {kind} must stand outside of others")
        try:
            if kind in self._commands:
                self.emit(line, self._commands[kind](tree), cost, pure=kind == _WAITING)
            else:
                self._blocks_by_name[kind](self, tree, line)
        except LocatedError:
            raise
        except RecursionError:
            raise LocatedError(f"line {line_of(tree)}: must be less deeply nested") from None
        except InputError as error:
            raise LocatedError(f"line {line_of(tree)}: {error}") from None

    def add_all(self, block: Node) -> None:
        """Add the statements of a block."""
        for tree in trees(block):
            self.add(tree)


CommandHandler = Callable[[Node], Action]
BlockHandler = Callable[[TreeAssembler, Node, int], None]
