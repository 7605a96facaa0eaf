"""Storage of a sweep's chunks on disk. Each file is complete or absent, so that no sample is lost or repeated.

A chunk is an .npz without pickled objects, which is safe to read from others.
"""

from __future__ import annotations

import hashlib
import json
import os
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError, PliantError
from pliant.files import SEAL_BYTES, content_of, seal_of, whole, write_text
from pliant.recording.npz import read_arrays
from pliant.version import __version__

Array = np.ndarray
Arrays = dict[str, Array]
ABOUT, SAMPLE = "sweep", "sample"  # names in a chunk: key and version, and the numbers of its samples


class DiskError(PliantError):
    """Raised when the disk does not accept a result of a sweep. All results written before stay valid."""


def write_dataset(recording: xr.Dataset, path: Path) -> None:
    """Write a dataset to `path` as netCDF so that the file is complete or absent, and flush it to the disk.

    Raises
    ------
    DiskError
        When the disk is full or refuses to write; no partial file is left behind.
    """
    content = BytesIO()  # in memory first: HDF5 that meets a full disk takes the process down with it
    recording.to_netcdf(content, engine="h5netcdf")
    write_sealed(content, path)


def write_sealed(content: BytesIO, path: Path) -> None:
    """Write bytes followed by their checksum to a file, completely or not at all."""
    try:
        with whole(path) as draft, draft.open("wb") as file:
            file.write(content.getbuffer())
            file.write(seal_of(content.getbuffer()))
            file.flush()
            os.fsync(file.fileno())
    except InputError as error:
        raise DiskError(
            f"{error}. All chunks written so far are complete: free space on the disk and start the same sweep again "
            "to continue where it stopped"
        ) from None


class Store:
    """Folder of one sweep, with one file for each chunk of samples and sweep.json.

    Parameters
    ----------
    folder : Path
    identity : dict
        All settings of the sweep. A folder that holds a sweep with other settings is rejected.
    """

    def __init__(self, folder: Path, identity: dict[str, Any]) -> None:
        self.folder = Path(folder)
        self.key = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]
        self.chunks = self.folder / "chunks"
        try:
            self.chunks.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot write into {self.folder}: {error.strerror or error}; choose another folder, or free space and "
                "check permissions"
            ) from None
        note = self.folder / "sweep.json"
        if note.exists() or any(self.chunks.iterdir()):
            try:
                before = json.loads(content_of(note, "sweep")).get("key")
            except (InputError, ValueError, AttributeError):
                before = None
            if before != self.key:
                raise InputError(
                    f"{self.folder} holds another sweep: use another folder, or remove this one to start anew"
                )
        else:
            self.note({"key": self.key, "identity": identity})
        self.identity = identity

    def note(self, content: dict[str, Any]) -> None:
        """Write sweep.json of the sweep's folder with the given content."""
        write_text(self.folder / "sweep.json", json.dumps({"key": self.key, **content}, indent=1) + "\n")

    def path(self, chunk: int) -> Path:
        """Return the path of the file of a chunk."""
        return self.chunks / f"chunk_{chunk:06d}.npz"

    def save(self, chunk: int, first: int, arrays: Arrays) -> None:
        """Write the result arrays of one chunk, completely or not at all; `first` is the index of its first sample.

        Raises
        ------
        DiskError
            See `write_dataset`.
        """
        content = BytesIO()
        samples = first + np.arange(len(next(iter(arrays.values()))))
        plain = {name: a.astype(str) if a.dtype.kind == "O" else a for name, a in arrays.items()}  # nothing is pickled
        entries: dict[str, Any] = {ABOUT: np.array([self.key, __version__]), SAMPLE: samples, **plain}
        np.savez(content, **entries)
        write_sealed(content, self.path(chunk))

    def load(self, chunk: int, first: int, last: int) -> xr.Dataset | None:
        """Return a chunk as a dataset; None if its file is absent, fails its checksum or belongs to another sweep."""
        try:
            data = self.path(chunk).read_bytes()
            content, end = data[:-SEAL_BYTES], data[-SEAL_BYTES:]
            if end != seal_of(content):
                return None
            arrays = read_arrays(BytesIO(content), len(content), self.path(chunk).name)
        except (OSError, InputError):
            return None
        samples, about = np.arange(first, last), [str(text) for text in np.ravel(arrays.pop(ABOUT, ()))]
        if len(about) != 2 or about[0] != self.key or not np.array_equal(arrays.pop(SAMPLE, ()), samples):
            return None
        if any(a.dtype.kind not in "fiubU" or a.shape[:1] != samples.shape for a in arrays.values()):
            return None
        return xr.Dataset(
            {name: (("sample", *(f"{name}_{k}" for k in range(1, a.ndim))), a) for name, a in arrays.items()},
            coords={"sample": samples}, attrs={"sweep": self.key, "source": f"pliant {about[1]}"},
        )

    def combine(self, bounds: list[tuple[int, int]]) -> xr.Dataset:
        """Return all chunks of a sweep as one dataset that contains every sample once and in order."""
        parts = []
        for chunk, (first, last) in enumerate(bounds):
            recording = self.load(chunk, first, last)
            if recording is None:
                raise PliantError(
                    f"chunk {chunk} (samples {first} to {last - 1}) in {self.folder} is missing or damaged: run the "
                    "sweep again"
                )
            parts.append(recording)
        whole = xr.concat(parts, dim="sample", data_vars="all", join="exact", combine_attrs="override")
        if not np.array_equal(whole["sample"].values, np.arange(bounds[-1][1])):
            raise PliantError(
                f"the chunks in {self.folder} do not hold every sample once: remove this folder and run the sweep again"
            )
        return whole
