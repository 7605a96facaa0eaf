"""States of estimators: their defaults, and the shift of rest angles that stands for model error and hysteresis."""

from __future__ import annotations

import numpy as np

from pliant.equations.memory import memory_angle
from pliant.estimation.contract import State
from pliant.estimation.kalman_loops import rest_shift
from pliant.model import Memory


def test_a_state_has_no_strains_unless_it_is_told():
    rest = State(1.0, np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), np.eye(6))
    assert rest.strain.size == rest.strain_rate.size == rest.strain_shift.size == 0
    assert (rest.torque_scale, rest.fault, rest.consistent) == (1.0, "", True)
    assert not State(1.0, *[np.zeros(2)] * 4, np.eye(6), fault="off").consistent


def test_a_rest_shift_without_memory_pulls_as_the_shift_and_the_memory_do(rng):
    """K (q - own) + K r = K (1 + left) (q - shift), where all of the memory follows the joint from now on."""
    angle, own, theta0 = rng.normal(size=(3, 3))
    law = Memory((0.1, 0.2), (1.0, 2.0), (0.3,), (10.0,)).law()
    states = rng.normal(size=(3, 3)) * 0.1
    shift, left, base = np.empty(3), 0.6, 0.4
    rest_shift(angle, own, states, base, theta0, law, left, shift)
    q = np.diff(angle, prepend=base) - theta0
    held = np.array([memory_angle(i, q[i], states, law) for i in range(3)])
    np.testing.assert_allclose((1 + left) * (q - shift), q - own + held, rtol=1e-12)
