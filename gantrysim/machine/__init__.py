"""The machine: one compiled MJCF with its axes, kinematics and tolerances, and the dispenser it carries."""
