"""Backend for xarray: ``xarray.open_dataset(path, engine="pliant")`` opens every format that `read` knows."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from xarray.backends import BackendEntrypoint

from pliant.errors import InputError
from pliant.recording.registry import read_recording

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import xarray as xr


class RecordingBackend(BackendEntrypoint):
    """Backend with which xarray opens files of recordings (C3D, wide CSV, netCDF, ...) as datasets."""

    description = "recordings of soft actuators: C3D, wide CSV, netCDF, MATLAB, NumPy, Luna, Motive"
    open_dataset_parameters = ("filename_or_obj", "drop_variables", "mapping", "format")

    def open_dataset(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        mapping: Mapping[str, Any] | None = None,
        format: str | None = None,  # noqa: A002
    ) -> xr.Dataset:
        """Read a recording from a file of any known format as an xarray dataset; `mapping` holds the options of that
        format.
        """
        if not isinstance(filename_or_obj, (str, os.PathLike)):
            raise InputError(f"a recording must be opened by its path, not by an object of type "
                             f"{type(filename_or_obj).__name__}")
        recording = read_recording(Path(filename_or_obj), mapping=mapping, format=format)
        names = [drop_variables] if isinstance(drop_variables, str) else list(drop_variables or ())
        return recording.drop_vars(names, errors="ignore")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Return whether xarray may choose this backend by the file name alone: True for C3D files, False for all
        others.
        """
        is_path = isinstance(filename_or_obj, (str, os.PathLike))
        return is_path and str(filename_or_obj).lower().endswith(".c3d")
