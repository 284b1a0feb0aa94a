"""The language MC-Basic: values, variables, control flow, subs and functions, and its errors."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.softmc import Basic
from gantrysim.job.programs import build

from support.soaked import examples

MOVES = "\nmove {0, 0}\nmove {10, 0}\n"


def printed(text, **arguments):
    return list(Basic(text + MOVES, **arguments).printed)


def shown(expression, *declarations):
    return printed("\n".join([*declarations, f"print {expression}"]))[-1]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("1 + 2 * 3", "7"),
        ("(1 + 2) * 3", "9"),
        ("-2^2", "-4"),
        ("2^-1", "0.5"),
        ("2^3^2", "512"),
        ("7 mod 4", "3"),
        ("-7 mod 4", "-3"),
        ("7/2", "3.5"),
        ("1/3", "0.333333333"),
        ("0xff", "255"),
        (".5e1", "5"),
        ("1 < 2", "1"),
        ("2 <> 2", "0"),
        ("not 1 = 2 and 3 >= 3", "1"),
        ("1 = 1 xor 2 = 2", "0"),
        ("0 or 0", "0"),
        ('"a" + "b"', "ab"),
        ('"a" = "A"', "0"),
        ("abs(-3)", "3"),
        ("int(-1.5)", "-2"),
        ("sgn(-4)", "-1"),
        ("sqrt(2)^2 = 2", "0"),
        ("sin(pi/2)", "1"),
        ("4*atn(1) - pi", "0"),
        ("atan2(1, -1)/pi", "0.75"),
        ("{1, 2, 3}", "{1 , 2 , 3}"),
        ("#{1, 2} + {3, 4}", "{4 , 6}"),
        ("2*{1, 2} - {1, 1}/2", "{1.5 , 3.5}"),
        ("-{1, -2}", "{-1 , 2}"),
        ("{1, 2, 3}{2}", "2"),
        ("{1, 2} = {1, 2}", "1"),
        ("ON", "1"),
        ('"x", 1; 2', "x 1 2"),
    ],
)
def test_an_expression_has_its_value(expression, expected):
    assert shown(expression) == expected


@examples(60)
@given(a=st.floats(-1e6, 1e6), b=st.floats(-1e3, 1e3), c=st.integers(-50, 50))
def test_arithmetic_is_that_of_doubles(a, b, c):
    value = a + b * c - (a - b) * 2
    text = shown(f"({a:.12f}) + ({b:.12f})*({c}) - (({a:.12f}) - ({b:.12f}))*2")
    assert float(text) == pytest.approx(value, rel=1e-9, abs=1e-6)


def test_names_and_words_know_no_case():
    assert printed("DIM Count AS LONG = 3\nPrInT cOUNT") == ["3"]


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [("long", "2.9", "2"), ("long", "-2.9", "-2"), ("double", "2.9", "2.9"), ("string", '"s"', "s")],
)
def test_a_variable_holds_its_type(kind, value, expected):
    assert shown("v", f"dim v as {kind} = {value}") == expected


def test_arrays_count_from_one_and_hold_points():
    program = """
dim p[2][3] as joint of XY
dim i as long
dim j as long
for i = 1 to 2
  for j = 1 to 3
    p[i][j] = {i, 10*j}
  next j
next
print p[1][3], p[2, 1]{2}
"""
    assert printed(program) == ["{1 , 30} 10"]


def test_control_flow():
    program = """
dim i as long
dim s as string
for i = 5 to 1 step -2
  if i = 5 then
    s = s + "a"
  elseif i = 3 then
    s = s + "b"
  else
    s = s + "c"
  end if
next i
while i < 3
  i = i + 2
  if i > 1 then s = s + "w" else s = s + "v"
end while
do
  i = i - 1
loop until i <= 0
do
  i = i + 1
loop while i < 4
print s, i
for i = 1 to 5
  select case i
    case 1
      print "one"
    case 2 to 3, 9
      print "few"
    case is > 4
      print "many"
    case else
      print "else"
  end select
next
"""
    assert printed(program) == ["abcvw 4", "one", "few", "few", "else", "many"]


def test_parameters_pass_by_reference_unless_byval():
    program = """
