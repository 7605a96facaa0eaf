"""Read any HDF5 file (netCDF 4, MATLAB 7.3, SLEAP, DeepLabCut) as plain arrays in a separate process.

Nothing outside the file is opened: links to other files, data stored in other files and virtual data sets are refused.
The stated size of a data set is compared with the stored bytes before memory is allocated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np

from pliant.recording.apart_worker import Content, Refused, content_bound, plain_attributes, without_objects

REFERENCES = "#refs#"  # group of MATLAB with what its cells and structs hold
MOST_CELLS = 1000  # of a cell of trials; a longer one is read as what it is, a data set of references
SKIPPED = ("_i_", "#")  # private groups: indices of PyTables, references of MATLAB
DEEPEST = 32  # groups within groups
FILTERS = (1, 2, 3, 4, 5, 6, 32000)  # of HDF5 and h5py; any other would load a library of this machine
DEFLATE_RATIO = 1100  # zlib packs 1032 to 1 at most
HIDDEN = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates", "_nc3_strict",
          "_NCProperties")  # fmt: skip
DIMENSION_ALONE = b"This is a netCDF dimension but not a netCDF variable"
LINKS = {h5py.h5l.TYPE_SOFT: "soft", h5py.h5l.TYPE_EXTERNAL: "external"}


def read(path: str) -> Content:
    """Return all numeric and text data sets of an HDF5 file as arrays, and a dict with the name, dimensions and
    attributes of each.

    Returns
    -------
    arrays : dict
        Arrays by key (``v0``, ``v1``, ...).
    facts : dict
        ``groups``: attributes by path of the group, those of the file under the empty path. ``variables``: by path, the
        key of the array, the names of its dimensions (empty where the file has none) and its attributes; a column of a
        compound data set has the path ``data_set:column``. ``others``: paths of data sets that hold neither numbers nor
        text.
    """
    arrays: dict[str, np.ndarray] = {}
    facts: dict[str, Any] = {"groups": {}, "variables": {}, "others": []}
    size = Path(path).stat().st_size
    left = content_bound(size)
    with h5py.File(path, "r") as file:
        for name, item in walk(file):
            if item is None:
                facts["others"].append(name)
                continue
            if isinstance(item, h5py.Group):
                facts["groups"][name] = attributes_of(item, name, size)
                continue
            left -= announced_bytes(item, name)
            if left < 0:
                raise Refused(f"the file states more data, up to {name!r}, than its {size} bytes can hold: it may be "
                              "damaged, so copy it again")
            keep(arrays, facts, name, item, attributes_of(item, name, size))
    return arrays, facts


def walk(file: Any) -> Iterator[tuple[str, Any]]:
    """Yield the path and the h5py object of each group and data set of an HDF5 file, and of what the cells and arrays
    of structs of MATLAB refer to, as ``cell(2)`` and ``struct(2)/field``. Soft and external links raise `Refused`.
    """
    addresses: set[int] = set()
    by_reference: set[str] = set()
    waiting = [("", file)]
    while waiting:
        name, item = waiting.pop()
        if not isinstance(item, h5py.Group):
            if isinstance(item, h5py.Dataset) and item.attrs.get("NAME", b"")[:52] != DIMENSION_ALONE:
                parts = referred(file, name, item)
                by_reference |= {path for path, _ in parts}
                waiting += reversed(parts)
                if not parts:
                    yield name, item
            continue
        address = int(h5py.h5o.get_info(item.id).addr)
        if address in addresses and name in by_reference:
            yield name, None
            continue
        if address in addresses or name.count("/") >= DEEPEST:
            raise Refused(f"group {name!r} contains itself, has two names, or is nested too deeply: copy its data "
                          "sets into a new file")
        addresses.add(address)
        yield name, item
        for key in item:
            if key.startswith(SKIPPED):
                continue
            path = f"{name}/{key}" if name else key
            link = item.id.links.get_info(key.encode()).type
            if link != h5py.h5l.TYPE_HARD:
                kind = LINKS.get(link, "user-defined")
                raise Refused(f"the file has a link ({kind}) at {path!r}, which is not followed: copy the data into "
                              "the file")
            waiting.append((path, item[key]))


def referred(file: Any, name: str, item: Any) -> list[tuple[str, Any]]:
    """Return the paths and objects to which a cell of MATLAB refers, or the field `item` of an array of structs; empty
    for another data set.
    """
    if REFERENCES not in file or h5py.check_ref_dtype(item.dtype) is not h5py.Reference or not item.shape:
        return []
    announced_bytes(item, name)
    of_cell = bytes(item.attrs.get("MATLAB_class", b"")) == b"cell"
    owner, _, field = name.rpartition("/")
    if of_cell and (item.size > MOST_CELLS or of_text(file, item)):
        return []
    names = [f"{name}({k})" if of_cell else f"{owner}({k})/{field}" for k in range(1, item.size + 1)]
    if name.count("(") >= DEEPEST:
        raise Refused(f"{name[:200]!r} is nested too deeply: copy its data sets into a new file")
    with suppress(ValueError, KeyError, RuntimeError):  # a reference to nothing: no cell of MATLAB
        return [(path, file[ref]) for path, ref in zip(names, item[()].ravel(), strict=True) if ref]
    return []


def of_text(file: Any, cell: Any) -> bool:
    """Return whether the first reference of a cell of MATLAB is to a text, as in a list of names or of times."""
    with suppress(ValueError, KeyError, RuntimeError):
        return bytes(file[cell[()].ravel()[0]].attrs.get("MATLAB_class", b"")) == b"char"
    return False


def announced_bytes(item: Any, name: str) -> int:
    """Return the memory [bytes] that an HDF5 data set needs according to its stated shape. Raise `Refused` if the file
    stores too few bytes for this shape.
    """
    creation = item.id.get_create_plist()
    if creation.get_layout() == h5py.h5d.VIRTUAL or creation.get_external_count():
        raise Refused(f"the data of {name!r} are in other files, which are not read: copy the data into the file")
    filters = [creation.get_filter(k)[0] for k in range(creation.get_nfilters())]
    unknown = [k for k in filters if k not in FILTERS]
    if unknown:
        raise Refused(f"{name!r} is compressed by filter {unknown[0]}, which HDF5 does not include: compress it with "
                      "gzip")
    announced = int(item.id.get_space().get_simple_extent_npoints()) * int(item.id.get_type().get_size())
    stored = int(item.id.get_storage_size())
    if announced > stored * (DEFLATE_RATIO if filters else 1):
        raise Refused(f"the file states {announced} bytes for {name!r}, but stores {stored}: it is damaged or "
                      "incomplete, so copy it again")
    return announced


def attributes_of(item: Any, name: str, size: int) -> dict[str, Any]:
    """Return the attributes of an HDF5 group or data set as a dict, except those by which HDF5 assigns dimensions."""
    values = {}
    for key in item.attrs:
        if key in HIDDEN:
            continue
        stored = item.attrs.get_id(key)
        announced = math.prod(stored.shape or ()) * stored.dtype.itemsize
        if announced > size:
            raise Refused(f"the file states {announced} bytes for attribute {key!r} of {name!r}, but has only {size} "
                          "in all: it is damaged, so copy it again")
        value = item.attrs[key]
        single = isinstance(value, np.ndarray) and value.shape == (1,)  # netCDF has no other single numbers
        values[key] = "" if isinstance(value, h5py.Empty) else value[0] if single else value
    return plain_attributes(values)


def keep(
    arrays: dict[str, np.ndarray], facts: dict[str, Any], name: str, item: Any, attributes: dict[str, Any]
) -> None:
    """Read one HDF5 data set into the dict `arrays` and add its name, dimensions and attributes to the dict `facts`.
    Both dicts are changed in place.
    """
    kind = item.dtype
    is_text = h5py.check_string_dtype(kind) is not None
    if item.shape is None or (kind.hasobject and not is_text) or (kind.kind == "V" and not kind.names):
        facts["others"].append(name)
        return
    values = np.asarray(item.asstr()[()] if kind.hasobject else item[()])
    columns = {f"{name}:{field}": values[field] for field in kind.names or ()} or {name: values}
    for path, column in columns.items():
        if column.dtype.kind == "V":
            facts["others"].append(path)
            continue
        key = f"v{len(arrays)}"
        arrays[key] = without_objects(column)
        facts["variables"][path] = [key, dimensions_of(item, name), attributes]


def dimensions_of(item: Any, name: str) -> list[str]:
    """Return the names of the dimensions of a netCDF variable in an HDF5 file; [] where it has none."""
    if item.is_scale and item.ndim == 1:
        return [name.rpartition("/")[2]]
    if "DIMENSION_LIST" not in item.attrs:
        return []
    return [str(item.dims[k][0].name).rpartition("/")[2] for k in range(item.ndim)]
