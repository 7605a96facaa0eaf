"""Functions that damage recordings, and decide from the changed bytes and the format whether the damage is detectable.
"""

from __future__ import annotations

import struct
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import hdf5_files
import numpy as np
import xarray as xr
from scipy.io import savemat

from pliant.errors import InputError
from pliant.files import seal
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording, read, write

FRAMES, POINTS = 24, 3
TIME = np.arange(FRAMES) / 50
GENTLE = np.random.default_rng(0).normal(size=(FRAMES, POINTS, 3)) * 1e-3 + np.arange(POINTS)[:, None] * 0.05
NUMBERS = (b"", b"nan", b"inf", b"-0", b"1e999", b"-1e308", b"1e308", b"5e-324", b"0x10", b"1_000", b"999", b"-", b'"')
UNITS = ((b"mm", b"m"), (b"Meters", b"Millimeters"), (b"kpa", b"psi"), (b"microstrain", b"strain"), (b"x_", b"y_"),
         (b"POINT", b"PAINT"), (b"time", b"tame"), (b"position", b"positiom"), (b"Strain", b"GHz"))  # fmt: skip
HDF5 = {  # originals that are HDF5 -> a data set of theirs that an attack replaces
    "nc, foreign": "position", "nc, resealed": "position", "mat, 7.3": "position", "h5, SLEAP": "tracks",
    "h5, DeepLabCut table": "df_with_missing/table", "h5, DeepLabCut fixed": "df_with_missing/block0_values",
}  # fmt: skip
HDF5_KINDS = ("attack", "attack", "pickle", "attribute", "size", "size")
CAMERA = {"camera": {"rate_hz": 50.0, "pixels_per_mm": 4.0}}
# mappings of the texts that need no camera
TOLD = {"csv, angles": None, "lvm, LabVIEW": None, "csv, curvature": {"curvature_unit": "1/m"}}
MARKER = Path(tempfile.gettempdir()) / "pliant_pickle_was_run"
KINDS = ("bits", "bytes", "cut", "lose", "double", "swap", "number", "unit", "encoding", "append", "lines", "zeros")


class Original(NamedTuple):
    """A valid file of one format."""

    name: str
    suffix: str
    data: bytes
    mapping: dict[str, Any] | None
    sealed: bool  # every byte that matters is under a checksum
    framed: bool  # the format says how long it is: cuts, lost and doubled bytes show
    text: bool


class Whole(NamedTuple):
    """The content of a valid file when it is read."""

    recording: xr.Dataset
    findings: tuple[str, ...]


def read_whole(original: Original, folder: Path) -> Whole:
    """Read a valid, undamaged file."""
    path = folder / f"damaged{original.suffix}"
    path.write_bytes(original.data)
    ds = read(path, mapping=original.mapping)
    return Whole(ds, quality(ds).findings)


def c3d() -> bytes:
    """Write a C3D file that states its properties in header and parameters."""

    def parameter(name: bytes, kind: int, dims: list[int], content: bytes) -> bytes:
        value = struct.pack("bB", kind, len(dims)) + bytes(dims) + content + b"\0"
        return struct.pack("bb", len(name), 1) + name + struct.pack("<H", len(value) + 2) + value

    entries = b"".join([
        struct.pack("bb", 5, -1) + b"POINT" + struct.pack("<HB", 3, 0),
        parameter(b"USED", 2, [], struct.pack("<H", POINTS)), parameter(b"FRAMES", 2, [], struct.pack("<H", FRAMES)),
        parameter(b"DATA_START", 2, [], struct.pack("<H", 3)), parameter(b"RATE", 4, [], struct.pack("<f", 50)),
        parameter(b"SCALE", 4, [], struct.pack("<f", -0.1)), parameter(b"UNITS", -1, [2, 1], b"mm"),
        parameter(b"LABELS", -1, [4, POINTS], b"basemid tip "),
    ])  # fmt: skip
    header = struct.pack("<BB5HfHHf", 2, 0x50, POINTS, 0, 1, FRAMES, 10, -0.1, 3, 0, 50)
    points = np.ones((FRAMES, POINTS, 4), "<f4")
    points[..., :3] = 1e3 * GENTLE
    body = header.ljust(512, b"\0") + (bytes([1, 0x50, 1, 84]) + entries).ljust(512, b"\0") + points.tobytes()
    return body + bytes(-len(body) % 512)


