"""Processor cores and memory of this machine, so that what cannot fit is refused before it is read."""

import os
import sys
from pathlib import Path

_CGROUP = Path("/sys/fs/cgroup")
UNKNOWN = 4 << 30
"""Bytes assumed where the system does not say."""


def available_cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_bytes() -> int:
    """Memory that a process can still take: what is free or can be freed (Linux), all there is (macOS), else a guess.

    The limit of a container counts too (version 2 of Linux control groups).
    """
    if sys.platform == "linux":
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = next((int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable:")), UNKNOWN)
        return min(free, _left_in_container(free))
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return UNKNOWN


def _left_in_container(otherwise: int) -> int:
    try:
        most, used = ((_CGROUP / name).read_text().strip() for name in ("memory.max", "memory.current"))
        return max(int(most) - int(used), 0)
    except (OSError, ValueError):  # none, or "max"
        return otherwise
