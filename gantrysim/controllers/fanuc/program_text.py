"""Parser of program text: the blocks that run, as motions in absolute coordinates.

Numbers are millimetres, or inches after G20, with or without a decimal point (calculator-type input).
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from gantrysim.controllers.fanuc.alarm import BlockSource
from gantrysim.controllers.fanuc.blocks import COMMENT, CORNERS, Block, Dwell, Words
from gantrysim.controllers.fanuc.codes import ACTIONS, CENTRES, MOTIONS, SETTINGS, g_codes_in_short
from gantrysim.controllers.fanuc.modal_state import ENDS, ModalState
from gantrysim.controllers.fanuc.sequence import ProgramSource, Sequence
from gantrysim.controllers.macro.variables import Parameters
from gantrysim.controllers.speeds import SpeedWords
from gantrysim.controllers.valve import NUMBERED

SPEEDS = SpeedWords(word=r"\bF|(?<=[0-9.\s])F", comment=COMMENT, key="feed")
_ENDS_OR_CALLS = frozenset({2.0, 30.0, 98.0, 99.0})  # M codes that no motion waits for
_OUTPUTS = range(1100, 1116)  # variables of the interface's output signals
_NUMBERED_PARAMETERS = (1132, 1133)  # of numbers that it puts out
_LENGTHS = set("XYZIJKQR")
# codes that change what a mirror image or a turn refers to
_PLAIN_ONLY = {"G17", "G18", "G19", "G28", "G30", "G52", "G54", "G55", "G56", "G57", "G58", "G59", "G92"}
# words of which a look at the whole text tells whether it switches the look-ahead; without them it is on
_SWITCHES_LOOK_AHEAD = r"G\s*0*(?:5\.1|8)(?![0-9.])"


@dataclass(frozen=True)
class SourceBlock(BlockSource):
    """A block and its source.

    Attributes:
        block: the block.
        idle: whether it is in G41 or G42 with an offset of 0, as without D.
        halting: whether it stops at its end in G64, as the program has G05.1 or G08 and they are off.
        continuous: whether the program asks for G64.
        zero_height: whether its arc has a height per turn of 0, as K0 in G17.
        outputs: names of those that are on, as of `Outputs`.
        flow: value of the output that sets the flow.
    """

    block: Block
    idle: bool = False
    halting: bool = False
    continuous: bool = False
    zero_height: bool = False
    outputs: tuple[str, ...] = ()
    flow: float = 0.0


class ProgramMotions(NamedTuple):
    """The motions of a program.

    Attributes:
        blocks: the motions.
        called_files: names of the files of subprograms that were called.
        outputs: numbers that the interface put out, by their variables.
        ignored: words without an effect on the path, and how often they were met.
    """

    blocks: tuple[SourceBlock, ...]
    called_files: frozenset[str]
    outputs: Mapping[str, Set[float]]
    ignored: Mapping[str, int]


def read(source: ProgramSource, state: ModalState, flow_output: str = "") -> ProgramMotions:
    """Return the motions of a program.

    Args:
        source: texts, and how they are read.
        state: at the program's start; it holds the state at its end afterwards.
        flow_output: S, or the variable of an output, whose value sets the flow; empty for none.

    Raises:
        Alarm: an invalid word, or invalid combination of words.
    """
    sequence = Sequence(source, state.controller_variable)
    state.contoured = sequence.has(_SWITCHES_LOOK_AHEAD)
    variable = int(flow_output[1:]) if flow_output.startswith("#") else 0
    blocks: list[SourceBlock] = []
    outputs: dict[str, set[float]] = {f"#{number}": set() for number in _NUMBERED_PARAMETERS}
    for words in sequence.run():
        motions = _run(state, words, sequence.parameters)
        for number in _NUMBERED_PARAMETERS:
            outputs[f"#{number}"].add(sequence.parameters.numbered(number))
        if not motions and blocks and not _ENDS_OR_CALLS.issuperset(words.auxiliary):
            blocks[-1] = _halted_motion(blocks[-1])
        blocks += (
            SourceBlock(
                name=words.name,
                line=words.line,
                block=block,
                idle=state.idle,
                halting=state.halting,
                continuous=state.continuous,
                zero_height=state.zero_height,
                outputs=state.outputs.now,
                flow=sequence.parameters.numbered(variable) if variable else state.spindle,
            )
            for block in motions
        )
    return ProgramMotions(tuple(blocks), sequence.called_files, outputs, state.ignored)


def _halted_motion(source: SourceBlock) -> SourceBlock:
    """Return a motion that comes to rest before a block of M codes alone; a dwell as it is."""
    if isinstance(source.block, Dwell):
        return source
    return replace(source, block=replace(source.block, exact_stop=True))


def _run(state: ModalState, words: Words, variables: Parameters) -> list[Block]:
    """Apply a block's codes, with the outputs that variables have set before it, and return its motions."""
    for number in _OUTPUTS:
        state.outputs.set_line(f"#{number}", opens=variables.numbered(number) != 0)
    _set_modes(state, words)
    values = words.values
    # of the tool length, and of the tool
    for letter in "HT":
        if values.pop(letter, None) is not None:
            state.ignored[letter] += 1
    actions = [name for name in words.g_names if name in ACTIONS]
    if actions:
        # a dwell yields to any other action, and that to one before it
        name = min(actions, key=lambda action: action == "G04")
        blocks = ACTIONS[name](state, words)
        if values:
            raise words.fail(9, f"address {next(iter(values))} is not used in {name}")
        return blocks
    if "F" in values:
        state.feed = values.pop("F") * state.unit
        if state.feed <= 0:
            raise words.fail(11, f"F = {state.feed:g}: must be greater than 0")
    # of the spindle
    values.pop("S", None)
    if not values.keys() & {*ENDS, *CENTRES, "Q", "L", "R", *CORNERS, state.rotary}:
        if values:
            raise words.fail(9, f"address {next(iter(values))} is not used in this block")
        return []
    return [_motion(state, words)]


