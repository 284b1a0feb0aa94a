"""The package uses the public interface of its libraries, but for the uses that are listed here with their reasons."""

import ast
from pathlib import Path

import pytest

import gantrysim

from support.syntax import tree_of

PACKAGE = Path(gantrysim.__file__).parent
MOST = 3  # reasons to use private parts
# why uses stay, and which they are by file
ALLOWED = {
    "compiled functions read mjData by the offsets of its struct; at import these are compared with MuJoCo's arrays": {
        "machine/layout.py": {
            *("ctypes.c_uint64.from_address", "ctypes.c_int.from_address", "ctypes.c_int64.from_address"),
            *("data._address", "model._address"),
        },
        "engine/native/callback.py": {"data._address"},
    },
    "no traceback of what is no error: an interrupt while modules are imported, the end of loky's manager": {
        "cli/start.py": {"sys.excepthook ="},
        "study/runner.py": {"threading.excepthook ="},
    },
    "compiled functions read and write arrays by their addresses, which numba offers to intrinsics alone": {
        "engine/native/pointers.py": {"llvmlite"}
    },
}
# documented for everyone in spite of their names: of named tuples, of os, and what notebooks ask for
PUBLIC = {"_replace", "_asdict", "_fields", "_make", "_field_defaults", "_exit", "_repr_png_", "_repr_html_"}
# modules that their library keeps to itself, though their names do not say so
INTERNAL = ("numba.core", "llvmlite")
# what reaches into another library, another process or the interpreter by a public name
REACHES = {"in_dll", "from_address", "addressof", "pythonapi", "prctl", "fork", "meta_path", "path_hooks"}
COLLECTION = {"freeze", "unfreeze", "disable"}  # of gc
# attributes of modules that programs set, as Python's documentation says
SET = {"sys.stdout", "sys.stderr", "sys.unraisablehook"}


class Uses(ast.NodeVisitor):
    """The uses of private parts in a file, as (line, text).

    Args:
        own: names with an underscore that objects of the same folder have.
    """

    def __init__(self, own=frozenset()):
        self.own = own
        self.foreign = set()  # names of modules and objects of other packages in this file
        self.found = []

    def note(self, node, text):
        self.found.append((node.lineno, text))

    def visit_Import(self, node):
        for alias in node.names:
            self.imported(node, alias.name)
            if not is_own(alias.name):
                self.foreign.add(alias.asname or alias.name.partition(".")[0])

    def visit_ImportFrom(self, node):
        if node.level or is_own(node.module) or node.module == "__future__":
            return
        self.imported(node, node.module)
        for alias in node.names:
            self.foreign.add(alias.asname or alias.name)
            if is_private(alias.name) or alias.name in REACHES or f"{node.module}.{alias.name}" in INTERNAL:
                self.note(node, f"{node.module}.{alias.name}")

    def imported(self, node, module):
        if not is_own(module) and (is_private_module(module) or module.startswith(INTERNAL)):
            self.note(node, module)

    def visit_Attribute(self, node):
        self.generic_visit(node)
        base = node.value
        is_foreign = root_of(base) in self.foreign
        is_own_object = (isinstance(base, ast.Name) and base.id in ("self", "cls")) or is_super(base)
        is_other = is_private(node.attr) and not is_own_object and (is_foreign or node.attr not in self.own)
        is_reach = node.attr in REACHES and (is_foreign or node.attr == "in_dll")
        is_collection = node.attr in COLLECTION and isinstance(base, ast.Name) and base.id == "gc"
        if is_other or is_reach or is_collection:
            self.note(node, ast.unparse(node)[-60:])
        elif isinstance(node.ctx, ast.Store):
            text = ast.unparse(node)[-60:]
            is_planted = is_foreign and isinstance(base, ast.Name) and text not in SET
            if node.attr == "__class__" or is_planted:
                self.note(node, f"{text} =")

    def visit_Call(self, node):
        """The same by getattr, setattr and their like; a copy of the process by its name."""
        self.generic_visit(node)
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if any(isinstance(value, ast.Constant) and value.value == "fork" for value in node.args):
            self.note(node, "fork")
        if name in ("getattr", "setattr", "hasattr", "delattr") and isinstance(node.args[1], ast.Constant):
            attribute = str(node.args[1].value)
            is_self = isinstance(node.args[0], ast.Name) and node.args[0].id in ("self", "cls")
            if is_private(attribute) and attribute not in self.own and not is_self:
                self.note(node, f"{name} {attribute}")


def is_own(module):
    return module.partition(".")[0] == "gantrysim"


def is_private(name):
    return name.startswith("_") and not name.startswith("__") and name.strip("_") != "" and name not in PUBLIC


def is_private_module(module):
    return any(is_private(part) for part in module.split("."))


