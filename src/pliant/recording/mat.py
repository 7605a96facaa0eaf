"""MATLAB .mat: versions 5 to 7 through SciPy, version 7.3 (HDF5) through the extra ``io``."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.arrays import recording_from_arrays
from pliant.recording.registry import Reader

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

BROKEN = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, TypeError, MemoryError,
          IndexError, AttributeError, OverflowError, zlib.error, struct.error)  # fmt: skip


def read_mat(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a .mat file; a struct's fields are named ``struct.field`` in the mapping.

    Options are those of `pliant.recording.arrays.ArrayMapping`.
    """
    with path.open("rb") as file:
        head = file.read(1024)
    is_hdf5 = b"MATLAB 7.3" in head or head[512:].startswith(b"\x89HDF") or head.startswith(b"\x89HDF")
    load = _load_v73 if is_hdf5 else _load_v5
    try:
        content = load(path)
    except BROKEN as error:
        if isinstance(error, InputError):
            raise
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"{path.name} is no readable .mat file, or it is damaged: {reason}") from None
    arrays: dict[str, Any] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _flatten(name, value, arrays)
    return recording_from_arrays(arrays, mapping, path.name)


def _load_v5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        return loadmat(path, simplify_cells=True)
    except MatReadError as error:
        raise ValueError(str(error)) from None


def _load_v73(path: Path) -> dict[str, Any]:
    try:
        from matio import load_from_mat
    except ImportError:
        raise InputError(
            f"{path.name} is a MATLAB 7.3 file: install the extra with `pip install pliant[io]`, or save it in "
            "MATLAB with -v7"
        ) from None
    return load_from_mat(str(path))


def _flatten(name: str, value: Any, arrays: dict[str, Any]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _flatten(f"{name}.{key}", item, arrays)
        return
    array = np.asarray(value)
    if array.dtype.names and array.size == 1:
        for key in array.dtype.names:
            _flatten(f"{name}.{key}", array.reshape(-1)[0][key], arrays)
    elif array.dtype.kind in "iufb":
        arrays[name] = array


READER = Reader("mat", (".mat",), read_mat)
