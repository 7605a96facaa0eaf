"""Packages kept out of commands that do not ask for them: others import all of them wherever they are installed.

Dask, a second, comes with xarray; coverage, which Numba tells what it compiles, takes 0.04 s.
"""

from __future__ import annotations

import sys
from typing import Any, cast

HEAVY = ("dask", "coverage")
_modules = cast("dict[str, Any]", sys.modules)


def hide_heavy() -> None:
    """Let this process find none of them that it has not yet: Python finds no module where None stands for it."""
    for name in HEAVY:
        _modules.setdefault(name, None)


def show_heavy() -> None:
    """Let this process find them again: a sweep on a cluster asks for dask, and another package's plugin may."""
    for name in HEAVY:
        if name in _modules and _modules[name] is None:
            del _modules[name]
