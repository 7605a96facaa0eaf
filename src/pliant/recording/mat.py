"""MATLAB .mat: versions 5 to 7 through SciPy, version 7.3 (HDF5) through the extra ``io``, in a helper process."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from pliant.errors import InputError
from pliant.recording.apart import read_apart
from pliant.recording.arrays import recording_from_arrays
from pliant.recording.registry import ENDINGS, Reader

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

def read_mat(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a .mat file; a struct's fields are named ``struct.field`` in the mapping.

    Options are those of `pliant.recording.arrays.ArrayMapping`.
    """
    with path.open("rb") as file:
        head = file.read(1024)
    is_hdf5 = b"MATLAB 7.3" in head or head[512:].startswith(b"\x89HDF") or head.startswith(b"\x89HDF")
    if is_hdf5 and find_spec("matio") is None:
        raise InputError(
            f"{path.name} is a MATLAB 7.3 file: install the extra with `pip install pliant[io]`, or save it in "
            "MATLAB with -v7"
        )
    stored, told = read_apart("mat73" if is_hdf5 else "mat5", path, ".mat")
    arrays = {name: stored[key] for name, key in told["names"].items()}
    return recording_from_arrays(arrays, mapping, path.name, others=told["others"])


READER = Reader("mat", ENDINGS["mat"], read_mat)
