"""All statements of Trio BASIC with a syntax of their own."""

from __future__ import annotations

from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.trio.basic import declarations, flow, statements

STATEMENTS = Statements.of(statements.statement, flow.statement, declarations.statement)
