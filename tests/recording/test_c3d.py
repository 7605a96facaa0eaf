"""C3D: stations in metres, drop-outs as NaN, damaged files refused in one sentence."""

from __future__ import annotations

import struct
import subprocess
import sys

import ezc3d
import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.c3d import DEC, INTEL, MIPS, one_float


@pytest.fixture
def c3d_file(tmp_path, rng):
    """Ten frames of three points in millimetres; one point is lost in frame 4."""

    def make(unit="mm", labels=("base", "mid", "tip"), analog=None):
        c3d = ezc3d.c3d()
        points = rng.uniform(1, 300, (4, len(labels), 10)).astype(np.float32)
        points[3] = 1
        points[:3, 1, 4] = np.nan
        c3d["parameters"]["POINT"]["RATE"]["value"] = [100.0]
        c3d["parameters"]["POINT"]["LABELS"]["value"] = list(labels)
        c3d["parameters"]["POINT"]["UNITS"]["value"] = [] if unit is None else [unit]
        c3d["data"]["points"] = points
        if analog:
            c3d["parameters"]["ANALOG"]["RATE"]["value"] = [200.0]
            c3d["parameters"]["ANALOG"]["LABELS"]["value"] = list(analog)
            c3d["data"]["analogs"] = np.arange(20.0)[None, None] * np.ones((1, len(analog), 1))
        path = tmp_path / "a.c3d"
        c3d.write(str(path))
        return path, np.moveaxis(points[:3], 0, -1).swapaxes(0, 1)

    return make


def test_points_become_stations_in_metres(c3d_file):
    path, points = c3d_file()
    ds = read(path)
    assert ds["station"].values.tolist() == ["base", "mid", "tip"]
    assert ds["time"].values[-1] == pytest.approx(0.09)
    np.testing.assert_allclose(ds["position"], points / 1000, rtol=1e-6)
    assert "1 of 30 points are marked invalid" in ds.attrs["history"]


def test_the_unit_must_be_known(c3d_file):
    path, points = c3d_file(unit=None)
    with pytest.raises(InputError, match="length_unit"):
        read(path)
    np.testing.assert_allclose(read(path, mapping={"length_unit": "cm"})["position"], points / 100, rtol=1e-6)


def test_names_that_repeat_or_are_missing_get_a_number(c3d_file):
    ds = read(c3d_file(labels=("tip", "tip", ""))[0])
    assert len(set(ds["station"].values)) == 3
    assert "2 point(s) had no name" in ds.attrs["history"]


def test_analog_channels_are_pressure_when_the_mapping_says_so(c3d_file):
    path, _ = c3d_file(analog=("p1", "p2"))
    ds = read(path, mapping={"pressure": {"channels": ["p2"], "unit": "kPa"}})
    assert ds["pressure"].values[2] == pytest.approx(2000)
    assert ds["pressure_time"].values[2] == pytest.approx(0.01)
    with pytest.raises(InputError, match="available: p1, p2"):
        read(path, mapping={"pressure": {"channels": ["p3"], "unit": "kPa"}})
    with pytest.raises(InputError, match="unknown key 'colour'"):
        read(path, mapping={"colour": 1})


