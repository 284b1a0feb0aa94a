"""Nodes of the parsed text."""

from __future__ import annotations

from lark import Token, Tree

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
