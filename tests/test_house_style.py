"""The style of the code, held by its syntax trees: names, assignments, sizes of functions and modules."""

import ast
from collections import Counter
from pathlib import Path

import pytest

from support.syntax import nodes_of

PACKAGE = Path(__file__).parent.parent / "gantrysim"
LONGEST_FUNCTION = 60  # lines without the docstring: a screen
LONGEST_MODULE = 500
MOST_PARAMETERS = 6  # self and cls not counted

# pronouns and participles: none names a quantity of the field
NO_NOUNS = {"own", "one", "found", "at", "each", "told", "kept", "left", "made", "rest", "more"}

# superlatives and the like, which as a constant's whole name do not say of what
WORDS_OF_QUANTITY = """
all any apart calm deepest early empty enough equal even exact farthest fastest few fewest fine finer flat flattest
furthest half hidden highest idle large largest least long longer longest lost lowest many missing mostly moving narrow
narrower near nearer nearest nearly often plain quick reach rest room rough same sharpest short shorter shortest
significant slow slower slowest smallest smooth steady steepest still straight sure unseen unstable useful whole wide
wider widest worst
"""

# Exceptions, "file:name" with the reason. Commands of the terminal may have any number of parameters without one.
NAMES_ALLOWED: dict[str, str] = {
    "render/film.py:at": "keyword of Film.save_picture that users type",
    "render/film.py:left": "side of a picture, beside its top",
    "render/strip.py:left": "side of the curves, beside right, above and bottom",
    "compare/runs/differences.py:SAME": "a value of the column, beside BETTER and WORSE",
    "controllers/softmc/basic/properties.py:IDLE": "the properties of a motion element without a motion",
    "controllers/trio/basic/moves.py:IDLE": "MTYPE of an axis without a move",
    "remedy/levers/program.py:SLOWER": "a lever, beside FASTER",
    "render/colours.py:PLAIN": "a colour of the bead, by its name",
    "results/colours.py:NEAR": "a colour of a row, beside GOOD and BAD",
}
PARAMETERS_ALLOWED: dict[str, str] = {
    "engine/batch.py:simulate_batch": "keywords that users type",
    "engine/simulate.py:simulate": "keywords that users type",
    "servo/laws/p_pi.py:cascaded_torque": "the quantities of its equation; compiled",
    "servo/laws/pid.py:torque_demand": "the quantities of its equation; compiled",
    "remedy/improve.py:improve": "keywords that users type",
    "servo/servo.py:derive": "keywords that users type",
    "render/film.py:save_video": "keywords of Take, Film and Film.save in one call, which users type",
    "render/renderer.py:__init__": "a run, its view and the looks of its bead, which users type",
    "engine/device.py:run": "a kernel: numba-cuda's simulator takes no records within tuples",
    "job/loaded.py:load": "keywords of a public constructor, one for each option of the command",
}
# States of a search or a recursion; those of a language's interpreter, in controllers, change by their nature.
CHANGING = {
    "engine/learning.py:_Pupil",
    "remedy/bench.py:Task",
    "remedy/course.py:Prospect",
    "study/tuning/candidates.py:Candidate",
    "study/tuning/search.py:MarginEdge",
    "study/tuning/search.py:_Runs",
}


def unparsed(nodes):
    return Counter(ast.unparse(node) for node in nodes)


def is_parallel(node):
    """Whether an assignment binds several names to several values: `a, b = 1, 2`, `a = b, c = pair`; swaps may."""
    if not isinstance(node, ast.Assign):
        return False
    tuples = [target for target in node.targets if isinstance(target, ast.Tuple | ast.List)]
    if tuples and len(node.targets) > 1:
        return True
    if not tuples or not isinstance(node.value, ast.Tuple | ast.List):
        return False
    return unparsed(tuples[0].elts) != unparsed(node.value.elts)


def bound_name(node):
    """Return the variable, parameter, attribute or field that a node binds, or None."""
    match node:
        case ast.Name(ctx=ast.Store()):
            return node.id
        case ast.Attribute(ctx=ast.Store()):
            return node.attr
        case ast.arg():
            return node.arg
        case ast.ExceptHandler() | ast.MatchAs() | ast.MatchStar():
            return node.name
        case ast.MatchMapping():
            return node.rest
        case ast.alias():
            return node.asname
    return None


def is_quantifier(name):
    return name is not None and name.isupper() and name.lstrip("_").lower() in WORDS_OF_QUANTITY.split()


def lines_of(function):
    docstring = ast.get_docstring(function, clean=False)
    lines_of_docstring = docstring.count("\n") + 1 if docstring else 0
    return function.end_lineno - function.lineno + 1 - lines_of_docstring


def parameters_of(function):
    arguments = function.args
    names = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def is_command(function, file):
    """Whether a function is a command of the terminal, in the file of its name: its parameters are the options."""
    decorated = any(ast.unparse(node).endswith(".command()") for node in function.decorator_list)
    return decorated or file == f"cli/{function.name}.py" or "typer." in ast.unparse(function.args)


