"""Number of processor cores that this Python process may use."""

from __future__ import annotations

import os


def cores() -> int:
    """Return the number of processor cores that this process may use: the system's limit or, without one, all cores."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
