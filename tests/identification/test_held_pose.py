"""The pose of a body that is held, from its points: poses in closed form, SciPy, and points that allow two poses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from pliant.identification.forward_model import pose_through, solved_pose
from pliant.mechanics import mechanics_of
from pliant.model import Model, Space, Station, chain_model

Array = np.ndarray
BODY = {"length": 0.3, "mass": 0.1, "stiffness": 0.1, "damping": 0.01, "torque": [1e-6]}
TRUNK = chain_model(**BODY, links=3, joint_placement="midsegment", space=True)
DISKS = [Station("a", 0, 0.03, 0.0, 0.0), Station("b", 1, 0.03, 0.0, 0.005), Station("c", 2, 0.045, 0.03, 0.02)]
HELD = np.array([[0.0, -0.012, 0.078], [-0.010, -0.060, 0.158], [-0.021, -0.156, 0.218]])  # m, of the three disks
ALSO_HELD = np.array([[0.012, -0.026, 0.057], [0.062, -0.109, 0.072], [0.146, -0.190, 0.076]])
BENT = np.array([[-0.001, -0.009, 0.079], [-0.013, -0.049, 0.156], [-0.089, -0.137, 0.165]])


def distances(q: Array, model: Model, stations: list[Station], positions: Array) -> Array:
    chain = mechanics_of(model.with_(stations=tuple(stations)))
    return np.asarray(chain.stations(chain.coordinates(q))[0] - positions).ravel()


def improbable(q: Array, positions: Array) -> float:
    """-2 log of the probability of a pose, less a constant: errors of one unknown size, and a normal prior of 0.9 rad
    divided by the root of 3 joints.
    """
    squares = float(np.sum(distances(q, TRUNK, DISKS, positions) ** 2))
    return positions.size * np.log(squares) + float(np.sum((q / 0.9) ** 2)) * 3


def minimum(start: Array, model: Model, positions: Array) -> Array:
    """SciPy's pose of least squared distances near `start`, which must be close to it."""
    best = least_squares(distances, start, args=(model, DISKS, positions), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(best.x - start).max() < 0.05
    return np.asarray(best.x)


@pytest.mark.parametrize(
    ("positions", "right", "wrong"),
    [
        (HELD, [0.37, -0.01, 0.64, -0.49, -0.65, 0.59], [0.44, -0.21, 0.28, 0.43, 0.10, -1.25]),
        (ALSO_HELD, [1.16, 0.58, 0.32, 0.22, -1.22, 0.16], [1.30, 0.57, -0.28, 0.17, -0.09, 0.28]),
        (BENT, [0.31, 0.08, 0.54, -1.07, 0.25, -0.17], [0.21, -0.08, 1.04, -0.32, -0.55, -1.34]),
    ],
    ids=["closer and less bent", "closer, more bent", "as close, less bent"],
)
def test_of_two_poses_that_fit_the_points_the_more_probable_one_is_found(
    positions: Array,
    right: list[float],
    wrong: list[float],
) -> None:
    best, other = minimum(np.array(right), TRUNK, positions), minimum(np.array(wrong), TRUNK, positions)
    assert improbable(best, positions) < improbable(other, positions) - 1.0
    np.testing.assert_allclose(solved_pose(TRUNK, DISKS, positions), best, atol=1e-6)


def test_a_changed_rest_angle_changes_the_pose_little() -> None:
    """The search from the unloaded shape without a penalty jumps by 1.9 rad near -0.085 rad."""
    turns, poses = np.zeros((3, 3)), []
    for turn in np.arange(-0.094, -0.076, 2e-3):
        turns[1, 1] = turn
        poses.append(solved_pose(TRUNK.with_(space=Space(rest_turn=turns)), DISKS, HELD))
    assert 1e-3 < np.abs(np.diff(poses, axis=0)).max() < 1e-2


@pytest.mark.parametrize("links", [3, 6])
@pytest.mark.parametrize("space", [True, False], ids=["space", "plane"])
def test_points_without_error_give_the_pose_itself(space: bool, links: int) -> None:
    model, rng = chain_model(**BODY, links=links, space=space), np.random.default_rng(links)
    for _ in range(8):
        across, aside = 0.015 * rng.normal(size=(2, links))
        stations = [Station(f"s{i}", i, 0.6 * float(model.link_length[i]), across[i], space * aside[i])
                    for i in range(links)]  # fmt: skip
        q = 0.6 * rng.normal(size=model.size) / np.sqrt(links / 3)
        positions = distances(q, model, stations, np.array(0.0)).reshape(links, -1)
        np.testing.assert_allclose(solved_pose(model, stations, positions), q, atol=1e-8)


@pytest.mark.parametrize("angle", [0.1, 0.4, -0.7])
def test_of_the_two_poses_of_an_elbow_the_less_bent_one_is_found(angle: float) -> None:
    """Two equal links bent by b reach the same point with angles (a, b) and (a + b, -b)."""
    model, bend = chain_model(**BODY, links=2), 0.6
    tip = [model.points[-1]]
    q = np.array([angle, bend])
    other = np.array([angle + bend, -bend])
    positions = distances(q, model, tip, np.array(0.0)).reshape(1, 2)
    np.testing.assert_allclose(distances(other, model, tip, positions), 0.0, atol=1e-12)
    less = min((q, other), key=lambda pose: float(np.linalg.norm(pose)))
    np.testing.assert_allclose(solved_pose(model, tip, positions), less, atol=1e-8)


def test_a_pose_is_searched_once_and_followed_over_small_changes() -> None:
    cache: dict[object, Array] = {}
    first = pose_through(TRUNK, DISKS, HELD, cache)
    first[:] = 9.0
    best = solved_pose(TRUNK, DISKS, HELD)
    np.testing.assert_array_equal(pose_through(TRUNK, DISKS, HELD, cache), best)
    size = len(cache)
    for change in (1e-6, 0.01):  # followed, and searched again
        moved = solved_pose(TRUNK, DISKS, HELD + change)
        np.testing.assert_allclose(pose_through(TRUNK, DISKS, HELD + change, cache), moved, atol=1e-11)
        assert np.abs(moved - best).max() > change
    assert len(cache) == size + 2
