"""Identification of a machine's axes from a log of their torque and position."""