def breaches(source, file):
    """Yield rule, line and text of every place in a source that breaks a rule."""
    lines = source.count("\n")
    if lines > LONGEST_MODULE:
        yield "modules", 1, f"{lines} lines"
    for node in nodes_of(source):
        name = bound_name(node)
        if name in NO_NOUNS and f"{file}:{name}" not in NAMES_ALLOWED:
            yield "names", node.lineno, name
        if is_quantifier(name) and f"{file}:{name}" not in NAMES_ALLOWED:
            yield "constants", node.lineno, name
        if is_parallel(node):
            yield "assignments", node.lineno, ast.unparse(node)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            if lines_of(node) > LONGEST_FUNCTION:
                yield "functions", node.lineno, f"{node.name}, {lines_of(node)} lines"
            count = len(parameters_of(node))
            if (
                count > MOST_PARAMETERS
                and not is_command(node, file)
                and f"{file}:{node.name}" not in PARAMETERS_ALLOWED
            ):
                yield "parameters", node.lineno, f"{node.name}, {count} parameters"


def sources():
    return {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


def test_the_package_keeps_every_rule():
    """In one test, as all rules walk the same tree."""
    places = [
        f"{rule}: gantrysim/{file.as_posix()}:{line} {text}"
        for file, source in ((path.relative_to(PACKAGE), source) for path, source in sources().items())
        for rule, line, text in breaches(source, file.as_posix())
    ]
    assert not places, "\n".join(places)


def test_values_do_not_change():
    """A dataclass is frozen, so that what shares a value never sees it change, unless it is a state by its name."""
    changing = {
        f"{path.relative_to(PACKAGE).as_posix()}:{node.name}"
        for path, source in sources().items()
        for node in nodes_of(source)
        if isinstance(node, ast.ClassDef)
        for decorator in map(ast.unparse, node.decorator_list)
        if decorator.startswith("dataclass") and "frozen=True" not in decorator
    }
    assert {name for name in changing if not name.startswith("controllers/")} == CHANGING


def test_exceptions_are_needed():
    """An exception that nothing needs would admit the next one in silence."""
    names = set()
    functions = set()
    for file in {place.partition(":")[0] for place in (*NAMES_ALLOWED, *PARAMETERS_ALLOWED)}:
        for node in nodes_of((PACKAGE / file).read_text(encoding="utf-8")):
            names.add(f"{file}:{bound_name(node)}")
            if isinstance(node, ast.FunctionDef) and len(parameters_of(node)) > MOST_PARAMETERS:
                functions.add(f"{file}:{node.name}")
    assert NAMES_ALLOWED.keys() <= names
    assert PARAMETERS_ALLOWED.keys() <= functions
    assert all(reason for reason in (*NAMES_ALLOWED.values(), *PARAMETERS_ALLOWED.values()))


PARALLEL = ["a, b = 1, 2", "a, (b, c) = 1, pair", "a = b, c = pair", "x[0], y = y, 0", "[a, b] = [1, 2]"]
SINGLE = ["a, b = pair", "a, b = b, a", "x[i], x[j] = x[j], x[i]", "a = b = 0", "a = 1, 2", "a, b = (f(x) for x in y)"]


def rules(source):
    return [rule for rule, _, _ in breaches(source, "room/file.py")]


@pytest.mark.parametrize("source", PARALLEL)
def test_parallel_assignments_are_seen(source):
    assert rules(source) == ["assignments"]


@pytest.mark.parametrize("source", SINGLE)
def test_other_assignments_are_not_taken_for_parallel_ones(source):
    assert rules(source) == []


BINDINGS = [
    "at = 1",
    "at: int",
    "at += 1",
    "(at := 1)",
    "a, *rest = b",
    "self.own = 1",
    "def f(one): pass",
    "def f(*more): pass",
    "f = lambda each: 0",
    "for at in b: pass",
    "a = [at for at in b]",
    "with f() as kept: pass",
    "import made as told",
    "try: pass\nexcept E as found: pass",
    "match a:\n case [1, *rest]: pass",
    "match a:\n case {1: 1, **rest}: pass",
    "class A:\n    left: float",
]


@pytest.mark.parametrize("source", BINDINGS)
def test_names_are_seen_however_they_are_bound(source):
    assert rules(source) == ["names"]


def test_a_constant_says_of_what():
    assert rules("_LONGEST = 5") == rules("class A:\n    FEWEST: int = 5") == ["constants"]
    assert rules("_LONGEST_PATH = 5\nlongest = _LONGEST") == []


def test_names_of_functions_and_uses_are_free():
    assert rules("def at(self): return path.left + one") == []


def test_sizes_are_seen():
    body = "    a = 1\n"
    docstring = '    """First.\n\n    Second.\n    """\n'
    assert rules("def f():\n" + 59 * body) == []
    assert rules("def f():\n" + 60 * body) == ["functions"]
    assert rules("def f():\n" + docstring + 59 * body) == []
    assert rules("class A:\n def f(self, a, b, c, d, e, f): pass") == []
    assert rules("def f(a, b, c, *, d, e, f, g): pass") == ["parameters"]
    assert rules("@app.command()\ndef f(a, b, c, d, e, f, g): pass") == []
    assert rules("a = 1\n" * 500) == []
    assert rules("a = 1\n" * 501) == ["modules"]
