"""Exact geometry of paths: chains of pieces, involutes, arc lengths, nearest points."""
