"""Functions that read, check and write recordings of soft actuators, with one module per file format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pliant.errors import InputError
from pliant.recording.registry import Reader, read_recording, readers
from pliant.recording.schema import append_history, check_recording, make_recording

if TYPE_CHECKING:
    import xarray as xr

read = read_recording

__all__ = ["Reader", "append_history", "check_recording", "make_recording", "read", "readers", "write"]


def write(recording: xr.Dataset, path: str | Path) -> Path:
    """Write a recording to a file: netCDF (.nc) or wide CSV (.csv), by the ending of its name. A failed write leaves no
    partial file.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording; see `check_recording`.
    path : str or Path
        The ending chooses the format. An existing file of this name is replaced.

    Returns
    -------
    Path
        The file that was written.

    Raises
    ------
    InputError
        When the ending is unknown, the folder cannot be written, or the format cannot hold the recording.

    Examples
    --------
    >>> import tempfile
    >>> import pliant
    >>> from pliant.recording import make_recording
    >>> recording = make_recording([0.0, 0.1], [[[0, 0, 0]], [[0, 0.1, 0]]], station=["tip"])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pliant.write(recording, f"{folder}/a.csv").name
    'a.csv'
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in (".nc", ".nc4"):
        from pliant.recording.netcdf import write_netcdf

        write_netcdf(recording, path)
    elif suffix == ".csv":
        from pliant.recording.wide_csv import write_wide_csv

        write_wide_csv(recording, path)
    else:
        raise InputError(f"cannot write {path.name!r}: choose a file name that ends in .nc or .csv")
    return path
