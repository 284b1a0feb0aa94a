"""Outputs of the controller as the set point of a pump's flow."""

from __future__ import annotations

import re
from collections.abc import Callable

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.buffers import MOST_AXES
from gantrysim.controllers.trio.basic.process import MOST_ANALOGUE, MOST_OUTPUTS, State
from gantrysim.controllers.trio.basic.words import MOST_BITS

SetPoint = Callable[[State], float]

_WORD = re.compile(r"(AOUT|DAC AXIS|OP)\((\d{1,4})(?:,(\d{1,4}))?\)")


def set_point(word: str) -> SetPoint:
    """Return what reads an output: "AOUT(0)", "DAC AXIS(3)", "OP(8)", or as a number the bits of "OP(8,15)".

    Raises:
        InputError: another word, or a number out of bounds.
    """
    parts = _WORD.fullmatch(word)
    if parts is None or (parts[3] is not None and parts[1] != "OP"):
        raise InputError(
            f'flow_output = "{word}": must be with its numbers "AOUT(0)", "DAC AXIS(3)", "OP(8)", or "OP(8,15)" for '
            "the number of which these outputs are the bits"
        )
    kind = parts[1]
    first = int(parts[2])
    last = first if parts[3] is None else int(parts[3])
    most = {"AOUT": MOST_ANALOGUE, "DAC AXIS": MOST_AXES, "OP": MOST_OUTPUTS}[kind]
    if not (0 <= last - first < MOST_BITS and last < most):
        raise InputError(f'flow_output = "{word}": must be up to {most - 1}, of at most {MOST_BITS} bits')
    if kind == "AOUT":
        return lambda state: state.analogue.get(first, 0.0)
    if kind == "DAC AXIS":
        return lambda state: state.motion.axis(first).values.get("DAC", 0.0)
    return lambda state: float(sum(1 << k for k in range(last - first + 1) if first + k in state.outputs))
