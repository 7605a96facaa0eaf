"""The pose of a body that is held, from its points: SciPy's minima, derivatives near the reach of the straight body,
and points that allow two poses.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from pliant.errors import SimulationError
from pliant.identification import Experiment, held_pose
from pliant.identification.forward_model import held_note
from pliant.identification.held_pose import BENDS, DISTANCE, STAGES, beyond_reach, chain_of, pose_through, solved_pose
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model, Space, Station, chain_model

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

Array = np.ndarray
BODY: dict[str, Any] = {"length": 0.3, "mass": 0.1, "damping": 0.01, "torque": [1e-6]}
TRUNK = chain_model(**BODY, stiffness=0.1, links=3, joint_placement="midsegment", space=True)
DISKS = [Station("a", 0, 0.03, 0.0, 0.0), Station("b", 1, 0.03, 0.0, 0.005), Station("c", 2, 0.045, 0.03, 0.02)]
HELD = np.array([[0.0, -0.012, 0.078], [-0.010, -0.060, 0.158], [-0.021, -0.156, 0.218]])  # m, of the three disks
REACH = 0.3  # m, of the bodies of `body`


def body(space: bool, **more: Any) -> Model:
    return chain_model(**BODY, **{"stiffness": 0.1, "links": 5, "space": space, **more})


def tip_at(space: bool, distance: float, angle: float) -> Array:
    """A tip (1, 2 or 3) [m] in a direction beside the axis of the base."""
    across, along = distance * np.sin(angle), distance * np.cos(angle)
    return np.array([[across, 0.0, along]]) if space else np.array([[across, along]])


def offsets(q: Array, model: Model, stations: list[Station], positions: Array) -> Array:
    chain = mechanics_of(model.with_(stations=tuple(stations)))
    return np.asarray(chain.stations(chain.coordinates(q))[0] - positions).ravel()


@pytest.mark.parametrize("model", [
    pytest.param(
        TRUNK.with_(stiffness=[0.1, 0.2, 0.05], space=Space(stiffness_ratio=1.3, twist_ratio=0.7, radius=0.02)),
        marks=pytest.mark.slow,
    ),
    body(False, links=3, stiffness=[0.1, 0.2, 0.05]),
    body(False, links=3, stiffness=[0.1, 0.2, 0.05]).with_(extensions=[Extension(stiffness=9.0, damping=0.1)]),
])  # fmt: skip
def test_each_stage_is_the_minimum_that_scipy_finds(model: Model) -> None:
    """The squares of distances and of joint angles, these weighted by the ratios of the stiffnesses."""
    stations, positions = (DISKS, HELD) if model.space else ([model.points[0], model.points[2]], HELD[[0, 2], 1:])
    K = mechanics_of(model).joints.K
    weight = K / model.stiffness.mean() * model.n / BENDS**2
    centre = np.zeros(model.size)
    for _ in range(STAGES):
        def cost(q: Array, centre: Array = centre) -> float:
            off = offsets(q, model, stations, positions) / (DISTANCE * 0.3)
            return float(np.sum(off**2) + np.sum(weight * (q - centre) ** 2))

        centre = minimize(cost, centre, method="BFGS", options={"gtol": 1e-9}).x
    np.testing.assert_allclose(solved_pose(model, stations, positions), centre, atol=2e-6)


@pytest.mark.parametrize("space", [True, False], ids=["space", "plane"])
@pytest.mark.parametrize(("distance", "angle"), [
    (distance, angle)
    for distance in (0.9, 0.97, 0.99, 0.999, 1.0, 1.001, 1.01, 1.2) for angle in (0.0, 0.05, -0.6)
    if angle or distance > 0.98  # of a straight body with its tip ahead, two mirrored poses are as good
])  # fmt: skip
def test_a_pose_has_one_derivative_inside_at_and_beyond_reach(space: bool, angle: float, distance: float) -> None:
    """Differences of steps from 3e-7 to 1e-4 of the reach agree, by the position of the tip across and along."""
    model, held = body(space), tip_at(space, distance * REACH, angle)
    tip = [model.points[-1]]
    for axis in (0, -1):
        slopes = []
        for step in (3e-5, 1e-6, 1e-7):
            move = np.zeros_like(held)
            move[0, axis] = step
            ends = [solved_pose(model, tip, held + side * move) for side in (1.0, -1.0)]
            slopes.append((ends[0] - ends[1]) / (2.0 * step))
        size = max(float(np.abs(slopes[1]).max()), 0.1 / REACH)
        assert size < 200.0 / REACH
        np.testing.assert_allclose(slopes[2], slopes[1], atol=1e-4 * size)
        np.testing.assert_allclose(slopes[0], slopes[1], atol=0.05 * size)


def test_a_derivative_of_the_followed_pose_is_that_of_the_pose_searched_anew() -> None:
    model = body(False)
    for distance in (0.97, 1.0, 1.05):
        held, cache = tip_at(False, distance * REACH, 0.2), dict[Any, Any]()
        base = pose_through(chain_of(model, [model.points[-1]]), held, cache)
        for step in (1e-6, 1e-5):
            moved = held + np.array([step, 2.0 * step])
            followed = pose_through(chain_of(model, [model.points[-1]]), moved, cache)
            np.testing.assert_allclose(followed, solved_pose(model, [model.points[-1]], moved), atol=1e-10)
            assert np.abs(followed - base).max() > 0.1 * step / REACH


def test_a_changed_rest_angle_changes_the_pose_little() -> None:
    """A search for least distances alone jumps by 1.9 rad near -0.085 rad."""
    turns, poses = np.zeros((3, 3)), []
    for turn in np.arange(-0.094, -0.076, 2e-3):
        turns[1, 1] = turn
        poses.append(solved_pose(TRUNK.with_(space=Space(rest_turn=turns)), DISKS, HELD))
    assert 1e-4 < np.abs(np.diff(poses, axis=0)).max() < 1e-2


@pytest.mark.parametrize("space", [True, False], ids=["space", "plane"])
def test_points_without_error_are_met(space: bool) -> None:
    """One point for each link, and random bends to both sides: within 0.4 % of the length."""
    rng = np.random.default_rng(3)
    for links in (3, 6):
        model = body(space, links=links)
        stations = [Station(f"s{i}", i, 0.6 * float(model.link_length[i]), *rng.normal(0.0, [0.015, 0.015 * space]))
                    for i in range(links)]  # fmt: skip
        for _ in range(4):
            q = 0.6 * rng.normal(size=model.size) / np.sqrt(links / 3)
            positions = offsets(q, model, stations, np.array(0.0)).reshape(links, -1)
            off = offsets(solved_pose(model, stations, positions), model, stations, positions)
            assert np.sqrt(np.mean(off**2)) < 4e-3 * REACH


@pytest.mark.parametrize("angle", [0.1, 0.4, -0.7])
def test_of_the_two_poses_of_an_elbow_the_less_bent_one_is_found(angle: float) -> None:
    """Two equal links bent by b reach the same point with angles (a, b) and (a + b, -b)."""
    model, bend = body(False, links=2), 0.6
    tip = [model.points[-1]]
    q = np.array([angle, bend])
    other = np.array([angle + bend, -bend])
    positions = offsets(q, model, tip, np.array(0.0)).reshape(1, 2)
    less = min((q, other), key=lambda pose: float(np.linalg.norm(pose)))
    np.testing.assert_allclose(solved_pose(model, tip, positions), less, atol=0.06)


def test_a_stiff_joint_bends_less() -> None:
    even, held = body(False, links=3), tip_at(False, 0.98 * REACH, 0.3)
    tip = [even.points[-1]]
    stiff = even.with_(stiffness=[0.1, 1.0, 0.1])
    bends = [np.abs(solved_pose(model, tip, held)[1]) for model in (even, stiff)]
    assert bends[1] < 0.5 * bends[0]
    scaled = solved_pose(stiff.with_(stiffness=7.0 * stiff.stiffness), tip, held)
    np.testing.assert_allclose(scaled, solved_pose(stiff, tip, held), rtol=1e-9)


def test_a_pose_is_searched_once_and_followed_over_small_changes() -> None:
    cache: dict[object, Any] = {}
    first = pose_through(chain_of(TRUNK, DISKS), HELD, cache)
    first[:] = 9.0
    best = solved_pose(TRUNK, DISKS, HELD)
    np.testing.assert_array_equal(pose_through(chain_of(TRUNK, DISKS), HELD, cache), best)
    size = len(cache)
    for change in (1e-6, 0.01):  # followed, and searched again
        moved = solved_pose(TRUNK, DISKS, HELD + change)
        np.testing.assert_allclose(pose_through(chain_of(TRUNK, DISKS), HELD + change, cache), moved, atol=1e-10)
        assert np.abs(moved - best).max() > change
    assert len(cache) == size + 2


def test_a_point_beyond_reach_is_named_with_its_distance() -> None:
    for space in (False, True):
        model = body(space, base_length=0.02)
        stations = [model.points[1], model.points[-1]]
        inside = np.vstack([tip_at(space, 0.1, 0.1), tip_at(space, 0.29, 0.1)])
        assert beyond_reach(model, stations, inside) == {}
        joint = 0.02 * np.eye(2 + space)[-1]
        away = np.vstack([inside[:1], joint + tip_at(space, model.link_length.sum() + 0.012, 0.4)])
        assert beyond_reach(model, stations, away) == {stations[1].name: pytest.approx(0.012)}


def test_a_search_without_an_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held_pose, "MOST_STEPS", 1)
    with pytest.raises(SimulationError, match="pose in which the body is held was not found within 1 steps"):
        solved_pose(TRUNK, DISKS, HELD)


@pytest.mark.parametrize("space", [True, False], ids=["space", "plane"])
def test_the_report_of_a_fit_names_the_station_beyond_reach_in_millimetres(space: bool) -> None:
    model = body(space).with_(stations=(Station("tip", 4, 0.06),))
    times = np.arange(0.0, 0.3, 0.01)
    seen = np.broadcast_to(tip_at(space, REACH, 0.1), (times.size, 1, 2 + space)).copy()
    seen[20:, 0, 0] += 0.02
    exp = Experiment("e", times, seen, ("tip",), "release", held=tip_at(space, REACH + 0.007, 0.3))
    assert held_note(model, exp, {}) == (
        "Experiment e: before its release the body is held beyond its reach, tip by 7 mm: check the length, the base, "
        "and the positions of the stations on the body."
    )
    assert held_note(model, exp, {"tip.along": 0.066}) == ""
    assert held_note(model, replace(exp, held=None), {}) == ""
