"""The codes of G-code, each a function of its name; `code.py` says what a code is."""

from gantrysim.controllers.gcode.codes import auxiliary, coordinates, machining, modes, motion, printing
from gantrysim.controllers.gcode.codes.code import CODES, Code, Kind
