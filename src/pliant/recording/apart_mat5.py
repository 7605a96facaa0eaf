"""Read a MATLAB file of version 5 to 7 by SciPy, in a separate process."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.io import loadmat

from pliant.recording.apart_worker import Content

DEEPEST = 20  # structs within structs


def read(path: str) -> Content:
    """Return the numeric arrays of a .mat file, and a dict with two entries: the names of these arrays, and the names
    of all variables that are not numeric.

    Fields of structs are named ``struct.field``.
    """
    arrays: dict[str, np.ndarray] = {}
    names: dict[str, str] = {}
    others: list[str] = []

    def walk(name: str, value: Any, depth: int) -> None:
        if isinstance(value, dict) and depth < DEEPEST:
            for key, item in value.items():
                walk(f"{name}.{key}", item, depth + 1)
            return
        array = np.asarray(value)
        if array.dtype.names and array.size == 1 and depth < DEEPEST:
            for key in array.dtype.names:
                walk(f"{name}.{key}", array.reshape(-1)[0][key], depth + 1)
        elif array.dtype.kind in "iufb":
            names[name] = f"v{len(arrays)}"
            arrays[names[name]] = array
        else:
            others.append(name)

    for name, value in loadmat(path, simplify_cells=True).items():
        if not name.startswith("__"):
            walk(name, value, 0)
    return arrays, {"names": names, "others": others}
