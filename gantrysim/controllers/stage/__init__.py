"""Outline tracing on an XY stage on top of a rotary table, under a stationary needle."""

from gantrysim.controllers.stage.outline_trace import OutlineTrace
