"""Read a classic netCDF file (version 3) by SciPy, in a separate process."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from pliant.recording.apart_worker import Content, plain_attributes, without_objects


def read(path: str) -> Content:
    """Return all arrays of a classic netCDF file, and a dict with the name, dimensions and attributes of each."""
    attributes = attrgetter("_attributes")  # SciPy has no public name for them
    arrays: dict[str, np.ndarray] = {}
    variables: dict[str, Any] = {}
    with netcdf_file(path, "r", mmap=False) as file:
        for name, variable in file.variables.items():
            key = f"v{len(arrays)}"
            arrays[key] = without_objects(np.array(variable[...]))
            variables[str(name)] = [key, list(variable.dimensions), plain_attributes(attributes(variable))]
        groups = {"": plain_attributes(attributes(file))}
    return arrays, {"groups": groups, "variables": variables, "others": []}
