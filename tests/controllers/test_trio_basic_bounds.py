"""Every bounded argument and parameter of Trio BASIC: at its bound it is taken, beyond it the line is refused."""

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import Basic

CAM = "TABLE(0,0,1,3)\n"

# taken at the bound; refused beyond it; why
BOUNDS = {
    "STEP": ("FOR i=1 TO 2 STEP 0.5\nNEXT i", "FOR i=1 TO 2 STEP 0\nNEXT i", "line 1: STEP 0: must not be 0"),
    "NEXT": (
        "FOR i=1 TO 2\nNEXT i", "FOR i=1 TO 2\nNEXT k", "line 2: NEXT k: must be NEXT i, of the FOR of line 1",
    ),
    "TABLE first": (
        "TABLE(511999,1)", "TABLE(512000,1)", "line 1: TABLE(512000): must be a whole number from 0 to 511999",
    ),
    "TABLE last": (
        "TABLE(511998,1,2)", "TABLE(511998,1,2,3)",
        "line 1: TABLE(512000): must be a whole number from 0 to 511999",
    ),
    "TABLE below": ("TABLE(0,1)", "TABLE(-1,1)", "line 1: TABLE(-1): must be a whole number from 0 to 511999"),
    "TABLE part": ("TABLE(1,1)", "TABLE(0.5,1)", "line 1: TABLE(0.5): must be a whole number from 0 to 511999"),
    "BASE": ("BASE(0,1)", "BASE(1,1)", "line 1: BASE(1, 1): must name an axis once"),
    "axis": ("BASE(63)", "BASE(64)", "line 1: axis 64: must be a whole number from 0 to 63"),
    "axis below": ("BASE(0)", "BASE(-1)", "line 1: axis -1: must be a whole number from 0 to 63"),
    "axis part": ("BASE(1)", "BASE(1.5)", "line 1: axis 1.5: must be a whole number from 0 to 63"),
    "MOVELINK acceleration": (
        "MOVELINK(10,20,0,5,1)", "MOVELINK(10,20,-1,5,1)",
        "line 1: link distance of acceleration = -1: must be at least 0",
    ),
    "MOVELINK deceleration": (
        "MOVELINK(10,20,5,0,1)", "MOVELINK(10,20,5,-1,1)",
        "line 1: link distance of deceleration = -1: must be at least 0",
    ),
    "MOVELINK distance": (
        "MOVELINK(10,0.5,0,0,1)", "MOVELINK(10,0,0,0,1)", "line 1: link distance = 0: must be greater than 0",
    ),
    "link options": (
        "MOVELINK(10,20,0,0,1,36)", "MOVELINK(10,20,0,0,1,1)",
        "line 1: link options = 1: must be a sum of 2 (from a position), 4 (repeat), 32 (forward)",
    ),
    "link options part": (
        "MOVELINK(10,20,0,0,1,4)", "MOVELINK(10,20,0,0,1,4.5)",
        "line 1: link options = 4.5: must be a sum of 2 (from a position), 4 (repeat), 32 (forward)",
    ),
    "link position": (
        "MOVELINK(10,20,0,0,1,2,5)", "MOVELINK(10,20,0,0,1,2)",
        "line 1: link position: must be given with link option 2, and with no other",
    ),
    "link position alone": (
        "MOVELINK(10,20,0,0,1,4)", "MOVELINK(10,20,0,0,1,4,5)",
        "line 1: link position: must be given with link option 2, and with no other",
    ),
    "CAMBOX points": (
        f"{CAM}CAMBOX(0,1,1,5,1)", f"{CAM}CAMBOX(1,1,1,5,1)",
        "line 2: cam from TABLE(1) to TABLE(1): must have 2 to 32000 points",
    ),
    "CAMBOX cells": (f"{CAM}CAMBOX(0,2,1,5,1)", f"{CAM}CAMBOX(0,3,1,5,1)", "line 2: cam: TABLE(3) must be set before"),
    "OP": ("OP(8,39,1)", "OP(8,40,1)", "line 1: OP(8,40, ...): must be 1 to 32 outputs, the first one first"),
    "OP order": ("OP(8,8,1)", "OP(9,8,1)", "line 1: OP(9,8, ...): must be 1 to 32 outputs, the first one first"),
    "OP number": ("OP(1023,1)", "OP(1024,1)", "line 1: OP(1024): must be a whole number from 0 to 1023"),
    "DATUM": (
        "DATUM(0)", "DATUM(1)",
        "line 1: DATUM(1): homing is not simulated; the axes begin where `start` says: must be 0, which clears errors",
    ),
    "CONSTANT": (
        'CONSTANT "a",3\nb=a', 'CONSTANT "a",3\na=4', "line 2: a = ...: is a CONSTANT, which cannot be assigned",
    ),
    "indices": (
        "DIM a AS FLOAT(2,3)\na(1,2)=3", "DIM a AS FLOAT(2,3)\na(1)=3", "line 2: a with 1 indices: must have 2",
    ),
    "UNITS": ("UNITS=0.1", "UNITS=0", "line 1: UNITS = 0 of axis 0: must be greater than 0"),
    "UNITS moved": (
        "UNITS=5\nMOVE(1)\nWAIT IDLE\nUNITS=5", "MOVE(1)\nWAIT IDLE\nUNITS=5",
        "line 3: UNITS of axis 0: must be set before it moves",
    ),
    "CORNER_MODE": (
        "CORNER_MODE=10", "CORNER_MODE=4",
        "line 1: CORNER_MODE = 4 of axis 0: must be a sum of 2 (DECEL_ANGLE and STOP_ANGLE) and 8 (FULL_SP_RADIUS); "
        "other bits are not emulated",
    ),
    "SPEED": ("SPEED=0", "SPEED=-1", "line 1: SPEED = -1 of axis 0: must be at least 0"),
    "ACCEL": ("ACCEL=0.1", "ACCEL=0", "line 1: ACCEL = 0 of axis 0: must be greater than 0"),
    "DECEL": ("DECEL=0.1", "DECEL=0", "line 1: DECEL = 0 of axis 0: must be greater than 0"),
    "circle end": (
        "BASE(0,1)\nMOVECIRC(2,0,1,0,0)", "BASE(0,1)\nMOVECIRC(1,0,1,0,0)",
        "line 2: circle about (1, 0): its end is its centre: must lie on the circle",
    ),
    "circle": (
        "BASE(0,1)\nMOVECIRC(0,0,1,0,0)", "BASE(0,1)\nMOVECIRC(0.5,0,1,0,0)",
        "line 2: circle about (1, 0): its end (0.5, 0) lies in the direction of the start, but 0.5 off it: must be "
        "(0, 0) for a full circle",
    ),
    "circle radius": (
        "BASE(0,1)\nMOVECIRC(2,0,1,0,0)", "BASE(0,1)\nMOVECIRC(2,0,0,0,0)",
        "line 2: circle about (0, 0) of radius 0: a radius must be above 0.001",
    ),
    "links": (
        "CONNECT(1,1) AXIS(0)\nCONNECT(1,2) AXIS(1)\nRAPIDSTOP(2)", "CONNECT(1,1) AXIS(0)\nCONNECT(1,0) AXIS(1)",
        "line 2: axis 1 would follow itself through axis 0: links must have no circle",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BOUNDS)
def test_a_bound_is_taken_and_what_lies_beyond_is_refused(name):
    taken, refused, message = BOUNDS[name]
    assert [line.text for line in Basic(f"{taken}\nPRINT 7[0]\nSTOP").printed] == ["7"]
    with pytest.raises(InputError) as caught:
        assert Basic(f"{refused}\nPRINT 7[0]\nSTOP").printed
    assert str(caught.value) == message


# as Trio's manual numbers them
TYPES = {
    "x=0": 0,
    "MOVE(5)": 1,
    "MOVEABS(5)": 2,
    "MHELICAL(0,0,3,0,1,2)": 3,
    "MOVECIRC(0,0,3,0,1)": 4,
    "MOVESP(5)": 6,
    "MOVEABSSP(5)": 7,
    "MOVECIRCSP(0,0,3,0,1)": 8,
    "MHELICALSP(0,0,3,0,1,2)": 9,
    "FORWARD": 10,
    "REVERSE": 11,
    "TABLE(0,0,1): CAM(0,1,1,5)": 13,
    "TABLE(0,0,1): CAMBOX(0,1,1,5,3)": 20,
    "CONNECT(1,3)": 21,
    "MOVELINK(5,5,0,0,3)": 22,
}


@pytest.mark.parametrize("text", TYPES)
def test_the_type_of_a_move_is_its_number_in_the_manual(text):
    made = Basic(f'BASE(0,1,2)\n{text}\nWA(1)\nPRINT MTYPE[0];" ";NTYPE[0]\nRAPIDSTOP(2)\nSTOP')
    assert [line.text.split() for line in made.printed] == [[str(TYPES[text]), "0"]]


# set; read elsewhere than set, with 2 units for the axis
PARAMETERS = {
    "SPEED=50": ("SPEED", 50),
    "ACCEL=300": ("ACCEL", 300),
    "DECEL=400": ("DECEL", 400),
    "CORNER_MODE=8": ("CORNER_MODE", 8),
    "DECEL_ANGLE=0.25": ("DECEL_ANGLE", 0.25),
    "STOP_ANGLE=0.5": ("STOP_ANGLE", 0.5),
    "FULL_SP_RADIUS=4": ("FULL_SP_RADIUS", 4),
    "FORCE_SPEED=30": ("FORCE_SPEED", 30),
    "SPEED=70": ("FORCE_SPEED", 70),
    "SPEED=71": ("STARTMOVE_SPEED", 71),
    "SPEED=72": ("ENDMOVE_SPEED", 72),
    "STARTMOVE_SPEED=20": ("STARTMOVE_SPEED", 20),
    "ENDMOVE_SPEED=21": ("ENDMOVE_SPEED", 21),
    "MERGE=ON": ("MERGE", 1),
    "SERVO=ON": ("SERVO", 1),
    "ATYPE=44": ("ATYPE", 44),
    "UNITS=2": ("UNITS", 2),
    "UNITS=2: DEFPOS(3)": ("DEMAND_EDGES", 6),
    "DEFPOS(3)": ("DPOS", 3),
    "OFFPOS=4": ("MPOS", 4),
    "OFFPOS=5": ("OFFPOS", 0),
    "FE_LIMIT=3": ("FE", 0),
    "MOVE(9)": ("IDLE", 0),
    "x=1": ("IDLE", -1),
    "MOVE(9): MOVE(8)": ("MOVES_BUFFERED", 1),
    "MOVE(9): MOVE(7)": ("LOADED", 0),
    "MOVE(6)": ("LOADED", -1),
    "CONNECT(1,3)": ("LINK_AXIS", 3),
    "MOVE(5)": ("LINK_AXIS", -1),
    "MOVE(10)": ("ENDMOVE", 10),
    "SPEED=40: ACCEL=10^7: MOVE(11): WA(50)": ("REMAIN", 9),
    "SPEED=41: ACCEL=10^7: MOVE(-12): WA(50)": ("MSPEED", -41),
    "SPEED=42: ACCEL=10^7: MOVE(-12): WA(50)": ("VP_SPEED", 42),
    "MOVE(13): WA(20): CANCEL": ("AXISSTATUS", 2048),
}


@pytest.mark.parametrize("text", PARAMETERS)
def test_a_parameter_reads_as_it_was_set_and_on_no_other_axis(text):
    name, value = PARAMETERS[text]
    made = Basic(f'BASE(2)\n{text}\nBASE(0)\nPRINT {name} AXIS(2)[6];" ";{name} AXIS(4)[6]\nRAPIDSTOP(2)\nSTOP')
    here, there = (float(number) for number in made.printed[0].text.split())
    plain = Basic(f"PRINT {name} AXIS(4)[6]\nSTOP").printed[0].text
    assert (here, there) == (pytest.approx(value, rel=0.03), float(plain))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        # NOT stands between comparisons and AND, as -2 ^ 2 and 2 + 3 * 4 have their own order
        ("NOT 0=1", -1),
        ("NOT(0)=1", -1),
        ("NOT 6 AND 12", 8),
        ("1=1 AND 2=3", 0),
        ("1 OR 6 AND 4", 5),
        ("2+3*4", 14),
        ("2*3=6", -1),
        ("10-4-3", 3),
    ],
)
def test_operators_bind_in_their_order(text, value):
    assert [line.text.strip() for line in Basic(f"PRINT ({text})[0]\nSTOP").printed] == [str(value)]
