"""Reader of MATLAB .mat files in a separate process: versions 5 to 7 by SciPy, version 7.3 by HDF5."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.apart import read_apart
from pliant.recording.arrays import recording_from_arrays
from pliant.recording.mapping import shorten
from pliant.recording.registry import ENDINGS, Reader

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))


def read_mat(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a MATLAB .mat file and return them as a recording.

    A field of a struct is named ``struct.field`` in the mapping, one of the second of several structs
    ``struct(2).field``. See `pliant.recording.arrays.ArrayMapping`.
    """
    with path.open("rb") as file:
        head = file.read(1024)
    is_hdf5 = b"MATLAB 7.3" in head or head[512:].startswith(b"\x89HDF") or head.startswith(b"\x89HDF")
    stored, facts = read_apart("hdf5" if is_hdf5 else "mat5", path, ".mat")
    if is_hdf5:
        arrays, others = matlab_arrays(stored, facts)
    else:
        arrays, others = {name: stored[key] for name, key in facts["names"].items()}, facts["others"]
    structs = facts.get("structs", {})
    refuse_unnumbered(mapping, structs, path.name)
    try:
        return recording_from_arrays(arrays, mapping, path.name, others=others)
    except InputError as error:
        raise InputError(f"{error}{listed_structs(structs)}") from None


def listed_structs(structs: Mapping[str, Any]) -> str:
    """Return the end of an error message that lists the arrays of structs of a file; "" where it has none."""
    listed = [f"{clipped(name, 40)}: {count} structs of {shorten(fields, 12)}"
              for name, (count, fields) in list(structs.items())[:6] if count > 1]  # fmt: skip
    first = next((f"{clipped(n, 40)}(1).{fields[0]}" for n, (c, fields) in structs.items() if c > 1 and fields), "")
    return f". {'; '.join(listed)}: name a field of one struct, such as {first}" if listed and first else ""


def refuse_unnumbered(mapping: Mapping[str, Any] | None, structs: Mapping[str, Any], file: str) -> None:
    """Raise InputError where the mapping names a field of an array of structs without the number of the struct."""
    for role, named in (mapping or {}).items():
        name, _, field = str(named).rpartition(".")
        if name in structs and field in structs[name][1]:
            raise InputError(f"{file} has several structs {clipped(name, 40)!r}, and {role} of the mapping names a "
                             f"field of none of them{listed_structs(structs)}")  # fmt: skip


def matlab_arrays(stored: Mapping[str, NDArray], facts: dict[str, Any]) -> tuple[dict[str, NDArray], list[str]]:
    """Return the numeric arrays of a MATLAB 7.3 file by name, with axes in MATLAB's order, and the names of variables
    that are not numeric.

    Each data set names its class in the attribute MATLAB_class; a struct is a group; a sparse matrix is a group with
    the attribute MATLAB_sparse; an empty array (MATLAB_empty) stores its shape instead of its values.
    """
    sparse = tuple(path for path, attributes in facts["groups"].items() if "MATLAB_sparse" in attributes)
    arrays: dict[str, NDArray] = {}
    others = [path.replace("/", ".") for path in (*facts["others"], *sparse)]
    for path, (key, _, attributes) in facts["variables"].items():
        if path.startswith(tuple(f"{group}/" for group in sparse)):
            continue
        name = path.partition(":")[0].replace("/", ".")
        if name != path.replace("/", "."):  # a column of a compound data set: complex numbers
            others += [] if name in others else [name]
        elif attributes.get("MATLAB_class", "double") not in NUMERIC or stored[key].dtype.kind not in "iufb":
            others.append(name)
        elif attributes.get("MATLAB_empty"):
            arrays[name] = np.zeros(0)
        else:
            arrays[name] = stored[key].T
    return arrays, others


READER = Reader("mat", ENDINGS["mat"], read_mat)
