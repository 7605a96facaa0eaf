"""Laws that are no polynomials: every law that `equations.laws` lists goes through each path by the same tests."""

from __future__ import annotations

import numpy as np
import pytest

import pliant
from pliant.batch import simulate_batch
from pliant.equations import laws
from pliant.equations.chamber import torque
from pliant.errors import InputError
from pliant.exporters.features import FEATURES
from pliant.identification import Experiment, Parameter, fit
from pliant.identification.parameters import apply
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model, Station, Valve
from pliant.simulation import Pulse, Stepper, equilibrium, modes, simulate

BODY = Model(
    link_length=[0.05, 0.05], link_mass=0.02, stiffness=0.5, damping=0.004, torque=[1e-6], tip_mass=0.01,
    stations=[Station("tip", 1, 0.05)], valve=Valve(rise_time=0.03, fall_time=0.05),
)
LEVELS = np.linspace(1e4, 1.2e5, 12)  # Pa
EACH_LAW = pytest.mark.parametrize("law", laws.LAWS, ids=lambda law: law.name)


def usual(law):
    """Its parameters for a torque that levels off, by the names of a fit."""
    begun = law.start(LEVELS, 2e-6 * LEVELS / (1.0 + LEVELS / 1e5))
    return {f"{law.name}_{name}": begun[name] for name in law.parameters}


def with_law(law):
    return apply(BODY, usual(law))


@EACH_LAW
def test_a_law_is_kept_in_files_and_checked(law, tmp_path):
    model = with_law(law)
    assert pliant.load_model(pliant.save_model(model, tmp_path / "m.json")) == model
    assert law.name in str(model)
    with pytest.raises(InputError, match=f"must hold the numbers {', '.join(law.parameters)}, got 17"):
        BODY.with_(law=law.name, torque=np.ones(17))
    with pytest.raises(InputError, match=r"law must be one of polynomial, .*, got 'none such'"):
        BODY.with_(law="none such")


@EACH_LAW
@pytest.mark.parametrize("rubber", [{}, {"swell_share": 0.5, "swell_time": 0.1, "inflation_limit": 4e5},
                                    {"inflation_limit": 6e4, "inflation_time": 0.03, "inflation_jm": 2.0}])
def test_a_motion_is_that_of_an_adaptive_solver_and_of_the_stepper(law, rubber):
    model, h, level = with_law(law).with_(**rubber), 1e-3, 8e4
    times, pulse = np.linspace(0.0, 0.3, 31), Pulse(level, 0.0, 1.0)
    run = simulate(model, pulse, times=times, time_step=h, check=False)
    exact = simulate(model, pulse, times=times, method="LSODA", rtol=1e-9)
    assert np.abs(run.tip_position - exact.tip_position).max() < 2e-5
    stepper = Stepper(model, h)
    stepper.step(level, 300)
    reached = mechanics_of(model).joint_angles(stepper.angle)
    np.testing.assert_allclose(reached, run.joint_angle.values[-1], rtol=1e-6)


@EACH_LAW
def test_a_linear_model_and_its_modes(law):
    model, p, h = with_law(law), 6e4, 10.0
    gain = (equilibrium(model, p + h) - equilibrium(model, p - h)).sum() / (2.0 * h)
    assert pliant.linearise(model, p).static_gain("angle_sum") == pytest.approx(gain, rel=1e-6)
    assert modes(model)[0] == pytest.approx(modes(BODY)[0])


@EACH_LAW
def test_a_fit_finds_a_law(law):
    """From the plateaus on, with exact derivatives."""
    true, times, experiments = with_law(law), np.arange(0.0, 0.8, 0.01), []
    for level in (3e4, 8e4, 1.2e5):
        seen = simulate(true, Pulse(level, 0.1, 0.4), times=times)["station_position"].values
        experiments.append(Experiment(f"at_{level:.0f}", times, seen, ("tip",), "pulse", level=level))
    edges = [Parameter(f"{e.name}.{n}", v, free=False) for e in experiments for n, v in (("start", 0.1), ("stop", 0.5))]
    found = fit(experiments, BODY, ["damping", *usual(law), *edges], starts=1)
    assert found.converged
    for name, value in usual(law).items():
        assert found.values[name] == pytest.approx(value, rel=2e-3)
    assert found.model.chambers[0].law == law.name
    again = apply(found.model, {"torque_1": 1e-6})
    assert (again.chambers[0].law, again.chambers[0].torque[0]) == ("polynomial", 1e-6)


@EACH_LAW
def test_batches_take_it_one_by_one_and_exports_carry_or_refuse_it(law, tmp_path):
    model, pulse = with_law(law), Pulse(8e4, 0.02, 0.2)
    many = simulate_batch([model, BODY], pulse, duration=0.1, time_step=1e-3)
    alone = simulate(model, pulse, duration=0.1, time_step=1e-3)
    np.testing.assert_allclose(many.tip_position.values[0], alone.tip_position.values, atol=1e-12)
    assert FEATURES["own_law"].names(model) == ("torque law that is no polynomial",)
    with pytest.raises(InputError, match="torque law that is no polynomial"):
        pliant.export(model, "mjcf", tmp_path / "m.xml")
    straight = FEATURES["own_law"].without(model).chambers[0]
    assert (straight.law, straight.torque.size) == ("polynomial", 1)


@EACH_LAW
def test_laws_of_two_kinds_drive_one_body(law):
    """A polynomial and the law, each on its joint: the torques at rest are those of each alone."""
    own = with_law(law).chambers[0].torque
    bent, pulled = (Chamber(torque=a, joint_gain=g, name=n, law=form) for a, g, n, form in (
        ([1e-6, 2e-12], [1.0, 0.0], "a", "polynomial"), (own, [0.0, -1.0], "b", law.name)))
    model = BODY.with_(chambers=(bent, pulled))
    wanted = np.array([torque(5e4, bent.torque), -7e4 * law.lever(7e4, own)])
    np.testing.assert_allclose(model.actuation.joint_torques([5e4, 7e4]), wanted, rtol=1e-14)
    stepper = Stepper(model, 1e-3)
    stepper.step(np.array([5e4, 7e4]), 3000)
    np.testing.assert_allclose(mechanics_of(model).joint_angles(stepper.angle), wanted / 0.5, rtol=1e-6)
