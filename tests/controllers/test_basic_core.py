"""The core of the BASICs by itself: operators against Python's, blocks and jumps, tasks and their clock."""

import ast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import STATEMENT, Assembler, ForLoop, Frame
from gantrysim.controllers.basic.operators import Operators, RankedOperator, of_values
from gantrysim.controllers.basic.statements import Statements, with_keywords
from gantrysim.controllers.basic.tasks import MOST_PER_TICK, Scheduler, StatementClock, Task

from support.soaked import examples

PERIOD = 1e-3


def joined(sign, *operands):
    """What an operator makes of texts: a text in brackets."""
    return f"({sign}{operands[0]})" if len(operands) == 1 else f"({operands[0]}{sign}{operands[1]})"


RANKS = {"|": 1, "&": 2, "+": 5, "-": 5, "*": 6, "/": 6, "%": 6, "**": 8}
PYTHONS = Operators(
    before={"~": RankedOperator(7, joined), "-": RankedOperator(7, joined), "+": RankedOperator(7, joined)},
    between={sign: RankedOperator(rank, joined, from_right=sign == "**") for sign, rank in RANKS.items()},
)
SIGNS = {
    **{ast.BitOr: "|", ast.BitAnd: "&", ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Mod: "%"},
    **{ast.Pow: "**", ast.Invert: "~", ast.USub: "-", ast.UAdd: "+"},
}


def bracketed(node):
    """A parsed expression of Python with all of its brackets."""
    match node:
        case ast.BinOp():
            return f"({bracketed(node.left)}{SIGNS[type(node.op)]}{bracketed(node.right)})"
        case ast.UnaryOp():
            return f"({SIGNS[type(node.op)]}{bracketed(node.operand)})"
    return ast.unparse(node)


class Operand:
    """A number that is no text, as a part that is no sign must be."""

    def __init__(self, text):
        self.text = text


@examples(300)
@given(
    st.lists(
        st.tuples(st.lists(st.sampled_from("~-+"), max_size=3), st.sampled_from(sorted(RANKS))),
        min_size=1,
        max_size=12,
    )
)
def test_a_flat_expression_has_the_brackets_that_python_gives_it(chain):
    parts = []
    for k, (before, between) in enumerate(chain):
        parts += [*before, Operand(str(k)), between]
    parts.pop()
    text = " ".join(part.text if isinstance(part, Operand) else part for part in parts)
    made = PYTHONS.read(
        parts, lambda sign, operator, operands: Operand(operator.join(sign, *(o.text for o in operands)))
    )
    assert made.text == bracketed(ast.parse(text, mode="eval").body)


def test_operands_are_evaluated_from_the_left():
    seen = []
    first, second = (lambda frame, k=k: seen.append(k) or k for k in (1, 2))
    assert of_values(lambda a, b: a - b)("-", first, second)(None) == -1
    assert seen == [1, 2]


def numbered(assembler, trace, k):
    assembler.emit(k, lambda frame: trace.append(k))


def run(code, **variables):
    frame = Frame(code=code, variables=variables)
    lines = []
    frame.run(lambda line, cost: lines.append(line))
    return lines


def counter(name, first, last, step):
    def start(frame):
        frame.variables[name] = first
        return ForLoop(lambda: frame.variables[name], lambda value: frame.variables.update({name: value}), last, step)

    return start


@pytest.mark.parametrize(("first", "last", "step"), [(1, 4, 1), (4, 1, -1), (1, 0, 1), (0, 1, 0.25), (2, 2, 5)])
def test_a_for_runs_from_the_first_to_the_last_value(first, last, step):
    assembler, seen = Assembler(), []
    assembler.begin_for(1, "k", counter("k", first, last, step))
    assembler.emit(2, lambda frame: seen.append(frame.variables["k"]))
    assembler.end_for(3, assembler.close("NEXT", "FOR"))
    run(assembler.finish())
    assert seen == [first + k * step for k in range(max(int((last - first) / step) + 1, 0))]


@pytest.mark.parametrize("value", range(4))
def test_one_branch_is_run_whichever_way_it_is_chosen(value):
    """IF, ELSEIF, ELSE and SELECT with the same branches."""
    by_conditions = []
    by_choice = []
    assembler = Assembler()
    assembler.begin_if(1, lambda frame: value == 0)
    numbered(assembler, by_conditions, 0)
    assembler.begin_elseif(2, lambda frame: value == 1)
    numbered(assembler, by_conditions, 1)
    assembler.begin_else(3)
    numbered(assembler, by_conditions, 2)
    assembler.end_if()
    branches = [lambda k=k: numbered(assembler, by_choice, k) for k in range(3)]
    assembler.select(4, lambda frame: min(value, 2), branches)
    run(assembler.finish())
    assert by_conditions == by_choice == [min(value, 2)]


