"""Hostile HDF5 of every format: refused in one sentence; nothing outside the file is opened, nothing large is taken."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import h5py
import hdf5_files as files
import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.files import seal
from pliant.recording import make_recording, read, write
from pliant.recording.apart import SOURCES, read_apart
from pliant.recording.apart_worker import WORKING, content_bound
from pliant.recording.netcdf import read_groups
from pliant.testbed.truth import read_truth
from pliant.validation.store import load_outcome

CAMERA = {"camera": {"rate_hz": 60.0, "pixels_per_mm": 4.0}}
PIXELS = np.random.default_rng(3).uniform(100, 900, (20, 3, 2))
TIME = np.arange(20) / 10
POSITION = np.random.default_rng(4).normal(size=(20, 3, 3))


def sleap(folder):
    return files.write_sleap(folder / "a.h5", PIXELS), "tracks", CAMERA


def deeplabcut(folder):
    path = files.write_fixed(folder / "a.h5", files.columns_of(), files.values_of(PIXELS))
    return path, f"{files.KEY}/block0_values", CAMERA


def mat73(folder):
    return files.write_mat73(folder / "a.mat", {"time": TIME[None], "position": POSITION}), "position", None


def foreign(folder):
    make_recording(TIME, POSITION).to_netcdf(folder / "a.nc", engine="h5netcdf")
    return folder / "a.nc", "position", None


def sealed(folder):
    return write(make_recording(TIME, POSITION), folder / "a.nc"), "position", None


FORMATS = (sleap, deeplabcut, mat73, foreign, sealed)


@pytest.mark.parametrize("make", FORMATS)
def test_a_whole_file_is_read(tmp_path, make):
    path, _, mapping = make(tmp_path)
    assert read(path, mapping=mapping).sizes == {"time": 20, "station": 3, "axis": 3}


def attacked(folder, make, attack):
    """A hostile file and its mapping; one with a checksum gets a new one, as anybody can give it."""
    path, name, mapping = make(folder)
    if make is sealed:
        path.write_bytes(path.read_bytes()[:-79])
    attack(path, name, folder / "secret")
    if make is sealed:
        seal(path)
    return path, mapping


def most_memory():
    """kB that this process or any helper so far held at once; a helper begins as an image of its parent."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


@pytest.mark.parametrize(("make", "attack"), [
    *((sleap, attack) for attack in files.ATTACKS),
    *((make, files.external_storage) for make in FORMATS[1:]),
    *(pytest.param(make, attack, marks=pytest.mark.slow) for make in FORMATS[1:] for attack in files.ATTACKS
      if attack is not files.external_storage),
])  # fmt: skip
def test_what_leads_out_or_announces_too_much_is_refused(tmp_path, make, attack):
    path, mapping = attacked(tmp_path, make, attack)
    spare = bytearray(b"1") * 2**25  # 32 MB held once: any reading takes some, the attacks would take 400 MB and more
    before = most_memory()
    del spare
    with pytest.raises(InputError, match=files.ATTACKS[attack]) as caught:
        read(path, mapping=mapping)
    assert "\n" not in str(caught.value)
    assert most_memory() <= max(before, 400_000)


@pytest.mark.parametrize("make", [
    sleap, deeplabcut, foreign, *(pytest.param(make, marks=pytest.mark.slow) for make in (mat73, sealed)),
])
def test_cut_files_are_one_sentence(tmp_path, make):
    path, _, mapping = make(tmp_path)
    data = path.read_bytes()
    for fraction in (0.3, 0.98):
        path.write_bytes(data[: int(fraction * len(data))])
        with pytest.raises(InputError) as caught:
            read(path, mapping=mapping)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("make", [sleap, deeplabcut])
def test_changed_bytes_end_in_a_recording_or_one_sentence(tmp_path, make):
    path, _, mapping = make(tmp_path)
    data, rng = path.read_bytes(), np.random.default_rng(6)
    for _ in range(2):
        broken = bytearray(data)
        for place in rng.integers(0, len(data), 30):
            broken[place] = rng.integers(0, 256)
        path.write_bytes(broken)
        try:
            read(path, mapping=mapping)
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017


