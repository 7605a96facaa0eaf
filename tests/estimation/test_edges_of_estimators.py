"""Parts of the estimators at their edges: loops in plain text, points between tips, levels of noise, defaults."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.estimation import adaptive_observer, kalman_loops
from pliant.estimation.adaptive_observer import AdaptiveObserver
from pliant.estimation.contract import Frame
from pliant.estimation.link_angles import LinkTips, with_rest_shape
from pliant.estimation.noise import Noise, default_noise
from pliant.estimation.symbols import FilterNoise, FilterState
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Memory, Model

SIZES = {"link_length": [0.1, 0.2], "link_mass": [0.02, 0.03], "stiffness": [1.0, 3.0], "damping": 0.01}
BODY = Model(**SIZES, torque=[1e-6], base_length=0.05, base_angle=0.2)


class Predicted:
    """A prediction whose Jacobian is given, in plain text, and what it was asked."""

    def __init__(self, monkeypatch, J, turns, n):
        self.asked = {}
        N = 3 * n
        self.work = SimpleNamespace(
            J=J, W=np.empty((N, N)), G=np.empty(2 * n), slopes=None, phi=np.empty(n), w=np.empty(n), held=None,
            work=SimpleNamespace(tau=np.zeros(n)),
        )
        self.joints = SimpleNamespace(K=np.array([2.0, 4.0, 5.0])[:turns], theta0=np.array([0.1, 0.2, 0.3])[:turns],
                                      hardening=np.zeros((2, turns)), unloaded=np.zeros(turns),
                                      spin=np.zeros(1))  # fmt: skip

        def step_jacobian(phi, w, h, tau, body, springs, slopes):
            self.asked.update(tau=tau.copy(), theta0=springs.theta0.copy(), body=body)
            phi += h * w

        monkeypatch.setattr(kalman_loops, "step_jacobian", step_jacobian)

    def run(self, state, h, torque, noise):
        model = (np.ones((1, 3)), "body", self.joints, None, False)
        return kalman_loops.predict(state, model, h, torque, noise, self.work)


def test_a_prediction_moves_state_and_covariance_and_recalls_the_motion(rng, monkeypatch):
    """A disturbance adds to the torque of its joint, or of the strain behind the joints."""
    n, turns, h = 3, 2, 0.01
    J = rng.normal(size=(3 * n, 2 * n))
    made = Predicted(monkeypatch, J, turns, n)
    state = (np.zeros(n), np.array([1.0, -2.0, 30.0]), np.array([0.4, 0.8, 7.0]), np.eye(3 * n), np.zeros((n, 0)))
    noise = FilterNoise(np.full(n, 0.3), np.zeros(1), np.full(n, 0.5), 2.0, np.zeros(1))
    assert made.run(state, h, np.array([0.1, 0.2, 0.3]), noise) == 0
    np.testing.assert_allclose(made.asked["tau"], [0.1 + 0.4, 0.2 + 0.8, 0.3 + 7.0])
    np.testing.assert_allclose(made.asked["theta0"], [0.1, 0.2])
    power = (1.0 + (-2.0 - 1.0) ** 2) / 2  # of the two joints alone
    assert noise.recent[0] == pytest.approx(power)
    F = np.eye(3 * n)
    F[: 2 * n] = J.T
    torques = J[2 * n :].T
    expected = F @ F.T
    expected[: 2 * n, : 2 * n] += 0.3 / h * torques @ torques.T
    expected[2 * n :, 2 * n :] += 0.5 * (1.0 + 2.0 * power) * h * np.eye(n)
    np.testing.assert_allclose(state[3], expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(state[0], h * state[1])


@pytest.mark.parametrize(("rate", "good"), [(99.9, True), (-99.9, True), (100.1, False), (-100.1, False),
                                            (np.nan, False)])  # fmt: skip
def test_a_step_in_which_a_link_turns_by_a_radian_fails(rng, monkeypatch, rate, good):
    n = 3
    made = Predicted(monkeypatch, rng.normal(size=(3 * n, 2 * n)), n, n)
    state = (np.zeros(n), np.array([0.0, 0.0, rate]), np.zeros(n), np.eye(3 * n), np.zeros((n, 0)))
    noise = FilterNoise(np.ones(n), np.zeros(1), np.ones(n), 0.0, np.zeros(1))
    assert (made.run(state, 0.01, np.zeros(n), noise) == 0) is good


def test_steps_of_a_span_end_where_one_fails(monkeypatch):
    results = iter([0, 0, -1])
    monkeypatch.setattr(kalman_loops, "predict", lambda *_: next(results))
    span = SimpleNamespace(steps=2, h=0.01, torque=None, noise=None)
    assert kalman_loops.predict_span(None, None, span, None) == 0
    span.steps = 5
    assert kalman_loops.predict_span(None, None, span, None) == -1
    calls = []
    monkeypatch.setattr(kalman_loops, "predict_span", lambda *_: calls.append("predict"))
    monkeypatch.setattr(kalman_loops, "update", lambda *_: calls.append("update"))
    kalman_loops.many_frames(3, None, None, None, None, None)
    assert calls == ["predict", "update"] * 3


def test_a_record_holds_each_prediction_estimate_and_transition(rng, monkeypatch):
    """Each step adds its length to all angles, each frame its first value; the transition is the product of steps."""
    n, frames = 2, 4
    N, J = 3 * n, rng.normal(size=(3 * n, 2 * n)) * 0.3
    state = FilterState(np.zeros(n), np.zeros(n), np.zeros(n), np.eye(N), np.zeros((n, 0)))

    def predict(state, model, h, torque, noise, workspace):
        state.angle[:] += h
        state.covariance[:] += torque
        noise.recent[0] = 10 * h
        return -1 if h > 1.0 else 0

    def update(state, model, frame, workspace):
        state.rate[:] += frame.values[0]
        state.disturbance[:] = (7.0, 8.0)
        state.covariance[:] *= 0.5
        return 2, frame.values[1], 0.25

    monkeypatch.setattr(kalman_loops, "predict", predict)
    monkeypatch.setattr(kalman_loops, "update", update)
    values = np.arange(8.0).reshape(frames, 2)
    seen = SimpleNamespace(values=values, base_angle=0.0, chain=None, wide=4, rows=None, variance=None)
    h, torque, begin = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]), np.array([0, 0, 2, 3, 3])
    shapes = {"predicted": (N,), "estimate": (N,), "predicted_covariance": (N, N), "covariance": (N, N),
              "transition": (N, N), "innovation": (2,), "score": (4,)}  # fmt: skip
    out = SimpleNamespace(**{k: np.full((frames, *s), np.nan) for k, s in shapes.items()})
    noise = SimpleNamespace(recent=np.zeros(1))
    work = SimpleNamespace(J=J, W=np.empty((N, N)))
    assert kalman_loops.filter_record(state, None, (h, torque, begin), noise, seen, out, work) == -1
    np.testing.assert_allclose(out.predicted[:, 0], [0.0, 0.3, 0.6, 0.6])
    np.testing.assert_allclose(out.predicted[:, n], [0.0, 0.0, 2.0, 6.0])
    np.testing.assert_allclose(out.estimate[:, 2 * n - 1], [0.0, 2.0, 6.0, 12.0])
    np.testing.assert_allclose(out.estimate[:, 2 * n :], np.tile([7.0, 8.0], (frames, 1)))
    np.testing.assert_allclose(out.predicted[0, 2 * n :], 0.0)
    np.testing.assert_allclose(out.predicted_covariance[:, 0, 1], [0.0, 3.0, 4.5, 2.25])
    np.testing.assert_allclose(out.covariance, 0.5 * out.predicted_covariance)
    np.testing.assert_allclose(out.score, [[2, 1, 0.25, 0], [2, 3, 0.25, 2], [2, 5, 0.25, 3], [2, 7, 0.25, 3]])
    F = np.eye(N)
    F[: 2 * n] = J.T
    for k, whole in enumerate((np.eye(N), F @ F, F, np.eye(N))):
        np.testing.assert_allclose(out.transition[k], whole, rtol=1e-12, atol=1e-14)
    h[2] = 2.0
    assert kalman_loops.filter_record(state, None, (h, torque, begin), noise, seen, out, work) == 2


# points and tips


def test_a_tip_divides_its_neighbours_as_it_divides_the_body():
    """Interpolated between points, and carried on along the last two where the body ends up to 2 mm beyond them."""
    arc = np.array([0.0, 0.06, 0.13, 0.16, 0.34, 0.349])
    places = LinkTips(BODY, arc, 2e-4)
    points = np.random.default_rng(2).normal(size=(3, arc.size, 2))
    found = places.tips(points)
    for k in range(2):
        x = points[..., k]
        np.testing.assert_allclose(found[:, 0, k], x[:, 2] + (x[:, 3] - x[:, 2]) * 2 / 3)  # 150 between 130, 160 mm
        np.testing.assert_allclose(found[:, 1, k], x[:, 4] + (x[:, 5] - x[:, 4]) * 10 / 9)
    frame = places.frame(points[0])
    assert isinstance(frame, Frame)
    np.testing.assert_allclose(frame.values, found[0].ravel())
    np.testing.assert_allclose(frame.variance, np.full(4, 4e-8))
    with pytest.raises(InputError, match=r"a shape must have 6 points, \(x, y\) each, got \(5, 2\)"):
        places.frame(points[0, 1:])


@pytest.mark.parametrize(
    ("arc", "good"),
    [
        ([0.15, 0.35], True),
        ([0.15, 0.3485], True),
        ([0.15, 0.347], False),
        ([0.151, 0.35], False),
        ([0.1, 0.2, 0.2, 0.35], False),
        ([0.1, 0.3, 0.2, 0.35], False),
        ([[0.1, 0.35]], False),
        ([0.35], False),
    ],
)
def test_points_increase_and_cover_the_tips(arc, good):
    if good:
        assert LinkTips(BODY, arc).rows.shape == (4, 4)
        return
    with pytest.raises(InputError, match=r"cover 150 to 350 mm, got"):
        LinkTips(BODY, arc)


def test_rest_angles_bring_the_links_to_their_tips():
    """Less what the joints are turned by already; a body may wind up by more than half a turn."""
    model = Model(link_length=[0.1] * 5, link_mass=0.01, stiffness=1.0, damping=0.01, torque=[1e-6], base_length=0.05,
                  base_angle=0.3)  # fmt: skip
    turn, loose = np.array([0.5, 1.1, 1.3, 0.9, 1.2]), np.array([0.1, -0.2, 0.3, 0.0, 0.05])
    angle = 0.3 + np.cumsum(turn)
    steps = 0.1 * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    tips = 0.05 * np.array([-np.sin(0.3), np.cos(0.3)]) + np.cumsum(steps, axis=0)
    np.testing.assert_allclose(mechanics_of(model).with_rest_shape(loose, tips).rest_angle, turn - loose, atol=1e-12)


def test_a_rest_takes_five_whole_frames_and_their_scatter():
    frames = np.tile(np.array([[0.0, 0.0], [0.0, 0.15], [0.0, 0.35]]), (6, 1, 1))
    frames[:, :, 0] += np.array([1, -1, 1, -1, 0, 0])[:, None] * 1e-3
    frames[5, 1, 0] = np.nan
    straight = BODY.with_(base_angle=0.0, base_length=0.05)
    model, places = with_rest_shape(straight, [0.0, 0.15, 0.35], frames)
    np.testing.assert_allclose(model.rest_angle, 0.0, atol=1e-9)
    spread = 1e-3 * np.sqrt(4 / 5)  # of x; y does not move
    np.testing.assert_allclose(places.frame(frames[0]).variance, (spread / 2) ** 2)
    with pytest.raises(InputError, match="needs at least 5 complete frames, got 4 of 5"):
        with_rest_shape(straight, [0.0, 0.15, 0.35], frames[1:])
    _, still = with_rest_shape(straight, [0.0, 0.15, 0.35], np.tile(frames[4], (5, 1, 1)))
    np.testing.assert_allclose(still.frame(frames[0]).variance, 1e-10)


# noise


def test_what_drives_a_strain_is_as_uncertain_in_parts_of_its_stiffness():
    """A strain of a segment is held by EA L, joints by their springs; both in parts of the joints' mean stiffness."""
    model = BODY.with_(extensions=(Extension(50.0),))
    size = np.array([1.0, 1.0, 50.0 * 0.35 / 2.0])
    noise = Noise(torque=3e-3, random_walk=4e-3, pressure=10.0, motion_growth=6.0, initial_disturbance=0.5)
    own, common, walk, growth = noise.densities(model)
    np.testing.assert_allclose(own, 9e-6 * size**2)
    np.testing.assert_allclose(walk, 16e-6 * size**2)
    np.testing.assert_allclose(common, [(1e-6 * 10.0) ** 2])
    assert growth == 6.0
    levels = np.concatenate([np.full(3, 0.05), np.full(3, 0.2), 0.5 * size])
    np.testing.assert_allclose(noise.initial(model), np.diag(levels**2))
    assert noise.states(model) == 9
    assert Noise(initial_disturbance=0.1).states(model) == Noise(random_walk=0.1).states(model) == 9
    assert Noise().states(model) == 6


