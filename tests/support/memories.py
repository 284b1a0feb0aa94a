"""How much memory this process holds, and by how much work grows it."""

import gc
from pathlib import Path

import pytest


def resident():
    """Resident memory of this process [B]; skips the test where the system does not tell."""
    file = Path("/proc/self/statm")
    if not file.exists():
        pytest.skip("no /proc")
    gc.collect()
    return 4096 * int(file.read_text(encoding="ascii").split()[1])


def open_files():
    """Number of this process' open files; skips likewise."""
    folder = Path("/proc/self/fd")
    if not folder.exists():
        pytest.skip("no /proc")
    gc.collect()
    return len(list(folder.iterdir()))
