"""Functions that write valid and malicious HDF5 files of the formats that pliant reads.

The layouts are those of pandas with PyTables 3.11 (`tests/recording/test_deeplabcut_hdf5.py` compares them). Names of
columns are pickles of protocol 0, which this module writes and never loads.
"""

from __future__ import annotations

import pickle
import zlib
from pathlib import Path

import h5py
import numpy as np

SCORER = "net"
POINTS = ("base", "mid", "tip")
COORDS = ("x", "y", "likelihood")
LEVELS = ("scorer", "bodyparts", "coords")
KEY = "df_with_missing"


class Creates:
    """An object whose pickle creates a file when it is loaded."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


def text_pickle(value: object) -> np.bytes_:
    """Return a pickle of protocol 0, the form in which PyTables stores objects that are neither numbers nor text."""
    return np.bytes_(pickle.dumps(value, 0))


def columns_of(points=POINTS) -> list[tuple[str, str, str]]:
    """Return the column names of one animal."""
    return [(SCORER, name, coordinate) for name in points for coordinate in COORDS]


def values_of(points: np.ndarray) -> np.ndarray:
    """Return the table (T, 3 S) of points (T, S, 2) [pixels] with a likelihood of 0.99."""
    likelihood = np.full((*points.shape[:2], 1), 0.99)
    return np.concatenate([points, likelihood], axis=2).reshape(len(points), -1)


def write_table(path: Path, columns: list, values: np.ndarray, levels=LEVELS, index=None) -> Path:
    """Write the layout "table"."""
    rows = np.zeros(len(values), [("index", "<i8"), ("values_block_0", "<f8", values.shape[1:])])
    rows["index"] = np.arange(len(values)) if index is None else index
    rows["values_block_0"] = values
    with h5py.File(path, "w") as file:
        group = file.create_group(KEY)
        group.attrs["CLASS"], group.attrs["pandas_type"] = np.bytes_("GROUP"), np.bytes_("frame_table")
        group.attrs["table_type"] = np.bytes_("appendable_frame")
        group.attrs["TITLE"] = h5py.Empty("S1")
        group.attrs["nan_rep"] = text_pickle(None)
        group.attrs["values_cols"] = text_pickle(["values_block_0"])
        group.attrs["non_index_axes"] = text_pickle([(1, columns)])
        about = {"names": list(levels), "type": "MultiIndex"}
        group.attrs["info"] = text_pickle({1: about, "index": {}, "values_block_0": {}})
        table = group.create_dataset("table", data=rows, chunks=(max(1, 65536 // rows.itemsize),), maxshape=(None,))
        table.attrs["index_kind"] = np.bytes_("integer")
        table.attrs["values_block_0_kind"] = text_pickle(columns)
        index = group.create_group("_i_table").create_group("index")
        index.create_dataset("indicesLR", (131072,), "<u4", chunks=(1024,))  # announced, never stored
    return path


def write_fixed(path: Path, columns: list, values: np.ndarray, levels=LEVELS, index=None) -> Path:
    """Write the layout "fixed"."""
    with h5py.File(path, "w") as file:
        group = file.create_group(KEY)
        group.attrs["CLASS"], group.attrs["pandas_type"] = np.bytes_("GROUP"), np.bytes_("frame")
        group.attrs["nblocks"], group.attrs["ndim"] = 1, 2
        for axis in ("axis0", "block0_items"):
            group.attrs[f"{axis}_nlevels"], group.attrs[f"{axis}_variety"] = len(levels), np.bytes_("multi")
            for k, level in enumerate(levels):
                texts = sorted({column[k] for column in columns})
                stored = group.create_dataset(f"{axis}_level{k}", data=np.array([t.encode() for t in texts]))
                stored.attrs["name"], stored.attrs["kind"] = np.bytes_(level), np.bytes_("string")
                codes = np.array([texts.index(column[k]) for column in columns], np.int8)
                group.create_dataset(f"{axis}_label{k}", data=codes)
        group["axis1"] = np.arange(len(values)) if index is None else np.asarray(index)
        group["axis1"].attrs["name"] = text_pickle(None)
        group["block0_values"] = values
        group["block0_values"].attrs["transposed"] = np.uint8(1)
    return path


def write_sleap(path: Path, points: np.ndarray, tracks: int = 1) -> Path:
    """Write SLEAP's analysis file of points (T, S, 2) [pixels]; each further track is 1000 pixels away."""
    moved = np.stack([points + 1000 * k for k in range(tracks)])
    with h5py.File(path, "w") as file:
        file["tracks"] = moved.transpose(0, 3, 2, 1)
        scores = np.full((tracks, points.shape[1], len(points)), 0.9)
        scores[0, -1, 0] = 0.1
        file["point_scores"] = scores
        file["node_names"] = [name.encode() for name in POINTS]
        file["track_names"] = [f"t{k}".encode() for k in range(tracks)]
        file["track_occupancy"] = np.ones((len(points), tracks))
    return path


