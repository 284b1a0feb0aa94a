"""Runs beside one another: which is better, by how much, and what differs between their jobs."""
