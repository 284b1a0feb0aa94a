"""All commands and blocks of MC-Basic."""

from __future__ import annotations

from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic import declarations, flow, motion, records, statements

COMMANDS = Statements.of(declarations.command, statements.command, motion.command, records.command)
BLOCKS = flow.block
