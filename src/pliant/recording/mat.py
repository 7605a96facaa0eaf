"""Reader of MATLAB .mat files in a separate process: versions 5 to 7 by SciPy, version 7.3 by HDF5."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.apart import read_apart
from pliant.recording.arrays import USUAL_NAMES, recording_from_arrays, trials_in_arrays
from pliant.recording.column_names import SHAPES
from pliant.recording.columns import trials_in_table
from pliant.recording.mapping import named_in, shorten
from pliant.recording.npz import arrays_of
from pliant.recording.registry import ENDINGS, Reader, describes_columns

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

NUMBERED = re.compile(r"[\[{]([0-9]+)[\]}]")  # of a struct or cell
FIELD = re.compile(r"(.*?)\((\d{1,9})\)\.([^.(]+).*")  # of one of several structs
VALUES = ".signals.values"
SAVE_ARRAYS = ("of a table T save the columns, by S = table2struct(T, 'ToScalar', true); save('new.mat', '-struct', "
               "'S'); of a timetable first T = timetable2table(T); T.t = seconds(T.Time - T.Time(1)); of a timeseries "
               "or Dataset its arrays, such as t = ts.Time; p = ts.Data")  # fmt: skip
NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))


def read_mat(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a MATLAB .mat file and return them as a recording.

    A field of a struct is named ``struct.field`` in the mapping, one of the second of several structs or cells
    ``struct(2).field``; ``struct{2}`` and ``struct[2]`` mean the same. With the entry ``struct = "train(2)"`` all names
    are those of its fields. See `pliant.recording.arrays.ArrayMapping`.
    """
    arrays, others, structs = stored_arrays(path)
    if not arrays and others:
        raise InputError(f"{path.name} holds {shorten(others, 6)} and no array of numbers: {SAVE_ARRAYS}")
    options = {role: in_round_brackets(entry) for role, entry in (mapping or {}).items()}
    arrays = of_simulink(arrays, options)
    chosen = options.pop("struct", None)
    if chosen is not None:
        arrays = fields_of(str(chosen), arrays, structs, path.name)
    elif len(usual := with_usual_names(structs)) == 1 and not options:
        raise InputError(f"{path.name} holds {structs[usual[0]][0]} structs {clipped(usual[0], 40)!r}: set struct = "
                         f'"{usual[0]}(1)" in the mapping to read one; `pliant new` makes a recording of each')
    refuse_unnumbered(options, structs, path.name)
    try:
        return recording_from_arrays(arrays, options or None, path.name, others=others)
    except InputError as error:
        objects = [name for name in others if name.endswith(")")]
        unread = f"; {shorten(objects, 6)} cannot be read: {SAVE_ARRAYS}" if objects else ""
        raise InputError(f"{error}{listed_structs(structs) if chosen is None else ''}{unread}") from None


def of_simulink(arrays: Mapping[str, NDArray], options: Mapping[str, Any]) -> dict[str, NDArray]:
    """Return the arrays with those of the block To Workspace of Simulink under the names of their variables: of each
    ``name.signals.values`` the frames come first, and the times that all share are ``time``, if the file has none under
    a usual name. A variable with other times than those keeps its arrays, unless the mapping names it, as do all if the
    mapping names ``signals.values``. Names lose that of a struct that holds all arrays, such as ``out``.
    """
    entries = named_in({role: entry for role, entry in options.items() if role not in ("struct", "station")})
    struct = f"{options['struct']}." if "struct" in options else ""
    logged = {name.removesuffix(VALUES): values for name, values in arrays.items() if name.endswith(VALUES)}
    if not logged or any(entry.endswith(VALUES) for entry in entries):
        return dict(arrays)
    rest = {n: a for n, a in arrays.items() if not n.startswith(tuple(f"{name}." for name in logged))}
    own = {name: np.ravel(arrays[f"{name}.time"]) for name in logged if f"{name}.time" in arrays}
    stated = [a for n, a in arrays.items() if n == f"{struct}{options.get('time')}"]
    clocks = stated or [a for n, a in {**rest, **logged}.items() if n.rpartition(".")[2] in USUAL_NAMES["time"]]
    shared = [time for time in own.values() if all(np.array_equal(time, other) for other in own.values())]
    for name, values in logged.items():
        apart = clocks and not any(np.array_equal(own.get(name, np.ravel(c)), np.ravel(c)) for c in clocks)
        begins = tuple(f"{n}." for n in (name, name.removeprefix(struct), name.partition(".")[2] or name))
        if apart and not any(f"{entry}.".startswith(begins) for entry in entries):
            rest |= {n: a for n, a in arrays.items() if n.startswith(f"{name}.")}
        else:
            rest[name] = frames_first(values, np.size(own.get(name, ())))
    outer = {name.partition(".")[0] if "." in name else "" for name in rest}
    if not struct and len(outer) == 1 and not any(entry.startswith(f"{min(outer)}.") for entry in entries):
        rest = {n.removeprefix(f"{min(outer)}."): a for n, a in rest.items()}
    if not shared:
        rest |= {f"{name}.time": time for name, time in own.items()}
    elif not clocks:
        rest[f"{struct}time"] = shared[0]
    return rest | {n: a for n, a in arrays.items() if n.removeprefix(struct) in entries}


def frames_first(values: NDArray, count: int) -> NDArray:
    """Return what Simulink stored of `count` frames, which are the last dimension of a vector's, as (T, ...)."""
    last = np.ndim(values) > 1 and np.shape(values)[-1] == count != np.shape(values)[0]
    return np.squeeze(np.moveaxis(values, -1, 0) if last else values)


