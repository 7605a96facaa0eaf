"""Tendons along the arcs of a chain in space: tension and slack, torques from a potential, steps across the edge."""

from types import SimpleNamespace

import numpy as np
import pytest
from oracles.derivatives import complex_step
from oracles.space import random_space_chain
from oracles.space import with_tendons as tendons_on
from scipy.integrate import solve_ivp

import pliant
from pliant.equations import arc_tendon, spatial
from pliant.mechanics import mechanics_of
from pliant.model import Space, Tendon

K, T0, EDGE = 800.0, 1.5, 0.08


def with_tendons(rng, n=2):
    return tendons_on(random_space_chain(rng, n), rng, stiffness=K, pretension=T0, edge=EDGE)


def test_tension_is_that_of_a_spring_or_nothing():
    chain = with_tendons(np.random.default_rng(1))
    q = np.zeros(4)
    taut, slope = arc_tendon.tension(0, q, 10.0, chain.body)
    assert taut == pytest.approx(10.0 + T0, abs=EDGE**2 / 40)
    assert slope == pytest.approx(1.0, abs=1e-4)
    loose, slope = arc_tendon.tension(0, q, -10.0, chain.body)
    assert 0.0 < loose < EDGE**2 / 30
    assert slope == pytest.approx(0.0, abs=1e-4)
    assert arc_tendon.tension(2, q, -10.0, chain.body) == (-10.0 + T0, 1.0)  # a pair pulls either way
    bent = chain.body.lever[0] * 1e-2 / (chain.body.lever[0] @ chain.body.lever[0])  # shortens the path by 10 mm
    assert arc_tendon.tension(0, bent, 20.0, chain.body)[0] == pytest.approx(20.0 + T0 - K * 1e-2, abs=1e-3)


def test_torques_are_those_of_virtual_work_and_their_slopes_exact():
    rng = np.random.default_rng(2)
    chain = with_tendons(rng)
    command = np.append(np.zeros(4), rng.uniform(-3, 3, 3))

    def torques(q):
        work = SimpleNamespace(t=0.0 * q, pull=0.0 * q)
        arc_tendon.add_pull(q, command, chain.body, work)
        return work.t

    q = rng.normal(0, 0.5, 4)
    T = np.array([arc_tendon.tension(r, q, command[4 + r], chain.body)[0] for r in range(3)])
    assert np.allclose(torques(q), T @ chain.body.lever, rtol=1e-14)
    A = np.zeros((4, 4))
    arc_tendon.add_pull_slopes(q, 1.0, command, chain.body, A)
    assert np.allclose(np.tril(A), np.tril(-complex_step(torques, q)), atol=1e-12)


def test_a_closed_cycle_of_a_tendon_that_is_held_takes_no_work():
    """Its torques have a potential: a random closed path in the coordinates, through slack and taut, gives nothing."""
    rng = np.random.default_rng(3)
    chain = with_tendons(rng)
    s = np.linspace(0.0, 2.0 * np.pi, 20001)
    path = sum(np.outer(np.sin(k * s + p), rng.normal(0, 0.5, 4)) for k, p in ((1, 0.3), (2, 1.0), (3, 2.0)))
    command = np.append(np.zeros(4), [1.0, 2.0, -1.0])
    torque = np.empty_like(path)
    for q, t in zip(path, torque, strict=True):
        t[:] = 0.0
        arc_tendon.add_pull(q, command, chain.body, SimpleNamespace(t=t, pull=0.0 * q))
    power = 0.5 * (torque[1:] + torque[:-1]) * np.diff(path, axis=0)
    assert abs(power.sum()) < 1e-6 * np.abs(power).sum()


