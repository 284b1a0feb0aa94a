"""FANUC's spiral and conical interpolation, with lines and arcs, in programs of blocks."""

from gantrysim.controllers.fanuc.alarm import Alarm
from gantrysim.controllers.fanuc.blocks import Arc, Block, Dwell, Line, Rapid, Spiral
from gantrysim.controllers.fanuc.program import Program
from gantrysim.controllers.fanuc.speed import Clamp
