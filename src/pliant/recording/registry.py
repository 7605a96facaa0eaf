"""Registry that selects the reader of a file: the built-in formats and those of installed packages.

Another package adds a format by an entry point of the group ``pliant.readers`` that points to a `Reader`. What a file
states about its content is compared with what was read in `read_recording`, for all formats alike; see
`pliant.recording.stated`.

Apply a scale and an offset to channels of a recording, such as raw counts or absolute pressures.

A mapping of any format may hold them, by variable (``pressure``, ``actuation``, ``angle``, ``position``, ``strain``) or
by the name of one chamber, input, station or core::

    [linear.pressure]
    scale = 0.0244      # value = scale * what the file holds + offset
    offset = -12.2
    unit = "kPa"        # of the offset
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from pliant.errors import InputError, clipped
from pliant.files import RECORDING, refuse_other, regular_file
from pliant.plugins import offered
from pliant.recording.lost import without_lost
from pliant.recording.mapping import FileMapping, options_of
from pliant.recording.published import PREFIX, published_path
from pliant.recording.schema import append_history, check_recording
from pliant.recording.stated import Reading, judge_stated
from pliant.recording.typed_steps import held, without_hold
from pliant.units import input_per, metre_per, pascal_per, radian_per

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import xarray as xr

GROUP = "pliant.readers"
HEAD_BYTES = 65536
BAG_METADATA = "metadata.yaml"  # in the folder of a ROS 2 bag

BUILT_IN = {  # name -> the reader and the endings of its files: only readers of the file's ending are imported
    "deeplabcut": ("pliant.recording.deeplabcut:READER", (".csv", ".h5", ".hdf5")),
    "sleap": ("pliant.recording.sleap:READER", (".h5", ".hdf5")),
    "netcdf": ("pliant.recording.netcdf:READER", (".nc", ".nc4", ".cdf", ".h5", ".hdf5")),
    "c3d": ("pliant.recording.c3d:READER", (".c3d",)),
    "columns": ("pliant.recording.wide_csv:COLUMNS", (".txt", ".dat", ".log")),
    "npz": ("pliant.recording.npz:READER", (".npz",)),
    "mat": ("pliant.recording.mat:READER", (".mat",)),
    "curvature": ("pliant.recording.curvature:READER", (".csv", ".tsv", ".txt")),
    "lvm": ("pliant.recording.lvm:READER", (".lvm",)),
    "tdms": ("pliant.recording.logger_channels:TDMS", (".tdms",)),
    "bag": ("pliant.recording.bag:READER", (".mcap", ".db3")),
    "luna": ("pliant.recording.luna:READER", (".tsv", ".txt")),
    "motive": ("pliant.recording.motive:READER", (".csv",)),
    "angles": ("pliant.recording.angle_log:READER", (".csv", ".txt", ".tsv", ".log", ".dat")),
    "csv": ("pliant.recording.wide_csv:READER", (".csv", ".tsv", ".trc")),  # last: reads any other table
}
ENDINGS = {name: endings for name, (_, endings) in BUILT_IN.items()}

KEYS = {"curvature": {"curvature_unit", "curvature", "components"}}  # of a mapping, which name the format of the file
MARKS = {  # words anywhere in the first bytes that show which program wrote a file
    "deeplabcut": (b"scorer", b"bodyparts", b"coords"),
    "sleap": (b"track_occupancy",),
    "motive": (b"format version", b"rigid body"),
}


CHANNELS: dict[str, tuple[str, Callable[[str], float] | None]] = {  # variable -> dimension of its channels, its units
    "pressure": ("chamber", pascal_per), "angle": ("station", radian_per), "position": ("station", metre_per),
    "strain": ("core", None), "actuation": ("input", input_per),
}  # fmt: skip
KEY = "linear"


class LinearScale(FileMapping):
    """Conversion of one recorded channel: value = scale * stored value + offset, with the offset in `unit`."""

    scale: float = Field(default=1.0, allow_inf_nan=False)
    offset: float = Field(default=0.0, allow_inf_nan=False)
    unit: str | None = None


def without_lines(mapping: Mapping[str, Any] | None) -> tuple[Mapping[str, Any] | None, Mapping[str, Any]]:
    """Split the options of a file into those of its reader and the table ``linear`` (scale and offset of channels), and
    return both.
    """
    if mapping is None or KEY not in mapping:
        return mapping, {}
    return {k: v for k, v in mapping.items() if k != KEY} or None, mapping[KEY]


def scaled(recording: xr.Dataset, lines: Mapping[str, Any], file: str) -> xr.Dataset:
    """Apply the scales and offsets in `lines`, a dict by channel name, to the channels of a recording. Return a new
    recording whose history lists them.

    Raises
    ------
    InputError
        When an entry names no channel of the recording, scales by 0, or has an offset without a unit.
    """
    if not hasattr(lines, "items"):
        raise InputError(f"the mapping for {file}: {KEY} must be a table by channel, such as [{KEY}.pressure]")
    for name, entry in lines.items():
        line = LinearScale.load(entry if hasattr(entry, "items") else {"scale": entry}, file)
        variable, where = channel(recording, str(name), file)
        added = line.offset * factor(variable, line, str(name), file)
        values = recording[variable].copy(deep=True)
        values[where] = line.scale * values[where] + added
        finding = f"{name} is {line.scale:g} times the stored value, plus {line.offset:g} {line.unit or ''}".rstrip()
        history = "\n".join(filter(None, [str(recording.attrs.get("history", "")), finding]))
        recording = recording.assign({variable: values}).assign_attrs(history=history)
    return recording


def channel(recording: xr.Dataset, name: str, file: str) -> tuple[str, dict[str, Any]]:
    """Find the variable of a recording that contains the channel `name`, and return the variable's name and the
    channel's index in it. The index is empty if `name` is the name of the variable itself.
    """
    if name in CHANNELS and name in recording:
        return name, {}
    for variable, (dimension, _) in CHANNELS.items():
        divided = variable in recording and dimension in recording[variable].dims
        names = [str(n) for n in recording[dimension].values] if divided else []
        if name in names:
            return variable, {dimension: names.index(name)}
    channels = ", ".join(v for v in CHANNELS if v in recording)
    raise InputError(f"the mapping for {file}: {KEY} names {name!r}, but the recording has no such channel: correct "
                     f"the name; its variables are {channels}")


def factor(variable: str, line: LinearScale, name: str, file: str) -> float:
    """Return the factor that converts a channel's offset from its stated unit to the SI unit, such as 1000 for kPa."""
    per = CHANNELS[variable][1]
    if line.scale == 0:
        raise InputError(f"the mapping for {file}: {KEY}.{name} has scale = 0, which would erase the channel: give "
                         "another scale")
    if per is None or (line.unit is None and line.offset == 0):
        return 1.0
    if line.unit is None:
        raise InputError(f"the mapping for {file}: {KEY}.{name} has an offset without a unit: add unit")
    return per(line.unit)


