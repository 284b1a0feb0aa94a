"""Arrangements of axes: each function turns a table into the bodies, joints and motors of a machine."""
