"""Syntax trees of source files, each built once for all tests of a process that read it."""

import ast
from functools import cache


@cache
def tree_of(source):
    """The syntax tree of a text, which is shared: nobody may change it."""
    return ast.parse(source)


@cache
def nodes_of(source):
    """The nodes of that tree, from its root: to find them takes as long as to build it."""
    return tuple(ast.walk(tree_of(source)))
