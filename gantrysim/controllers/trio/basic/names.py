"""Names that a program may give to its variables."""

from __future__ import annotations

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis_parameters import AXIS_PARAMETERS
from gantrysim.controllers.trio.basic.commands import COMMANDS


def variable(name: str) -> str:
    """Return the name of a variable that is assigned, in capitals, or raise InputError where it is a word."""
    word = name.upper()
    tables = (words.CONSTANTS, words.FUNCTIONS, AXIS_PARAMETERS, words.SYSTEM_PARAMETERS, words.IGNORED, COMMANDS)
    if word in words.KEYWORDS or any(word in table for table in tables) or word in ("IN", "READ_OP"):
        raise InputError(f"{name} = ...: is a word of the language that cannot be assigned")
    if word in words.NOT_EMULATED:
        raise InputError(f"{name}: a word of the controller that is not emulated")
    return word
