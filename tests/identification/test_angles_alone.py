"""Angles without places: a sensor's lag in closed form, and a pendulum that another integrator moved found again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pliant.errors import InputError
from pliant.identification import Parameter, experiment, fit
from pliant.identification.observation import behind_sensors, between_frames, lagged
from pliant.identification.residuals import Observations
from pliant.identification.sensitivity import sensitivities
from pliant.model import chain_model
from pliant.preprocessing.detectors import quantum
from pliant.recording import make_recording

LENGTH, MASS, K, D, TORQUE, LAG = 0.15, 0.06, 0.3, 1.5e-3, 2.2e-6, 0.09
STEP = np.deg2rad(0.8)
LEVELS = {"low": 40e3, "high": 80e3}


def pressed(t, level):
    return np.interp(t, [0.3, 0.35, 2.0, 2.05], [0.0, level, level, 0.0])


def seen(level, *, coarse=True):
    """A rod on one spring behind a sensor of first order, by LSODA: one angle at 20 Hz, in steps of 0.8 degrees."""
    inertia = MASS * LENGTH**2 / 3

    def rates(t, y):
        return [y[1], (TORQUE * pressed(t, level) - K * y[0] - D * y[1]) / inertia, (y[0] - y[2]) / LAG]

    t = np.arange(0.0, 4.0, 0.05)
    exact = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-11, "max_step": 5e-3}
    y = solve_ivp(rates, (0.0, 4.0), [0.0, 0.0, 0.0], t_eval=t, **exact).y[2]
    fine = np.arange(0.0, 4.0, 0.01)
    angle = np.round(y / STEP) * STEP if coarse else y
    return make_recording(t, angle=angle[:, None], station=["tip"], frame="planar", pressure=pressed(fine, level),
                          pressure_time=fine)  # fmt: skip


@pytest.fixture(scope="module")
def model():
    return chain_model(length=LENGTH, mass=MASS, links=1, stiffness=1.0, damping=1e-3, torque=[0.0])


def test_a_lag_is_that_of_the_closed_form():
    t, w = np.arange(0.0, 2.0, 0.05), 2 * np.pi * 4
    between = between_frames(t)
    motion = np.sin(w * between[0])[:, None, None] * np.ones((1, 1, 3))
    found = behind_sensors(motion, between, np.array([LAG]))[:, 0, 0]
    exact = (np.sin(w * t) - w * LAG * np.cos(w * t) + w * LAG * np.exp(-t / LAG)) / (1 + (w * LAG) ** 2)
    np.testing.assert_allclose(found, exact, atol=1e-3)
    slope = lagged(motion.astype(complex), between[0], np.array([LAG + 1e-20j])).imag / 1e-20
    ahead, behind = (lagged(motion, between[0], np.array([LAG + h])) for h in (1e-5, -1e-5))
    np.testing.assert_allclose(slope, (ahead - behind) / 2e-5, atol=1e-5)
    np.testing.assert_allclose(behind_sensors(motion, between, np.zeros(1)), motion[between[1]], atol=1e-6)


def test_a_pendulum_behind_a_coarse_and_late_sensor_is_found_again(model):
    records = [experiment(name, seen(level)) for name, level in LEVELS.items()]
    assert all(r.without_positions and r.angles_alone and r.angle_reference == "rest" for r in records)
    free = ["stiffness", "damping", "torque_1", "sensor_lag"]
    found = fit(records, model, free, starts=1)
    # the angle alone gives ratios to the mass, which is stated here
    for name, value, within in zip(free, (K, D, TORQUE, LAG), (0.02, 0.1, 0.02, 0.05), strict=True):
        assert found.values[name] == pytest.approx(value, rel=within), name
    assert found.turns
    assert max(found.rmse.values()) == pytest.approx(STEP / np.sqrt(12), rel=0.4)  # the steps are what is left
    assert "deg" in found.card().lines[-1]
    with pytest.raises(InputError, match="either positions or angles"):
        fit([*records, with_places(records[0])], model, free)


def with_places(record):
    from dataclasses import replace

    place = np.stack([np.sin(record.angle), np.cos(record.angle)], axis=-1)
    return replace(record, name="placed", position=place, angle=None, angle_reference="", angles_alone=False)


def test_derivatives_of_a_lagging_sensor(model):
    exp = experiment("low", seen(LEVELS["low"]))
    values = {"stiffness": K, "damping": D, "torque_1": TORQUE, "tip.sensor_lag": LAG, "latency": 0.01}
    sizes = {"stiffness": 0.1, "tip.sensor_lag": 0.02, "latency": 5e-3}
    body = fit([exp], model, [Parameter(n, v, free=n == "damping") for n, v in values.items()], starts=1).model
    _, slopes = sensitivities(body, exp, values, sizes, 2e-3)
    for k, (name, size) in enumerate(sizes.items()):
        ahead, behind = (sensitivities(body, exp, {**values, name: values[name] + h}, {}, 2e-3)[0]
                         for h in (1e-3 * size, -1e-3 * size))  # fmt: skip
        difference = (ahead - behind) / (2e-3 * size)
        np.testing.assert_allclose(slopes[k], difference, atol=2e-3 * np.abs(difference).max())


def test_the_steps_of_a_coarse_sensor_are_its_noise():
    coarse, fine = (experiment("low", seen(LEVELS["low"], coarse=c)) for c in (True, False))
    assert quantum(coarse.angle[:, 0]) == pytest.approx(STEP)
    assert quantum(fine.angle[:, 0]) == 0
    assert 1 / Observations(coarse, "noise").weight[0, 2] >= STEP / np.sqrt(12)
