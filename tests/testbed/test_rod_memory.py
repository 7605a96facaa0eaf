"""Relaxation, slip and what they do to the rod."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import kstest

from pliant.testbed.rod import RodParameters, prony_decay, slip_thresholds
from pliant.testbed.stepping import simulate

LINEAR = RodParameters().uniform()
GAIN = LINEAR.chamber_area * LINEAR.chamber_height


def test_prony_update_is_exact_on_a_ramp():
    time, dt = np.array([0.05, 0.6, 8.0]), 0.1
    c = prony_decay(time, dt)
    for k in range(3):
        exact = solve_ivp(lambda t, y, k=k: (0.3 + 7.0 * t - y) / time[k], (0, dt), [1.2], rtol=1e-11, atol=1e-13)
        assert c[k] @ [1.2, 0.3, 1.0] == pytest.approx(exact.y[0, -1], rel=1e-9)
    assert prony_decay(time, 1e9) == pytest.approx(np.tile([0.0, 0.0, 1.0], (3, 1)), abs=1e-6)


def test_creep_reaches_the_relaxed_curvature():
    p = replace(LINEAR, prony_share=(0.2,), prony_time=(0.3,), loss_time=0.05)
    loads = np.zeros((3000, 4))
    loads[:, 0] = 1e5
    kappa = simulate(p, loads, 1e-3, stride=10).curvature[:, 50]
    relaxed = 1e5 * GAIN / p.bending_stiffness
    assert kappa[-1] == pytest.approx(relaxed, rel=1e-3)
    late = np.log(relaxed - kappa[100:200])
    slow = np.roots([0.05 * 0.3, 0.05 + 1.2 * 0.3, 1.0]).max()  # (1 + 0.05 s)(1 + 0.3 s) + 0.2 * 0.3 s = 0
    assert np.polyfit(np.arange(100) * 0.01, late, 1)[0] == pytest.approx(slow, rel=0.01)


def test_slip_loop_has_the_closed_form_area():
    """Elements of one threshold x: area 4 k x (X - x) per length, X the curvature's amplitude."""
    p = replace(LINEAR, slip_share=0.3, slip_elements=3, slip_scale=1.0, slip_shape=1e7)
    corner = [0.0, 1.5e5, -1.5e5, 1.5e5]
    path = np.concatenate([np.linspace(a, b, 400)[1:] for a, b in pairwise(corner)])
    loads = np.zeros((path.size, 4))
    loads[:, 0] = path
    m = simulate(p, loads, 1.0, stride=1, static=True)
    kappa, moment = m.curvature[1:, 50], path * GAIN
    loop = slice(399 - 1, None)
    area = abs(np.trapezoid(moment[loop], kappa[loop]))
    amplitude = 0.5 * (kappa[loop].max() - kappa[loop].min())
    assert area == pytest.approx(4 * 0.3 * p.bending_stiffness * (amplitude - 1.0), rel=1e-3)


def test_thresholds_follow_the_weibull_law():
    x = slip_thresholds(400, 15, scale=4.0, shape=1.4, seed=3)
    assert x.shape == (400, 15)
    assert kstest(x.ravel(), lambda v: 1 - np.exp(-((v / 4.0) ** 1.4))).statistic < 0.02
    assert np.array_equal(x, slip_thresholds(400, 15, scale=4.0, shape=1.4, seed=3))
    assert slip_thresholds(5, 0, scale=4.0, shape=1.4, seed=3).shape == (5, 0)
