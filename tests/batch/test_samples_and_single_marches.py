"""Samples of parameters and bodies marched one by one, where they differ from the plain case."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.batch import one_by_one
from pliant.batch.batch import simulate_batch
from pliant.batch.samples import gather, repeated
from pliant.errors import InputError
from pliant.identification.forward_model import no_drive
from pliant.model import Chamber, Memory, chain_model
from pliant.simulation import Pulse, simulate

TIMES = np.arange(5) / 200


def two_chambers(paper, **changes):
    chambers = (Chamber([1e-6], name="a"), Chamber([1e-6], joint_gain=[0, 0, 0, 0, 1.0], name="b"))
    return paper.with_(chambers=chambers, **changes)


def test_a_gain_is_the_mean_of_those_of_the_joints(paper):
    """And a mass the sum of those of the links; both keep the shares that the model has."""
    model = paper.with_(joint_gain=[0.2, 0.4, 0.6, 0.8, 1.0], link_mass=[1e-3, 2e-3, 3e-3, 4e-3, 5e-3])
    made = repeated(model, {"gain": [0.3, 1.2], "mass": [0.03, 0.06]}, 1).values
    np.testing.assert_allclose(made["joint_gain"], np.outer(model.joint_gain, [0.5, 2.0]))
    np.testing.assert_allclose(made["link_mass"], np.outer(model.link_mass, [2.0, 4.0]))


def test_samples_whose_numbers_are_not_finite_are_counted(paper):
    stiffness = np.ones((4, paper.n))
    stiffness[1, 2] = stiffness[3, 0] = np.nan
    with pytest.raises(InputError, match="stiffness must be finite: in 2 of 4 samples it is not"):
        repeated(paper, {"stiffness": stiffness}, 1)
    with pytest.raises(InputError, match="tip_mass must be finite: in 1 of 3 samples it is not"):
        repeated(paper, {"tip_mass": [0.0, np.inf, 1e-3]}, 1)


def test_laws_of_other_lengths_are_filled_up(paper):
    made = gather([paper.with_(torque=[1e-6]), paper.with_(torque=[2e-6, 3e-12, 4e-18])], None, 1)
    np.testing.assert_array_equal(made.values["torque"], [[1e-6, 2e-6], [0, 3e-12], [0, 4e-18]])
    np.testing.assert_allclose(made.torque_at(np.array([1e4, 2e4])), [1e-2, 4e-2 + 1.2e-3 + 3.2e-5])
    assert (made.size, made.template.n) == (2, paper.n)


def test_one_body_alone_is_a_batch_and_takes_no_step_that_is_too_long(paper):
    body = two_chambers(paper)
    inputs = (Pulse(3e4, 0.005), Pulse(1e4))
    found = simulate_batch([body], [inputs], times=TIMES, time_step=1e-3)
    alone = simulate(body, inputs, times=TIMES, time_step=1e-3)
    np.testing.assert_allclose(found["joint_angle"][0], alone["joint_angle"],
                               atol=1e-13)  # fmt: skip
    with pytest.raises(InputError, match="too long"):
        simulate_batch([body, body.with_(stiffness=1e4)], [inputs] * 2, times=TIMES, time_step=1e-3)


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid")
def test_a_body_alone_may_fail_in_its_first_step(paper):
    """Of several chambers, and one that remembers."""
    sudden = Pulse(1e9, 0.0)
    for body, inputs in (
        (two_chambers(paper), [(sudden, Pulse(0.0)), (Pulse(1e4), Pulse(0.0))]),
        (paper.with_(memory=Memory(creep_share=(0.2,), creep_time=(0.3,))), [sudden, Pulse(1e4)]),
    ):
        found = simulate_batch([body] * 2, inputs, times=TIMES, time_step=1e-3, failures="mark")
        assert found["failed_at"].values.tolist() == pytest.approx([1e-3, np.nan], nan_ok=True)
        assert np.isnan(found["joint_angle"].values).all(axis=(1, 2)).tolist() == [True, False]


def test_a_body_alone_starts_at_rest_or_where_it_is_told(paper):
    body = chain_model(length=0.2, mass=0.05, links=paper.n, stiffness=1.0, damping=0.01,
                       chambers=(Chamber([1e-6], name="a"), Chamber([1e-6], name="b")))  # fmt: skip
    still = [(Pulse(0.0), Pulse(0.0))]
    q, dq = np.full(body.n, 0.01), np.linspace(-0.1, 0.1, body.n)
    told = simulate_batch([body] * 2, still, times=TIMES, initial_angle=q, initial_rate=np.stack([dq, 2 * dq]),
                          variables=("joint_angle", "joint_rate"))  # fmt: skip
    for k in range(2):
        np.testing.assert_allclose(told["joint_angle"][k, 0], q)
        np.testing.assert_allclose(told["joint_rate"][k, 0], (k + 1) * dq, atol=1e-15)
    rest = simulate_batch([body] * 2, still, times=TIMES, variables=("joint_angle", "joint_rate"))
    assert not rest["joint_angle"].values.any()
    assert not rest["joint_rate"].values.any()


@pytest.mark.parametrize(("code", "step"), [(-1, -1), (0, 0), (7, 7), (-2, 0), (-9, 7)])
def test_a_march_alone_names_the_step_that_failed(paper, monkeypatch, code, step):
    """From 0: a link turned too far; from -2 downwards: the memory came to no agreement."""
    monkeypatch.setattr(one_by_one, "free_twin", lambda *_: lambda *_: code)
    steps = no_drive(paper).steps
    made, failed = one_by_one.march_alone(paper, steps, np.zeros(paper.n), np.zeros(paper.n), 2)
    assert failed == step
    assert bool(made) is (step < 0)


def test_a_first_frequency_may_be_lower_than_a_radian_a_second():
    """Of a rod on a spring: K over m l^2 / 3; times later than 0 fail at their own."""
    rods = [chain_model(length=0.2, mass=0.05, links=1, stiffness=k, damping=1e-3, torque=[1e-6]) for k in (1e-4, 0.1)]
    squared = np.array([1e-4, 0.1]) / (0.05 * 0.2**2 / 3)
    np.testing.assert_allclose(gather(rods, None, 1).first_frequency(), np.sqrt(squared) / (2 * np.pi))
