"""Dask, kept out of commands that do not ask for it: xarray imports all of it, a second, wherever it is installed."""

from __future__ import annotations

import sys
from typing import Any, cast

_modules = cast("dict[str, Any]", sys.modules)


def hide_dask() -> None:
    """Let this process find no dask, unless it has it already: Python finds no module where None stands for it."""
    _modules.setdefault("dask", None)


def show_dask() -> None:
    """Let this process find dask again: a sweep on a cluster asks for it, and another package's plugin may."""
    if "dask" in _modules and _modules["dask"] is None:
        del _modules["dask"]
