"""The codes of G-code, each a function of its name; `code_table.py` says what a code is."""

from gantrysim.controllers.gcode.codes import auxiliary, machining, modal, motions, offsets, printing
from gantrysim.controllers.gcode.codes.code_table import CODES, Code, Kind
