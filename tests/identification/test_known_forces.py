"""A thread that pulls at a known point: held to least energy, to a pendulum that SciPy integrates, to differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from pliant.errors import InputError
from pliant.identification import Experiment, fit, predict, sensitivities
from pliant.model import Extension, Memory, Model, Station
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce, integral

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIMES = np.arange(0.0, 0.8, 0.01)
L, MASS, K, D = np.array([0.06, 0.05]), np.array([0.02, 0.015]), np.array([0.5, 0.4]), np.array([2e-3, 1e-3])
THREAD = PointForce(np.array([0.1, 0.15, 0.5, 0.5]), np.array([[0, 0], [0.6, -0.4], [0.6, -0.4], [0, 0]]), "knot")
ALONG, ACROSS = 0.04, 0.012


def pendulum(**changes: Any) -> Model:
    """Two links with their masses at their tips, springs and dampers, and a knot beside the second link."""
    entries: dict[str, Any] = {
        "link_length": L, "link_mass": MASS, "stiffness": K, "damping": D, "torque": [1e-6], "mass_at": "tip",
        "rest_angle": [0.2, -0.1], "stations": (Station("knot", 1, ALONG, ACROSS), Station("tip", 1, L[1])),
    }
    return Model(**entries | changes)


def under(force: PointForce, model: Model, times: np.ndarray = TIMES, pressure: float = 0.0) -> Experiment:
    """An experiment in which the force is all that happens; what was seen does not matter here."""
    seen = np.cumsum(np.ones((times.size, 2, 2)), axis=0)
    return Experiment("it", times, seen, ("knot", "tip"), "trace", Trace([0.0], [pressure]), forces=(force,))


def places(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knot and tip at joint angles q, from the drawing: links point along (-sin, cos), left of them is (-cos, -sin)."""
    one, two = 0.2 + q[0], 0.1 + q[0] + q[1]
    joint = L[0] * np.array([-np.sin(one), np.cos(one)])
    ahead, left = np.array([-np.sin(two), np.cos(two)]), np.array([-np.cos(two), -np.sin(two)])
    return joint + ALONG * ahead + ACROSS * left, joint + L[1] * ahead


@pytest.mark.parametrize("pressure", [0.0, 8e4])
def test_a_constant_force_holds_the_body_where_its_energy_is_least(pressure: float) -> None:
    model, f = pendulum(), np.array([0.7, -0.9])
    steady = PointForce(np.zeros(1), f[None], "knot")

    def energy(q: np.ndarray) -> float:
        return float(0.5 * K @ q**2 - 1e-6 * pressure * q.sum() - f @ places(q)[0])

    least = minimize(energy, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-16}).x
    rows = predict(model, under(steady, model, pressure=pressure), {}, 2e-3)["position"]
    np.testing.assert_allclose(rows[0], places(least), atol=1e-7)
    np.testing.assert_allclose(rows[-1], rows[0], atol=1e-10)  # and it stays there


