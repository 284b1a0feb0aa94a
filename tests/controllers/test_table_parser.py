"""Parsing with lark's tables against lark itself: the same values, lines and errors."""

from hypothesis import given, settings
from hypothesis import strategies as st
from lark import Lark
from lark.exceptions import UnexpectedInput

from gantrysim.controllers.basic.statements import with_keywords
from gantrysim.controllers.basic.table_parser import TableParser

# words that are keywords here and names there, a bit that looks like a number, parts that may be missing, a rule that
# gives way to its only part, one that may be empty, comments and lines that go on
GRAMMAR = with_keywords(
    r"""
start: (line? _NL)*
?line: IF expr THEN [line] -> branch
    | FOR NAME "=" expr TO expr [STEP expr]
    | ON expr GOTO NAME ("," NAME)*
    | WAIT (IDLE | LOADED) -> wait
    | bits LOADED -> marked
    | ref "=" expr -> assign
    | ref
bits: BIT*
ref: NAME ["(" expr ("," expr)* ")"] [BIT]
?expr: operand
    | _chain -> chain
_chain: (operand | _chain) (AND | SIGN) operand
?operand: NUMBER | STRING | ref | "(" expr ")"
SIGN: /[+*-]/
NAME: /[A-Z_][A-Z0-9_]*/i
NUMBER: /(\d+\.?\d*|\.\d+)(E[+-]?\d+)?/i
BIT: /\.\d+/
STRING: /"[^"\n]*"/
_NL: /\n/
COMMENT.2: /('|REM\b)[^\n]*/i
CONTINUED.2: /[ \t]_[ \t]*\n/
%ignore /[^\S\n]+/
%ignore COMMENT
%ignore CONTINUED
"""
)
LARKS = [
    Lark(GRAMMAR, parser="lalr", propagate_positions=positions, maybe_placeholders=True) for positions in (True, False)
]
TABLES = [TableParser(lark) for lark in LARKS]
PARTS = (
    *("if", "THEN", "For", "to", "step", "on", "goto", "wait", "idle", "loaded", "and", "a", "b1", "tox", "remark"),
    *("=", "(", ")", ",", "+", "-", "1", "2.5", ".5", "3e2", '"x y"', " ", " ", " ", "\n", "\n", " _\n", "' c\n"),
    *("rem then\n", "ſtep", "\N{KELVIN SIGN}", "µ", "?"),
)
LINES = (
    *("a=1", "if a then b.3=2", "for i=0 to 10 step a", "on a goto x, y,z", "wait idle", "b1(1,(a and 2)) = c.4+.5"),
    *("if a then if b then wait LOADED", "' only a comment", "to = step", "a = _\n b", "for i=0TO10", "x = 3and4", ""),
    *("loaded", ".1 _\n.2 loaded", "a = ( _\n 3) and 2", "a = (( _\n b1(1 _\n)))", 'if ( _\n"x y") then b1 = 2'),
)


def read(parse, text):
    """Return the tree of a text with the lines of its parts, or its error."""
    try:
        tree = parse(text)
    except UnexpectedInput as error:
        return type(error), str(error)
    return tree, [part.meta.line for part in tree.iter_subtrees_topdown() if not part.meta.empty]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(PARTS), max_size=12).map("".join))
def test_any_text_is_read_as_by_lark(text):
    for tables, lark in zip(TABLES, LARKS, strict=True):
        assert read(tables.parse, text) == read(lark.parse, text)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.sampled_from(LINES), max_size=6).map(lambda lines: "\n".join([*lines, ""])))
def test_lines_of_programs_are_read_as_by_lark(text):
    for tables, lark in zip(TABLES, LARKS, strict=True):
        assert read(tables.parse, text) == read(lark.parse, text)


def test_only_letters_beyond_ascii_need_lark():
    restarts = []
    for line in LINES:
        TABLES[0].parse(f"{line}\n", lambda line=line: restarts.append(line))
    assert not restarts
    TABLES[0].parse("\N{KELVIN SIGN} = 1\n", lambda: restarts.append("name"))  # which is a K to lark
    assert restarts == ["name"]