def luna() -> str:
    """Write a Luna table."""
    rows = [f"2023-09-06 12:51:28.{888946 + 20 * k:06d}\tmeasurement\tstrain\t{k:.1f}\t{2 * k:.1f}\t{-k:.1f}"
            for k in range(FRAMES)]  # fmt: skip
    head = ["Test name:\tbench", "Gage Pitch (mm):\t50", "Units:\tmicrostrain", "-----", "x-axis\t\t\t0.00\t0.05\t0.10"]
    return "\n".join([*head, *rows, ""])


def motive() -> str:
    """Write a Motive export of three markers."""
    names = [n for n in ("base", "mid", "tip") for _ in "xyz"]
    head = [f"Format Version,1.23,Total Exported Frames,{FRAMES},Export Frame Rate,50.0,Length Units,Meters", "",
            ",Type" + ",Marker" * 9, ",Name," + ",".join(names), ",ID," + ",".join(str(i // 3) for i in range(9)),
            "," + ",Position" * 9, "Frame,Time (Seconds)" + ",X,Y,Z" * 3]  # fmt: skip
    rows = [f"{k},{TIME[k]:.6f}," + ",".join(f"{v:.6f}" for v in GENTLE[k].ravel()) for k in range(FRAMES)]
    return "\n".join([*head, *rows, ""])


def tracker_texts() -> dict[str, str]:
    """Write text files of trackers and small loggers: tables of points in pixels, and a log of an angle."""
    names, pixels = ("base", "mid", "tip"), 500.0 + 1e3 * GENTLE[..., :2]
    rows = [",".join([str(k), *(f"{x:.3f},{y:.3f},0.99" for x, y in frame)]) for k, frame in enumerate(pixels)]
    scored = ["scorer" + ",net" * 9, "bodyparts," + ",".join(n for n in names for _ in range(3)),
              "coords" + ",x,y,likelihood" * 3]  # fmt: skip
    angles = [f"{t:.3f};{20 * np.sin(t):.4f};{10 * t:.3f}" for t in TIME]
    logged = [f"{t:.6f}\t{5 * t:.6f}\t{21 + t:.3f}" for t in TIME]
    bends = [f"{t:.3f},{0.1 + np.sin(t):.5f},{np.sin(2 * t):.5f},{t:.5f}" for t in TIME]
    return {
        "csv, DeepLabCut": "\n".join([*scored, *rows, ""]),
        "csv, angles": "\n".join(["time_s;angle_deg;pressure_kpa", *angles, ""]),
        "lvm, LabVIEW": "\n".join([
            "LabVIEW Measurement\t", "Separator\tTab", "X_Columns\tOne", "***End_of_Header***", "", "Channels\t2",
            "Y_Unit_Label\tpsi\tDeg C", "***End_of_Header***", "X_Value\tChamber\tTemp\tComment", *logged, ""]),
        "csv, curvature": "\n".join(["time_s,k_0,k_40,k_80", *bends, ""]),
    }


def hdf5_originals(folder: Path) -> list[Original]:
    """Write one valid file of each HDF5 layout other than netCDF."""
    pixels = 500.0 + 1e3 * GENTLE[..., :2]
    columns, values = hdf5_files.columns_of(), hdf5_files.values_of(pixels)
    paths = {
        "h5, DeepLabCut table": hdf5_files.write_table(folder / "table.h5", columns, values),
        "h5, DeepLabCut fixed": hdf5_files.write_fixed(folder / "fixed.h5", columns, values),
        "h5, SLEAP": hdf5_files.write_sleap(folder / "sleap.h5", pixels),
        "mat, 7.3": hdf5_files.write_mat73(folder / "a.mat", {"time": TIME[None], "position": GENTLE}),
        "nc, resealed": folder / "foreign.nc",
    }
    cameras = {name: CAMERA if path.suffix == ".h5" else None for name, path in paths.items()}
    return [Original(name, path.suffix, path.read_bytes(), cameras[name], sealed=False, framed=False, text=False)
            for name, path in paths.items()]  # fmt: skip


def originals(folder: Path) -> list[Original]:
    """Write one valid file of each format in `folder`."""
    pressure = np.linspace(0, 5e4, FRAMES)
    ds = make_recording(TIME, GENTLE, pressure=pressure, pressure_time=TIME)
    write(ds, folder / "own.nc")
    write(ds, folder / "own.csv")
    ds.to_netcdf(folder / "foreign.nc", engine="h5netcdf")
    arrays = {"time": TIME, "position": GENTLE, "p_kpa": pressure / 1e3}
    np.savez(folder / "a.npz", **arrays)
    savemat(folder / "plain.mat", arrays)
    savemat(folder / "packed.mat", arrays, do_compression=True)
    header = "t,p_kpa," + ",".join(f"{a}_{s:03d}" for s in range(POINTS) for a in "xyz")
    rows = [f"{t:.3f},{p:.3f}," + ",".join(f"{v:.6f}" for v in x.ravel())
            for t, p, x in zip(TIME, pressure / 1e3, GENTLE, strict=True)]  # fmt: skip
    wide = "\n".join([header, *rows, ""]).encode()
    plain = "\n".join([*(" ".join(f"{v:.6f}" for v in x.ravel()) for x in GENTLE), ""]).encode()
    table = {"delimiter": "space", "rate_hz": 50, "length_unit": "m", "points": {"count": POINTS}}

    def of(name: str) -> bytes:
        return (folder / name).read_bytes()

    return [
        Original("csv, own", ".csv", of("own.csv"), None, True, True, True),
        Original("csv, wide", ".csv", wide, None, False, False, True),
        Original("csv, Motive", ".csv", motive().encode(), None, False, True, True),
        Original("tsv, Luna", ".tsv", luna().encode(), None, False, False, True),
        Original("txt, mapped", ".txt", plain, table, False, False, True),
        Original("c3d", ".c3d", c3d(), None, False, True, False),
        Original("npz", ".npz", of("a.npz"), None, True, True, False),
        Original("nc, own", ".nc", of("own.nc"), None, True, True, False),
        Original("nc, foreign", ".nc", of("foreign.nc"), None, False, False, False),
        Original("mat, plain", ".mat", of("plain.mat"), None, False, False, False),
        Original("mat, packed", ".mat", of("packed.mat"), None, True, False, False),
        *(Original(name, f".{name[:3]}", text.encode(), TOLD.get(name, CAMERA), False, False, True)
          for name, text in tracker_texts().items()),
        *hdf5_originals(folder),
    ]


def damaged(original: Original, rng: np.random.Generator) -> tuple[bytes, str, int]:
    """Return a damaged copy, a description of the damage, and the position of the first changed byte."""
    kinds = KINDS if original.text else ("bits", "bytes", "cut", "lose", "double", "unit", "append", "zeros")
    kinds = (*kinds, *HDF5_KINDS) if original.name in HDF5 else kinds
    kind = str(rng.choice(kinds))
    data, what, at = _hostile(original, kind, rng) if kind in HDF5_KINDS else _broken(original, kind, rng)
    return (resealed(data) if original.name == "nc, resealed" else data), what, at


def resealed(data: bytes) -> bytes:
    """Return the file with a recomputed checksum, as an attacker could write it."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "a.nc"
        path.write_bytes(data)
        seal(path)
        return path.read_bytes()


def _hostile(original: Original, kind: str, rng: np.random.Generator) -> tuple[bytes, str, int]:
    """Return a well-formed HDF5 file that refers to other files, declares too much, or holds a pickle or an odd
    attribute.
    """
    if kind == "size":  # a count of rows or bytes, wherever one lies, becomes huge
        small = [at for at in range(0, len(original.data) - 8, 4)
                 if 0 < int.from_bytes(original.data[at : at + 8], "little") < 10_000]  # fmt: skip
        at = int(rng.choice(small))
        huge = int(rng.choice([2**20, 2**31, 2**32 + 1, 2**40, 2**62, -1])) % 2**64
        return original.data[:at] + huge.to_bytes(8, "little") + original.data[at + 8 :], kind, at
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "a.h5"
        path.write_bytes(original.data)
        what = kind
        if kind == "attack":
            attack = list(hdf5_files.ATTACKS)[int(rng.integers(len(hdf5_files.ATTACKS)))]
            attack(path, HDF5[original.name], Path(name) / "secret")
            what = f"attack, {attack.__name__}"
        else:
            _odd_attribute(path, kind, rng)
        return path.read_bytes(), what, 0


def _odd_attribute(path: Path, kind: str, rng: np.random.Generator) -> None:
    """Replace one attribute by a pickle that creates a file, or by a value of another type."""
    with h5py.File(path, "r+") as file:
        holders = [(file, "TITLE")]
        file.visititems(lambda _, item: holders.extend((item, key) for key in (*item.attrs, "TITLE")))
        item, key = holders[int(rng.integers(len(holders)))]
        values = [np.float64(np.nan), "x" * 5000, np.arange(7), h5py.Empty("S1"), np.bytes_(b"\x1b[2J\xff"), item.ref]
        is_pickle = kind == "pickle"
        value = hdf5_files.text_pickle(hdf5_files.Creates(MARKER)) if is_pickle else values[int(rng.integers(6))]
        item.attrs[key] = value


def _broken(original: Original, kind: str, rng: np.random.Generator) -> tuple[bytes, str, int]:
    """Return the bytes with some changed, lost or doubled."""
    data, size = original.data, len(original.data)
    at, length = int(rng.integers(0, size)), int(rng.choice([1, 1, 2, 3, 4, 7, 16, 100, 512]))
    if kind in ("bits", "bytes"):
        broken, places = bytearray(data), np.sort(rng.integers(0, size, rng.integers(1, 6)))
        for place in places:
            broken[place] = broken[place] ^ (1 << int(rng.integers(8))) if kind == "bits" else int(rng.integers(256))
        return bytes(broken), kind, int(places[0])
    made = {
        "cut": lambda: data[:at], "lose": lambda: data[:at] + data[at + length :],
        "double": lambda: data[: at + length] + data[at:], "append": lambda: data + data, "zeros": lambda: data[:at]
        + bytes(min(length, size - at)) + data[at + length :],
        "encoding": lambda: _encoded(data, rng),
    }  # fmt: skip
    if kind in made:
        return made[kind](), kind, 0 if kind == "encoding" else size if kind == "append" else at
    if kind == "unit":
        there = [pair for pair in UNITS if pair[0] in data]
        if not there:
            return data[:at], "cut", at
        old, new = there[int(rng.integers(len(there)))]
        return data.replace(old, new, 1), kind, data.index(old)
    lines = data.split(b"\n")
    if kind == "lines":
        i, j = rng.integers(0, len(lines), 2)
        lines[i], lines[j] = lines[j], lines[i]
        return b"\n".join(lines), kind, sum(len(line) + 1 for line in lines[: min(i, j)])
    return _cells(original, lines, kind, rng)


def _encoded(data: bytes, rng: np.random.Generator) -> bytes:
    codec = ("utf-16", "utf-8-sig", "latin-1", "utf-32", "cp037")[int(rng.integers(5))]
    return data.decode().encode(codec)


def _cells(original: Original, lines: list[bytes], kind: str, rng: np.random.Generator) -> tuple[bytes, str, int]:
    """Swap columns, or replace one number."""
    separator = {".csv": b",", ".tsv": b"\t", ".lvm": b"\t", ".txt": b" "}[original.suffix]
    row = int(rng.integers(0, len(lines) - 1))
    cells = lines[row].split(separator)
    i, j = rng.integers(0, len(cells), 2)
    if kind == "number":
        cells[i] = NUMBERS[int(rng.integers(len(NUMBERS)))]
    else:
        cells[i], cells[j] = cells[j], cells[i]
    lines[row] = separator.join(cells)
    return b"\n".join(lines), kind, sum(len(line) + 1 for line in lines[:row])


def can_show(original: Original, kind: str, at: int, data: bytes) -> bool:
    """Return whether the format contains information that reveals the change.

    A number that became another number in a format without a checksum shows nothing; a length does, where the format
    says how long it is, and so does the missing line end of a text that was cut inside a line.
    """
    if original.sealed:
        return original.name != "csv, own" or at > original.data.index(b"\n")  # its first line is metadata
    if original.text and kind == "cut":
        return original.framed or not data.endswith(b"\n")
    if kind in ("append", "encoding") or (kind in ("lose", "double", "cut") and not original.text):
        return original.framed
    return False


def outcome(original: Original, data: bytes, kind: str, at: int, whole: Whole, folder: Path) -> tuple[str, str]:
    """Read a damaged file; return right, refused, told, unseen, silent or crash, and the message."""
    result = _outcome(original, data, kind, at, whole, folder)
    if MARKER.exists():
        MARKER.unlink()
        return "crash", "a pickle was run"
    return result


def _outcome(original: Original, data: bytes, kind: str, at: int, whole: Whole, folder: Path) -> tuple[str, str]:
    path = folder / f"damaged{original.suffix}"
    path.write_bytes(data)
    try:
        ds = read(path, mapping=original.mapping)
        found = quality(ds).findings
        if kind.startswith("attack"):
            return "silent", f"{kind} was read"
    except InputError as error:
        return ("crash" if "\n" in str(error) or "Traceback" in str(error) else "refused"), str(error)
    except BaseException as error:
        return "crash", f"{type(error).__name__}: {error}"
    same = ds.drop_attrs(deep=False).equals(whole.recording.drop_attrs(deep=False))
    history, before = (str(d.attrs["history"]).split("\n")[:-1] for d in (ds, whole.recording))
    told = [line for line in (*history, *found) if line not in (*before, *whole.findings)]
    if same:
        return "right", ""
    if told:
        return "told", told[0]
    return ("silent" if can_show(original, kind, at, data) else "unseen"), kind
