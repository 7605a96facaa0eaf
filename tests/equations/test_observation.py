"""Points on links as fits and filters see them: where the mechanics has them, with the slopes of their positions."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from oracles.derivatives import complex_step

from pliant.equations.observation import (
    ALONG_X,
    ALONG_Y,
    ANGLE,
    motion_of,
    observe_rows,
    outputs,
    place_links,
    position,
)
from pliant.equations.spatial_observation import motion_of as motion_in_space
from pliant.equations.symbols import ObservedChain
from pliant.estimation.kalman_loops import recall
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model, Station

POINTS = [Station("base", -1, 0.006, 0.002), Station("first", 0, 0.01, 0.004), Station("last", 2, 0.03, -0.003)]


@pytest.fixture(params=[0, 1], ids=["fixed length", "lengthens"])
def model(request):
    return Model(
        link_length=[0.04, 0.03, 0.05], link_mass=0.01, stiffness=1.0, damping=1e-3, torque=[1e-6], base_length=0.02,
        base_angle=0.3, stations=POINTS, extensions=[Extension(100.0)] * request.param,
    )


def placed(model, x):
    chain = ObservedChain(model.base_length, model.link_length, np.array(model.stretch_share))
    links = np.zeros((5, model.n + 1), dtype=x.dtype)
    place_links(x, model.base_angle, chain, links)
    return chain, links


def test_points_lie_where_the_mechanics_has_them(model, rng):
    x = 0.3 * rng.normal(size=model.size)
    _, links = placed(model, x)
    found = [[position(axis, p.link, p.along, p.across, links) for axis in range(2)] for p in POINTS]
    np.testing.assert_allclose(found, mechanics_of(model).stations(x)[0], atol=1e-15)


def test_slopes_are_those_of_the_positions(model, rng):
    """Against complex steps through the positions of the mechanics, by the plain text of the rows."""
    x, chain = 0.3 * rng.normal(size=model.size), mechanics_of(model)
    rows = np.array([(kind, p.link, p.along, p.across) for p in POINTS[1:] for kind in (ALONG_X, ALONG_Y, ANGLE)])
    frame = SimpleNamespace(rows=rows, wide=4, base_angle=model.base_angle, chain=chain.observed)
    seen, H = np.empty(len(rows)), np.empty((len(rows), model.size))
    observe_rows(x, frame, chain.sight(np.complex128), seen, H)

    def rows_at(x):
        place, angle = chain.stations(x)
        return np.concatenate([place, angle[:, None]], axis=1)[1:].ravel()

    np.testing.assert_allclose(seen, rows_at(x), atol=1e-15)
    np.testing.assert_allclose(H, complex_step(rows_at, x), atol=1e-15)
    values = np.empty(len(rows))
    outputs(x[: model.n], x[model.n :], frame, chain.sight(np.array), values)
    assert values.tolist() == seen.tolist()


def test_motion_of_late_is_the_mean_square_of_joint_rates_and_fades():
    recent, empty = np.zeros(1), {"hardening": np.zeros((3, 4)), "tied": np.zeros((2, 0))}
    joints = SimpleNamespace(theta0=np.zeros(3), unloaded=np.zeros(2), spin=np.zeros(2), **empty)
    recall(motion_of(np.array([1.0, 3.0, 0.0, 9.0]), joints), 0.01, recent)  # the last one is the rate of a strain
    assert recent[0] == pytest.approx((1.0 + 4.0 + 9.0) / 3)
    assert motion_in_space(np.array([1.0, 3.0, -2.0, 0.0, 9.0]), joints) == pytest.approx(14.0 / 2)
    carried = SimpleNamespace(theta0=np.zeros(3), spin=np.array([4.0, 0.0]))
    assert motion_of(np.array([4.0, 4.0, 6.0]), carried) == pytest.approx(4.0 / 3)  # the base turns at 4 rad/s
    recall(0.0, 0.05, recent)
    assert recent[0] == pytest.approx((14.0 / 3) / 1.5)
