"""Read and write recordings as netCDF 4 (HDF5). Classic netCDF files (version 3) are refused.

A file that pliant writes ends in a checksum of its bytes. The checksum detects damage and proves no origin, so every
file is read in a separate process.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.files import is_sealed, seal, whole
from pliant.recording.apart import read_apart
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.schema import COORDINATES, VARIABLES, check_recording

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

CLASSIC = b"CDF"  # first bytes of a classic netCDF file
BROKEN_FILE = (OSError, ValueError, LookupError, RuntimeError, TypeError, AttributeError, NotImplementedError,
               ArithmeticError, MemoryError)  # fmt: skip


def read_netcdf(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a recording from a netCDF file that pliant wrote; arrays stored as float32 are returned as float64. Of any
    other HDF5 file the mapping names the arrays, see `pliant.recording.arrays.ArrayMapping`.
    """
    if is_sealed(path) is False:
        raise InputError(f"{path.name} is damaged: its checksum is not the one that it was written with; copy the "
                         "file again")
    arrays, facts = _stored(path)
    if "schema" not in facts["groups"].get("", {}):
        from pliant.recording.hdf5_arrays import of_named  # not for files of pliant

        return of_named(arrays, facts, mapping, path.name)
    if mapping:
        raise InputError(f"{path.name} is netCDF, which needs no mapping: remove the mapping")
    return _in_memory(_decoded(arrays, facts, path.name)["/"])


def read_groups(path: Path) -> dict[str, xr.Dataset]:
    """Return a dict from the path of each group in a netCDF file (``/`` for the root) to its dataset in memory. Times
    are not converted to dates.

    The file is opened in a separate process, as it may come from an untrusted source.

    Raises
    ------
    InputError
        When the file does not exist, is not netCDF, is damaged, or links to other files.
    """
    try:
        return _decoded(*_stored(path), path.name)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def _stored(path: Path) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Return the arrays of a file and the facts about them, read through a separate process."""
    with path.open("rb") as file:
        if file.read(len(CLASSIC)) == CLASSIC:
            raise InputError(f"{path.name} is a classic netCDF file (version 3), which pliant does not read: convert "
                             f"it to netCDF 4, for example by `nccopy -k nc4 {path.name} NEW.nc`")
    return read_apart("hdf5", path, "netCDF")


def _decoded(arrays: Mapping[str, NDArray], facts: Mapping[str, Any], file: str) -> dict[str, xr.Dataset]:
    """Return the groups of a file by path, with the variables decoded."""
    import xarray as xr  # not before: it is imported while the helper reads

    try:
        variables: dict[str, dict[str, Any]] = {group: {} for group in facts["groups"]}
        for name, (key, dims, attrs) in facts["variables"].items():
            group, _, short = name.rpartition("/")
            variables[group][short] = xr.Variable(dims, arrays[key], _attributes(attrs))
        return {
            f"/{group}": xr.decode_cf(
                xr.Dataset(members, attrs=_attributes(facts["groups"][group])), decode_times=False).load()
            for group, members in variables.items()
        }  # fmt: skip
    except BROKEN_FILE as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"{file} cannot be read as netCDF; it may be damaged, so copy it again: "
                         f"{reason}") from None


def _attributes(stored: dict[str, Any]) -> dict[str, Any]:
    return {key: np.array(value["array"], value["dtype"]) if isinstance(value, dict) else value
            for key, value in stored.items()}  # fmt: skip


def write_netcdf(recording: xr.Dataset, path: Path, *, float32: bool = False, compress: bool = False) -> None:
    """Write a recording as netCDF; a failed write leaves no partial file.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording.
    path : Path
    float32 : bool
        Store the measured arrays in single precision: half the size, 1e-7 relative error. Times stay double.
    compress : bool
        Compress the measured arrays (deflate): a smaller file, slower to write and read.
    """
    check_recording(recording)
    encoding: dict[str, dict[str, Any]] = {}
    for name in VARIABLES:
        if name in recording:
            encoding[name] = {"dtype": "float32" if float32 else "float64", "_FillValue": None}
            if compress:
                encoding[name] |= {"zlib": True, "complevel": 1, "shuffle": True}
    attrs = {key: _storable(value) for key, value in recording.attrs.items()} | {"Conventions": "CF-1.11"}
    plain = recording.drop_encoding().assign_attrs(attrs)
    with whole(path) as temporary:
        try:
            plain.to_netcdf(temporary, engine="h5netcdf", encoding=encoding)
        except (ValueError, TypeError, NotImplementedError) as error:
            raise InputError(f"cannot write {path.name} as netCDF: {error}") from None
        seal(temporary)


def _storable(value: Any) -> Any:
    """Return an attribute that netCDF can hold: text, a number or an array of numbers as is, the rest as JSON."""
    if isinstance(value, (str, int, float, np.number)):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        return value
    return json.dumps(value, default=str)


def _in_memory(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with float64 arrays, plain strings and no netCDF encoding."""
    recording = recording.drop_encoding()
    for name in ("station", "axis", "component", "chamber", "core", "input", "kind"):
        if name in recording.coords:
            recording = recording.assign_coords({name: recording[name].astype(str)})
    for name in (*VARIABLES, *COORDINATES):
        if name in recording.variables and recording[name].dtype.kind in "iuf" and recording[name].dtype != np.float64:
            recording[name] = recording[name].astype(np.float64)  # it is ours since drop_encoding
    attrs = {key: value.item() if isinstance(value, np.generic) else value for key, value in recording.attrs.items()}
    attrs.pop("Conventions", None)
    recording.attrs = attrs
    return recording


READER = Reader("netcdf", ENDINGS["netcdf"], read_netcdf, begins_with(b"\x89HDF\r\n\x1a\n", CLASSIC))
