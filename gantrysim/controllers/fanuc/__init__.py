"""FANUC's spiral and conical interpolation, among the lines and arcs of a file of blocks."""

from gantrysim.controllers.fanuc.alarm import Alarm
from gantrysim.controllers.fanuc.blocks import Arc, Block, Dwell, Line, Rapid, Spiral
from gantrysim.controllers.fanuc.program import Program
from gantrysim.controllers.fanuc.speed import Clamp

__all__ = ["Alarm", "Arc", "Block", "Clamp", "Dwell", "Line", "Program", "Rapid", "Spiral"]
