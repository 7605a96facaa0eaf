"""Read a C3D file by ezc3d, in a separate process."""

from __future__ import annotations

from typing import Any

import ezc3d
import numpy as np

from pliant.recording.apart_worker import Content


def read(path: str) -> Content:
    """Return the marker coordinates and analog values of a C3D file as arrays, and its parameters as a dict.

    Returns
    -------
    arrays : dict
        ``points`` (T, N, 3) in the unit of the file, NaN where a point is marked invalid; ``analog`` (T * samples, C).
    facts : dict
        ``parameters``: values by group and name, both in upper case.
    """
    content = ezc3d.c3d(path)
    points = np.moveaxis(np.asarray(content["data"]["points"])[:3], 0, -1).swapaxes(0, 1)
    parameters: dict[str, dict[str, list[Any]]] = {}
    for group, entries in content["parameters"].items():
        of_group = parameters.setdefault(text(group).upper(), {})
        for name, entry in entries.items():
            if name != "__METADATA__":
                values = entry["value"]
                plain = values.ravel().tolist() if isinstance(values, np.ndarray) else list(values)
                of_group[text(name).upper()] = [text(v) if isinstance(v, str) else v for v in plain]
    arrays = {"points": np.ascontiguousarray(points), "analog": np.asarray(content["data"]["analogs"])[0].T}
    return arrays, {"parameters": parameters}


def text(value: str) -> str:
    """Return a name from a C3D file without null bytes and outer blanks; invalid characters are replaced."""
    return value.encode("utf-8", "replace").decode("utf-8").strip("\0 ")
