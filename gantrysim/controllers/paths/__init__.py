"""Exact geometry: paths by arc length, chains of pieces, the nearest point."""