def test_noise_by_default_grows_with_the_springs():
    soft, stiff = (default_noise(BODY.with_(stiffness=k)) for k in (1.0, 2.0))
    for name in ("torque", "random_walk", "initial_disturbance"):
        assert getattr(stiff, name) == pytest.approx(2 * getattr(soft, name)) != 0
    assert (soft.motion_growth, soft.position) == (stiff.motion_growth, stiff.position)
    alone = default_noise(BODY, disturbance=False)
    assert alone.states(BODY) == 4
    assert alone.torque > default_noise(BODY).torque


# the observer


def test_an_observer_of_defaults_takes_steps_of_two_milliseconds_and_the_pressure_at_hand(monkeypatch):
    monkeypatch.setattr(adaptive_observer, "twin", lambda *_: None)  # nothing runs
    body = BODY.with_(base_length=0.0, memory=Memory(slip_share=(0.3,), slip_angle=(0.02,)))
    for period, parts in ((0.01, 5), (0.011, 6), (0.001, 1)):
        made = AdaptiveObserver(body, period)
        assert (made.pace.parts, made.pace.h) == (parts, pytest.approx(period / parts))
    assert made.body.instantaneous == pytest.approx(0.3)
    assert len(made._waiting) == 0
    assert AdaptiveObserver(body, 0.01, late=2, share=0.5).body.instantaneous == pytest.approx(0.15)
    np.testing.assert_allclose(made.inputs(np.zeros(2))[0], 1)
    assert made.scale == 1.0


ALONE = """
import numpy as np
from pliant.actuators import chen2018
from pliant.estimation.adaptive_observer import AdaptiveObserver
from pliant.estimation.link_angles import joint_rows
model = chen2018.model(stiffening=-0.3, stiffening_bound=0.6)
observer, rows = AdaptiveObserver(model, 4e-3), joint_rows(model)
for k in range(3):
    observer.push_pressure(4e-3 * k, 2e4)
    observer.push_frame(4e-3 * k, rows, np.zeros(model.n), np.full(model.n, 4e-6))
print(np.isfinite(observer._x).all() and bool(observer._x[0].any()) and not observer.fault)
"""


def test_an_observer_of_bounded_springs_needs_no_code_of_others():
    """In a process that has simulated nothing else: machine code of a step is shared within a process."""
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "True", done.stderr