def write_mat73(path: Path, arrays: dict[str, np.ndarray]) -> Path:
    """Write MATLAB 7.3: a user block of 512 bytes, reversed axes, and the class of each array."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in arrays.items():
            stored = file.create_dataset(name, data=np.asarray(value).T)
            stored.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116, b" ") + bytes(8) + b"\x00\x02IM")
    return path


def refer(file: h5py.File, name: str, values: list, *, cell: bool = False) -> None:
    """Store arrays, or structs of arrays (dicts), as MATLAB 7.3 stores a cell or one field of an array of structs."""
    refs = file.require_group("#refs#")
    rows = []
    for value in values:
        label = f"r{len(refs)}"
        if isinstance(value, dict):
            refs.create_group(label).attrs["MATLAB_class"] = np.bytes_("struct")
        for key, array in value.items() if isinstance(value, dict) else [("", value)]:
            refs[f"{label}/{key}".rstrip("/")] = np.asarray(array).T
            refs[f"{label}/{key}".rstrip("/")].attrs["MATLAB_class"] = np.bytes_("double")
        rows.append(refs[label].ref)
    file[name] = np.array([rows], h5py.ref_dtype)
    if cell:
        file[name].attrs["MATLAB_class"] = np.bytes_("cell")


def external_link(path: Path, name: str, secret: Path) -> None:
    """Replace a data set by a link to another HDF5 file."""
    with h5py.File(secret, "w") as other:
        other["hidden"] = np.full(h5py.File(path, "r")[name].shape, 42.0)
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = h5py.ExternalLink(str(secret), "/hidden")


def external_storage(path: Path, name: str, secret: Path) -> None:
    """Replace a data set by one whose bytes are in another file of any kind."""
    with h5py.File(path, "r+") as file:
        shape, size = file[name].shape, file[name].size
        secret.write_bytes(b"A secret of another program. " * (1 + 8 * size // 29))
        del file[name]
        file.create_dataset(name, shape, "<f8", external=[(str(secret), 0, 8 * size)])


def virtual(path: Path, name: str, secret: Path) -> None:
    """Replace a data set by a virtual one, gathered from another HDF5 file."""
    with h5py.File(path, "r+") as file:
        shape = file[name].shape
        with h5py.File(secret, "w") as other:
            other["hidden"] = np.full(shape, 42.0)
        layout = h5py.VirtualLayout(shape, "<f8")
        layout[...] = h5py.VirtualSource(str(secret), "hidden", shape)
        del file[name]
        file.create_virtual_dataset(name, layout)


def soft_circle(path: Path, name: str, _secret: Path) -> None:
    """Replace a data set by a soft link to itself."""
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = h5py.SoftLink(f"/{name}")


def group_circle(path: Path, _name: str, _secret: Path) -> None:
    """Add a group that holds the root."""
    with h5py.File(path, "r+") as file:
        file.create_group("turn")["again"] = file["/"]


def announced(path: Path, name: str, _secret: Path) -> None:
    """Replace a data set by one that declares 300 million numbers and stores none."""
    with h5py.File(path, "r+") as file:
        rank = file[name].ndim
        del file[name]
        shape = (1,) * (rank - 1) + (300_000_000,)
        file.create_dataset(name, shape, "<f8", chunks=(1,) * (rank - 1) + (1000,), compression="gzip")


def compressed(path: Path, name: str, _secret: Path) -> None:
    """Replace a data set by 400 MB of zeros that need less than a megabyte of storage."""
    with h5py.File(path, "r+") as file:
        start = (0,) * (file[name].ndim - 1)
        del file[name]
        ones, chunk = tuple(1 for _ in start), zlib.compress(bytes(8_000_000))
        stored = file.create_dataset(
            name, (*ones, 50_000_000), "<f8", chunks=(*ones, 1_000_000), compression="gzip"
        )
        for first in range(0, 50_000_000, 1_000_000):
            stored.id.write_direct_chunk((*start, first), chunk)


def unknown_filter(path: Path, name: str, _secret: Path) -> None:
    """Replace a data set by one with a filter that HDF5 would load as a library."""
    with h5py.File(path, "r+") as file:
        shape = file[name].shape
        del file[name]
        made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        made.set_chunk(tuple(max(1, n) for n in shape))
        made.set_filter(32001, h5py.h5z.FLAG_OPTIONAL, (0,))
        space = h5py.h5s.create_simple(shape)
        h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, space, made)


ATTACKS = {  # what is done to a data set -> words that the refusal must hold
    external_link: r"a link \(external\) at .*, which is not followed",
    external_storage: "in other files, which are not read",
    virtual: "in other files, which are not read",
    soft_circle: r"a link \(soft\) at .*, which is not followed",
    group_circle: "contains itself",
    announced: "states 2400000000 bytes",
    compressed: "states more data",
    unknown_filter: "by filter 32001",
}
