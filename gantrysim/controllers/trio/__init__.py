"""Trio Motion BASIC: the "Move Spiral" method of application note AN-225, and an interpreter of programs."""

from gantrysim.base.lazy_names import lazy_names

# __init__.pyi lists the names; the interpreter is imported where a program is read
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
