"""Checks of a log, and of the fit to it: one file each, with its reason and its bounds.

A log that no check of the log passes is refused; a value that a check of the fit doubts gets a wider interval, or is
not identified.
"""
