"""Tuning: the gains with the smallest error of a job, within a stability margin and on machines that differ."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
