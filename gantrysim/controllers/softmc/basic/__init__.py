"""An interpreter of MC-Basic programs."""

from gantrysim.controllers.softmc.basic.program import Basic