def test_parts_of_a_statement_cost_nothing():
    assembler = Assembler()
    assembler.begin_if(1, lambda frame: False)
    assembler.begin_elseif(2, lambda frame: True, None)
    assembler.emit(3, lambda frame: None)
    assembler.begin_else(4)
    assembler.emit(5, lambda frame: None)
    assembler.end_if()
    assembler.emit(6, lambda frame: None)
    assert run(assembler.finish()) == [1, 3, 6]


def test_subroutines_return_behind_their_call():
    assembler, seen = Assembler(), []
    assembler.gosub(1, "twice")
    numbered(assembler, seen, 2)
    assembler.goto(3, "END")
    assembler.label("TWICE")
    assembler.gosub(4, "ONCE")
    assembler.label("ONCE")
    numbered(assembler, seen, 5)
    assembler.leave(6)
    assembler.label("END")
    run(assembler.finish())
    assert seen == [5, 5, 2]


@pytest.mark.parametrize(
    ("build", "error"),
    [
        (lambda a: a.begin_while(7, lambda frame: True), "line 7: WHILE without its WEND"),
        (lambda a: a.goto(3, "home"), "line 3: label HOME: must stand before a colon at the start of a line"),
        (lambda a: (a.begin_repeat(2), a.end_if()), "ENDIF without IF inside the REPEAT of line 2"),
        (lambda a: a.end_while(1), "WEND without WHILE"),
        (lambda a: (a.label("X"), a.label("X")), "label X: stands in two places, must be in one"),
    ],
)
def test_blocks_and_labels_that_do_not_fit_are_refused(build, error):
    def assemble():
        assembler = Assembler()
        build(assembler)
        assembler.finish()

    with pytest.raises(InputError) as refusal:
        assemble()
    assert str(refusal.value) == error


def endless(trace, name, cost):
    assembler = Assembler()
    assembler.begin_while(1, lambda frame: True)
    assembler.emit(2, lambda frame: trace.append(name), cost)
    assembler.end_while(3)
    return assembler.finish()


def test_each_task_takes_the_time_of_its_statements():
    """Two endless loops beside one another: a pass of the slow one takes 10 ticks, of the fast one 2."""
    clock = StatementClock({"slow": 10e-3, "fast": 2e-3, STATEMENT: 0.0}, 10_000, "")
    scheduler, trace = Scheduler(clock, PERIOD), []
    tasks = [Task(code=endless(trace, name, name)) for name in ("slow", "fast")]
    for tick in range(101):
        for task in tasks:
            scheduler.execute(task, tick)
    assert (trace.count("slow"), trace.count("fast")) == (11, 51)


def test_statements_without_time_are_bounded_within_a_tick_and_in_all():
    clock = StatementClock({STATEMENT: 0.0}, 3 * MOST_PER_TICK, "too many")
    scheduler, trace = Scheduler(clock, PERIOD), []
    task = Task(code=endless(trace, "x", STATEMENT))
    scheduler.execute(task, 0)
    assert clock.count == MOST_PER_TICK
    scheduler.execute(task, 1)
    scheduler.execute(task, 2)
    with pytest.raises(InputError, match=r"^line \d: too many$"):
        scheduler.execute(task, 3)


def test_a_task_that_waits_is_asked_at_every_tick():
    clock = StatementClock({STATEMENT: 0.0}, 100, "")
    scheduler, asked = Scheduler(clock, PERIOD), []
    assembler = Assembler()

    def wait(frame):
        frame.blocked = lambda: asked.append(1) or len(asked) == 3

    assembler.emit(1, wait)
    task = Task(code=assembler.finish())
    for tick in range(6):
        scheduler.execute(task, tick)
    assert (len(asked), task.ended, task.ready) == (3, True, 3 * PERIOD)


def test_keywords_follow_from_the_syntax():
    table = Statements()

    @table('(_HOP | _SKIP) NAME "THEN"i [expr]')
    def cmd_hop(tree):
        pass

    assert table.rule == '(_HOP | _SKIP) NAME "THEN"i [expr] -> hop'
    assert table.first_words == {"hop", "skip"}
    grammar = with_keywords(f"start: {table.rule}\nexpr: NAME // AND\nNAME: /[A-Z]+/\n")
    assert grammar.splitlines()[-2:] == ['_HOP: "hop"i', '_SKIP: "skip"i']