def _set_modes(state: ModalState, words: Words) -> None:
    state.in_machine = False
    for name, code in zip(words.g_names, words.codes, strict=True):
        if name in _PLAIN_ONLY and not state.turn.is_plain:
            raise words.fail(10, f"{name} in G51.1 or G68: must follow G50.1 and G69")
        if name in MOTIONS:
            state.motion = name
        elif name in SETTINGS:
            SETTINGS[name](state, words)
        elif name not in ACTIONS:
            raise words.fail(10, f"G{code:g}: must be one of {g_codes_in_short()}")
    broken = [code for code in words.auxiliary if not code.is_integer()]
    if broken:
        raise words.fail(9, f"M{broken[0]:g}: must be a whole number")
    if "D" in words.values:
        state.offset_number = f"{words.values.pop('D'):g}"
        state.offset = float(state.offsets.get(state.offset_number, 0.0))
    state.spindle = words.values.get("S", state.spindle)
    codes = [int(code) for code in words.auxiliary]
    state.ignored.update(f"M{code}" for code in codes if code not in _ENDS_OR_CALLS)
    if codes or "S" in words.values:
        state.outputs.switch(codes, words.values.get("P"), words.values.get("S"))
        if not NUMBERED.isdisjoint(codes):
            words.values.pop("P", None)


def _motion(state: ModalState, words: Words) -> Block:
    """Return the motion in force, with the words of a block, and move to its end."""
    if state.side and state.offsets and state.offset_number not in {"0", *state.offsets}:
        # without compensation D may be anything, as in T1 D1 M06; without any offset given, all are 0, with a note
        known = ", ".join(sorted(state.offsets))
        raise words.fail(9, f"D{state.offset_number}: must be one of the program's offsets, {known}")
    values = words.values
    for letter in _LENGTHS & values.keys():
        values[letter] *= state.unit
    coordinates = [values.pop(letter, None) for letter in ENDS]
    if state.in_machine:
        if state.motion not in ("G00", "G01"):
            raise words.fail(10, "G53 must be with G00 or G01")
        if not state.absolute:
            raise words.fail(10, "G53 in G91: must be in G90, as the controller ignores it in G91")
        end = coordinates
    else:
        end = state.ends(coordinates)
    rotary = values.pop(state.rotary, None)
    if rotary is not None:
        state.angle = rotary if state.absolute else state.angle + rotary
        rotary = state.angle
    arguments: dict[str, Any] = {
        "end": tuple(end),
        "rotary": rotary,
        "compensation": state.side * state.turn.sense(state.plane) * state.offset,
        "plane": state.plane,
        "exact_stop": state.exact_stop or state.halting,
        "rounding": _corner(state, words, ",R"),
        "chamfer": _corner(state, words, ",C"),
    }
    if arguments["rounding"] and arguments["chamfer"]:
        raise words.fail(9, f",R{arguments['rounding']:g} and ,C{arguments['chamfer']:g}: must be one of them")
    state.zero_height = False
    block = MOTIONS[state.motion](state, words, arguments)
    if values:
        raise words.fail(9, f"address {next(iter(values))} is not used in {state.motion}")
    state.here = [there if there is not None else here for there, here in zip(end, state.here, strict=True)]
    return block


def _corner(state: ModalState, words: Words, word: str) -> float:
    """Take the size of the corner at a motion's end; 0 without [mm]."""
    size = words.values.pop(word, 0.0) * state.unit
    if size and state.motion == "G00":
        raise words.fail(50, f"{word} in G00: must be in G01, G02 or G03")
    if size < 0:
        raise words.fail(9, f"{word} = {size:g} mm: must be at least 0 mm")
    return size
