"""netCDF keeps a recording bit by bit, and is written whole or not at all."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import xarray as xr
from command_line import invoke

from pliant.errors import InputError
from pliant.recording import make_recording, read, write
from pliant.recording.netcdf import read_groups, write_netcdf
from pliant.recording.rules import TEXTS


def test_what_is_written_comes_back(recording, tmp_path):
    path = write(recording, tmp_path / "a.nc")
    again = read(path)
    xr.testing.assert_equal(again, recording)
    assert again["position"].attrs == recording["position"].attrs
    assert again.attrs["nominal_pressure"] == 1e4
    assert again.attrs["history"] == "made for a test\nread a.nc as netcdf"
    assert len(again.attrs["source_sha256"]) == 64
    assert [p.name for p in tmp_path.iterdir()] == ["a.nc"]


def test_the_first_source_is_kept(recording, tmp_path):
    first = read(write(recording, tmp_path / "a.nc"))
    second = read(write(first, tmp_path / "b.nc"))
    assert second.attrs["source"] == "a.nc"


@pytest.mark.parametrize("compress", [False, True])
def test_single_precision_comes_back_as_double(recording, tmp_path, compress):
    write_netcdf(recording, tmp_path / "a.nc", float32=True, compress=compress)
    again = read(tmp_path / "a.nc")
    assert again["position"].dtype == np.float64
    xr.testing.assert_allclose(again, recording, rtol=1e-6)
    assert np.array_equal(again["time"], recording["time"])


@pytest.mark.parametrize("name", ["a.nc", "a.cdf"])
def test_a_classic_file_is_refused_with_the_way_out(tmp_path, name):
    path = tmp_path / name
    make_recording([0, 1, 2], np.ones((3, 2, 3))).to_netcdf(tmp_path / "classic.nc", engine="scipy")
    (tmp_path / "classic.nc").rename(path)
    for reads in (read, read_groups):
        with pytest.raises(InputError, match=rf"^{name} is a classic netCDF file .*`nccopy -k nc4 {name} NEW.nc`$"):
            reads(path)
    result = invoke("inspect", path)
    assert result.exit_code != 0
    assert "convert it to netCDF 4" in str(result.exception)


def test_a_failed_write_leaves_the_old_file(recording, tmp_path):
    path = write(recording, tmp_path / "a.nc")
    before = path.read_bytes()
    with pytest.raises(InputError, match="schema"):
        write(recording.drop_attrs(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.nc"]


def test_folders_that_are_not_there_and_unknown_endings_are_refused(recording, tmp_path):
    with pytest.raises(InputError, match="cannot write"):
        write(recording, tmp_path / "none" / "a.nc")
    with pytest.raises(InputError, match=r"a file name that ends in .nc or .csv"):
        write(recording, tmp_path / "a.mat")


def test_netcdf_of_others_is_refused_by_name(tmp_path):
    xr.Dataset({"temperature": ("x", [1.0])}).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="temperature"):
        read(tmp_path / "a.nc")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.99])
def test_a_cut_file_is_refused(recording, tmp_path, share):
    data = write(recording, tmp_path / "a.nc").read_bytes()
    (tmp_path / "b.nc").write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError):
        read(tmp_path / "b.nc")


def test_a_dense_shape_in_single_precision(tmp_path):
    frames = 5_000
    position = np.zeros((frames, 212, 3)) + np.arange(frames)[:, None, None]
    write_netcdf(make_recording(np.arange(frames) / 250, position), tmp_path / "a.nc", float32=True)
    ds = read(tmp_path / "a.nc")
    assert ds.sizes == {"time": frames, "station": 212, "axis": 3}
    np.testing.assert_array_equal(ds.position, position)


def test_text_in_an_encoding_that_there_is_not_is_refused(tmp_path):
    ds = make_recording([0, 1, 2], np.ones((3, 2, 3))).assign(note=("time", [b"a", b"b", b"c"]))
    ds.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with h5py.File(tmp_path / "a.nc", "r+") as file:
        file["note"].attrs["_Encoding"] = "utf.8"
    with pytest.raises(InputError, match=r"a\.nc cannot be read as netCDF; it may be damaged, "
                                         r"so copy it again: unknown encoding"):
        read(tmp_path / "a.nc")


@pytest.mark.parametrize(("holder", "name"), [
    *((None, name) for name in TEXTS), *(("time", name) for name in ("units", "long_name")), ("angle", "reference"),
])
def test_an_attribute_that_became_an_array_is_refused_in_one_sentence(tmp_path, holder, name):
    """Anybody can change a file and write the checksum that fits."""
    ds = make_recording([0, 1], np.ones((2, 1, 2)), frame="planar", angle=np.ones((2, 1)))
    (ds if holder is None else ds[holder]).attrs[name] = np.arange(7)
    ds.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    where = holder or "the recording"
    with pytest.raises(InputError, match=rf"^the attribute {name} of {where} must be a text, not array[^\n]*$"):
        read(tmp_path / "a.nc")
