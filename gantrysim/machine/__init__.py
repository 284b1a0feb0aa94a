"""The machine: one compiled MJCF with its axes, kinematics and tolerances."""
