"""Outline tracing on an XY stage that rides on a rotary table, under a needle that stands still."""

from gantrysim.controllers.stage.trace import OutlineTrace
