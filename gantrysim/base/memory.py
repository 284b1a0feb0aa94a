"""Memory needed by long runs, and memory available."""

from __future__ import annotations

import ctypes
import math
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from gantrysim.base.errors import InputError

# Runs of more ticks keep their tables of a row per tick in temporary files instead of memory.
LONG_RUN = 250_000

# Measured with all figures, error budget and bead, on an225 with two axes; see tests/engine/test_long.py.
_TICK = 1000.0  # memory of a tick, where it is kept there [B]
# of a tick of a long run, and of its tables and of a block [B]
_LONG_TICK = 130.0
_LONG_BASE = 2e8
_FILE_TICK = 900.0  # in temporary files, of each tick of a long run [B]

_ALWAYS_FITTING = 200_000  # ticks that any machine has memory for
_GB = 1e9
# of control groups, versions 2 and 1: mount, limit, use
_GROUPS = (
    ("sys/fs/cgroup", "memory.max", "memory.current"),
    ("sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"),
)


def give_back() -> None:
    """Return freed memory, which the C library keeps, to the system; glibc does so on request."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def needed_memory(ticks: float) -> float:
    """Return about how much memory a run of so many ticks needs, with all its figures [B]."""
    return _LONG_BASE + _LONG_TICK * ticks if ticks > LONG_RUN else _TICK * ticks


def needed_files(ticks: float) -> float:
    """Return about how much room in temporary files it needs [B]."""
    return _FILE_TICK * ticks if ticks > LONG_RUN else 0.0


def available_memory(root: Path = Path("/")) -> float:
    """Return the memory that this process may still take: of the machine, and of its control groups [B].

    Args:
        root: of the file system that holds the statistics.
    """
    return min([_machine_memory(root), *_group_memory(root)])


def check_ticks(ticks: float, what: str, remedy: str) -> None:
    """Check that there is memory, and room in temporary files, for a run.

    Args:
        ticks: of the run.
        what: makes these ticks, as the message begins.
        remedy: makes fewer of them, as it ends.

    Raises:
        InputError: there is too little.
    """
    if ticks <= _ALWAYS_FITTING:
        return
    needed = needed_memory(ticks)
    available = available_memory()
    if needed > available:
        raise InputError(
            f"{what}: makes {ticks:.3g} ticks, which need about {needed / _GB:.3g} GB of memory, where "
            f"{available / _GB:.3g} GB are available; {remedy}"
        )
    needed = needed_files(ticks)
    folder = tempfile.gettempdir()
    if not needed:
        return
    free = float(shutil.disk_usage(folder).free)
    if needed > free:
        raise InputError(
            f"{what}: makes {ticks:.3g} ticks, which need about {needed / _GB:.3g} GB of temporary files, where "
            f"{free / _GB:.3g} GB are free in {folder}; {remedy}, or set TMPDIR to a folder with more room"
        )


def _machine_memory(root: Path) -> float:
    """Return the memory available; the whole memory where that is not stated, inf where neither is [B]."""
    available = _statistics(root / "proc/meminfo").get("MemAvailable:")
    if available is not None:
        return 1024.0 * available
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # Windows has no sysconf
        return float("inf")


def _group_memory(root: Path) -> Iterator[float]:
    """Yield what each control group of this process with a limit has left; files' pages count, as they can go [B]."""
    paths = {line.partition(":")[2].partition(":")[2] for line in _text(root / "proc/self/cgroup").splitlines()}
    groups = {group for path in paths for group in (Path(path), *Path(path).parents)} | {Path("/")}
    for mount, limit, use in _GROUPS:
        for group in groups:
            folder = root / mount / group.relative_to(group.anchor)
            try:
                # "max" where there is none
                allowed = float(_text(folder / limit))
                used = float(_text(folder / use))
            except ValueError:
                continue
            pages = _statistics(folder / "memory.stat")
            if math.isfinite(allowed):
                yield max(allowed - used + pages.get("inactive_file", 0.0) + pages.get("active_file", 0.0), 0.0)


def _statistics(file: Path) -> dict[str, float]:
    """Return the numbers of a file with a name and a number in each line."""
    rows = (line.split() for line in _text(file).splitlines())
    return {row[0]: float(row[1]) for row in rows if len(row) > 1 and row[1].isdigit()}


def _text(file: Path) -> str:
    """Return the text of a file, empty where it cannot be read."""
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
