"""Tuning: servo gains that minimise the error of a job within a stability margin, on perturbed machines."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
