"""C3D: stations in metres, drop-outs as NaN, damaged files refused in one sentence."""

from __future__ import annotations

import subprocess
import sys

import ezc3d
import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.c3d_sections import DEC, INTEL, MIPS, _floats, decode_c3d


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
for _ in range(300):
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


@pytest.mark.parametrize("processor", ["intel", "dec", "mips"])
def test_numbers_of_each_processor(processor):
    """Bytes of 1.0 and -0.15625 as the three processors write them."""
    written = {"intel": "0000803f000020be", "dec": "8040000020bf0000", "mips": "3f800000be200000"}
    codes = {"intel": INTEL, "dec": DEC, "mips": MIPS}
    assert _floats(bytes.fromhex(written[processor]), codes[processor]).tolist() == [1.0, -0.15625]


def test_the_decoder_agrees_with_an_independent_one(c3d_file):
    path, _ = c3d_file(analog=("p1", "p2"))
    other, ours = ezc3d.c3d(str(path)), decode_c3d(path.read_bytes(), path.name)
    np.testing.assert_array_equal(ours.points, np.moveaxis(other["data"]["points"][:3], 0, -1).swapaxes(0, 1))
    np.testing.assert_array_equal(ours.analog, other["data"]["analogs"][0].T)
    assert ours.analog_rate == 200
