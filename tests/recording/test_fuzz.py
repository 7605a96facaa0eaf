"""Damaged files of every format: the right answer or one InputError, never another exception."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from pliant.errors import InputError
from pliant.recording import check_recording, make_recording, read
from pliant.recording.netcdf import write_netcdf
from pliant.recording.wide_csv import write_wide_csv

TIME = np.arange(12) / 10
POSITION = np.random.default_rng(0).normal(size=(12, 2, 3))
LUNA = (
    "Test name:\tbench\nUnits:\tmicrostrain\n-----\nx-axis\t\t\t0.0\t0.1\n"
    "2023-09-06 12:51:28.888946\tmeasurement\tstrain\t1.0\t2.0\n"
    "2023-09-06 12:51:28.908946\tmeasurement\tstrain\t1.5\t-2.0\n"
)
MOTIVE = (
    "Format Version,1.23,Length Units,Meters\n\n,Type,Marker,Marker,Marker\n,Name,tip,tip,tip\n,ID,1,1,1\n"
    ",,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n0,0.0,1,2,3\n1,0.01,1,2,3\n"
)
ANGLES = "time;angle_deg;p_kpa;set_point\r" + "".join(f"0.{k:02};{k / 2};{k}.5;7\r" for k in range(12))
TABLE = "\n".join(" ".join(f"{v:.6f}" for v in row) for row in POSITION.reshape(12, 6))


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """One whole file of each format, as (bytes, ending, mapping)."""
    folder = tmp_path_factory.mktemp("originals")
    ds = make_recording(TIME, POSITION, pressure=np.zeros(12))
    write_netcdf(ds, folder / "a.nc")
    write_wide_csv(ds, folder / "a.csv")
    np.savez(folder / "a.npz", time=TIME, position=POSITION)
    savemat(folder / "a.mat", {"time": TIME, "position": POSITION})
    (folder / "a.tsv").write_text(LUNA)
    (folder / "b.csv").write_text(MOTIVE)
    (folder / "a.txt").write_text(TABLE)
    (folder / "a.log").write_text(ANGLES.replace(".", ","), newline="")
    table = {"delimiter": "space", "rate_hz": 10, "length_unit": "m", "points": {"count": 2}}
    return [(p.read_bytes(), p.suffix, table if p.suffix == ".txt" else None) for p in sorted(folder.iterdir())]


def attempt(folder, data, ending, mapping):
    path = folder / f"broken{ending}"
    path.write_bytes(data)
    said = "no error"
    try:
        check_recording(read(path, mapping=mapping))
    except InputError as error:
        said = str(error)
    assert said
    assert "\n" not in said


SETTINGS = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@SETTINGS
@given(data=st.data())
def test_bytes_changed_at_random(originals, tmp_path, data):
    """Not for HDF5 and plain MAT: their libraries have no checksums there and may not return."""
    guarded = [o for o in originals if o[1] not in (".nc", ".mat")]
    original, ending, mapping = data.draw(st.sampled_from(guarded))
    broken = bytearray(original)
    for place in data.draw(st.lists(st.integers(0, len(broken) - 1), min_size=1, max_size=8)):
        broken[place] = data.draw(st.integers(0, 255))
    attempt(tmp_path, bytes(broken), ending, mapping)


@pytest.mark.slow
@SETTINGS
@given(data=st.data())
def test_files_cut_anywhere(originals, tmp_path, data):
    original, ending, mapping = data.draw(st.sampled_from(originals))
    attempt(tmp_path, original[: data.draw(st.integers(0, len(original)))], ending, mapping)


@SETTINGS
@given(data=st.data())
def test_lines_shuffled_repeated_or_lost(originals, tmp_path, data):
    texts = [o for o in originals if o[1] in (".csv", ".tsv", ".txt")]
    original, ending, mapping = data.draw(st.sampled_from(texts))
    lines = original.split(b"\n")
    order = data.draw(st.lists(st.integers(0, len(lines) - 1), max_size=len(lines) + 3))
    attempt(tmp_path, b"\n".join(lines[i] for i in order), ending, mapping)


@SETTINGS
@given(data=st.data())
def test_cells_replaced_by_anything(originals, tmp_path, data):
    texts = [o for o in originals if o[1] in (".csv", ".tsv", ".txt")]
    original, ending, mapping = data.draw(st.sampled_from(texts))
    separator = {".csv": ",", ".tsv": "\t", ".txt": " "}[ending]
    cells = original.decode().split(separator)
    cells[data.draw(st.integers(0, len(cells) - 1))] = data.draw(
        st.sampled_from(["", "nan", "inf", "-", "1e999", "0x10", "1_000", "１", "1,5", "\x00", '"', "NaN ", "é"])
    )
    attempt(tmp_path, separator.join(cells).encode(), ending, mapping)


def test_numbers_mean_what_python_means_by_them(tmp_path):
    """Digit groups, hexadecimal and other scripts are refused, not guessed."""
    for cell in ("1_000", "0x10", "１"):
        (tmp_path / "a.csv").write_text(f"t,x_a,y_a,z_a\n0,0,0,0\n1,{cell},0,0\n", encoding="utf-8")
        with pytest.raises(InputError, match="not a number"):
            read(tmp_path / "a.csv")


def test_a_huge_header_is_refused_at_once(tmp_path):
    (tmp_path / "a.csv").write_text("t," + ",".join(f"x_{i}" for i in range(500_000)) + "\n0\n")
    with pytest.raises(InputError):
        read(tmp_path / "a.csv")
