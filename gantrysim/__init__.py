"""Simulate a glue-dispensing gantry; locate the bead's error on the chain from program to nozzle, find its causes."""

import lazy_loader

__version__ = "0.1.0"

# __init__.pyi lists the public names; each is imported at its first use
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
