"""Variables that the block To Workspace of Simulink stores, with their times, as MATLAB saves them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

from pliant.errors import InputError
from pliant.recording import read

T = np.arange(50) / 100
PLACES = np.stack([np.zeros((50, 3)), np.outer(np.sin(T), [0.0, 0.02, 0.1])], axis=1)  # (T, S, 3) m
KPA = 30.0 * T[:, None]


def logged(values, time=T):
    """A structure with time; a vector of each step has the steps as its last dimension."""
    return {"time": time[:, None], "blockName": "arm/log",
            "signals": {"values": values, "dimensions": float(values.shape[-1]), "label": "y"}}  # fmt: skip


@pytest.mark.parametrize("values", [PLACES.reshape(50, 6), PLACES.reshape(50, 6).T.reshape(6, 1, 50)])
@pytest.mark.parametrize("outer", ["", "out"])
def test_structures_with_time_are_arrays_of_their_variables(tmp_path, values, outer):
    content = {"tout": T[:, None], "markers": logged(values), "p_kPa": logged(KPA)}
    savemat(tmp_path / "sim.mat", {outer: content} if outer else content)
    mapping = {"position": "markers", "station": ["base", "tip"]}
    for more in ({}, {"struct": "out", "pressure": "p_kPa", "pressure_unit": "kPa"} if outer else {}):
        ds = read(tmp_path / "sim.mat", mapping={**mapping, **more})
        np.testing.assert_allclose(ds["position"].values, PLACES)
        np.testing.assert_allclose(ds["pressure"].values, 1e3 * KPA[:, 0])
        np.testing.assert_allclose(ds["time"].values, T)


def test_full_names_still_name_the_arrays(tmp_path):
    savemat(tmp_path / "sim.mat", {"y": logged(PLACES.reshape(50, 6)), "p_kpa": logged(KPA, T + 0.005)})
    ds = read(tmp_path / "sim.mat", mapping={
        "time": "y.time", "position": "y.signals.values", "station": ["base", "tip"], "pressure_unit": "kPa",
        "pressure": "p_kpa.signals.values", "pressure_time": "p_kpa.time"})  # fmt: skip
    np.testing.assert_allclose(ds["pressure_time"].values, T + 0.005)
    np.testing.assert_allclose(ds["position"].values, PLACES)


def test_columns_of_several_stations_ask_for_their_names(tmp_path):
    savemat(tmp_path / "sim.mat", {"tout": T, "pos": logged(PLACES.reshape(50, 6))})
    with pytest.raises(InputError, match=r"position has 6 columns: .* name the stations in the mapping"):
        read(tmp_path / "sim.mat", mapping={"position": "pos"})


STATIONS = {"t": T, "position": PLACES}


@pytest.mark.parametrize(("content", "mapping"), [
    ({"tout": T, "base": logged(PLACES[:, 0]), "tip": logged(PLACES[:, 1]), "p_kpa": logged(KPA)},
     {"time": "tout", "position": {"base": "base.signals.values", "tip": "tip.signals.values"}}),
    ({**STATIONS, "p": logged(KPA)}, {"pressure_time": "p.time"}),
    ({**STATIONS, "p": logged(KPA)}, {"time": "p.time"}),
    ({**STATIONS, "p_kpa": logged(KPA, T + 0.005)}, None),
    ({"out": {"tout": T, "pos": logged(PLACES.reshape(50, 6))}},
     {"struct": "out", "position": "pos.signals.values", "time": "pos.time", "station": ["base", "tip"]}),
])  # fmt: skip
def test_names_and_times_beside_variables_of_simulink(tmp_path, content, mapping):
    """Arrays named in full, and arrays on a clock of their own."""
    savemat(tmp_path / "sim.mat", content)
    ds = read(tmp_path / "sim.mat", mapping=mapping)
    np.testing.assert_allclose(ds["position"].values, PLACES)
    np.testing.assert_allclose(ds["time"].values, T)
    assert "pressure" not in ds


@pytest.mark.parametrize("beside", [{}, {"meta": np.arange(3.0)}])
def test_a_variable_may_be_named_with_its_struct(tmp_path, beside):
    content = {"out": {"tout": T, "pos": logged(PLACES.reshape(50, 6))}, **beside}
    savemat(tmp_path / "sim.mat", content)
    ds = read(tmp_path / "sim.mat", mapping={"position": "out.pos", "station": ["base", "tip"]})
    np.testing.assert_allclose(ds["position"].values, PLACES)
    np.testing.assert_allclose(ds["time"].values, T)


def test_a_pressure_on_the_clock_of_the_positions_is_read(tmp_path):
    savemat(tmp_path / "sim.mat", {**STATIONS, "p_kpa": logged(KPA)})
    np.testing.assert_allclose(read(tmp_path / "sim.mat")["pressure"].values, 1e3 * KPA[:, 0])
