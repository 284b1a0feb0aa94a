"""The error of a program that softMC would not run."""

from __future__ import annotations

from gantrysim.errors import InputError


class SoftMCError(InputError):
    """A command that cannot be run, with its line, its text and what is wrong."""
