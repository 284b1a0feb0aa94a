"""Glue: how it leaves the dispenser, and the bead that is laid."""
