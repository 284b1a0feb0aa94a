"""Motion controllers and their languages: programs in, setpoints out. This package is independent of MuJoCo."""

import lazy_loader

# __init__.pyi lists the controllers; each is imported at its first use
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