def is_super(node):
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super"


def root_of(node):
    while isinstance(node, ast.Attribute | ast.Call | ast.Subscript):
        node = node.func if isinstance(node, ast.Call) else node.value
    return node.id if isinstance(node, ast.Name) else None


def own_names(trees):
    """Names with an underscore that objects of these files have: what classes define, and attributes of self."""
    names = set()
    for node in (node for tree in trees for node in ast.walk(tree)):
        match node:
            case ast.ClassDef(body=body):
                names.update(part.name for part in body if isinstance(part, ast.FunctionDef))
                fields = [part for part in body if isinstance(part, ast.Assign | ast.AnnAssign)]
                names.update(name.id for part in fields for name in ast.walk(part) if isinstance(name, ast.Name))
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name, ctx=ast.Store()):
                names.add(name)
    return frozenset(name for name in names if is_private(name))


@pytest.fixture(scope="module")
def uses():
    """The uses of private parts in the package, as (line, text) by file."""
    trees = {file.relative_to(PACKAGE): tree_of(file.read_text(encoding="utf-8")) for file in PACKAGE.rglob("*.py")}
    folders = {file.parent for file in trees}
    own = {folder: own_names(tree for file, tree in trees.items() if file.parent == folder) for folder in folders}
    found = {}
    for file, tree in sorted(trees.items()):
        visitor = Uses(own[file.parent])
        visitor.visit(tree)
        found[file.as_posix()] = visitor.found
    return found


def test_the_package_uses_no_private_parts_but_those_that_are_listed(uses):
    listed = {file: texts for files in ALLOWED.values() for file, texts in files.items()}
    unlisted = [
        f"{file}, line {line}: {text}"
        for file, uses_of_file in uses.items()
        for line, text in uses_of_file
        if text not in listed.get(file, ())
    ]
    assert unlisted == []


def test_the_list_is_short_and_holds_nothing_that_is_gone(uses):
    assert len(ALLOWED) <= MOST
    for files in ALLOWED.values():
        for file, texts in files.items():
            assert texts <= {text for _, text in uses[file]}, file


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("import numba._dynfunc", "numba._dynfunc"),
        ("from joblib._parallel_backends import LokyBackend", "joblib._parallel_backends"),
        ("from joblib import _store_backends", "joblib._store_backends"),
        ("import llvmlite.binding as llvm", "llvmlite.binding"),
        ("from numba.core.types import Type", "numba.core.types"),
        ("from numba import core", "numba.core"),
        ("import os\nos.fork()", "os.fork"),
        ("import multiprocessing\nmultiprocessing.get_context('fork')", "fork"),
        ("import ctypes\nctypes.CDLL(None).prctl(1, 9)", "ctypes.CDLL(None).prctl"),
        ("from ctypes import c_void_p as p\np.in_dll(library, 'x')", "p.in_dll"),
        ("import gc\ngc.freeze()", "gc.freeze"),
        ("import sys\nsys.meta_path.insert(0, finder)", "sys.meta_path"),
        ("import sys\nsys.excepthook = told", "sys.excepthook ="),
        ("import threading\nthreading.excepthook = told", "threading.excepthook ="),
        ("import mujoco.viewer\nmujoco.viewer._Simulate()", "mujoco.viewer._Simulate"),
        ("from matplotlib.axis import Axis\nAxis.draw = drawn", "Axis.draw ="),
        ("value.__class__ = Other", "value.__class__ ="),
        ("def draw(axis): axis._update_ticks()", "axis._update_ticks"),
        ("getattr(legend, '_loc')", "getattr _loc"),
        ("setattr(legend, '_loc', 3)", "setattr _loc"),
    ],
)
def test_a_use_is_found(code, text):
    visitor = Uses(own_names([ast.parse(code)]))
    visitor.visit(ast.parse(code))
    assert [found for _, found in visitor.found] == [text]


@pytest.mark.parametrize(
    "code",
    [
        "from gantrysim.base._inner import _helper",
        "from __future__ import annotations\nfrom ._inner import _helper",
        "import os\nos._exit(1)\nrow._replace(x=1)\nrow._fields\nprint(os.__name__)",
        "class A:\n    def _draw(self): self._x = 1\n    def draw(self, other): return other._x, other._draw()",
        "class A(B):\n    def draw(self): super()._draw()",
        "import sys\nsys.stdout = stream\ngc = 1",
        "import numpy as np\nvalues = np.zeros(3)\nvalues.flags.writeable = False",
        "getattr(run, 'time')",
    ],
)
def test_what_is_public_or_of_the_package_is_no_use(code):
    visitor = Uses(own_names([ast.parse(code)]))
    visitor.visit(ast.parse(code))
    assert visitor.found == []
