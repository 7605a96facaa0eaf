"""NumPy and MATLAB files: usual names without a mapping, other names with one."""

from __future__ import annotations

from pathlib import Path

import h5py
import hdf5_files
import numpy as np
import pytest
from scipy.io import savemat

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.mat import trials_of

TIME = np.arange(6) / 10
POSITION = np.arange(6 * 2 * 3.0).reshape(6, 2, 3)


def test_usual_names_need_no_mapping(tmp_path):
    np.savez(tmp_path / "a.npz", t=TIME, xyz=POSITION, p_kpa=np.arange(3), t_p=np.arange(3), s=[0, 0.1])
    ds = read(tmp_path / "a.npz")
    np.testing.assert_array_equal(ds["position"], POSITION)
    assert ds["pressure"].values.tolist() == [0, 1000, 2000]
    assert ds["arc_length"].values.tolist() == [0, 0.1]


def test_a_pressure_in_capitals_states_its_unit_and_comes_second(tmp_path):
    np.savez(tmp_path / "a.npz", t=TIME, xyz=POSITION, p_kpa=np.arange(6), P_kPa=np.zeros(6))
    assert read(tmp_path / "a.npz")["pressure"].values[5] == 5000
    np.savez(tmp_path / "b.npz", t=TIME, xyz=POSITION, p_kPa=np.arange(6))
    assert read(tmp_path / "b.npz")["pressure"].values[5] == 5000
    np.savez(tmp_path / "c.npz", t=TIME, xyz=POSITION, Pressure=np.arange(6))
    ds = read(tmp_path / "c.npz")
    assert "pressure" not in ds
    assert "not used: Pressure" in ds.attrs["history"]


def test_other_names_units_and_orders_by_mapping(tmp_path):
    savemat(tmp_path / "a.mat", {"log": {"pos": np.transpose(POSITION, (2, 1, 0)), "press": np.arange(6.0)}})
    mapping = {"position": "log.pos", "order": "ast", "length_unit": "mm", "rate_hz": 10, "pressure": "log.press"}
    with pytest.raises(InputError, match="pressure_unit"):
        read(tmp_path / "a.mat", mapping=mapping)
    ds = read(tmp_path / "a.mat", mapping=mapping | {"pressure_unit": "bar", "station": ["base", "tip"]})
    np.testing.assert_allclose(ds["position"], POSITION / 1000)
    np.testing.assert_allclose(ds["time"], TIME)
    assert ds["pressure"].values[-1] == 5e5


def test_matlab_73_is_read(tmp_path):
    path = hdf5_files.write_mat73(tmp_path / "a.mat", {"time": TIME[None], "position": POSITION})
    np.testing.assert_array_equal(read(path)["position"], POSITION)


def test_what_matlab_73_holds_beside_numbers_is_named(tmp_path):
    """Structs by their fields; text, complex, sparse and empty arrays, references and cells under their names."""
    arrays = {"time": TIME[None], "log/pos": POSITION, "none": np.array([0, 3])}
    path = hdf5_files.write_mat73(tmp_path / "a.mat", arrays)
    with h5py.File(path, "r+") as file:
        file["none"].attrs["MATLAB_empty"] = np.uint8(1)
        file["name"] = np.uint16([[97, 98]])
        file["name"].attrs["MATLAB_class"] = np.bytes_("char")
        file["wave"] = np.array([[1 + 2j]]).view([("real", "f8"), ("imag", "f8")])
        file["wave"].attrs["MATLAB_class"] = np.bytes_("double")
        file["cell"] = np.array([file["name"].ref], h5py.ref_dtype)
        sparse = file.create_group("grid")
        sparse.attrs["MATLAB_sparse"] = np.uint64(3)
        sparse["data"], sparse["ir"], sparse["jc"] = np.ones(2), np.uint64([0, 1]), np.uint64([0, 1, 2])
    ds = read(path, mapping={"position": "log.pos"})
    np.testing.assert_array_equal(ds["position"], POSITION)
    line = next(line for line in ds.attrs["history"].split("\n") if "not used" in line)
    assert line.startswith("5 array(s) of a.mat were not used: ")
    assert set(line.partition("used: ")[2].split(", ")) == {"none", "name", "wave", "cell", "grid"}


def trials_73(path: Path, kind: str, arrays: dict | None = None) -> Path:
    """MATLAB 7.3 with two trials, the second shifted by 1 m: an array of structs, or a cell of structs."""
    hdf5_files.write_mat73(path, arrays or {})
    trials = [{"t": TIME[None], "position": POSITION + k} for k in range(2)]
    with h5py.File(path, "r+") as file:
        if kind == "cell":
            hdf5_files.refer(file, "train", trials, cell=True)
        else:
            for field in ("t", "position"):
                hdf5_files.refer(file, f"train/{field}", [trial[field] for trial in trials])
    return path


@pytest.mark.parametrize("kind", ["structs", "cell"])
def test_structs_and_cells_of_matlab_73_are_read_as_those_of_older_versions(tmp_path, kind):
    path = trials_73(tmp_path / "a.mat", kind)
    for named in ("train(2)", "train{2}", "train[2]"):
        ds = read(path, mapping={"struct": named})
        np.testing.assert_array_equal(ds["position"], POSITION + 1)
        np.testing.assert_array_equal(ds["time"], TIME)
    mixed = read(path, mapping={"position": "train(1).position", "time": "train(2).t"})
    np.testing.assert_array_equal(mixed["position"], POSITION)
    with pytest.raises(InputError, match=r"a.mat holds 2 structs 'train': set struct = \"train\(1\)\""):
        read(path)
    with pytest.raises(InputError, match=r"a.mat has no struct 'train\(3\)'"):
        read(path, mapping={"struct": "train(3)"})
    assert list(trials_of(path, None)) == ["1", "2"]


