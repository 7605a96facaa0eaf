"""What damage does to a file: it is refused or told, never read as other numbers in silence."""

from __future__ import annotations

import struct
import subprocess
import sys

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from pliant.errors import InputError
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording, read, write
from pliant.recording.apart import read_apart

TIME = np.arange(12) / 10
POSITION = np.random.default_rng(0).normal(size=(12, 2, 3))
WIDE = "t,p_kpa,x_a,y_a,z_a\n0.00,1,0.1,0.2,0.27944\n0.01,1,0.1,0.2,0.27951\n0.02,1,0.1,0.2,0.27955\n"
LUNA = (
    "Test name:\tbench\nGage Pitch (mm):\t100\nUnits:\tmicrostrain\n-----\nx-axis\t\t\t0.0\t0.1\n"
    "2023-09-06 12:51:28.888946\tmeasurement\tstrain\t1.0\t2.0\n"
    "2023-09-06 12:51:28.908946\tmeasurement\tstrain\t1.5\t-2.0\n"
)
MOTIVE = (
    "Format Version,1.23,Total Exported Frames,3,Export Frame Rate,100.0,Length Units,Meters\n\n"
    ",Type,Marker,Marker,Marker,Marker,Marker,Marker\n,Name,tip,tip,tip,tip,tip,tip\n,ID,1,1,1,2,2,2\n"
    ",,Position,Position,Position,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,X,Y,Z\n"
    "0,0.0,1,2,3,4,5,6\n1,0.01,1,2,3,4,5,6\n2,0.02,1,2,3,4,5,6\n"
)


def put(folder, content, name):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def c3d_bytes(frames=20, count=3):
    """A small C3D file with the facts that its header and its parameters both state."""

    def parameter(group, name, kind, dims, content):
        value = struct.pack("bB", kind, len(dims)) + bytes(dims) + content + b"\0"
        return struct.pack("bb", len(name), group) + name + struct.pack("<H", len(value) + 2) + value

    entries = b"".join([
        struct.pack("bb", 5, -1) + b"POINT" + struct.pack("<HB", 3, 0),
        parameter(1, b"USED", 2, [], struct.pack("<H", count)),
        parameter(1, b"FRAMES", 2, [], struct.pack("<H", frames)),
        parameter(1, b"DATA_START", 2, [], struct.pack("<H", 3)),
        parameter(1, b"RATE", 4, [], struct.pack("<f", 100)),
        parameter(1, b"SCALE", 4, [], struct.pack("<f", -0.1)),
        parameter(1, b"UNITS", -1, [2, 1], b"mm"),
    ])  # fmt: skip
    header = struct.pack("<BB5HfHHf", 2, 0x50, count, 0, 1, frames, 10, -0.1, 3, 0, 100)
    section = bytes([1, 0x50, 1, 84]) + entries
    points = np.random.default_rng(1).uniform(1, 300, (frames, count, 4)).astype("<f4")
    points[..., 3] = 1
    return header.ljust(512, b"\0") + section.ljust(512, b"\0") + points.tobytes() + bytes(-points.nbytes % 512)


def test_a_whole_c3d_file_is_read(tmp_path):
    ds = read(put(tmp_path, c3d_bytes(), "a.c3d"))
    assert ds.sizes["time"] == 20
    assert "contradict" not in ds.attrs["history"]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: d[:8] + struct.pack("<H", 19) + d[10:], "POINT:FRAMES is 20, but the header has 19"),
        (lambda d: d[:20] + struct.pack("<f", 50) + d[24:], "POINT:RATE is 100"),
        (lambda d: d[:12] + struct.pack("<f", -0.2) + d[16:], "POINT:SCALE"),
        (lambda d: d[:16] + struct.pack("<H", 2) + d[18:], "begin in block 2"),
        (lambda d: d + d, "follow the last frame"),
        (lambda d: d[:1500] + d[1501:], "lost or doubled"),
        (lambda d: d[:1500] + d[1499:], "lost or doubled"),
        (lambda d: d[:1100] + d[1107:1600] + d[1593:], "no whole residual"),
    ],
)
def test_a_c3d_file_that_contradicts_itself_is_refused(tmp_path, damage, message):
    path = put(tmp_path, damage(c3d_bytes()), "a.c3d")
    with pytest.raises(InputError, match=message):
        read(path)
    if "header has" in message:  # and read by its header where the user says so, with the sentence in the history
        assert message[:10] in read(path, mapping={"trust_header": True}).attrs["history"]


