"""Read a MATLAB file of version 5 to 7 by SciPy, in a separate process."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.io import loadmat

from pliant.recording.apart_worker import Content

DEEPEST = 20  # structs within structs
OPAQUE = ("s0", "s1", "s2", "arr")  # parts of an object of MATLAB, as SciPy reads it: its name, .., class, ..
UNNAMED = "None"  # name that SciPy gives the variable that holds it
PARTED = (dict, list, np.ndarray)  # cells that hold structs, cells or arrays


def read(path: str) -> Content:
    """Return the numeric arrays of a .mat file, and a dict with three entries: the names of these arrays, the names of
    all variables that are not numeric, and for each array or cell of structs the number of its structs and their
    fields.

    Fields of structs are named ``struct.field``, those of the second struct of several ``struct(2).field``, and the
    array in the second cell ``cell(2)``.
    """
    content = Variables()
    for name, value in loadmat(path, simplify_cells=True).items():
        if not name.startswith("__"):
            content.walk(name, value, 0)
    return content.arrays, {"names": content.names, "others": content.others, "structs": content.structs}


class Variables:
    """The variables of a .mat file: numeric arrays by key, their keys by name, the names of the others, and the number
    and fields of the structs of each array of structs.
    """

    def __init__(self) -> None:
        self.arrays: dict[str, np.ndarray] = {}
        self.names: dict[str, str] = {}
        self.others: list[str] = []
        self.structs: dict[str, tuple[int, list[str]]] = {}

    def walk(self, name: str, value: Any, depth: int) -> None:
        """Add a variable, and the fields of structs in it down to `DEEPEST`."""
        if isinstance(value, dict) and depth < DEEPEST:
            for key, item in value.items():
                self.walk(f"{name}.{key}", item, depth + 1)
            return
        array = as_array(value)
        if array.dtype == object and array.size and depth < DEEPEST and any(isinstance(v, PARTED) for v in array.flat):
            if all(isinstance(v, dict) for v in array.flat):
                self.structs[name] = (array.size, [str(key) for key in array.flat[0]])
            for k, item in enumerate(array.ravel(order="F"), 1):
                self.walk(f"{name}({k})", item, depth + 1)
        elif array.dtype.names == OPAQUE:
            title, _, kind, _ = array.reshape(-1)[0]
            self.others.append(f"{title.decode() if name == UNNAMED else name} ({kind.decode()})")
        elif array.dtype.names and array.size == 1 and depth < DEEPEST:
            for key in array.dtype.names:
                self.walk(f"{name}.{key}", array.reshape(-1)[0][key], depth + 1)
        elif array.dtype.kind in "iufb":
            self.names[name] = f"v{len(self.arrays)}"
            self.arrays[self.names[name]] = array
        else:
            self.others.append(name)


def as_array(value: Any) -> np.ndarray:
    """Return a value as an array; a list of structs becomes an array of objects."""
    if isinstance(value, list):
        array = np.empty(len(value), object)
        array[:] = value
        return array
    return np.asarray(value)
