"""How much memory this process takes."""

import math
from contextlib import suppress
from pathlib import Path


def memory_mb(field: str) -> float:
    """Memory now (``VmRSS``) or at its peak (``VmHWM``), MiB; NaN where the system does not say (not Linux)."""
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field))
    return math.nan