@pytest.mark.parametrize("length", range(1, 6))
def test_a_number_that_a_cut_left_is_left_out(tmp_path, length):
    """Without its line end a last `0.27955` may read 0.27: other digits than above, so the row goes."""
    ds = read(put(tmp_path, WIDE[: -1 - length], "a.csv"))
    assert ds.sizes["time"] == 2
    assert "has no line end" in ds.attrs["history"]


def test_a_last_line_without_an_end_is_told_where_it_cannot_be_judged(tmp_path):
    ds = read(put(tmp_path, WIDE[:-1], "a.csv"))
    assert ds.sizes["time"] == 3
    assert "may be truncated inside its last number" in ds.attrs["history"]
    assert "line end" not in read(put(tmp_path, WIDE, "b.csv")).attrs["history"]


def test_every_text_format_judges_its_end(tmp_path):
    table = put(tmp_path, "1 2 3.25\n1 2 3.50\n1 2 3", "a.txt")
    mapping = {"delimiter": "space", "rate_hz": 1, "length_unit": "m", "points": {"count": 1}}
    for path, given in (
        (put(tmp_path, LUNA[:-4], "a.tsv"), None), (put(tmp_path, LUNA[:-5], "b.tsv"), None), (table, mapping),
    ):  # fmt: skip
        assert "has no line end" in read(path, mapping=given).attrs["history"], path
    with pytest.raises(InputError, match=r"3 frames .*, but only 2 of 3 were read"):
        read(put(tmp_path, MOTIVE[:-3], "a.csv"))


def test_a_changed_table_of_ours_is_told(tmp_path):
    path = write(make_recording(TIME, POSITION), tmp_path / "a.csv")
    assert "checksum" not in read(path).attrs["history"]
    text = path.read_text()
    path.write_text(text[:-3] + "7" + text[-2:])
    assert "its checksum differs" in read(path).attrs["history"]


def test_two_markers_of_one_name_stay_two(tmp_path):
    ds = read(put(tmp_path, MOTIVE, "a.csv"))
    assert ds["station"].values.tolist() == ["tip", "tip #2"]
    assert ds["position"].values[0].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert "1 asset(s) have a repeated name" in ds.attrs["history"]


def test_motive_headers_are_held_to_their_rows(tmp_path):
    history = read(put(tmp_path, MOTIVE.replace("100.0", "120.0"), "a.csv")).attrs["history"]
    assert "states 120 Hz" in history
    lost = MOTIVE.replace("1,0.01", "7,0.01")
    assert "do not increase by one at 2 frame(s)" in read(put(tmp_path, lost, "b.csv")).attrs["history"]


def test_a_pitch_that_the_gauges_do_not_have_is_told(tmp_path):
    assert "0.065 m apart" in read(put(tmp_path, LUNA.replace(":\t100", ":\t65"), "a.tsv")).attrs["history"]


def test_infinite_quaternions_are_counted(tmp_path):
    path = put(tmp_path, "0,1,2,3,0,0,0,1\n1,1,2,3,0,0,0,1e999\n2,1,2,3,0,0,,1\n", "a.txt")
    ds = read(path, mapping={"time": 0, "length_unit": "m",
                             "stations": {"a": {"position": [1, 2, 3], "quaternion": [4, 5, 6, 7]}}})  # fmt: skip
    assert "quaternion that is incomplete or not of unit length; read as gaps: a 2" in ds.attrs["history"]
    assert np.isnan(ds["position"].values[1:]).all()


def test_arrays_and_columns_that_are_not_used_are_named(tmp_path):
    np.savez(tmp_path / "a.npz", t=TIME, xyz=POSITION, Pressure=TIME, t_p=TIME)
    assert "2 array(s) of a.npz were not used: Pressure, t_p" in read(tmp_path / "a.npz").attrs["history"]
    savemat(tmp_path / "a.mat", {"t": TIME, "xyz": POSITION, "Pressure": TIME, "note": "by hand"})
    history = read(tmp_path / "a.mat").attrs["history"]
    assert "Pressure" in history
    assert "note" in history
    table = put(tmp_path, "t,x,y,z,p\n0,1,2,3,9\n1,1,2,3,9\n", "a.txt")
    mapping = {"header": True, "time": "t", "length_unit": "m", "stations": {"a": {"position": ["x", "y", "z"]}}}
    assert "1 column(s) of a.txt are not in the mapping and were left out: p" in (
        read(table, mapping=mapping).attrs["history"]
    )


def test_a_pressure_that_says_its_unit_is_read(tmp_path):
    np.savez(tmp_path / "a.npz", t=TIME, xyz=POSITION, pressure_kpa=TIME)
    np.testing.assert_allclose(read(tmp_path / "a.npz")["pressure"], 1e3 * TIME)