def test_texts_that_share_one_heap_do_not_fill_the_memory(tmp_path):
    """Each of 200,000 names leads to the same long text: some kilobytes of file, 20 GB of names."""
    path, _, mapping = sleap(tmp_path)
    with h5py.File(path, "r+") as file:
        del file["node_names"]
        names = file.create_dataset("node_names", (200_000,), h5py.string_dtype())
        names[0] = "x" * 100_000
        names[1] = "y"
    data = path.read_bytes()
    at = data.index(b"x" * 1000)
    assert at > 0
    with h5py.File(path) as file:
        start, stored = file["node_names"].id.get_offset(), file["node_names"].id.get_storage_size()
    broken = bytearray(data)
    broken[start : start + stored] = data[start : start + 16] * (stored // 16)
    path.write_bytes(broken)
    before = most_memory()
    with pytest.raises(InputError):
        read(path, mapping=mapping)
    most = WORKING + 2 * content_bound(path.stat().st_size)
    assert most_memory() * 1024 <= max(most + 2**28, 1024 * before)


def test_the_helper_is_the_only_one_that_opens_hdf5(tmp_path):
    """Neither h5py nor xarray's own reader opens a file in the reading process, not even one with a checksum."""
    path, _, _ = sealed(tmp_path)
    code = (
        "import sys, h5py\n"
        "def refuse(*_, **__): raise SystemExit('opened here')\n"
        "h5py.File.__init__ = refuse\n"
        f"from pliant.recording import read\nprint(read({str(path)!r}).sizes['time'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "20"


OPENS = re.compile(r"\b(xr\.(open|load)_\w+|(h5py|h5netcdf)\.File|netcdf_file|read_hdf)\(")


def test_only_the_helper_opens_hdf5_in_the_whole_package():
    """Files that pliant wrote itself come from anybody, too: results of a run, truths of the test bed."""
    opens = {path.relative_to(SOURCES).as_posix() for path in Path(SOURCES).glob("pliant/**/*.py")
             if OPENS.search(path.read_text(encoding="utf-8"))}  # fmt: skip
    assert opens == {"pliant/recording/apart_hdf5.py"}


@pytest.mark.parametrize("attack", [
    files.external_link, *(pytest.param(a, marks=pytest.mark.slow) for a in (files.external_storage, files.virtual)),
])
def test_files_of_our_own_are_followed_nowhere_either(tmp_path, attack):
    path = tmp_path / "results.nc"
    about = {"schema": "pliant-results", "run_id": ""}
    group = xr.Dataset({"position": (("time", "axis"), np.ones((4, 2)))})
    xr.DataTree.from_dict({"/": xr.Dataset(attrs=about), "/recording_0": group}).to_netcdf(path, engine="h5netcdf")
    (tmp_path / "metrics.json").write_text('{"schema": "pliant-metrics"}')
    assert read_groups(path)["/recording_0"]["position"].shape == (4, 2)
    attack(path, "recording_0/position", tmp_path / "secret")
    for reads in (lambda: load_outcome(tmp_path), lambda: read_truth(path)):
        with pytest.raises(InputError, match=files.ATTACKS[attack]) as caught:
            reads()
        assert "\n" not in str(caught.value)


def test_the_helper_finds_the_pliant_that_started_it(tmp_path):
    path, _, _ = foreign(tmp_path)
    code = f"import sys; sys.path.insert(0, {SOURCES!r})\nfrom pliant.recording import read\nprint(read({str(path)!r}))"
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=False)
    assert done.returncode == 0, done.stderr


def test_attributes_are_bounded_by_the_file(tmp_path):
    path, _, mapping = sleap(tmp_path)
    with h5py.File(path, "r+") as file:
        file["tracks"].attrs["note"] = np.zeros(5000)
    assert read(path, mapping=mapping).sizes["time"] == 20
    with h5py.File(path) as file:
        assert file["tracks"].attrs["note"].nbytes < path.stat().st_size
    data = path.read_bytes().replace((5000).to_bytes(8, "little"), (500_000_000).to_bytes(8, "little"))
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_apart("hdf5", path, "SLEAP analysis")
    assert "\n" not in str(caught.value)
