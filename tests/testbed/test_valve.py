"""Valve and chamber against closed forms; the transducer against its settings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lti, step

from pliant.errors import InputError
from pliant.testbed.stepping_loops import GAS_CONSTANT, REFERENCE_DENSITY, Gas, chamber_rate, mass_flow
from pliant.testbed.valve import Iso6358, PressureSensor, SupplyRegulator, read_pressure, supply_pressure

TIME = np.arange(40_001) * 2.5e-5


def stairs(at, level):
    return lambda t: np.where(t >= at, level, 0.0)


def test_regulator_is_the_second_order_system_behind_a_dead_time():
    valve = SupplyRegulator(dead_band=0.0, slew_up=1e12, slew_down=1e12, exhaust_slowdown=1.0)
    p = supply_pressure(stairs(0.1, 1e5), TIME, valve)
    w = 2 * np.pi * valve.frequency
    t, exact = step(lti([w * w], [1, 2 * valve.damping * w, w * w]), T=TIME[:30_000])
    delayed = np.interp(TIME - 0.1 - valve.dead_time, t, 1e5 * exact, left=0.0)
    assert np.abs(p - delayed).max() < 150.0


def test_regulator_limits_slew_and_exhausts_more_slowly():
    p = supply_pressure(lambda t: np.where((t > 0.05) & (t < 0.5), 2.4e5, 0.0), TIME, SupplyRegulator(slew_up=2e6))
    rate = np.diff(p) / 2.5e-5
    assert rate.max() == pytest.approx(2e6, rel=1e-3)
    up, down = np.argmax(p > 1.2e5) * 2.5e-5 - 0.05, np.argmax((p < 1.2e5) & (TIME > 0.5)) * 2.5e-5 - 0.5
    assert down > 0
    free = supply_pressure(lambda t: np.where((t > 0.05) & (t < 0.5), 1e4, 0.0), TIME, SupplyRegulator())
    up, down = np.argmax(free > 5e3) * 2.5e-5 - 0.05, np.argmax((free < 5e3) & (TIME > 0.5)) * 2.5e-5 - 0.5
    assert down - 0.008 > 1.2 * (up - 0.008)
    assert p.min() >= 0.0


def test_choked_blow_down_is_exponential():
    """Constant gas temperature: p' = -n R T C rho0 p / V while the outlet is choked."""
    c, volume, n, temperature = 2e-9, 3e-5, 1.4, 293.15
    p, dt, gas = 8e5, 1e-5, Gas(9e5, 1e5, c, c, 0.3, volume, n, temperature)
    rate = n * GAS_CONSTANT * temperature * c * REFERENCE_DENSITY / volume
    for k in range(2000):
        half = p + 0.5 * dt * chamber_rate(p, -1.0, gas)
        p += dt * chamber_rate(half, -1.0, gas)
        assert p == pytest.approx(8e5 * np.exp(-rate * (k + 1) * dt), rel=1e-6)


def test_choked_fill_has_a_constant_slope_and_flow_falls_to_zero():
    gas = Gas(6e5, 1e5, 2e-9, 2e-9, 0.3, 3e-5, 1.2, 293.15)
    slope = [chamber_rate(p, 1.0, gas) for p in (1e5, 1.7e5)]
    exact = 1.2 * GAS_CONSTANT * 293.15 * 2e-9 * 6e5 * REFERENCE_DENSITY / 3e-5
    assert slope == pytest.approx([exact, exact], rel=1e-12)
    flow = [mass_flow(6e5, r * 6e5, 2e-9, 0.3, 293.15) for r in (0.3, 0.65, 0.9, 1.0, 1.2)]
    assert flow[1] == pytest.approx(flow[0] * np.sqrt(0.75), rel=1e-12)
    assert flow[2] > flow[3] == flow[4] == 0.0


@pytest.mark.parametrize("valve", [SupplyRegulator(dead_band=0.0), Iso6358()], ids=["regulator", "iso 6358"])
def test_steady_pressure_is_the_command(valve):
    assert supply_pressure(stairs(0.05, 1.19e5), TIME, valve)[-1] == pytest.approx(1.19e5, rel=1e-4)


def test_transducer_has_its_own_clock_noise_bias_and_resolution(rng):
    sensor = PressureSensor(noise=300.0, bias=150.0)
    time = np.linspace(0.0, 20.0, 20_001)
    bias, start = [], []
    for _ in range(60):
        clock, value = read_pressure(time, np.full(time.size, 1e5), sensor, rng)
        np.testing.assert_allclose(np.diff(clock), 1 / 750, rtol=1e-9)
        assert np.std(value) == pytest.approx(300.0, rel=0.03)
        assert np.abs(value / sensor.resolution - np.round(value / sensor.resolution)).max() < 1e-6
        bias.append(value.mean() - 1e5)
        start.append(clock[0])
    assert np.std(bias) == pytest.approx(150.0, rel=0.3)
    assert 0.0 <= min(start) < max(start) < 1 / 750


def test_commands_that_no_valve_can_follow_are_refused():
    with pytest.raises(InputError, match="finite and >= 0"):
        supply_pressure(stairs(0.1, -1e4), TIME, SupplyRegulator())
    with pytest.raises(InputError, match="exceeds the supply pressure"):
        supply_pressure(stairs(0.1, 6e5), TIME, Iso6358())
