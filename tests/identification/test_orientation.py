"""Orientations of rigid bodies in a fit: rotation vectors against SciPy, derivatives against differences, twist."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_cases import LINKS, STEP, TIME, TRACES, arm

from pliant.errors import InputError
from pliant.identification import Parameter, experiment
from pliant.identification.experiment import Experiment
from pliant.identification.following import observed_rows
from pliant.identification.forward_model import forward_problem
from pliant.identification.observation import frames_of, rotation_vectors, slopes_through, turns_off, with_axes
from pliant.identification.problem import Problem
from pliant.mechanics import mechanics_of
from pliant.model import Space, Station
from pliant.preprocessing.align import align
from pliant.preprocessing.detectors import white_noise
from pliant.recording import make_recording
from pliant.simulation.forces import PointForce


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 0.3, 0.32, 1.5, 3.1])
def test_rotation_vectors_are_those_of_scipy_and_have_derivatives(rng, size):
    axis = rng.normal(0, 1, 3)
    vector = size * axis / np.linalg.norm(axis)
    R = Rotation.from_rotvec(vector).as_matrix()
    assert rotation_vectors(R) == pytest.approx(vector, abs=1e-12 if size < 3 else 1e-9)
    turn = rng.normal(0, 1, 3)
    dR = R @ np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    slope = rotation_vectors(R + 1e-20j * dR).imag / 1e-20
    ahead, behind = ((Rotation.from_matrix(R) * Rotation.from_rotvec(s * 1e-6 * turn)).as_rotvec() for s in (1, -1))
    assert slope == pytest.approx((ahead - behind) / 2e-6, rel=1e-5, abs=1e-6)


def test_half_a_turn_is_far_and_finite():
    off = rotation_vectors(Rotation.from_rotvec([[np.pi, 0, 0], [3.1415, 0, 0]]).as_matrix())
    assert np.isfinite(off).all()


def test_points_on_axes_show_the_frames_of_links(rng):
    chain = mechanics_of(arm(stations=[Station("a", 1, 0.02, 0.01, -0.02), Station("b", 2, 0.05, 0.0, 0.01)]))
    x = rng.normal(0, 0.4, chain.size)
    places, oriented = np.array([p[2:] for p in chain.model.points]).T, np.array([0, 1])
    links = [1, 2, 1, 2, 1, 2]
    points = [Station(f"p{k}", link, *row) for k, (link, row) in
              enumerate(zip(links, with_axes(places, oriented).T, strict=True))]  # fmt: skip
    rows = mechanics_of(chain.model.with_(stations=points)).stations(x)[0]
    expected = chain.posed(x).R[[2, 3]]
    assert frames_of(rows, oriented) == pytest.approx(expected, abs=1e-13)
    assert frames_of(rows * 1.7 + 0.3, oriented) == pytest.approx(expected, abs=1e-13)


def test_turns_since_the_first_frame_are_compared_in_the_measured_axes(rng):
    turns = [Rotation.from_rotvec(rng.normal(0, 0.4, (5, 3))) for _ in range(2)]
    first = Rotation.from_rotvec(rng.normal(0, 1, 3))
    frames = (turns[0] * turns[0][0].inv() * first).as_matrix()[:, None]
    place = rng.normal(0, 1, (5, 1, 3))
    rows = np.concatenate([place, place + frames[..., 2], place + frames[..., 0]], axis=1)
    off = turns_off(rows, np.array([0]), turns[1].as_matrix()[:, None])
    expected = (turns[1].inv() * (turns[0] * turns[0][0].inv())).as_rotvec()
    assert off[:, 0] == pytest.approx(expected, abs=1e-12)
    more = rng.normal(0, 1, (2, *rows.shape))
    slopes = slopes_through(
        partial(turns_off, oriented=np.array([0]), measured=turns[1].as_matrix()[:, None]), rows, more
    )
    for slope, change in zip(slopes, more, strict=True):
        ahead, behind = (turns_off(rows + s * 1e-6 * change, np.array([0]), turns[1].as_matrix()[:, None])
                         for s in (1, -1))  # fmt: skip
        assert slope == pytest.approx((ahead - behind) / 2e-6, abs=1e-7)


def test_white_noise_is_found_and_what_was_not_seen_has_none(rng):
    data = np.linspace(0, 1, 4000)[:, None, None] + rng.normal(0, [[0.1, 0.2], [0.3, 1.0]], (4000, 2, 2))
    data[:, 1, 1] = np.nan
    assert white_noise(data) == pytest.approx(np.array([[0.1, 0.2], [0.3, 1.0]]), rel=0.05)


def recorded(model, rng, noise=2e-3, **more):
    """The model's own motion as an experiment, with its orientations at the tip, turned by `noise` [rad]."""
    plain = Experiment("r", TIME, still(), ("mid", "tip"), "trace", drives=TRACES, forces=more.get("forces", ()))
    chain_rows = moved_rows(model, plain)
    turns = Rotation.from_matrix(tip_turns(model, plain)) * Rotation.from_rotvec(rng.normal(0, noise, (TIME.size, 3)))
    seen = np.full((TIME.size, 2, 4), np.nan)
    seen[:, 1] = turns.as_quat()
    position = chain_rows + rng.normal(0, 1e-4, chain_rows.shape)
    return Experiment("r", TIME, position, ("mid", "tip"), "trace", drives=TRACES, orientation=seen, **more)


def still():
    position = np.tile([0.0, 0.0, 0.1], (TIME.size, 2, 1))
    position[:, 1, 0] += np.linspace(0, 0.1, TIME.size)
    return position


