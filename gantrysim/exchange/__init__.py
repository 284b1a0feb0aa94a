"""Exchange with other programs and real machines: gains, tables, measured traces."""
