"""Stability: the sampled loops of a servo on a machine, and how far they are from instability."""
