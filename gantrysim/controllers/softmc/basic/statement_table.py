"""All commands and blocks of MC-Basic."""

from __future__ import annotations

from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic import motion, records, statements

COMMANDS = Statements.of(statements.command, motion.command, records.command)
BLOCKS = statements.block
