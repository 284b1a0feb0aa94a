"""The command `gantrysim`."""