def test_a_cut_file_is_refused_at_every_length(c3d_file):
    data = c3d_file()[0].read_bytes()
    path = c3d_file()[0].with_name("cut.c3d")
    end = len(data.rstrip(b"\0"))  # the last block is filled up with zeros
    for length in [*range(0, end - 1, max(1, end // 60)), end - 2]:
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            read(path)


FLIP = """
import sys, numpy as np
from pathlib import Path
from pliant.errors import InputError
from pliant.recording import read
data = Path(sys.argv[1]).read_bytes()
rng = np.random.default_rng(1)
path = Path(sys.argv[1]).with_name("flipped.c3d")
for _ in range(60):
    broken = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 6)):
        broken[place] = rng.integers(0, 256)
    path.write_bytes(broken)
    try:
        read(path)
    except InputError:
        pass
print("survived")
"""


@pytest.mark.slow
def test_damaged_bytes_never_end_the_process(c3d_file):
    path, _ = c3d_file(analog=("p1",))
    command = [sys.executable, "-c", FLIP, str(path)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "survived", done.stderr[-2000:]


def test_other_files_are_refused(tmp_path):
    for content in (b"text", b"\x02P" + bytes(2000), bytes(2000)):
        (tmp_path / "a.c3d").write_bytes(content)
        with pytest.raises(InputError):
            read(tmp_path / "a.c3d")


@pytest.mark.parametrize("processor", ["intel", "dec"])
def test_numbers_of_each_processor(processor):
    """Bytes of 1.0 and -0.15625 as the two processors write them."""
    written = {"intel": "0000803f000020be", "dec": "8040000020bf0000"}
    codes = {"intel": INTEL, "dec": DEC}
    content = bytes.fromhex(written[processor])
    assert [one_float(content[k : k + 4], codes[processor]) for k in (0, 4)] == [1.0, -0.15625]


def bytes_of(processor=INTEL, scale=-0.1, frames=20, count=3, residual=1.0, analog=0, tail=b""):
    """A C3D file as the user guide has it: its bytes, and the points (T, N, 3) [mm] and analog (T, A) that it holds."""
    def number(value):
        if processor != DEC:
            return struct.pack("<f", value)
        content = struct.pack("<f", 4 * value)
        return content[2:] + content[:2]

    def entry(group, name, kind, dims, content):
        value = struct.pack("bB", kind, len(dims)) + bytes(dims) + content + b"\0"
        return struct.pack("bb", len(name), group) + name + struct.pack("<H", len(value) + 2) + value

    def word(value):
        return struct.pack("<h", value)

    groups = b"".join(
        struct.pack("bb", len(name), -k) + name + struct.pack("<H", 3) + b"\0"
        for k, name in ((1, b"POINT"), (2, b"ANALOG"))
    )
    entries = groups + b"".join([
        entry(1, b"USED", 2, [], word(count)), entry(1, b"FRAMES", 2, [], word(frames)),
        entry(1, b"DATA_START", 2, [], word(3)), entry(1, b"RATE", 4, [], number(100.0)),
        entry(1, b"SCALE", 4, [], number(scale)), entry(1, b"UNITS", -1, [2, 1], b"mm"),
        entry(2, b"USED", 2, [], word(analog)), entry(2, b"RATE", 4, [], number(100.0)),
        entry(2, b"GEN_SCALE", 4, [], number(0.5)), entry(2, b"SCALE", 4, [analog], number(2.0) * analog),
        entry(2, b"OFFSET", 2, [analog], word(3) * analog), entry(2, b"LABELS", -1, [2, analog], b"p1p2"[: 2 * analog]),
    ])  # fmt: skip
    header = struct.pack("<5H", count, analog, 1, frames, 10) + number(scale)
    header = bytes([2, 0x50]) + header + struct.pack("<2H", 3, 1 if analog else 0) + number(100.0)
    raw = np.random.default_rng(1).integers(-3000, 3000, (frames, 4 * count + analog)).astype(float)
    raw[:, 3 : 4 * count : 4] = residual
    section = (bytes([1, 0x50, 1, processor]) + entries).ljust(512, b"\0")
    if scale < 0:
        raw[:, : 4 * count] *= np.where(np.arange(4 * count) % 4 == 3, 1.0, 0.125)
        content = b"".join(map(number, raw.ravel()))
    else:
        content = raw.astype("<i2").tobytes()
    points = raw[:, : 4 * count].reshape(frames, count, 4)[..., :3] * (1.0 if scale < 0 else scale)
    whole = header.ljust(512, b"\0") + section + content
    return whole + bytes(-len(whole) % 512) + tail, points, (raw[:, 4 * count :] - 3) * 2.0 * 0.5


def put(folder, content):
    (folder / "a.c3d").write_bytes(content)
    return folder / "a.c3d"


@pytest.mark.parametrize("processor", [INTEL, DEC])
@pytest.mark.parametrize("scale", [-0.1, 0.125])
def test_points_and_analog_of_each_processor_as_floats_and_integers(tmp_path, processor, scale):
    content, points, analog = bytes_of(processor, scale, analog=2)
    ds = read(put(tmp_path, content), mapping={"pressure": {"channels": ["p1", "p2"], "unit": "kPa"}})
    np.testing.assert_allclose(ds["position"], points / 1e3, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ds["pressure"], analog * 1e3, rtol=1e-12)


def test_what_ezc3d_does_not_read_says_what_to_do(tmp_path):
    data = bytearray(bytes_of()[0])
    data[512 + 3] = MIPS
    with pytest.raises(InputError, match="MIPS processors, which ezc3d does not read: export it again"):
        read(put(tmp_path, data))


@pytest.mark.parametrize("blocks", [1, 3])
def test_blocks_of_zeros_behind_the_last_frame_are_read(tmp_path, blocks):
    """Qualisys ends a file with a block of zeros."""
    content, points, _ = bytes_of(tail=bytes(512 * blocks))
    ds = read(put(tmp_path, content))
    np.testing.assert_allclose(ds["position"], points / 1e3, rtol=0, atol=1e-12)
    assert "follow" not in ds.attrs["history"]
    with pytest.raises(InputError, match="bytes follow the last frame that the header states"):
        read(put(tmp_path, content[:-600] + b"x" + content[-599:] if blocks > 1 else content + b"x" * 512))


def test_residuals_that_are_no_whole_numbers_are_read(tmp_path):
    """Some systems write the residual itself, in the file's unit, where the guide packs it with a mask of cameras."""
    ds = read(put(tmp_path, bytes_of(residual=0.4375)[0]))
    assert "residual" not in ds.attrs["history"]
    data = bytearray(bytes_of(residual=0.4375)[0])
    data[1024 + 28 : 1024 + 32] = struct.pack("<f", 7e8)  # of the second point
    with pytest.raises(InputError, match="1 of 60 points have no whole residual"):
        read(put(tmp_path, data))


def test_rubbish_in_the_rest_of_the_last_block_is_told(tmp_path):
    content = bytes_of()[0]
    ds = read(put(tmp_path, content[:-8] + b"rubbish!"))
    assert "the block of the last frame is not filled up with zeros" in ds.attrs["history"]


def test_a_point_marked_invalid_is_a_gap(tmp_path):
    data = bytearray(bytes_of()[0])
    data[1024 + 12 : 1024 + 16] = struct.pack("<f", -1.0)
    position = read(put(tmp_path, data))["position"].values
    assert np.isnan(position[0, 0]).all()
    assert np.isfinite(position).sum() == position.size - 3


def test_the_library_is_loaded_in_the_helper_process_alone(c3d_file):
    code = (
        "import sys; from pliant.recording import read\n"
        f"read({str(c3d_file()[0])!r})\nprint('ezc3d' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "False"
