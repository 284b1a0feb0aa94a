"""Setpoints, the record of a run and its file."""
