"""Memory as parameters: names, starts, refusals, exact derivatives, and numbers that come back."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, fit, predict
from pliant.identification.following import observed_rows
from pliant.identification.forward_model import forward_problem
from pliant.identification.names import families
from pliant.identification.parameters import apply
from pliant.identification.sensitivity import input_slopes, sensitivities
from pliant.model import Extension, Memory, Model, Station
from pliant.simulation import Pulse, simulate

TRUTH = {"creep_share_1": 0.25, "creep_time_1": 0.4, "slip_share_1": 0.3, "slip_angle_1": 0.004}
OTHERS = {
    "boucwen_share": 0.2, "boucwen_beta": 100.0, "boucwen_gamma": 50.0, "boucwen_exponent": 1.5, "swell_share": 0.3,
    "swell_time": 0.7, "inflation_limit": 1.6e5, "inflation_time": 0.06, "valve_settle_share": 0.1,
    "valve_settle_time": 0.5, "valve_fall_rate": 2e5, "stiffness": 0.9, "torque_1": 4e-7, "base_angle": 0.01,
}  # fmt: skip


@pytest.fixture(scope="module")
def arm():
    return Model(
        link_length=np.full(3, 0.04), link_mass=0.012, stiffness=0.9, damping=4e-3, torque=[4e-7, 2e-12],
        gravity=[0.0, 9.81], stations=(Station("tip", 2, 0.04),),
    )


def recorded(model, noise=0.0):
    times = np.linspace(0.0, 2.0, 201)
    position = simulate(model, Pulse(8e4, 0.1, 1.0), times=times, time_step=1e-3).station_position.values
    position = position + noise * np.random.default_rng(3).normal(size=position.shape)
    return Experiment("r", times, position, ("tip",), "pulse", level=8e4)


def test_every_row_enters_the_model(arm):
    kinds = ("creep", "slip", "axial_creep", "axial_slip", "boucwen", "swell", "inflation", "valve")
    bounds = {name.replace("<k>", "1"): q.upper for name, q in families().items() if name.startswith(kinds)}
    values = {name: upper**0.5 if upper < 100 else 50.0 for name, upper in bounds.items()}
    values |= {"boucwen_beta": 60.0, "slip_angle_1": 0.2, "valve_fall_rate": 1e5, "valve_rise_rate": 2e5}
    values |= {"inflation_limit": 3e5}
    with pytest.raises(InputError, match="has no segment that lengthens"):
        apply(arm, values)
    arm = arm.with_(extensions=(Extension(200.0),))
    changed = apply(arm, values)
    assert changed.memory == Memory(
        (values["creep_share_1"],), (50.0,), (values["slip_share_1"],), (0.2,), values["boucwen_share"], 60.0, 50.0,
        values["boucwen_exponent"], axial_creep_share=(values["axial_creep_share_1"],), axial_creep_time=(50.0,),
        axial_slip_share=(values["axial_slip_share_1"],), axial_slip_strain=(values["axial_slip_strain_1"],),
    )
    changed_chamber = changed.chamber
    assert (changed_chamber.swell_share, changed_chamber.swell_time) == (1.0, 50.0)
    assert (changed_chamber.inflation_limit, changed_chamber.inflation_time) == (3e5, 50.0)
    assert (changed.valve.settle_share, changed.valve.settle_time) == (values["valve_settle_share"], 50.0)
    assert (changed.valve.rise_rate, changed.valve.fall_rate) == (2e5, 1e5)
    assert apply(changed, {"creep_share_1": 0.1}).memory.creep_share == (0.1,)
    assert apply(arm, {}).memory == Memory()


def test_branches_without_a_partner_or_with_a_gap_are_refused(arm):
    with pytest.raises(InputError, match="each creep branch needs"):
        apply(arm, {"creep_share_1": 0.1})
    with pytest.raises(InputError, match="without a gap"):
        apply(arm, {"slip_share_2": 0.1, "slip_angle_2": 0.1})


def test_branches_begin_apart():
    times = [Parameter(f"creep_time_{j}").value for j in (1, 2, 3)]
    assert len(set(times)) == 3
    assert Parameter("swell_share").value == 0.3
    assert Parameter("creep_share_1", 0.7).value == 0.7


def test_derivatives_are_exact(arm):
    exp = recorded(arm)
    values = {**TRUTH, **OTHERS, "r.start": 0.1003, "r.stop": 1.1007}
    _, slopes = sensitivities(arm, exp, values, {name: abs(v) for name, v in values.items()}, 2e-3)

    def at(changed):
        made = forward_problem(arm, exp, changed, 2e-3)
        return observed_rows(made, made.numbers, exp.time.size)

    for name, slope in zip(values, slopes, strict=True):
        size = 1e-5 * abs(values[name])
        around = [at({**values, name: values[name] + sign * size}) for sign in (-1, 1)]
        found = (around[1] - around[0]) / (2 * size)
        assert np.abs(slope - found).max() < 1e-5 * np.abs(found).max(), name


def test_an_input_that_a_parameter_leaves_alone_has_no_derivative_at_an_edge(arm):
    """Beta at least gamma: at equal values the differences are one-sided."""
    exp = recorded(arm)
    values = {"boucwen_share": 0.2, "boucwen_beta": 50.0, "boucwen_gamma": 50.0}

    def problem_at(value, _):
        return forward_problem(arm, exp, {**values, "boucwen_beta": value}, 2e-3)

    base = problem_at(50.0, None)
    _, slope = input_slopes("boucwen_beta", problem_at, base, 50.0, 5e-4, None)
    assert np.count_nonzero(slope.row) == 1
    assert slope.row.max() == pytest.approx(1.0, rel=1e-9)
    assert not np.any(slope.torque)
    assert not np.any(slope.h)


@pytest.mark.slow
def test_creep_and_slip_come_back(arm):
    """From motion that `simulate` made, with 0.01 mm of noise, beside the stiffness that they trade with."""
    truth = apply(arm, TRUTH)
    exp = recorded(truth, 1e-5)
    found = fit([exp], arm, ["stiffness", *TRUTH], time_step=1e-3, starts=1)
    for name, value in TRUTH.items():
        assert found.values[name] == pytest.approx(value, rel=0.1), (name, found.status)
    error = predict(found.model, exp, found.values, 1e-3)["position"] - exp.position
    assert np.sqrt(np.mean(error**2)) < 1.2e-5
