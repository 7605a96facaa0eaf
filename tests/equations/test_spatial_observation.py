"""What a filter sees of a chain in space: positions, and orientations by rotation vectors, against SciPy."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.compiler.twin import rebuild
from pliant.equations import spatial_observation
from pliant.equations.observation import ALONG_X, ALONG_Y, ALONG_Z, TURN_X, TURN_Y, TURN_Z, observe_rows
from pliant.equations.spatial_observation import angle_over_sine, tilt
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Space, Station, chain_model

TURNS, AXES = (TURN_X, TURN_Y, TURN_Z), (ALONG_X, ALONG_Y, ALONG_Z)


@pytest.fixture
def chain(rng):
    space = Space(twist_ratio=0.7, radius=0.01, rest_turn=rng.normal(0, 0.3, (3, 3)), base_tilt=(0.2, -0.1))
    return mechanics_of(chain_model(
        length=0.15, mass=0.06, links=3, stiffness=1.2, damping=6e-3, space=space, stations=[Station("a", 1, 0.02)],
        torque=(1e-6,), extensions=(Extension(60.0, 0.05, 0.0, None, "all"),),
    ))  # fmt: skip


def observed(chain, x, rows, values):
    """By the plain text of the rows, with the links of a chain in space as its compiled form has them."""
    own = {"place_links": spatial_observation.place_links, "look": spatial_observation.look}
    plain, body = rebuild(observe_rows, lambda kernel: kernel, own), chain.observed
    seen, H = np.empty(len(rows)), np.full((len(rows), chain.size), np.nan)
    frame = SimpleNamespace(rows=rows, wide=5, values=values, chain=body, base_angle=0.0)
    with np.errstate(invalid="ignore"):  # a missing orientation
        plain(x, frame, chain.sight(np.complex128), seen, H)
    return seen, H


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.4, 1.6, 3.0, 3.14])
def test_an_angle_over_its_sine(angle):
    expected = angle / np.sin(angle) if angle else 1.0
    assert angle_over_sine(np.cos(angle)) == pytest.approx(expected, rel=1e-9 if angle > 3.1 else 1e-12)


@pytest.mark.parametrize("angle", [1e-3, 0.4, 1.5, 3.0])
def test_a_tilt_is_the_angle_from_the_axis(angle):
    z = np.array([np.sin(angle) * np.cos(0.7), np.sin(angle) * np.sin(0.7), np.cos(angle)])
    assert tilt(z) == pytest.approx(angle, rel=1e-6)


def test_a_position_is_that_of_the_mechanics_and_so_are_its_slopes(chain, rng):
    x, point = rng.normal(0, 0.3, chain.size), Station("a", 1, 0.02, 0.01, -0.005)
    rows = np.array([[kind, point.link, point.along, point.across, point.aside] for kind in AXES])
    chain = mechanics_of(chain.model.with_(stations=[point]))
    seen, H = observed(chain, x, rows, np.zeros(3))
    assert seen == pytest.approx(chain.stations(x)[0][0], abs=1e-15)
    ends = [(chain.stations(x + s)[0][0] - chain.stations(x - s)[0][0]) / 2e-6 for s in 1e-6 * np.eye(chain.size)]
    assert pytest.approx(np.array(ends).T, abs=1e-9) == H


@pytest.mark.parametrize("off", [0.0, 1e-6, 0.03, 0.8, 1.5])
def test_the_residual_of_an_orientation_is_a_rotation_vector_with_its_slopes(chain, rng, off):
    """From the link to the measured frame, in fixed axes, as SciPy has it; slopes by differences of SciPy's."""
    x = rng.normal(0, 0.4, chain.size)
    for link in range(3):
        rows = np.array([[kind, link, 0.0, 0.0, 0.0] for kind in TURNS])
        axis = rng.normal(0, 1, 3)
        measured = Rotation.from_rotvec(off * axis / np.linalg.norm(axis)) * frame(chain, x, link)
        value = measured.as_rotvec()
        seen, H = observed(chain, x, rows, value)

        def residual(x, link=link, measured=measured):
            return (measured * frame(chain, x, link).inv()).as_rotvec()

        assert value - seen == pytest.approx(residual(x), abs=1e-13)
        ends = [(residual(x - s) - residual(x + s)) / 2e-5 for s in 1e-5 * np.eye(chain.size)]
        assert pytest.approx(np.array(ends).T, abs=1e-6) == H


def frame(chain, x, link):
    return Rotation.from_matrix(chain.posed(x).R[link + 1])


def test_the_sign_of_a_quaternion_plays_no_part_and_a_flip_is_not_seen(chain, rng):
    x = rng.normal(0, 0.4, chain.size)
    rows = np.array([[kind, 2, 0.0, 0.0, 0.0] for kind in TURNS])
    off = [Rotation.from_rotvec(a * np.array([0.6, 0.0, 0.8])) * frame(chain, x, 2) for a in (1.56, 1.58, np.pi)]
    seen = [observed(chain, x, rows, turn.as_rotvec())[0] for turn in off]
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1:]).all()
    assert np.isnan(observed(chain, x, rows, off[0].as_rotvec() * [1, np.nan, 1])[0]).all()
    other = Rotation.from_quat(-off[0].as_quat()).as_rotvec()
    assert observed(chain, x, rows, other)[0] == pytest.approx(seen[0], abs=1e-14)