def test_files_without_a_checksum_are_read_by_a_helper_and_are_equal(tmp_path, recording):
    path = write(recording, tmp_path / "a.nc")
    direct = read(path)
    path.write_bytes(path.read_bytes()[:-79])
    xr.testing.assert_identical(read(path).drop_attrs(deep=False), direct.drop_attrs(deep=False))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.95])
def test_one_bit_of_a_recording_of_ours_is_noticed(tmp_path, recording, share):
    path = write(recording, tmp_path / "a.nc")
    data = bytearray(path.read_bytes())
    data[int(share * len(data))] ^= 4
    path.write_bytes(data)
    with pytest.raises(InputError, match="its checksum is not the one"):
        read(path)


def test_an_npz_whose_index_hides_an_array_is_refused(tmp_path, recording):
    """A length in the index swallows the last entry: NumPy then reads the others without a word."""
    path = tmp_path / "a.npz"
    np.savez(path, time=recording["time"], position=recording["position"], pressure=np.arange(3.0))
    data = bytearray(path.read_bytes())
    last = data.rfind(b"PK\x01\x02")
    before, end = data.rfind(b"PK\x01\x02", 0, last), data.rfind(b"PK\x05\x06")
    data[before + 32 : before + 34] = (end - last).to_bytes(2, "little")
    path.write_bytes(data)
    assert np.load(path).files == ["time", "position"]
    with pytest.raises(InputError, match="its index lists 2 arrays, its end record states 3"):
        read(path)


@pytest.mark.parametrize("at", [-79, -70, -30, -1])
def test_a_checksum_that_was_damaged_itself_is_no_missing_one(tmp_path, recording, at):
    path = write(recording, tmp_path / "a.nc")
    data = bytearray(path.read_bytes())
    data[at] ^= 4
    path.write_bytes(data)
    with pytest.raises(InputError, match="its checksum is not the one"):
        read(path)


def test_a_file_that_another_program_changed_is_read(tmp_path, recording):
    path = write(recording, tmp_path / "a.nc")
    with h5py.File(path, "r+") as file:
        file["position"][0, 0, 0] = 3.0
    assert read(path)["position"].values[0, 0, 0] == 3.0


@pytest.mark.slow
def test_damaged_libraries_never_end_the_process(tmp_path):
    """MATLAB 5 and HDF5 hold lengths and addresses: a run of wrong ones ends or holds a reader."""
    savemat(tmp_path / "a.mat", {"time": TIME, "position": POSITION})
    make_recording(TIME, POSITION).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    rng = np.random.default_rng(4)
    for name in ("a.mat", "a.nc"):
        whole = (tmp_path / name).read_bytes()
        for _ in range(6):
            broken = bytearray(whole)
            for place in rng.integers(0, len(whole), 40):
                broken[place] = rng.integers(0, 256)
            path = put(tmp_path, bytes(broken), f"b{name}")
            try:
                read(path)
            except InputError as error:
                assert "\n" not in str(error)  # noqa: PT017


def test_what_does_not_come_back_is_ended(tmp_path, monkeypatch):
    """The helper's two ends, a signal and no end at all, are one sentence each."""
    path = put(tmp_path, b"x", "a.mat")
    monkeypatch.setattr("pliant.recording.apart.START", "import os; os.abort()")
    with pytest.raises(InputError, match="crashed while reading"):
        read_apart("mat5", path, ".mat")
    limited = "import sys; sys.path.append(sys.argv[1])\nfrom pliant.recording.apart_worker import limit\n"
    monkeypatch.setattr("pliant.recording.apart.SECONDS", 1)
    monkeypatch.setattr("pliant.recording.apart.WAIT_FACTOR", 20)
    monkeypatch.setattr("pliant.recording.apart.START", limited + "limit(1, 2**31)\nwhile True: pass")
    with pytest.raises(InputError, match="did not finish within 1 s"):
        read_apart("mat5", path, ".mat")


@pytest.mark.parametrize("value", ["-1e308", "1e300", "1e7"])
def test_numbers_that_nobody_measures_are_refused(tmp_path, value):
    path = put(tmp_path, WIDE.replace("0.27951", value), "a.csv")
    with pytest.raises(InputError, match="beyond 1e\\+06 m"):
        read(path)


def test_quality_takes_whatever_is_accepted(tmp_path):
    for value in ("-1e6", "1e-320", "1e5", ""):
        quality(read(put(tmp_path, WIDE.replace("0.27951", value), "a.csv")))


def test_inspect_tells_what_reading_did(tmp_path):
    path = put(tmp_path, WIDE[:-3], "a.csv")
    done = subprocess.run([sys.executable, "-m", "pliant", "inspect", path], capture_output=True, text=True, check=True)
    assert "has no line end" in done.stdout
