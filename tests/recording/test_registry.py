"""The right reader is found, by ending and content; xarray opens the same files."""

from __future__ import annotations

import subprocess
import sys

import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.recording import read, readers, write
from pliant.recording.backend import RecordingBackend
from pliant.recording.registry import BUILT_IN
from pliant.testbed.bundle import FOLDER


def test_xarray_opens_recordings(recording, tmp_path):
    path = write(recording, tmp_path / "a.csv")
    ds = xr.open_dataset(path, engine=RecordingBackend)
    xr.testing.assert_equal(ds.load(), recording)
    assert "pressure" not in xr.open_dataset(path, engine=RecordingBackend, drop_variables="pressure")


def test_every_built_in_reader_loads():
    assert {name: reader.name for name, reader in readers().items() if name in BUILT_IN} == {
        name: name for name in BUILT_IN
    }


def test_a_reader_of_another_ending_is_not_loaded():
    code = (
        "import sys; from pliant.recording import read\n"
        f"print(read({str(FOLDER / 'pulse_119.nc')!r}).sizes['station'])\n"
        "print([m for m in ('camera', 'c3d', 'tables') if f'pliant.recording.{m}' in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["296", "[]"]


def test_files_that_are_absent_or_unknown_are_named(tmp_path):
    with pytest.raises(InputError, match="absent"):
        read(tmp_path / "a.csv")
    with pytest.raises(InputError, match="a folder"):
        read(tmp_path)
    (tmp_path / "a.xyz").write_text("1 2 3")
    with pytest.raises(InputError, match="no known format"):
        read(tmp_path / "a.xyz")
    with pytest.raises(InputError, match=r"use one of .*netcdf"):
        read(tmp_path / "a.xyz", format="word")
    (tmp_path / "b.csv").write_bytes(b"")
    with pytest.raises(InputError, match="empty"):
        read(tmp_path / "b.csv")


@pytest.mark.parametrize("ending", [".nc", ".c3d", ".npz", ".mat", ".tsv", ".csv", ".txt", ".h5"])
@pytest.mark.parametrize("content", [b"\x00" * 3000, b"\xff\xfe\x00a" * 900, b"no numbers here\n", b"1"])
def test_any_bytes_under_any_ending_end_in_one_sentence(tmp_path, ending, content):
    (tmp_path / f"a{ending}").write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(tmp_path / f"a{ending}")
    assert "\n" not in str(caught.value)