def moved_rows(model, exp):
    made = forward_problem(model, exp, {}, STEP)
    return observed_rows(made, made.numbers, TIME.size)


def tip_turns(model, exp):
    """Rotations (T, 3, 3) of the last link since the first frame, by the three corners of a triangle on it."""
    corners = [Station("mid", LINKS - 1, 0.0), Station("tip", LINKS - 1, 0.05)]
    aside = [Station("mid", LINKS - 1, 0.0, 0.0, 0.05), Station("tip", LINKS - 1, 0.0, 0.05, 0.0)]
    start, end = np.moveaxis(moved_rows(model.with_(stations=corners), exp), 1, 0)
    x, across = np.moveaxis(moved_rows(model.with_(stations=aside), exp), 1, 0)
    frames = np.stack([x - start, start - across, end - start], axis=-1) / 0.05
    return frames @ frames[0].T


TWIST = PointForce(np.zeros(1), np.array([[0.0, 0.5, 0.0]]), Station("hand", LINKS - 1, 0.05, 0.0, 0.04))
FEW = {"stiffness": 0.55, "stiffness_ratio": 1.3, "twist_ratio": 0.8, "red.gain_x": 1.05, "base_tilt_x": 0.03,
       "sensor_lag": 0.02, "latency": 3e-3}  # fmt: skip


@pytest.mark.slow  # compiles the motion on dual numbers
def test_derivatives_are_those_of_differences(rng):
    exp = recorded(arm(), rng, own_places=True)
    parameters = [Parameter(name, value, scale=abs(value)) for name, value in FEW.items()]
    problem = Problem([exp], arm(), parameters, STEP, "noise")
    J = problem.data_jacobian(problem.start)
    turns = problem.observed[0].station == 2
    assert turns.sum() == 3 * TIME.size
    for k in range(len(FEW)):
        e = 1e-5 * np.eye(len(FEW))[k]
        slope = (problem.data_residual(problem.start + e) - problem.data_residual(problem.start - e)) / 2e-5
        assert np.abs(J[:, k] - slope).max() <= 1e-5 * np.abs(slope).max(), problem.free[k].name
        assert np.abs(J[turns, k]).max() > 0.0, problem.free[k].name
    problem.learn_sizes(problem.start)
    scaled = problem.data_residual(problem.start)[turns]
    assert np.sqrt(np.mean(scaled**2)) == pytest.approx(1.0)


@pytest.mark.slow
def test_an_orientation_shows_the_twist_that_points_on_the_axis_hide(rng):
    """A known force beside the axis twists the arm; standard errors of the torsional stiffness, with and without."""
    model = arm(stations=[Station("mid", 1, 0.04), Station("tip", 2, 0.05)], space=Space(twist_ratio=0.7, radius=0.02))
    exp = recorded(model, rng, forces=(TWIST,))
    errors = []
    for orientation in (exp.orientation, None):
        seen = Experiment("r", TIME, exp.position, exp.stations, "trace", drives=TRACES, forces=(TWIST,),
                          orientation=orientation)  # fmt: skip
        free = [Parameter(n, v, scale=abs(v)) for n, v in (("stiffness", 0.5), ("twist_ratio", 0.7))]
        J = Problem([seen], model, free, STEP, "noise").data_jacobian(np.ones(2))
        errors.append(np.sqrt(np.linalg.inv(J.T @ J)[1, 1]))
    assert errors[0] < 0.03
    assert errors[1] > 3 * errors[0]


def test_an_experiment_takes_orientations_of_an_aligned_recording(rng):
    time, angle = np.linspace(0, 1, 40), 0.4 * np.sin(np.linspace(0, 6, 40))
    angle[:8] = 0.0
    turn = Rotation.from_rotvec(np.outer(angle, [1.0, 0.5, 0.2]))
    tip = 0.2 * turn.as_matrix()[:, :, 2]
    position = np.stack([np.zeros((40, 3)), tip], axis=1)
    quaternion = np.stack([np.tile([0.0, 0.0, 0.0, 1.0], (40, 1)), turn.as_quat()], axis=1)
    raw = make_recording(time, position, station=["base", "tip"], quaternion=quaternion, pressure=1e4 * time)
    seen = align(raw, space=True, base="base", tangent="+z", rest=(0.0, 0.15))
    exp = experiment("r", seen, stations=("tip",), angles=True)
    assert exp.oriented.tolist() == [0]
    angles = Rotation.from_quat(exp.orientation[:, 0]).magnitude()
    assert angles == pytest.approx(turn.magnitude(), abs=1e-9)
    with pytest.raises(InputError, match="has no orientations to fit"):
        experiment("r", seen.drop_vars("quaternion"), stations=("tip",), angles=True)


@pytest.mark.parametrize(("more", "sentence"), [
    ({"orientation": np.zeros((TIME.size, 2, 3))}, r"must be \(time, station, 4\)"),
    ({"orientation": np.zeros((TIME.size, 2, 4))}, "unit quaternions"),
    ({"orientation_noise": -1.0}, "noise levels must be positive"),
])  # fmt: skip
def test_what_is_no_orientation_is_refused(more, sentence):
    with pytest.raises(InputError, match=sentence):
        Experiment("r", TIME, still(), ("mid", "tip"), "trace", drives=TRACES, **more)
    flat = still()[..., 1:]
    with pytest.raises(InputError, match="for a planar one give angles"):
        Experiment("r", TIME, flat, ("mid", "tip"), "trace", drives=TRACES, orientation=np.zeros((TIME.size, 2, 4)))
