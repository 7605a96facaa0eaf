"""A base that moves as prescribed, kernel by kernel."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.equations import base
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model, Space

LINKS = {"link_length": [0.05, 0.04, 0.06], "link_mass": [0.01, 0.012, 0.008], "stiffness": [0.4, 0.3, 0.2],
         "damping": [2e-3, 1e-3, 3e-3], "torque": [1e-6]}  # fmt: skip
REACH, RATE, TURNING = 0.03, 3.0, 40.0  # m, rad/s, rad/s^2


def accelerations(model, x, v, torque, spin, weight):
    """Of a chain on a base of the given spin under the given weight per mass."""
    chain = mechanics_of(model).with_own_base()
    body, joints, work = chain.parts()
    (joints if chain.dimension == 2 else body).spin[:] = spin
    body = body._replace(**dict(zip(("gx", "gy", "gz"), map(float, weight), strict=False)))
    a = np.zeros(chain.size)
    chain.acceleration()(x.copy(), v.copy(), torque.copy(), body, joints, work, a)
    return a


def test_base_is_a_first_link_whose_motion_is_given(rng):
    """A longer chain whose first joint is turned by the torque that gives the first link the base's acceleration."""
    whole = {name: np.append(first, LINKS[name]) for name, first in
             {"link_length": REACH, "link_mass": 0.02, "stiffness": 0.5, "damping": 1e-3}.items()}
    first = Model(**whole, torque=[1e-6], gravity=(0.5, -9.81))
    phi, w, torque = rng.normal(size=4), rng.normal(size=4), rng.normal(size=4)
    w[0] = RATE
    free, pushed = (accelerations(first, phi, w, torque + push * np.eye(4)[0], (0.0, 0.0), first.gravity)
                    for push in (0.0, 1.0))  # fmt: skip
    expected = free + (TURNING - free[0]) / (pushed - free)[0] * (pushed - free)
    rest = Model(**LINKS, base_length=REACH, base_angle=phi[0], gravity=first.gravity)
    ahead = np.array([-np.sin(phi[0]), np.cos(phi[0])])
    aside = np.array([-ahead[1], ahead[0]])
    weight = first.gravity - REACH * (TURNING * aside - RATE**2 * ahead)
    found = accelerations(rest, phi[1:], w[1:], torque[1:], (RATE, TURNING), weight)
    assert found == pytest.approx(expected[1:], rel=1e-10)


@pytest.mark.parametrize("segments", [(), (Extension(stiffness=20.0, damping=0.1),)])
def test_turning_base_in_space_is_that_of_the_plane(segments, rng):
    flat = Model(**LINKS, base_length=REACH, gravity=(0.5, -9.81), extensions=segments)
    deep = Model(**LINKS, base_length=REACH, gravity=(0.0, 0.5, -9.81), extensions=segments, space=Space(radius=1e-7))
    deep, S = deep.with_(moving_base=True), len(segments)
    q, dq, e, de = 0.5 * rng.normal(size=3), 5.0 * rng.normal(size=3), 0.1 * rng.normal(size=S), rng.normal(size=S)
    torque = np.append(0.1 * rng.normal(size=3), 0.1 * rng.normal(size=S))
    chain = mechanics_of(flat)
    x, v = chain.coordinates(np.append(q, e)), chain.rates(np.append(dq, de))
    v[:3] += RATE
    arm = np.zeros(2) if segments else REACH * np.array([-TURNING, -(RATE**2)])
    a = accelerations(flat, x, v, torque, (RATE, TURNING), flat.gravity - arm)
    a[:3] -= TURNING
    expected = chain.joint_rates(a[None])[0]

    def across(values):
        return np.concatenate([np.column_stack([values[:3], np.zeros(3)]).ravel(), values[3:]])

    spin = np.array([[RATE, 0.0, 0.0], [TURNING, 0.0, 0.0]])
    found = accelerations(deep, across(np.append(q, e)), across(np.append(dq, de)), across(torque), spin, deep.gravity)
    assert found == pytest.approx(across(expected), rel=1e-7, abs=1e-7 * np.abs(expected).max())


def test_step_on_a_turning_base_is_of_second_order():
    """From rest without weight, against far shorter steps: a step's rows, and its return to the axes of the base."""
    chain = mechanics_of(Model(**LINKS)).with_own_base()

    def after(h):
        from pliant.equations.motion import step

        body, joints, work = chain.parts()
        x, v = chain.coordinates(np.zeros(3)), np.zeros(3)
        for k in range(round(0.1 / h)):
            ends = 9 * h * np.array([k, k + 1])
            rates, turn = np.sin(ends), -np.diff(np.cos(ends))[0] / 9
            motion = np.array([turn / h, (rates[1] - rates[0]) / h, *rates, turn])
            base.begin_step(motion, v, body, joints)
            step(x, v, h, np.zeros(3), body, joints, work)
            base.end_step(motion, x, v, body, joints)
        return np.append(x, v)

    exact = after(5e-5)
    errors = [np.abs(after(h) - exact).max() for h in (1e-3, 5e-4)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_step_in_space_takes_the_spin_and_keeps_the_rates():
    chain = mechanics_of(Model(**LINKS, gravity=(0.0, 0.0, -9.81), space=Space(), moving_base=True)).with_own_base()
    body, joints, _ = chain.parts()
    x, v = np.ones(6), np.ones(6)
    base.begin_step_in_space(np.arange(6.0), v, body, joints)
    base.end_step_in_space(np.arange(6.0), x, v, body, joints)
    assert body.spin.tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert [*x, *v] == [1.0] * 12
