"""Tuning: servo gains that minimise the error of a job within a stability margin, on perturbed machines."""

from gantrysim.base.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
