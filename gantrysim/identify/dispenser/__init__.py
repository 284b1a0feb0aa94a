"""A dispenser and its glue from measurements: masses, beads, dots and records of switching."""
