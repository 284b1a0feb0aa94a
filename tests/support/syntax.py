"""Syntax trees of source files, each built once for all tests of a process that read it."""

import ast
from functools import cache


@cache
def tree_of(source):
    """The syntax tree of a text, which is shared: nobody may change it."""
    return ast.parse(source)
