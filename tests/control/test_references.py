"""Set-points, references and limits that are refused; the rig's valve from its gauge."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.control import Limits, SupplyValve, ValveRun, equilibria, identify_valve, valve_response
from pliant.control.design import check_reference
from pliant.control.plan import SetPoint
from pliant.errors import InputError
from pliant.model import chain_model


@pytest.fixture
def arm():
    return chain_model(length=0.17, mass=0.069, mass_at="tip", stiffness=1.6067, damping=8e-3, torque=[6.6667e-7])


def test_equilibria_say_what_is_out_of_reach(arm):
    family = equilibria(arm, 1.19e5)
    assert family.pressure_for(0.0) == 0.0
    assert family.reach == pytest.approx(0.02513, rel=1e-3)
    with pytest.raises(InputError, match="out of reach"):
        family.pressure_for(0.04)


def test_limits():
    with pytest.raises(InputError, match="positive"):
        Limits(0.0)


def test_a_valve_is_found_from_its_gauge():
    """Both frequencies, damping and dead time from noisy steps up and down, whatever the gauge's offset."""
    true = SupplyValve(9.0, 6.4, 0.75, 0.008)
    time, edges, levels = np.arange(0.0, 1.2, 1 / 750), np.array([0.1, 0.5, 0.9]), np.array([6e4, 1e4, 3e4])
    noise = np.random.default_rng(4).standard_normal(time.size)
    gauge = valve_response(true, edges, levels, time) + 100 + 300 * noise
    found = identify_valve([ValveRun(edges, levels, time, gauge)])
    assert found.rmse == pytest.approx(300, rel=0.1)
    for name, value in vars(true).items():
        assert abs(getattr(found.valve, name) - value) < max(5 * found.standard_error[name], 1e-3 * value)
    with pytest.raises(InputError, match="as many edges"):
        identify_valve([ValveRun(edges, levels[:2], time, time)])
    with pytest.raises(InputError, match="pressure of a run for a valve must be finite"):
        identify_valve([ValveRun(edges, levels, time, np.full(time.size, np.nan))])
    with pytest.raises(InputError, match="at least one level of a run for a valve must be > 0 Pa"):
        identify_valve([ValveRun(edges, 0.0 * levels, time, time)])
    with pytest.raises(InputError, match="edge_time of a run for a valve must increase"):
        identify_valve([ValveRun(edges[::-1], levels, time, time)])
    with pytest.raises(InputError, match="at least one run"):
        identify_valve([])


@pytest.mark.parametrize(("time", "far", "ramp", "said"), [
    ([0.0, 1.0], [0.01], 0.0, r"got displacements of shape \(1,\) and times of shape \(2,\)"),
    ([1.0, 1.0], [0.01, 0.02], 0.0, "the times of a set-point must increase"),
    ([0.0], [np.nan], 0.0, "the displacements of a set-point must be finite"),
    ([np.nan], [0.01], 0.0, "the times of a set-point must increase"),
    ([0.0], [0.01], np.nan, "the ramp of a set-point must be >= 0 s, got nan"),
    ([0.0], [0.01], -1.0, "the ramp of a set-point must be >= 0 s, got -1"),
])
def test_what_is_no_set_point_is_refused(time, far, ramp, said):
    with pytest.raises(InputError, match=said):
        SetPoint(np.array(time), np.array(far), ramp)


def test_what_is_no_reference_is_refused():
    with pytest.raises(InputError, match=r"must have the shape \(K, 2\), .* got shape \(3, 1\)"):
        check_reference(np.zeros((3, 1)), 2)
    with pytest.raises(InputError, match="the reference must be finite, but 1 of its 2 numbers are not"):
        check_reference(np.array([[0.0, np.inf]]), 2)
