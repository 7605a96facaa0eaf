"""A fit in space compares a further kind of observation that depends on the orientation of a link, such as the reading
of an inclinometer: its value, its derivative, and the same value in the rows of a filter.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.compiler.twin import rebuild
from pliant.equations import observation, spatial_observation
from pliant.equations.observation import FURTHER, KINDS, RowKind, observe_rows
from pliant.estimation.offline import frame_of
from pliant.identification import Experiment, Parameter
from pliant.identification import observation as observed_by_fits
from pliant.identification.experiment import FurtherRows
from pliant.identification.problem import Problem
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station, chain_model
from pliant.simulation import Trace, simulate

Array = np.ndarray
NAME, KIND = "inclination_of_tests", len(KINDS)
BODY = chain_model(
    length=0.2, mass=0.06, links=3, stiffness=0.3, damping=0.01, torque=[1e-6], space=True, gravity=[2.0, 1.0, -9.0],
).with_(stations=(Station("mid", 1, 0.03, 0.004, 0.002), Station("tip", 2, 0.05)))
TIMES = np.arange(0.0, 0.4, 0.02)
PULL = Trace([0.0, 0.1, 0.1], [0.0, 0.0, 4e4])


def seen_by(kind: int, sight: Any, constants: Any) -> Any:
    """A sum of all that an orientation shows: angles of two links, and the rotation vector."""
    if kind != KIND:
        return observation.row_value(kind, sight, constants)
    return sight.angle[0] + 0.3 * sight.angle[1] + sight.turn[0] + 2.0 * sight.turn[1] + constants[0] * sight.turn[2]


@pytest.fixture(autouse=True)
def inclination(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, KIND, RowKind("inclination", "of a link", "rad", {2: 1, 3: 1}, NAME, 1e-3))
    monkeypatch.setitem(FURTHER, NAME, KIND)
    monkeypatch.setattr(observed_by_fits, "row_value", seen_by)


def expected(model: Model, x: Array) -> Array:
    """The values (S,) at both stations, from the frames of the links."""
    from scipy.spatial.transform import Rotation

    frames = mechanics_of(model).link_frames(x)[1:]
    tilt = np.arccos(np.clip(frames[:, 2, 2], -1.0, 1.0))
    turn = Rotation.from_matrix(frames).as_rotvec()
    before = np.array([0.0, tilt[1]])  # of the station before, as in the plane
    return np.asarray(tilt[1:] + 0.3 * before + turn[1:, 0] + 2.0 * turn[1:, 1] + 0.5 * turn[1:, 2])


def test_the_rows_of_a_fit_and_of_a_filter_see_the_orientation_of_a_link() -> None:
    q = 0.1 * np.arange(1.0, BODY.size + 1.0)
    chain = mechanics_of(BODY)
    x = chain.coordinates(q)
    place = chain.stations(x)[0]
    frames = chain.link_frames(x)[[2, 3]]
    rows = np.concatenate([place, place + frames[:, :, 2], place + frames[:, :, 0]])[None]
    constants = np.full((2, 1), 0.5)
    value = observed_by_fits.modelled_rows(rows, NAME, constants, planar=False)[0, :, 0]
    np.testing.assert_allclose(value, expected(BODY, x), atol=1e-12)
    listed = np.array([[KIND, p.link, p.along, p.across, p.aside, 0.5] for p in BODY.points])
    spatial = {name: getattr(spatial_observation, name) for name in ("place_links", "look")}
    plain = rebuild(observe_rows, lambda kernel: kernel, {**spatial, "row_value": seen_by})
    frame = frame_of(BODY, listed, np.zeros(2), np.ones(2))
    seen, H = np.empty(2), np.empty((2, BODY.size))
    plain(x, frame, chain.sight(np.complex128), seen, H)
    np.testing.assert_allclose(seen[1], value[1], atol=1e-12)  # the link before it is that of the station before
    step = 1e-6
    for k in range(BODY.size):
        ends = []
        for side in (step, -step):
            again = np.empty(2)
            plain(x + side * np.eye(BODY.size)[k], frame, chain.sight(np.complex128), again, H.copy())
            ends.append(again)
        np.testing.assert_allclose(H[:, k], (ends[0] - ends[1]) / (2.0 * step), atol=1e-7)


def test_the_rest_of_a_straight_body_has_finite_values() -> None:
    x = np.zeros(BODY.size)
    chain = mechanics_of(BODY)
    place, frames = chain.stations(x)[0], chain.link_frames(x)[[2, 3]]
    rows = np.concatenate([place, place + frames[:, :, 2], place + frames[:, :, 0]])[None]
    modelled = observed_by_fits.modelled_rows(rows, NAME, np.full((2, 1), 0.5), planar=False)[0, :, 0]
    np.testing.assert_allclose(modelled, 0.0, atol=1e-12)


@pytest.mark.slow  # loads the compiler of dual numbers
@pytest.mark.parametrize("orientation", [False, True])
def test_its_derivatives_in_a_fit_are_those_of_differences(orientation: bool) -> None:
    run = simulate(BODY, PULL, times=TIMES, time_step=2e-3, check=False)
    values = np.stack([expected(BODY, x) for x in mechanics_of(BODY).coordinates(_joint_coordinates(run))])
    quaternion = np.full((TIMES.size, 2, 4), np.nan)
    quaternion[:, 1] = [0.0, 0.0, 0.0, 1.0]
    more = {"orientation": quaternion} if orientation else {}
    exp = Experiment(
        "e", TIMES, run.station_position.values, ("mid", "tip"), "trace", PULL,
        further={NAME: FurtherRows(values, np.full((2, 1), 0.5), 1e-3)}, **more,
    )
    problem = Problem([exp], BODY, [Parameter("stiffness", 0.35), Parameter("damping", 0.012)], 2e-3, "metre")
    observed = problem.observed[0]
    further = observed.station == observed.data.shape[1] - 1
    at_truth = problem.data_residual(np.array([0.3, 0.01]) / problem.scale)
    assert np.abs(at_truth[further]).max() < 1e-6
    J = problem.data_jacobian(problem.start)
    for k in range(2):
        h = 1e-6 * np.eye(2)[k]
        slope = (problem.data_residual(problem.start + h) - problem.data_residual(problem.start - h)) / 2e-6
        np.testing.assert_allclose(J[:, k], slope, atol=1e-5 * np.abs(slope).max())
        assert np.abs(J[further, k]).max() > 1e-3


def _joint_coordinates(run: Any) -> Array:
    chain = mechanics_of(BODY)
    return chain.gathered(run, 0)