def test_a_body_that_lengthens_rests_under_a_force_where_its_energy_is_least() -> None:
    """Two segments, one of which holds the last link alone: 1/2 EA L e^2 each, and a knot that moves along."""
    ends = (Extension(9.0, 0.5, 0.0, L[0], "near"), Extension(6.0, 0.5, L[0], None, "far"))
    model, f = pendulum(extensions=ends), np.array([0.7, 0.9])
    steady = PointForce(np.zeros(1), f[None], "knot")

    def stretched(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        one, two = 0.2 + x[0], 0.1 + x[0] + x[1]
        joint = L[0] * (1.0 + x[2]) * np.array([-np.sin(one), np.cos(one)])
        ahead, left = np.array([-np.sin(two), np.cos(two)]), np.array([-np.cos(two), -np.sin(two)])
        return joint + ALONG * (1.0 + x[3]) * ahead + ACROSS * left, joint + L[1] * (1.0 + x[3]) * ahead

    def energy(x: np.ndarray) -> float:
        return float(0.5 * K @ x[:2] ** 2 + 0.5 * (np.array([9.0, 6.0]) * L) @ x[2:] ** 2 - f @ stretched(x)[0])

    least = minimize(energy, np.zeros(4), method="BFGS", options={"gtol": 1e-12}).x
    rows = predict(model, under(steady, model), {}, 2e-3)["position"]
    assert least[3] > 0.05
    np.testing.assert_allclose(rows[0], stretched(least), atol=1e-7)
    np.testing.assert_allclose(rows[-1], rows[0], atol=1e-9)


def swing(creep_share: float = 0.0, creep_time: float = 1.0) -> np.ndarray:
    """Knot and tip (T, 2, 2) of a double pendulum with springs under the thread, by SciPy; Lagrange's equations."""
    m1, m2 = MASS

    def force(t: float) -> np.ndarray:
        size = float(np.interp(t, [0.1, 0.15], [0.0, 1.0])) * (t < 0.5)
        return size * np.array([0.6, -0.4])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, dq, creep = y[:2], y[2:4], y[4:]
        a, w = 0.2 + q[0], dq[0]
        b, v = 0.1 + q[0] + q[1], dq[0] + dq[1]
        ahead = [np.array([-np.sin(x), np.cos(x)]) for x in (a, b)]
        left = [np.array([-np.cos(x), -np.sin(x)]) for x in (a, b)]
        joint = -K * q - creep_share * K * (q - creep) - D * dq
        f = force(t)
        torque = np.array([  # on the absolute angles: by virtual work of springs and thread
            joint[0] - joint[1] + L[0] * left[0] @ f, joint[1] + (ALONG * left[1] - ACROSS * ahead[1]) @ f,
        ])
        c, s = m2 * L[0] * L[1] * np.cos(a - b), m2 * L[0] * L[1] * np.sin(a - b)
        M = np.array([[(m1 + m2) * L[0] ** 2, c], [c, m2 * L[1] ** 2]])
        alpha = np.linalg.solve(M, torque + np.array([-s * v**2, s * w**2]))
        return np.concatenate([dq, [alpha[0], alpha[1] - alpha[0]], (q - creep) / creep_time])

    parts, y = [], np.zeros(6)
    for t0, t1 in ((0.0, 0.1), (0.1, 0.15), (0.15, 0.5), (0.5, 0.8)):  # the force bends or jumps between them
        at = TIMES[(t0 <= TIMES) & (t1 > TIMES)]
        inside = t1 - 1e-12
        done = solve_ivp(rate, (t0, inside), y, t_eval=np.append(at, inside), method="DOP853", rtol=1e-11, atol=1e-13)
        parts.append(done.y[:, :-1].T)
        y = done.y[:, -1]
    return np.array([places(q) for q in np.concatenate(parts)[:, :2]])


@pytest.mark.parametrize("creep", [None, (0.4, 0.1)])
def test_the_motion_under_a_thread_is_that_of_a_pendulum_to_second_order(creep: tuple[float, float] | None) -> None:
    model = pendulum(memory=Memory((creep[0],), (creep[1],))) if creep else pendulum()
    expected = swing(*creep) if creep else swing()
    steps = np.array([2e-3, 1e-3, 5e-4])
    wrong = [np.abs(predict(model, under(THREAD, model), {}, h)["position"] - expected).max() for h in steps]
    assert np.ptp(expected[:, 1], axis=0).max() > 0.02
    assert wrong[-1] < 2e-5
    order = np.polyfit(np.log(steps), np.log(wrong), 1)[0]
    assert 1.8 < order < 2.3


VALUES = {
    "stiffness_1": 0.5, "stiffness_2": 0.4, "damping": 2e-3, "torque_1": 1e-6, "joint_gain_2": 0.8, "latency": 0.0033,
    "knot.along": ALONG, "knot.across": ACROSS, "base_angle": 0.05, "rest_angle_2": -0.1, "tip_mass": 0.004,
    "gravity_angle": 2.9,
}
CREEP = {"creep_share_1": 0.4, "creep_time_1": 0.1}
AXIAL = {"axial_stiffness": 40.0, "axial_damping": 0.2, "axial_gain": 30.0}


@pytest.mark.parametrize("lengthens", [False, True])
@pytest.mark.parametrize("memory", [False, True])
@pytest.mark.parametrize("at_rest", [False, True])
def test_every_parameter_agrees_with_differences_under_a_thread(memory: bool, at_rest: bool, lengthens: bool) -> None:
    model = pendulum(gravity=[0.0, -9.81])
    if lengthens:
        model = model.with_(extensions=(Extension(40.0, 0.2),), base_length=0.01)
    force = replace_time(THREAD, -0.3) if at_rest else THREAD  # then it pulls before the first frame
    exp = under(force, model, pressure=6e4)
    values = VALUES | (CREEP if memory else {}) | (AXIAL if lengthens else {})
    for name, value in values.items():
        _, slopes = sensitivities(model, exp, values, {name: abs(value)}, 1e-3)
        d = 2e-5 * abs(value)
        high, low = (predict(model, exp, {**values, name: value + side * d}, 1e-3)["position"] for side in (1, -1))
        expected = (high - low) / (2 * d)
        assert np.abs(slopes[0, ..., :2] - expected).max() < 5e-6 * np.abs(expected).max(), name


def replace_time(force: PointForce, by: float) -> PointForce:
    return force._replace(time=force.time + by)


def test_known_pushes_tell_the_gain_of_each_joint_from_its_stiffness() -> None:
    """The mass is unknown too: no frequency fixes the stiffness, only the known force has newtons in it."""
    truth = pendulum(joint_gain=[1.2, 0.8], stations=(Station("mid", 0, L[0]), Station("tip", 1, L[1])))
    pushes = PointForce(np.array([0.1, 0.12, 0.3, 0.32]), np.array([[0, 0], [-0.8, 0.0], [-0.8, 0.0], [0, 0]]), "tip")
    trace = Trace([0.45, 0.47, 0.75, 0.76], [0.0, 8e4, 8e4, 0.0])
    times = np.arange(0.0, 1.2, 0.01)
    exp = Experiment("it", times, np.cumsum(np.ones((times.size, 2, 2)), axis=0), ("mid", "tip"), "trace", trace,
                     forces=(pushes,))  # fmt: skip
    noise = 5e-5 * np.random.default_rng(2).standard_normal((times.size, 2, 2))
    seen = predict(truth, exp, {}, 1e-3)["position"] + noise
    free = ["stiffness_*", "damping_*", "joint_gain_*", "torque_1", "mass"]
    start = truth.with_(stiffness=0.7, damping=3e-3, torque=[1.4e-6], joint_gain=1.0, link_mass=1.3 * MASS)
    found = fit([replace(exp, position=seen)], start, free, time_step=1e-3, starts=1)
    expected = {
        "stiffness_1": 0.5, "stiffness_2": 0.4, "joint_gain_1": 1.2, "joint_gain_2": 0.8, "torque_1": 1e-6,
        "mass": MASS.sum(),
    }
    for p in found.parameters:
        if p.name in expected:
            assert p.std < 0.05 * p.value, p
            assert abs(p.value - expected[p.name]) < 4 * p.std, p


def test_the_impulse_of_a_force_is_exact_between_and_beyond_its_times() -> None:
    force = PointForce(np.array([1.0, 2.0, 2.0, 4.0]), np.array([[1.0, 0.0], [3.0, 0], [5.0, 0], [1.0, 0]]), "tip")
    at = np.array([0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0])
    np.testing.assert_allclose(integral(force, at)[:, 0], [-1.0, 0.0, 0.75, 2.0, 6.0, 8.0, 10.0], atol=1e-15)


@pytest.mark.parametrize(("force", "sentence"), [
    (PointForce(np.zeros(2), np.zeros((1, 2)), "tip"), "needs one row .fx, fy. for each time"),
    (PointForce(np.zeros(1), np.full((1, 2), np.nan), "tip"), "a known force and its times must be finite"),
    (PointForce(np.array([1.0, 0.0]), np.zeros((2, 2)), "tip"), "the times of a known force must not decrease"),
    (PointForce(np.zeros(1), np.ones((1, 2)), "nose"), "acts at 'nose', but the model's points are knot, tip"),
    (PointForce(np.zeros(1), np.ones((1, 2)), Station("x", 2, 0.0)), "acts on link 3, but the model has links 1 to 2"),
])
def test_a_force_that_makes_no_sense_is_told(force: PointForce, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        predict(pendulum(), under(force, pendulum()), {}, 1e-3)
