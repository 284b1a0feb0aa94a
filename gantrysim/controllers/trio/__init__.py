"""Trio Motion BASIC: the "Move Spiral" method of application note AN-225, and an interpreter of programs."""

import lazy_loader

# __init__.pyi lists the names; the interpreter is imported where a program is read
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