def test_steps_through_slack_and_taut_converge_in_second_order():
    chain = with_tendons(np.random.default_rng(4), 1)
    body, joints = chain.body._replace(edge=np.full(3, 0.5)), chain.joints
    command = np.append(np.zeros(2), [0.5, 0.5, 0.0])
    start, span, work = np.array([0.6, -0.4, 0.0, 0.0]), 0.1, chain.work()

    def rate(_, y):
        a = np.empty(2)
        spatial.acceleration(y[:2], y[2:], command, body, joints, work, a)
        return np.append(y[2:], a)

    exact = solve_ivp(rate, (0.0, span), start, rtol=1e-11, atol=1e-12, dense_output=True)
    looks = exact.sol(np.linspace(0, span, 50))[:2].T
    tensions = [arc_tendon.tension(r, q, 0.5, body)[0] for r in (0, 1) for q in looks]
    assert np.min(tensions) < 0.1 < 1.0 < np.max(tensions)  # slack and taut on the way
    errors = []
    for steps in (50, 100, 200, 400):
        x, v = start[:2].copy(), start[2:].copy()
        for _ in range(steps):
            spatial.step(x, v, span / steps, command, body, joints, work)
        errors.append(np.abs(x - exact.y[:2, -1]).max())
    order = -np.polyfit(np.log([50, 100, 200, 400]), np.log(errors), 1)[0]
    assert 1.8 < order < 2.3, (order, errors)


def arm(**more):
    cord = {"driven_by": "displacement", "lever": 8e-3, "line_stiffness": 2e3, "pretension": 2.0}
    tendons = [Tendon.at_azimuth(a, np.ones(3), name=name, **cord) for name, a in (("a", 0.3), ("b", 2.4), ("c", 4.5))]
    return pliant.chain_model(**({
        "length": 0.3, "mass": 0.1, "links": 3, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 4e-3,
        "space": Space(), "chambers": tendons,
    } | more))  # fmt: skip


def test_a_tendon_draws_the_tip_towards_its_azimuth_and_hangs_slack_when_let_out():
    model = arm()
    q = pliant.equilibrium(model, np.array([4e-3, -9e-3, -9e-3]))  # the two others are let out
    tip = mechanics_of(model).tips(q)[-1]
    assert np.arctan2(tip[1], tip[0]) == pytest.approx(0.3, abs=2e-2)
    # one taut tendon of stiffness k at lever g and n equal joints K: K q = g (k (u - n g q) + T_0)
    swing = 8e-3 * (2e3 * 4e-3 + 2.0) / (0.5 + 3 * 2e3 * 8e-3**2)
    assert np.allclose(np.hypot(*q.reshape(3, 2).T), swing, rtol=2e-3)


def test_a_pair_on_one_motor_is_a_spring_both_ways(tmp_path):
    motor = {"driven_by": "angle", "pulley": 0.01, "lever": 8e-3, "line_stiffness": 2e3, "pair": True}
    model = arm(chambers=[Tendon.at_azimuth(np.pi / 2, np.ones(3), **motor)])
    forth, back = (pliant.equilibrium(model, np.array([angle])) for angle in (0.4, -0.4))
    assert np.allclose(forth, -back, atol=1e-12)
    assert forth[0] == pytest.approx(-8e-3 * 2e3 * 0.01 * 0.4 / (0.5 + 3 * 2e3 * 8e-3**2), rel=1e-9)
    assert model.actuation.units == ("rad",)
    assert pliant.load_model(pliant.save_model(model, tmp_path / "m.json")) == model


@pytest.mark.parametrize(("wrong", "sentence"), [
    ({"driven_by": "voltage"}, "driven_by must be"), ({"driven_by": "displacement"}, "needs a line_stiffness"),
    ({"driven_by": "angle", "line_stiffness": 1e3}, "a pulley"), ({"pulley": 0.01}, "a pulley"),
    ({"lever": 0.0}, "lever must be positive"), ({"swell_share": 0.1}, "those of a chamber"),
])  # fmt: skip
def test_tendons_that_cannot_be_are_refused(wrong, sentence):
    with pytest.raises(pliant.InputError, match=sentence):
        Tendon(**({"lever": 8e-3} | wrong))


def test_a_tendon_is_refused_in_a_plane():
    with pytest.raises(pliant.InputError, match="give the model its space"):
        arm(space=None)
