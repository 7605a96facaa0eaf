"""Every kind of row that the table of measurements lists has the derivative of differences, or is refused."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.wire import NAME, add_wire, plain_rows

from pliant.compiler.choose import twin
from pliant.equations.observation import KINDS, observe_rows
from pliant.errors import InputError
from pliant.estimation import KalmanFilter, Noise, rows_of
from pliant.estimation.measurement import TURNS, measurement_of
from pliant.estimation.offline import frame_of
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model, Space, Station
from pliant.recording import make_recording, read
from pliant.recording.netcdf import write_netcdf

PLANAR = Model(
    link_length=[0.05, 0.04], link_mass=0.02, stiffness=0.5, damping=0.004, torque=[1e-6], base_length=0.01,
    base_angle=0.2, extensions=(Extension(300.0, 1.0),), stations=[Station("tip", 1, 0.04)],
)
SPATIAL = PLANAR.with_(space=Space(stiffness_ratio=1.2), gravity=np.zeros(3), base_angle=0.0)
BODIES = {2: PLANAR, 3: SPATIAL}
PLACES = [(dimension, kind) for dimension in BODIES for kind in KINDS]


def seen_at(dimension, rows, x):
    """Values and slopes of rows."""
    model = BODIES[dimension]
    chain = mechanics_of(model)
    frame = frame_of(model, rows, np.full(len(rows), 0.1), np.ones(len(rows)))
    seen, H = np.full(len(rows), np.inf), np.zeros((len(rows), model.size))
    twin(observe_rows, *chain.sizes)(x, frame, chain.sight(), seen, H)
    return seen, H


def rows_with(dimension, kind):
    """Rows of a kind for both links; an orientation has three."""
    kinds = TURNS if kind in TURNS else (kind,)
    rows = np.array([(k, link, 0.03, 0.004, 0.002) for link in (0, 1) for k in kinds], dtype=float)[:, : dimension + 2]
    constants = 0.1 + 0.02 * np.arange(KINDS[kind].constants.get(dimension, 0))
    return np.concatenate([rows, np.tile(constants, (len(rows), 1))], axis=1)


@pytest.mark.parametrize(("dimension", "kind"), PLACES)
def test_a_kind_has_its_derivative_or_is_refused(dimension, kind):
    rows, model = rows_with(dimension, kind), BODIES[dimension]
    x = mechanics_of(model).coordinates(0.1 + 0.05 * np.arange(model.size))
    seen, H = seen_at(dimension, rows, x)
    if dimension not in KINDS[kind].constants:
        assert np.isnan(seen).all()
        with pytest.raises(InputError, match="a row must begin with a kind of measurement"):
            KalmanFilter(model).push_frame(0.0, rows, np.zeros(len(rows)), np.ones(len(rows)))
        return
    assert np.isfinite(seen).all()
    each = 1e-6 * np.eye(model.size)
    slope = np.stack([(seen_at(dimension, rows, x + d)[0] - seen_at(dimension, rows, x - d)[0]) / 2e-6 for d in each])
    np.testing.assert_allclose(H, slope.T, atol=1e-8)
    assert (np.abs(H).max(axis=1) > 1e-3).any()


def test_kinds_are_numbered_in_order():
    assert list(KINDS) == list(range(len(KINDS)))


@pytest.mark.parametrize("wrong", [(99.0, 1.0), (-1.0, 1.0), (1.5, 1.0), (1.0, 2.0), (1.0, -1.0), (np.nan, 1.0)])
def test_unknown_kinds_and_links_are_refused(wrong):
    model = PLANAR.with_(extensions=())
    rows = rows_of(model, model.points)
    rows[0, :2] = wrong
    with pytest.raises(InputError, match=r"got \["):
        KalmanFilter(model).push_frame(0.0, rows, np.zeros(2), np.ones(2))


@pytest.mark.parametrize("dimension", BODIES)
def test_a_kind_of_the_registry_goes_from_a_recording_to_the_rows_of_a_filter(monkeypatch, rng, dimension, tmp_path):
    """A wire to each of two stations: written, read, and compared with the model's length of the wire."""
    add_wire(monkeypatch)
    body = BODIES[dimension].with_(stations=[Station("middle", 0, 0.05), Station("tip", 1, 0.04)])
    chain, fixed = mechanics_of(body), rng.normal(0, 0.1, (2, dimension))
    x = chain.coordinates(0.1 + 0.05 * np.arange(body.size))
    place = np.array([chain.stations(x)[0]] * 5)
    recording = make_recording(
        0.01 * np.arange(5), place, station=["middle", "tip"], frame="planar" if dimension == 2 else "spatial",
        further={NAME: np.linalg.norm(place - fixed, axis=2), f"{NAME}_constants": fixed},
    )
    write_netcdf(recording, tmp_path / "a.nc")
    read_back = read(tmp_path / "a.nc")
    measurement = measurement_of(read_back, body, Noise(), None)
    assert measurement.label[dimension :: dimension + 1] == ("middle wire", "tip wire")
    np.testing.assert_allclose(measurement.variance[dimension], 7e-4**2)
    np.testing.assert_array_equal(measurement.rows[dimension :: dimension + 1, 2 + dimension :], fixed)
    louder = measurement_of(read_back, body, Noise(further={NAME: 2e-3}), ("tip",))
    np.testing.assert_allclose(louder.variance[-1], 2e-3**2)
    frame = frame_of(body, measurement.rows, measurement.value[0], measurement.variance)
    seen, H = np.empty(len(frame.rows)), np.empty((len(frame.rows), body.size))
    plain_rows(dimension)(x, frame, chain.sight(np.complex128), seen, H)
    np.testing.assert_allclose(seen, measurement.value[0], atol=1e-14)
    away, slopes = place[0] - fixed, [chain.position_jacobian(x, point) for point in body.points]
    wanted = np.einsum("si,sin->sn", away / np.linalg.norm(away, axis=1, keepdims=True), slopes)
    np.testing.assert_allclose(H[dimension :: dimension + 1], wanted, atol=1e-14)