dim a as double = 1
dim b as double = 1
dim l[2] as double
call Change(a, b, l)
print a, b, l[2], Twice(Twice(a)), Three
sub Change(x as double, byval y as double, z[*] as double)
  x = 5
  y = 5
  z[2] = 7
end sub
function Twice(byval x as double) as double
  Twice = 2*x
end function
function Three as long
  Three = 3.7
end function
"""
    assert printed(program) == ["5 1 7 20 3"]


def test_locals_are_hidden_and_recursion_has_its_own():
    program = """
print Factorial(10)
function Factorial(byval n as long) as double
  if n <= 1 then
    Factorial = 1
  else
    Factorial = n * Factorial(n - 1)
  end if
end function
"""
    assert printed(program) == [str(math.factorial(10))]
    with pytest.raises(InputError, match=r"^line 7: unknown name 'hidden'"):
        Basic("program\ncall One\nend program\nsub One\ndim hidden as long\nend sub\nhidden = 1")


def test_the_files_of_a_project_run_in_their_order():
    project = """
' configuration
common shared LIMIT as const long = 3
dim shared count as long
program
  count = 1
end program
' setup
program continue
  count = count + LIMIT
terminate program
' program
program
  print count
end program
"""
    assert printed(project) == ["4"]


def test_a_property_is_that_of_the_element_of_with():
    program = """
common shared drives[2] as generic axis
common shared table as group Axnm = a1 Axnm = a2
drives[1] = a1
drives[2] = a2
drives[1].vmax = 300
a2.velocitymax = 200
with table
vmax = faster(j1.vmax, drives[2].vmax)
print vmax, table.VelocityMax, ElementName
with a2
print vmax
end with
?VesExecute("vmax = 7")
print vmax
function faster(byval p as double, q as double) as double
  faster = q
  if p >= q then faster = p
