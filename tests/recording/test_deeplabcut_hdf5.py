"""DeepLabCut's HDF5: both layouts of pandas are read as plain arrays, and no pickle in them is ever run."""

from __future__ import annotations

import pickle
import sys

import h5py
import hdf5_files as files
import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.pandas_layout import plain_value, read_frame

CAMERA = {"camera": {"rate_hz": 60.0, "pixels_per_mm": 4.0}}
PIXELS = np.random.default_rng(3).uniform(100, 900, (20, 3, 2))
METRES = PIXELS * [1.0, -1.0] / 4e3


@pytest.mark.parametrize("write", [files.write_table, files.write_fixed])
def test_both_layouts_are_read(tmp_path, write):
    path = write(tmp_path / "a.h5", files.columns_of(), files.values_of(PIXELS))
    ds = read(path, mapping=CAMERA)
    assert ds["station"].values.tolist() == list(files.POINTS)
    np.testing.assert_allclose(ds["position"].values[..., :2], METRES, rtol=0, atol=1e-15)


@pytest.mark.parametrize("write", [files.write_table, files.write_fixed])
def test_several_animals_and_names_of_other_scripts(tmp_path, write):
    levels = ("scorer", "individuals", "bodyparts", "coords")
    points = ("pied é", "指", "a\\b")
    columns = [("net", a, p, c) for a in ("left", "right") for p in points for c in files.COORDS]
    values = np.concatenate([files.values_of(PIXELS), files.values_of(PIXELS + 50.0)], axis=1)
    path = write(tmp_path / "a.h5", columns, values, levels=levels)
    with pytest.raises(InputError, match="set individual in the mapping to one of left, right"):
        read(path, mapping=CAMERA)
    ds = read(path, mapping={**CAMERA, "individual": "right"})
    assert ds["station"].values.tolist() == list(points)
    np.testing.assert_allclose(ds["position"].values[..., 0], (PIXELS[..., 0] + 50.0) / 4e3)


@pytest.mark.parametrize("write", [files.write_table, files.write_fixed])
def test_rows_that_are_left_out_are_gaps(tmp_path, write):
    keep = np.delete(np.arange(20), [5, 6])
    path = write(tmp_path / "a.h5", files.columns_of(), files.values_of(PIXELS)[keep], index=keep)
    ds = read(path, mapping=CAMERA)
    assert ds.sizes["time"] == 20
    assert np.isnan(ds["position"].values[5:7]).all()


def test_columns_are_found_by_name_not_by_place(tmp_path):
    """`non_index_axes` gives the order of the table, `values_block_0_kind` that of the stored values."""
    path = files.write_table(tmp_path / "a.h5", files.columns_of(), files.values_of(PIXELS))
    with h5py.File(path, "r+") as file:
        group = file[files.KEY]
        group.attrs["non_index_axes"] = files.text_pickle([(1, files.columns_of(files.POINTS[::-1]))])
    ds = read(path, mapping=CAMERA)
    assert ds["station"].values.tolist() == list(files.POINTS[::-1])
    np.testing.assert_allclose(ds["position"].values[..., :2], METRES[:, ::-1])


@pytest.mark.parametrize("layout", ["table", "fixed"])
def test_the_layouts_are_those_of_pytables(tmp_path, layout):
    """Where PyTables is installed: its file is read, and ours has each data set and attribute that the reader uses."""
    pytest.importorskip("tables", reason="PyTables is not installed; pliant does not need it")
    import pandas as pd

    columns = pd.MultiIndex.from_tuples(files.columns_of(), names=files.LEVELS)
    frame = pd.DataFrame(files.values_of(PIXELS), columns=columns)
    frame.to_hdf(tmp_path / "theirs.h5", key=files.KEY, format=layout, mode="w")
    write = files.write_table if layout == "table" else files.write_fixed
    write(tmp_path / "ours.h5", files.columns_of(), files.values_of(PIXELS))
    theirs, ours = (read(tmp_path / name, mapping=CAMERA) for name in ("theirs.h5", "ours.h5"))
    np.testing.assert_array_equal(theirs["position"], ours["position"])
    with h5py.File(tmp_path / "theirs.h5") as a, h5py.File(tmp_path / "ours.h5") as b:
        names = []
        b.visit(names.append)
        assert all(name in a for name in names)
        for name in names:
            assert not isinstance(b[name], h5py.Dataset) or (b[name].shape, b[name].dtype) == (
                a[name].shape, a[name].dtype)  # fmt: skip
            for key in b[name].attrs:
                assert str(b[name].attrs[key]) == str(a[name].attrs[key]), f"{name} {key}"


@pytest.mark.parametrize(("attribute", "protocol"), [
    ("non_index_axes", 0), ("info", 2), ("values_cols", 0), ("values_block_0_kind", 5), ("nan_rep", 0), ("any", 4),
])
def test_a_pickle_that_would_run_code_runs_none(tmp_path, attribute, protocol):
    path = files.write_table(tmp_path / "a.h5", files.columns_of(), files.values_of(PIXELS))
    marker = tmp_path / "created"
    hostile = pickle.dumps(files.Creates(marker), protocol)
    with h5py.File(path, "r+") as file:
        group = file[files.KEY]
        holder = group["table"] if attribute.endswith("kind") else group
        holder.attrs[attribute] = np.void(hostile) if b"\0" in hostile else np.bytes_(hostile)
        file.attrs["TITLE"] = holder.attrs[attribute]
    if attribute in ("nan_rep", "any"):  # no reader looks at them
        assert read(path, mapping=CAMERA).sizes["station"] == 3
    else:
        with pytest.raises(InputError, match="cannot be read as a DeepLabCut file"):
            read(path, mapping=CAMERA)
    assert not marker.exists()
    pickle.loads(hostile).close()  # the attack is one
    assert marker.exists()


@pytest.mark.parametrize("value", [
    [(1, [("net", "tip é", "x")])], {1: {"names": ["a", "指"]}, "index": {}}, None, [], (), "a\nb\\c", 12, -3, [[1], 2],
])
def test_plain_values_are_those_of_pickle(value):
    assert plain_value(pickle.dumps(value, 0).decode("latin-1")) == value


@pytest.mark.parametrize("text", [
    "", ".", "(", "(.", "a.", "s.", "l.", "g1\n.", "(lp0\n", "(I1\nd.", "(I1\nI2\na.", "Vtext", "p0\n.", "I1\nI2\n.",
    "I12x\n.", "(lp0\ng0\na.",
])
def test_damaged_names_are_refused(tmp_path, text):
    attributes = {"t": {"pandas_type": "frame_table", "non_index_axes": text}}
    facts = {"groups": attributes, "variables": {"t/table:index": ["v0", [], {}]}}
    with pytest.raises(InputError) as caught:
        read_frame({"v0": np.arange(3)}, facts, "a.h5")
    assert str(caught.value).startswith("a.h5 cannot be read as a DeepLabCut file")
    assert "\n" not in str(caught.value)


def test_reading_needs_no_pandas_and_no_pytables(tmp_path, monkeypatch):
    path = files.write_fixed(tmp_path / "a.h5", files.columns_of(), files.values_of(PIXELS))
    monkeypatch.setitem(sys.modules, "tables", None)
    assert read(path, mapping=CAMERA).sizes["time"] == 20
