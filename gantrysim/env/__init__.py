"""Gymnasium environments: gains, torques, pressure or speed set while the nozzle follows a path."""

import lazy_loader

from gantrysim.base.extras import extra

# __init__.pyi lists the public names; each is imported at its first use
_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Import a public name; without Gymnasium the error says what to install."""
    with extra("learning", f"gantrysim.env.{name}"):
        return _attribute(name)
