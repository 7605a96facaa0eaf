"""Optional packages (Dask, coverage) that are hidden from imports until they are needed, so that commands start faster.

Other packages import Dask and coverage wherever these are installed. Dask, which xarray imports, takes about 1 s;
coverage, which Numba imports, takes 0.04 s.
"""

from __future__ import annotations

import sys
from typing import Any, cast

HEAVY = ("dask", "coverage")
_modules = cast("dict[str, Any]", sys.modules)


def hide_heavy() -> None:
    """Make imports of the packages dask and coverage fail in this process, unless they are imported already.

    Python raises ImportError for a module whose entry in `sys.modules` is None.
    """
    for name in HEAVY:
        _modules.setdefault(name, None)


def show_heavy() -> None:
    """Allow this process to import the packages dask and coverage again.

    A sweep on a cluster or a plug-in needs them, for example.
    """
    for name in HEAVY:
        if name in _modules and _modules[name] is None:
            del _modules[name]
