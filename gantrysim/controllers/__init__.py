"""Motion controllers and their languages: programs in, setpoints out. This package is independent of MuJoCo."""

from gantrysim.base.lazy_names import lazy_names

# __init__.pyi lists the controllers; each is imported at its first use
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