def test_a_cell_of_arrays_of_matlab_73_is_read_by_its_numbers(tmp_path):
    path = hdf5_files.write_mat73(tmp_path / "a.mat", {"time": TIME[None]})
    with h5py.File(path, "r+") as file:
        hdf5_files.refer(file, "poses", [POSITION, POSITION + 1], cell=True)
    np.testing.assert_array_equal(read(path, mapping={"position": "poses{2}"})["position"], POSITION + 1)


@pytest.mark.parametrize("damage", ["structs", "cell", "shared", "itself", "nothing", "many", "labels"])
def test_a_recording_of_matlab_73_stays_what_it_is_beside_structs_and_cells(tmp_path, damage):
    arrays = {"time": TIME[None], "position": POSITION - 1}
    path = trials_73(tmp_path / "a.mat", "cell" if damage == "cell" else "structs", arrays)
    with h5py.File(path, "r+") as file:
        refs = file["#refs#"]
        if damage == "shared":
            refs.create_group("one")["x"] = np.ones(3)
            file["cell"] = np.array([refs["one"].ref] * 3, h5py.ref_dtype)
            file["cell"].attrs["MATLAB_class"] = np.bytes_("cell")
        elif damage == "itself":
            group = refs.create_group("loop")
            group["again"] = np.array([group.ref], h5py.ref_dtype)
            group["again"].attrs["MATLAB_class"] = np.bytes_("cell")
            file["cell"] = np.array([group.ref], h5py.ref_dtype)
        elif damage == "nothing":
            refs["gone"] = np.ones(3)
            file["cell"] = np.array([refs["gone"].ref, h5py.Reference()], h5py.ref_dtype)
            del refs["gone"]
        elif damage == "many":
            hdf5_files.refer(file, "cell", [np.ones(2)] * 300, cell=True)
        elif damage == "labels":
            hdf5_files.refer(file, "cell", [np.uint16([97, 98])] * 3, cell=True)
    np.testing.assert_array_equal(read(path)["position"], POSITION - 1)
    assert trials_of(path, None) == {}


def test_strain_and_a_single_station(tmp_path):
    np.savez(tmp_path / "a.npz", time=TIME, strain=np.zeros((6, 3, 4)), gauge_position=np.arange(4.0))
    assert read(tmp_path / "a.npz")["strain"].shape == (6, 3, 4)
    np.savez(tmp_path / "b.npz", time=TIME, position=POSITION[:, 0])
    assert read(tmp_path / "b.npz").sizes["station"] == 1


@pytest.mark.parametrize(
    ("arrays", "mapping", "message"),
    [
        ({"position": POSITION}, None, r"set time \(the name of the array\) or rate_hz"),
        ({"t": TIME, "time": TIME, "position": POSITION}, None, "t, both|time and t"),
        ({"t": TIME, "q": POSITION}, None, r"Its arrays are: t \(6,\), q \(6, 2, 3\)"),
        ({"t": TIME, "position": POSITION}, {"position": "pos"}, "no array 'pos'"),
        ({"t": TIME, "position": POSITION}, {"rate_hz": 5}, "remove rate_hz from the mapping"),
        ({"t": TIME[:3], "position": POSITION}, None, "do not match"),
        ({"t": TIME, "position": POSITION.astype(str)}, None, "must hold real numbers"),
        ({"t": TIME, "position": POSITION, "p_kpa": TIME, "p_bar": TIME}, None, "several pressures"),
        ({"t": TIME, "position": np.zeros((6, 2, 3, 1))}, None, "2 or 3 dimensions"),
        ({"t": TIME, "position": np.zeros((6, 2, 5))}, None, "2 .planar. or 3"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, arrays, mapping, message):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=message):
        read(tmp_path / "a.npz", mapping=mapping)


def test_pickled_objects_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", time=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="holds Python objects, such as a dict"):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.99])
def test_cut_files_are_refused(tmp_path, share):
    np.savez_compressed(tmp_path / "a.npz", time=TIME, position=POSITION)
    savemat(tmp_path / "a.mat", {"time": TIME, "position": POSITION}, do_compression=True)
    for name in ("a.npz", "a.mat"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: max(1, int(share * len(data)))])
        with pytest.raises(InputError):
            read(tmp_path / name)


def test_one_of_several_trials_with_its_level(tmp_path):
    trials = np.stack([POSITION, POSITION + 1.0])
    np.savez(tmp_path / "a.npz", t=TIME, xyz=trials, pressure_mbar=[50, 100])
    ds = read(tmp_path / "a.npz", mapping={"trial": 1})
    np.testing.assert_array_equal(ds["position"], POSITION + 1.0)
    assert ds.attrs["nominal_pressure"] == 1e4
    with pytest.raises(InputError, match="has no trial 2: choose one of 0 to 1"):
        read(tmp_path / "a.npz", mapping={"trial": 2})
    with pytest.raises(InputError, match="must have 2 or 3 dimensions"):
        read(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", t=TIME, xyz=POSITION)
    with pytest.raises(InputError, match=r"b\.npz: `trial` needs positions of four .* but holds one of shape"):
        read(tmp_path / "b.npz", mapping={"trial": 0})
    np.savez(tmp_path / "c.npz", t=TIME, xyz=trials, pressure_mbar=[[0, 50, 50]] * 2, t_p=[0.0, 0.2, 0.4])
    assert read(tmp_path / "c.npz", mapping={"trial": 0})["pressure"].values.tolist() == [0, 5000, 5000]
    np.savez(tmp_path / "d.npz", t=TIME, xyz=trials, pressure_mbar=[50.0])
    with pytest.raises(InputError, match="2 trials, but its pressure has 1 rows"):
        read(tmp_path / "d.npz", mapping={"trial": 0})
