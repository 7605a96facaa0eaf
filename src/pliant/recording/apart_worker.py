"""Run by `pliant.recording.apart` as a process of its own: read one file with a library, hand its arrays to stdout.

Nothing of pliant is imported here: the process starts fast, and what a damaged file does to it stays in it.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable
from operator import attrgetter
from typing import Any

import numpy as np

MAGIC = b"pliant-arrays\n"
Content = tuple[dict[str, np.ndarray], dict[str, Any]]


def limit(seconds: int, memory: int) -> None:
    """Let the system end this process where it takes more; Windows has no such limits, only the parent's clock."""
    try:
        import resource
    except ImportError:
        return
    for kind, most in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_AS, memory), (resource.RLIMIT_CORE, 0)):
        try:
            hard = resource.getrlimit(kind)[1]
            bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (bound, hard))
        except (OSError, ValueError):  # macOS does not limit the address space
            continue


def read_hdf5(path: str) -> Content:
    """Every variable of a netCDF 4 file as it is stored, with dimensions and attributes."""
    import h5netcdf

    with h5netcdf.File(path, "r") as file:
        return _variables(file.variables.items(), file.attrs, lambda v: (v.dimensions, v[...], dict(v.attrs)))


def read_classic(path: str) -> Content:
    """The same of a classic netCDF file."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "r", mmap=False) as file:
        attributes = attrgetter("_attributes")  # SciPy has no other door to them
        return _variables(
            file.variables.items(), attributes(file), lambda v: (v.dimensions, np.array(v[...]), attributes(v))
        )


def read_mat5(path: str) -> Content:
    """The numeric arrays of a MATLAB file of version 5 to 7; structs become ``struct.field``."""
    from scipy.io import loadmat

    return _flat(loadmat(path, simplify_cells=True))


def read_mat73(path: str) -> Content:
    """The same of version 7.3, which is HDF5."""
    from matio import load_from_mat

    return _flat(load_from_mat(path))


def _variables(variables: Any, attrs: Any, parts: Callable[[Any], tuple[Any, Any, Any]]) -> Content:
    arrays: dict[str, np.ndarray] = {}
    told: dict[str, Any] = {"attrs": _plain(dict(attrs)), "variables": {}}
    for name, variable in variables:
        dims, values, own = parts(variable)
        arrays[f"v{len(arrays)}"] = _storable(np.asarray(values))
        told["variables"][str(name)] = [f"v{len(arrays) - 1}", list(dims), _plain(own)]
    return arrays, told


def _flat(content: dict[str, Any]) -> Content:
    arrays: dict[str, np.ndarray] = {}
    names: dict[str, str] = {}
    others: list[str] = []

    def walk(name: str, value: Any, depth: int) -> None:
        if isinstance(value, dict) and depth < 20:
            for key, item in value.items():
                walk(f"{name}.{key}", item, depth + 1)
            return
        array = np.asarray(value)
        if array.dtype.names and array.size == 1 and depth < 20:
            for key in array.dtype.names:
                walk(f"{name}.{key}", array.reshape(-1)[0][key], depth + 1)
        elif array.dtype.kind in "iufb":
            names[name] = f"v{len(arrays)}"
            arrays[names[name]] = array
        else:
            others.append(name)

    for name, value in content.items():
        if not name.startswith("__"):
            walk(name, value, 0)
    return arrays, {"names": names, "others": others}


def _storable(values: np.ndarray) -> np.ndarray:
    if not values.dtype.hasobject:
        return values
    return np.array([v.decode() if isinstance(v, bytes) else str(v) for v in values.ravel()]).reshape(values.shape)


def _plain(attrs: dict[Any, Any]) -> dict[str, Any]:
    """Attributes for JSON: numbers, text and lists of them."""
    found = {}
    for key, value in attrs.items():
        if isinstance(value, bytes):
            plain: Any = value.decode("utf-8", "replace")
        elif isinstance(value, (np.ndarray, np.generic)):
            plain = {"array": value.tolist(), "dtype": str(value.dtype)} if np.ndim(value) else value.item()
        else:
            plain = value if isinstance(value, (str, int, float, bool)) else str(value)
        found[str(key)] = plain.decode("utf-8", "replace") if isinstance(plain, bytes) else plain
    return found


READ = {"hdf5": read_hdf5, "classic": read_classic, "mat5": read_mat5, "mat73": read_mat73}


def main() -> None:
    """Arguments: kind, path, seconds, bytes of memory. One answer on stdout; a reason in one line where it fails."""
    kind, path, seconds, memory = sys.argv[1:5]
    answer = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # a library that prints must not mix with the answer
    limit(int(seconds), int(memory))
    try:
        arrays, told = READ[kind](path)
        stream = io.BytesIO()
        np.savez(stream, told=np.frombuffer(json.dumps(told).encode(), np.uint8), **arrays)  # type: ignore[arg-type]
        content: Any = stream.getbuffer()
    except BaseException as error:  # noqa: BLE001  whatever a library raises is one reason
        lines = str(error).split("\n")
        content = json.dumps({"reason": (lines[0] or type(error).__name__)[:200]}).encode()
    with os.fdopen(answer, "wb") as out:
        out.write(MAGIC)
        out.write(content)


if __name__ == "__main__":
    main()