def stored_arrays(path: Path) -> tuple[dict[str, NDArray], list[str], dict[str, tuple[int, list[str]]]]:
    """Return the numeric arrays of a .mat file by name, the names of its other variables, and for each array of structs
    their number and fields.
    """
    with path.open("rb") as file:
        head = file.read(1024)
    is_hdf5 = b"MATLAB 7.3" in head or head[512:].startswith(b"\x89HDF") or head.startswith(b"\x89HDF")
    stored, facts = read_apart("hdf5" if is_hdf5 else "mat5", path, ".mat")
    if is_hdf5:
        arrays, others = matlab_arrays(stored, facts)
        return arrays, others, {} if is_recording(arrays) else numbered_structs([*arrays, *others])
    structs = {name: (int(count), list(fields)) for name, (count, fields) in facts["structs"].items()}
    return {name: stored[key] for name, key in facts["names"].items()}, facts["others"], structs


def is_recording(arrays: Mapping[str, NDArray]) -> bool:
    """Return whether arrays outside of structs hold times and positions, strains or a pressure by name."""
    named = [role for role, names in USUAL_NAMES.items() if {*names} & {*arrays}]
    return "time" in named and bool({*named} & {"position", "strain", "pressure"})


def numbered_structs(names: Sequence[str]) -> dict[str, tuple[int, list[str]]]:
    """Return for each array or cell of structs the number of its structs and their fields, from the names of all
    variables, such as ``train(2).t``.
    """
    structs: dict[str, tuple[int, list[str]]] = {}
    for match in filter(None, map(FIELD.fullmatch, names)):
        count, fields = structs.get(match[1], (0, []))
        structs[match[1]] = max(count, int(match[2])), list(dict.fromkeys([*fields, match[3]]))
    return structs


def in_round_brackets(entry: Any) -> Any:
    """Return an entry of a mapping with ``(2)`` for the numbers ``{2}`` and ``[2]`` of structs and cells."""
    if isinstance(entry, str):
        return NUMBERED.sub(r"(\1)", entry)
    if isinstance(entry, Mapping):
        return {name: in_round_brackets(value) for name, value in entry.items()}
    return [in_round_brackets(value) for value in entry] if isinstance(entry, list) else entry


def with_usual_names(structs: Mapping[str, tuple[int, list[str]]]) -> list[str]:
    """Return the names of the arrays of structs that hold trials: several structs with a field of times or positions
    under a usual name.
    """
    names = {*USUAL_NAMES["time"], *USUAL_NAMES["position"]}
    return [name for name, (count, fields) in structs.items() if count > 1 and names & set(fields)]


def fields_of(
    struct: str, arrays: Mapping[str, NDArray], structs: Mapping[str, tuple[int, list[str]]], file: str
) -> dict[str, NDArray]:
    """Return the arrays of one struct by the names of its fields.

    Raises
    ------
    InputError
        When the file has no such struct, or `struct` names several.
    """
    fields = {name.removeprefix(f"{struct}."): array for name, array in arrays.items() if name.startswith(f"{struct}.")}
    if fields:
        return fields
    if struct in structs and structs[struct][0] > 1:
        raise InputError(f"{file} holds {structs[struct][0]} structs {clipped(struct, 40)!r}: choose one by struct = "
                         f'"{struct}(1)" in the mapping; `pliant new` makes a recording of each')
    known = [*structs, *dict.fromkeys(name.rpartition(".")[0] for name in arrays if "." in name)]
    raise InputError(f"{file} has no struct {clipped(struct, 40)!r}: correct struct in the mapping; it has "
                     f"{shorten(known, 8) or 'none'}")


def trials_in_mat(path: Path, mapping: Mapping[str, Any] | None) -> dict[str, dict[str, Any]]:
    """Return the options of each trial of a .mat file whose trials are several structs, by the number of the trial;
    empty if the file holds one trial.
    """
    options = dict(mapping or {})
    _, _, structs = stored_arrays(path)
    named = in_round_brackets(options.get("struct"))
    name = named if named is not None else next(iter(with_usual_names(structs) if not options else []), None)
    count = structs.get(str(name), (0, []))[0]
    return {str(k): options | {"struct": f"{name}({k})"} for k in range(1, count + 1)} if count > 1 else {}


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
            is_object = "MATLAB_object_decode" in attributes
            others.append(f"{name} ({attributes['MATLAB_class']})" if is_object else name)
        elif attributes.get("MATLAB_empty"):
            arrays[name] = np.zeros(0)
        else:
            arrays[name] = stored[key].T
    return arrays, others


def trials_of(path: Path, mapping: Mapping[str, Any] | None) -> dict[str, dict[str, Any]]:
    """Return the options by which each trial of a file is read, by the name of the trial; empty for a file with one.

    A table holds several trials if its mapping has ``select`` without a value, or if its names are repeated or its
    times begin anew, and its mapping describes the columns of its shape. A MATLAB file does if ``struct`` of its
    mapping names an array of structs or, without a mapping, if it has one array of structs with usual names. An .npz
    file does if its positions have four dimensions.

    Raises
    ------
    InputError
        When the file cannot be read, or the mapping does not fit it.
    """
    if path.is_dir():
        return {}
    if path.suffix.lower() == ".mat":
        return trials_in_mat(path, mapping)
    if path.suffix.lower() == ".npz":
        return trials_in_arrays(arrays_of(path), mapping, path.name)
    if mapping and ("select" in mapping or (set(SHAPES) & set(mapping) and describes_columns(mapping))):
        return trials_in_table(path, mapping)
    return {}


READER = Reader("mat", ENDINGS["mat"], read_mat)