@dataclass(frozen=True)
class Reader:
    """A file format: its name, its file name endings, and the functions that recognise and read its files.

    Attributes
    ----------
    name : str
        Name of the format, as in ``read(path, format=name)``.
    suffixes : tuple of str
        File name endings in lower case, with the dot.
    read : callable
        ``read(path, mapping)`` returns a recording or, where the format states numbers of samples or rates, a
        `Reading`; `mapping` is None or a dict of options of this format.
    recognises : callable
        ``recognises(head) -> bool`` from the first 64 KiB; returns True for a file of this format; decides between
        formats that share an ending.
    needs_mapping : bool
        Whether the file cannot be read without a mapping.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, Mapping[str, Any] | None], xr.Dataset | Reading]
    recognises: Callable[[bytes], bool] = lambda _head: True
    needs_mapping: bool = False


def begins_with(*starts: bytes) -> Callable[[bytes], bool]:
    """Return a function that says whether the first bytes of a file, behind a byte-order mark, are one of `starts`."""
    return lambda head: head.removeprefix(b"\xef\xbb\xbf").startswith(starts)


def readers() -> dict[str, Reader]:
    """Return all known file formats by name, each with its reader: those of pliant first, then those of installed
    plugins.
    """
    return offered(GROUP, {name: target for name, (target, _) in BUILT_IN.items()}, Reader)


def read_recording(
    path: str | Path, *, mapping: Mapping[str, Any] | None = None, format: str | None = None  # noqa: A002
) -> xr.Dataset:
    """Read a recorded file and return it as a checked recording (`xarray.Dataset`) in SI units.

    Parameters
    ----------
    path : str or Path
        Path of a file or of the folder of a ROS 2 bag, or ``data:NAME/FILE``, a public recording that `pliant data
        fetch` has downloaded.
    mapping : dict, optional
        Information that the file lacks: columns and units of a plain table, names of arrays, the unit
        of length. The keys depend on the format; see the module of its reader. ``format`` is the next entry;
        ``files`` holds options of single files, see `pliant.recording.mapping`;
        ``linear`` scales channels of any format, see `pliant.recording.registry`; ``hold`` states whether inputs keep
        the value of a row until the next, see `pliant.recording.typed_steps`; ``incomplete = true`` reads a file that
        holds fewer samples than it states.
    format : str, optional
        Name of the format. Default: ``format`` of the mapping, otherwise recognised from the ending and the first
        bytes of the file. A mapping that describes ``stations``, ``points``, ``inputs`` or ``pressure`` by columns
        selects the format ``columns``.

    Returns
    -------
    xarray.Dataset
        A recording as `pliant.recording.make_recording` describes it; attributes hold the file name and its checksum.
        Positions that a tracker wrote in place of a lost station, such as 0, 0, 0, are NaN and counted in the history,
        see `pliant.recording.lost.lost_frames`.

    Raises
    ------
    InputError
        When the file does not exist, has no known format, is damaged, holds less than it states, or does not fit the
        mapping.

    Examples
    --------
    >>> import pliant
    >>> from pliant.testbed.bundle import FOLDER
    >>> pliant.read(FOLDER / "pulse_119.nc").sizes["station"]
    296
    """
    path = published_path(Path(path).as_posix()) if str(path).startswith(PREFIX) else Path(path)
    _check_exists(path)
    if mapping is not None and not hasattr(mapping, "items"):
        raise InputError(f"mapping must be a dict of options, not {type(mapping).__name__}")
    mapping = options_of(path, mapping)
    mapping, format = _without(mapping, "format", format)  # noqa: A001
    mapping, incomplete = _without(mapping, "incomplete", None)
    if incomplete not in (None, True, False):
        raise InputError(f"incomplete in the mapping for {path.name} must be true or false, not {incomplete!r:.60}")
    head, digest = _head_and_digest(path)
    mapping, hold = without_hold(mapping, path.name)
    mapping, lines = without_lines(mapping)
    reader = _choose(path, head, mapping, format and str(format))
    try:
        content = reader.read(path, mapping)
        reading = content if isinstance(content, Reading) else Reading(content)
        warnings = judge_stated(reading.stated, path.name, incomplete=bool(incomplete))
        recording = append_history(reading.recording, *warnings) if warnings else reading.recording
        recording = scaled(without_lost(recording), lines, path.name)
        recording = check_recording(held(recording, hold, path.name))
    except InputError as error:
        raise InputError(f"{error}{looks_like(head, reader.name)}") from None
    return recording.assign_attrs(_provenance(recording, path, reader.name, digest))


def _check_exists(path: Path) -> None:
    """Raise InputError where `path` is neither a file nor the folder of a ROS 2 bag."""
    try:
        if is_bag_folder(path) or (path.exists() and not path.is_dir()):
            return
    except OSError as error:  # such as a name too long
        where = clipped(str(path), 200)
        raise InputError(f"cannot read a recording from {where}: {error.strerror or error}") from None
    what = "this is a folder, not a file" if path.is_dir() else "there is no such file"
    if path.is_dir() and (bags := sorted(f.name for f in path.iterdir() if f.suffix in (".mcap", ".db3"))):
        what += f" (nor a whole ROS 2 bag, which has {BAG_METADATA}): give the file in it, such as {bags[0]}"
    raise InputError(f"cannot read a recording from {path}: {what}")


def is_bag_folder(path: Path) -> bool:
    """Return whether `path` is the folder of a ROS 2 bag, which holds `BAG_METADATA`."""
    return path.is_dir() and (path / BAG_METADATA).is_file()


def _without(mapping: Mapping[str, Any] | None, key: str, value: Any) -> tuple[Mapping[str, Any] | None, Any]:
    """Return the options without `key`, and `value` or else that of the option."""
    if mapping is None or key not in mapping:
        return mapping, value
    return {k: v for k, v in mapping.items() if k != key} or None, mapping[key] if value is None else value


def _head_and_digest(path: Path) -> tuple[bytes, str]:
    """Return the first bytes of a file and its checksum; of a folder, those of its first file and of all together."""
    files = sorted(f for f in path.iterdir() if f.is_file()) if path.is_dir() else [path]
    files.sort(key=lambda file: file.name == BAG_METADATA)
    try:
        with regular_file(files[0], "recording") as file:
            head = file.read(HEAD_BYTES)
        total = hashlib.sha256()
        for part in files:
            with regular_file(part, "recording") as file:
                digest = hashlib.file_digest(file, "sha256")
            total.update(digest.digest())
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    if not head:
        raise InputError(f"{path.name} is empty: copy or export it again")
    return head, total.hexdigest() if path.is_dir() else digest.hexdigest()


def _provenance(recording: xr.Dataset, path: Path, name: str, digest: str) -> dict[str, str]:
    """Return the attributes of origin; a recording that already names a source keeps it."""
    line = f"read {path.name} as {name}"
    history = str(recording.attrs.get("history", ""))
    attrs = {"history": f"{history}\n{line}" if history else line}
    if not recording.attrs.get("source"):
        attrs |= {"source": path.name, "source_format": name, "source_sha256": digest}
    return attrs


def looks_like(head: bytes, but: str = "") -> str:
    """Return a hint for an error message if the first bytes of a file, `head`, look like those of a known tracking
    program, else "". The program `but` is not considered.

    The hint, ``this looks like a file of ...: set format = ...``, ends the message about a file that could not be read.
    """
    words = head.lower()
    kind = next((name for name, marks in MARKS.items() if name != but and all(m in words for m in marks)), None)
    return f'; this looks like a file of {kind}: set format = "{kind}" in its mapping' if kind else ""


def describes_columns(mapping: Mapping[str, Any]) -> bool:
    """Return whether options of a file assign table columns to stations, points, angles, inputs or pressure."""
    pressure = mapping.get("pressure")
    named = bool({"points", "angles", "inputs"} & set(mapping))
    named = named or not isinstance(mapping.get("stations", []), list)  # a list chooses among names
    return named or (isinstance(pressure, dict) and "columns" in pressure)


SHEET, ONE_ROW = "save its sheet as CSV", "write a CSV with one row for each time"
ELSEWHERE = {  # what to do with files of other programs, by their endings
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods", ".numbers"), SHEET),
    **dict.fromkeys((".json", ".jsonl", ".ndjson", ".xml", ".parquet", ".feather", ".pkl", ".pickle"), ONE_ROW),
    **dict.fromkeys((".zip", ".gz", ".bz2", ".xz", ".7z", ".rar", ".tar", ".tgz"), "unpack it first"),
    ".npy": "store its array with its times under names, by numpy.savez('name.npz', time=..., position=...)",
    ".bag": "convert this bag of ROS 1 to one of ROS 2, by rosbags-convert --src name.bag --dst name",
    ".bvh": "export the positions of its joints as C3D, TRC or CSV", ".ulg": "convert it to CSV, by ulog2csv",
    ".slx": "run the model and save what it logs, by save('name.mat', 'out')",
}  # fmt: skip
SIGNED = {b"PK\x03\x04": ".xlsx", b"\xd0\xcf\x11\xe0": ".xls", b"PAR1": ".parquet", b"\x1f\x8b": ".gz",
          b"#ROSBAG": ".bag", b"HIERARCHY": ".bvh"}  # first bytes of such files, whatever their endings


def _choose(path: Path, head: bytes, mapping: Mapping[str, Any] | None, name: str | None) -> Reader:
    if path.is_dir():
        name = "bag"
    if name is None and mapping is not None:
        name = next((candidate for candidate, keys in KEYS.items() if keys & set(mapping)), None)
    if name is None and mapping is not None and describes_columns(mapping):
        name = "columns"
    if name is not None:
        known = readers()
        if name not in known:
            raise InputError(f"unknown format {name!r}: use one of {', '.join(known)}")
        return known[name]
    suffix = path.suffix.lower()
    ours = {reader: target for reader, (target, endings) in BUILT_IN.items() if suffix in endings}
    fitting = [r for r in offered(GROUP, ours, Reader).values() if suffix in r.suffixes and r.recognises(head)]
    ready = [r for r in fitting if not r.needs_mapping] or fitting
    if not ready:
        refuse_other(path, RECORDING)
        shown_by_bytes = (ending if ending != ".xlsx" or b"xl/" in head else ".zip"
                          for mark, ending in SIGNED.items() if head.startswith(mark))  # fmt: skip
        suffix = suffix if suffix in ELSEWHERE else next(shown_by_bytes, suffix)
        if suffix in ELSEWHERE:
            why = "" if path.suffix.lower() == suffix else f", a {suffix} file by its first bytes"
            raise InputError(f"pliant does not read {path.name}{why}: {ELSEWHERE[suffix]}")
        formats = ", ".join(f"{r.name} ({' '.join(r.suffixes)})" for r in readers().values())
        raise InputError(
            f"{path.name} has no known format: its ending or its first bytes match none of {formats}; "
            f"to read a plain table, give a mapping with stations or points{looks_like(head)}"
        )
    return ready[0]
