"""Trio Motion BASIC: the "Move Spiral" method of application note AN-225, and an interpreter of programs."""

from gantrysim.controllers.trio.basic import Basic, InterpreterTime, StatedSpiral
from gantrysim.controllers.trio.spiral import MoveSpiral
