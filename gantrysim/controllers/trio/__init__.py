"""Trio Motion BASIC: the "Move Spiral" method of application note AN-225."""

from gantrysim.controllers.trio.spiral import MoveSpiral
