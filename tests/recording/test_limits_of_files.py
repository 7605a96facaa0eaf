"""What a file announces is bounded by its own size, and every reader takes a time in proportion to it."""

from __future__ import annotations

import io
import json
import tracemalloc
import zipfile

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import make_recording, read

ROWS = "0,1,2,3,4\n0.1,1,2,3,4\n"
TABLE = "t,x_0,y_0,x_1,y_1\n" + ROWS
MANY = 60_000  # columns: a minute and more for a reader that compares each with each


def put(folder, content, name="a.csv"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def npy(shape):
    """Bytes of a .npy file of float64 whose header announces `shape` and that ends there."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return header.getvalue()


def npz(folder, **entries):
    """An .npz of raw entries, compressed; their checksums are right."""
    with zipfile.ZipFile(folder / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(f"{name}.npy", content)
    return folder / "a.npz"


def test_a_station_number_does_not_announce_stations(tmp_path):
    path = put(tmp_path, TABLE.replace("_1", "_99999999"))
    missing = r"x_99999999 follows x_0, but column x_1 is missing: add it, or number the stations without gaps$"
    with pytest.raises(InputError, match=missing):
        read(path)


@pytest.mark.parametrize("name", ["9" * 5000, "²", "٣"])  # digits that int() does not take, or of other scripts
def test_what_is_no_number_is_a_name(tmp_path, name):
    assert read(put(tmp_path, TABLE.replace("_1", f"_{name}")))["station"].values.tolist() == ["s0", f"s{name}"]


def test_repeated_columns_are_refused_in_one_sentence(tmp_path):
    path = put(tmp_path, "t," + ",".join(f"a{k // 2}" for k in range(MANY)) + "\n1\n")
    with pytest.raises(InputError, match=r"repeated column names: a0, a1, a10, a100, a1000 and 29995 more: "
                                         r"rename them, or give a mapping that names the columns by index$"):
        read(path)


def test_many_stations_are_checked_in_proportion():
    names = [f"s{k}" for k in range(MANY)]
    ds = make_recording([0.0], np.zeros((1, MANY, 3)), station=names)
    assert ds.sizes["station"] == MANY
    with pytest.raises(InputError, match=r"must differ, but these repeat: s7; give each"):
        make_recording([0.0], np.zeros((1, MANY, 3)), station=[*names[:-1], "s7"])


def test_assets_of_one_name_are_numbered_in_proportion(tmp_path):
    columns = 3 * (MANY // 3)
    text = "\n".join([
        "Format Version,1.23,Length Units,Meters", "", ",Type" + ",Marker" * columns, ",Name" + ",tip" * columns,
        ",ID" + "".join(f",{k // 3}" for k in range(columns)), "," + ",Position" * columns,
        "Frame,Time (Seconds)" + ",X,Y,Z" * (columns // 3), "0,0.0", ""])  # fmt: skip
    with pytest.raises(InputError, match=r"line 8 .* has 2 cell"):  # behind the header, which is what takes the time
        read(put(tmp_path, text))


def test_columns_are_looked_up_in_proportion(tmp_path):
    text = "t_s," + ",".join(f"a{k}_angle_deg" for k in range(MANY)) + "\n0\n"
    with pytest.raises(InputError, match=r"line 2 .* has 1 cell"):
        read(put(tmp_path, text))
    names = [f"a{k}" for k in range(MANY // 40)]
    path = put(tmp_path, ",".join(["t", *names]) + "\n" + ",".join(["0"] * (len(names) + 1)) + "\n")
    angles = dict(zip(names, names, strict=True))
    ds = read(path, mapping={"header": True, "time": "t", "angles": angles, "angle_unit": "deg"})
    assert ds.sizes["station"] == len(names)


def test_an_npz_takes_no_more_memory_than_its_size_allows(tmp_path):
    path = npz(tmp_path, time=npy((3,)) + bytes(24), other=npy((12_000_000,)) + bytes(96_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"has \d+ bytes, but states 96000280 bytes of content, more than "
                                             r"the \d+ accepted"):  # fmt: skip
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("shape", [(10**12,), (10**6, 10**6, 10**6), (3, 10**9)])
def test_an_array_of_an_npz_that_announces_more_than_it_has_is_refused(tmp_path, shape):
    with pytest.raises(InputError, match=r"damaged: its array 'position' states the shape .*, "
                                         r"but has \d+ bytes; copy it again$"):
        read(npz(tmp_path, time=npy((3,)) + bytes(24), position=npy(shape) + bytes(100)))


def test_every_bit_of_an_npz_header_may_flip(tmp_path):
    whole = npy((3, 2, 3)) + bytes(144)
    read_again = 0
    for at in range(10, 80):
        for bit in (0, 3, 6):
            flipped = bytearray(whole)
            flipped[at] ^= 1 << bit
            path = npz(tmp_path, time=npy((3,)) + np.arange(3.0).tobytes(), position=bytes(flipped))
            try:
                read_again += read(path)["position"].shape[2] == 3
            except InputError as error:
                assert "\n" not in str(error)  # noqa: PT017  either way is right
    assert read_again > 0  # spaces of the padding


@pytest.mark.parametrize(("entry", "message"), [
    ({"nominal_pressure": "high"}, "nominal_pressure: Input should be a valid number"),
    ({"nominal_pressure": 10**400}, "nominal_pressure: Input should be a valid number"),
    ({"nominal_pressure": [1]}, "nominal_pressure"), ({"station": 5}, "station: Input should be a valid list"),
    ({"station": "ab"}, "station: Input should be a valid list"), ({"arc_length": "x"}, "arc_length"),
    ({"arc_length": [0, None]}, "arc_length.1"), ({"arc_length": {"a": 1}}, "arc_length"),
    ({"frame": [1]}, "frame"), ({"source": {"a": 1}}, "source"), ({"history": 1.5}, None), ({"rows": "two"}, "rows"),
    ({"angle_reference": [1]}, "angle_reference"), ({"length_unit": 3}, "unknown unit of length '3'"),
    ({"parameters": None, "arc_length": None}, None),
])  # fmt: skip
def test_metadata_of_another_kind_are_refused_by_name(tmp_path, entry, message):
    path = put(tmp_path, f"# {json.dumps(entry)}\n{TABLE}")
    if message is None:
        assert read(path).sizes["station"] == 2
        return
    with pytest.raises(InputError, match=message) as raised:
        read(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("number", ["²", "9" * 5000, "-1", "1e3"])
def test_a_count_of_frames_that_is_no_number_is_no_count(tmp_path, number):
    text = "\n".join([
        f"Format Version,1.23,Total Exported Frames,{number},Export Frame Rate,10.0,Length Units,Meters", "",
        ",Type,Marker,Marker,Marker", ",Name,tip,tip,tip", ",ID,1,1,1", ",,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z", "0,0.0,1,2,3", "1,0.1,1,2,3", ""])  # fmt: skip
    assert read(put(tmp_path, text)).sizes["time"] == 2
