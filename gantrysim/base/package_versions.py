"""Versions of the packages that the numbers of a run depend on."""

from __future__ import annotations

import platform
from importlib.metadata import version


def package_versions() -> dict[str, str]:
    """Return the versions of the packages that the numbers of a run depend on, and that of Python, by name."""
    packages = {name: version(name) for name in ("gantrysim", "mujoco", "numpy", "numba", "scipy")}
    return {**packages, "python": platform.python_version()}