end function
"""
    assert printed(program) == ["300 300 table", "200", "0", "7"]


def test_comments_and_continued_lines():
    assert printed("rem nothing\nprint \"it's\", _\n  2 ' two\n\n\nprint 3") == ["it's 2", "3"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("move {1, 2", 'line 1 "move {1, 2": the end of the line does not fit there'),
        ("a = 1\nfor = 3", "line 2 \"for = 3\": '=' does not fit there"),
        ("if 1 then\nmove {1, 2}", "line 2: the text ends within a program, a sub, a function, a loop or a condition"),
        ("\n\nx = 3", "line 3: unknown name 'x': must be declared by DIM, or be a property"),
        ("dim counter as long\ncountr = 3", "line 2: unknown name 'countr': did you mean counter?"),
        ("vmx = 3", "line 1: unknown name 'vmx': did you mean vmax?"),
        ("print foo(1)", "line 1: unknown function 'foo': known: abs, acos, asin, atan2, atn, cos, exp, int, log, "
            "sgn, sin, sqrt, tan, and those of the program"),
        ("call Foo", "line 1: unknown sub 'Foo': there are none"),
        ("dim a[3] as long\na[4] = 2", "line 2: index of a = 4: must be 1 to 3"),
        ("dim a[3] as long\na = 2", "line 2: a is an array: must have an index"),
        ("dim a as const long = 3\na = 2", "line 2: a is a constant: must not be assigned"),
        ("dim a as joint of XY\nprint a", "line 2: a has no value yet: must be assigned first"),
        ('dim a as long\na = "s"', "line 2: a = s: must be a number"),
        ("print 1/0", "line 1: 1 / 0: has no finite value"),
        ("print (-8)^0.5", "line 1: -8 ^ 0.5: has no finite value"),
        ("print sqrt(-1)", "line 1: sqrt(-1): has no finite value"),
        ("print {1, 2} + {1, 2, 3}", "line 1: {1 , 2} + {1 , 2 , 3}: must be points of one length"),
        ("print {1, 2}{3}", "line 1: {1 , 2}{3}: must be a coordinate of the point, 1 to 2"),
        ("sub A\ncall A\nend sub\ncall A", "line 2: A: calls are nested more than 32 deep"),
        ("sub A(byval x as long)\nend sub\ncall A", "line 3: A of 0 arguments: must have 1"),
        ("dim s as string = \"ab\"\nwhile 1\ns = s + s\nend while",
            "line 3: string of 512 characters: must be at most 256"),
        ("dim a[400][400] as long",
            "line 1: dimensions [400, 400]: must be at least 1, and at most 100000 items in all"),
        ("print " + "-" * 3000 + "1", "line 1: must be less deeply nested"),
        ("move a1 5", "line 1: a1 is not a group: must be one, as single axes do not move"),
        ("move G1 {1, 1}\nmove G2 {2, 2}", "line 2: G2: must be an axis or a group; the group is G1"),
        ("sleep -1", "line 1: sleep = -1 ms: must be at least 0 ms"),
        ("BlendingMethod = 1", "line 1: BlendingMethod = 1: must be 0; motions run from rest to rest"),
        ("StartType = 1", "line 1: StartType = 1: must be 2 (in position) or 3 (generator completed)"),
        ("pcmd = 3", "line 1: pcmd: can be read only"),
        ("move {1, 2} vtran = 3 vcruise = 4", "line 1: vcruise and vtran: give only one of the two"),
        ("en = 0\nmove {1, 2}\nmove {2, 2}", "line 2: the group is disabled: must be en = 1, and sys.motion = on"),
        ("move {1, 2, 3, 4, 5}", "line 1: target of 5 numbers: must be 2 to 4, of the axes x, y, z, r"),
        ("circle angle = 1e-12 circlecenter = {1, 0}", "line 1: path of 1.74533e-14 mm: must be longer than 1e-09 mm"),
        ("sub A\nprint 1\nend sub\ndim a as long\na = One + b\nfunction One as long\nOne = 1\nend function",
            "line 5: unknown name 'b': must be declared by DIM, or be a property"),
        ("recordon", "line 1: no record is open: RECORD must come first"),
        ("recordoff", "line 1: no record is open: RECORD must come first"),
        ("record a.rec 10 recdata = pcmd{1}\nrecordon\nrecordclose\nrecordoff",
            "line 4: no record is open: RECORD must come first"),
        ("record a.rec 10 gap = 1", "line 1: RecData is missing: must follow with expressions, as in "
            "RecData = pcmd{1}, sys.clock"),
        ("record a.rec 10 recdata = foo", "line 1: unknown expression of RecData 'foo': known: pcmd, pe, pfb, "
            "setpoint, sys.clock, vcmd, vfb"),
        ("record a.rec 10 recdata = pcmd{1} - pfb{1}", "line 1: RecData: must be names, as in pcmd{1}, pfb, sys.clock; "
            "no operators"),
        ("record a.rec 10 recdata = pcmd{1, 2}", "line 1: a coordinate's number in { }: must be one number"),
        ("sys.ain.1 = 3", "line 1: .1: must follow sys.dout"),
        ("' nothing", "program moves none of x, y, z: must have at least one command that does"),
    ],
)  # fmt: skip
def test_an_error_names_line_and_reason(text, message):
    with pytest.raises(InputError) as caught:
        Basic(text)
    assert str(caught.value) == message


def test_an_unknown_statement_and_an_unknown_word_are_refused_by_name():
    with pytest.raises(
        InputError, match=r"^line 2 .onsystemerror stop.: unknown statement .onsystemerror.: known: att"
    ):
        Basic("move {1, 2}\nonsystemerror stop")
    # a word before an assignment is no statement that is unknown, but one too many
    with pytest.raises(InputError, match=r"^line 2 .long k = 3.: .k. does not fit there$"):
        Basic("move {1, 2}\nlong k = 3")
    with pytest.raises(InputError, match=r"^line 2: unknown word 'vcruse': did you mean vcruise"):
        Basic("move {1, 2}\nmove {3, 4} vcruse = 3")


@pytest.mark.parametrize("text", ["while 1\nend while", "while ismoving = 0\nsleep 0\nend while", "do\nloop while 1"])
def test_an_endless_program_is_refused(text):
    with pytest.raises(InputError, match=r"line \d: 1000 statements are run: a program must end before; see max_stat"):
        Basic(MOVES + "sleep 1e4\n" + text, max_statements=1000)
    with pytest.raises(InputError, match=r"^line 2: the program runs for more than 86400 s: must end before$"):
        Basic("while 1\nsleep 1e6\nend while")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": (0,)}, r"^start = \(0,\): must be 2 to 4 numbers, of x, y, z, r$"),
        ({"coordinates": ("x", "x")}, r"^coordinates = \('x', 'x'\): must be 2 to 4 different names of axes$"),
        ({"line_time": -1}, r"^line_time = -1 s: must be at least 0 s$"),
        ({"override": 0}, r"^override = 0 %: must be greater than 0 %$"),
        ({"max_statements": 0}, r"^max_statements = 0: must be at least 1$"),
    ],
)
def test_an_argument_out_of_its_bound_is_named(arguments, message):
    with pytest.raises(InputError, match=message):
        Basic(MOVES, **arguments)


def test_properties_without_effect_are_noted():
    notes = Basic("a1.pfac = 2^16\na2.pfac = 1\nsys.doubleformat = 1\ndecstop = 5" + MOVES, start=(1, 1)).notes
    assert notes == ("4 assignments without effect here, of axis pfac, group decstop, system doubleformat",)
    assert Basic("print 5" + MOVES).notes[-1] == "prints 1 line: 5"


# long and short names of one property, as the reference of the language pairs them
SYNONYMS = """
VelocityCruise VCruise, VelocityTranslation VTran, VelocityMax VMax, Acceleration Acc, AccelerationMax AMax,
Deceleration Dec, DecelerationMax DMax, DecelerationStop DecStop, JerkMax JMax, ProfileType PrfType,
SmoothFactor Smooth, Absolute Abs, PositionErrorMax PEMax, PESettle PositionErrorSettle, VelocityFactor VFac,
AccelerationFactor AFac, JerkFactor JFac, PositionFactor PFac, VelocityOverride VOrd, VelocityOverspeed VOSpd,
Enable En, PositionCommand PCmd, PositionFeedback PFb, PositionError PE, VelocityCommand VCmd, VelocityFeedback VFb
"""


@pytest.mark.parametrize("names", [pair.split() for pair in SYNONYMS.split(",")], ids=lambda names: names[0])
def test_a_property_has_a_long_and_a_short_name(names):
    def outcome(name):
        try:
            return str(Basic(f"{name} = 1{MOVES}").notes).lower()
        except InputError as error:
            return str(error).lower()

    long, short = map(str.lower, names)
    assert outcome(long).replace(long, short) == outcome(short)


def test_a_group_may_be_declared_after_its_first_property():
    assert printed("vmax = 70\ncommon shared late as group Axnm = a2 Axnm = a1\nprint late.vmax, late") == ["70 late"]
    with pytest.raises(InputError, match=r"^line 2: group g2: must be g1; a program moves one group$"):
        Basic("common shared g1 as group Axnm = a1 Axnm = a2\ncommon shared g2 as group Axnm = a1 Axnm = a2")


def test_waits_for_settling_without_a_bound_are_noted():
    text = "starttype = inposition" + MOVES
    assert Basic(text, start=(1, 1)).notes == ("waits for settling have no effect without PositionErrorSettle",)
    assert Basic("pesettle = 1\n" + text, start=(1, 1)).notes == ()


def test_the_registry_builds_it_and_its_arguments_build_it_again():
    basic = build("softmc.Basic", {"text": MOVES, "group": {"velocity": 50.0}})
    assert basic.suffixes == (".prg",)
    assert build("softmc.Basic", basic.arguments()).arguments() == basic.arguments()


def test_a_program_has_a_million_characters_at_most():
    begin = "move {0, 0}\nmove {10, 0}\n'"
    longest = begin + (1_000_000 - len(begin)) * "x"
    assert Basic(longest).setpoints(1e-3).requested.length == pytest.approx(10.0)
    with pytest.raises(InputError, match=r"^program of 1000001 characters: must be at most 1000000$"):
        Basic(longest + "x")
