"""Trio BASIC: an interpreter of programs against a motion generator of the controller's axes."""

from gantrysim.controllers.trio.basic.program import Basic, InterpreterTime, StatedSpiral
