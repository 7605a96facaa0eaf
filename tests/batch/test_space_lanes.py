"""Chains in space in SIMD vectors: the motion of single simulations for every part, failures, time steps."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.batch import simulate_batch
from pliant.batch.space_lanes import check_steps_in_space, fits_lanes, shared_steps, unloaded_rest
from pliant.compiler import WIDTH
from pliant.errors import InputError, SimulationError
from pliant.identification.parameters import apply
from pliant.model import Chamber, Extension, Memory, Model, Space, Tendon, Valve, chain_model
from pliant.simulation import Pulse, Trace, modes, simulate
from pliant.simulation.solve import STEPS_PER_PERIOD

TIMES = np.arange(41) / 100
AZIMUTHS = np.radians([90.0, 210.0, 330.0])


def arm(**fields) -> Model:
    chambers = [Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"c{k}") for k, a in
                enumerate(AZIMUTHS)]  # fmt: skip
    return chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, gravity=(0.5, 0.2, -9.8),
                       chambers=chambers, space=Space(stiffness_ratio=1.2, radius=0.012)).with_(**fields)  # fmt: skip


def with_chambers(**fields) -> Model:
    return arm(chambers=tuple(replace(c, **fields) for c in arm().chambers))


BODIES = {
    "plain": arm, "twisting": lambda: arm(space=Space(twist_ratio=0.7, radius=0.012, rest_turn=[0.1, -0.05, 0.2])),
    "softening": lambda: arm(stiffening=-0.2, cubic_stiffening=0.1),
    "valves": lambda: with_chambers(valve=Valve(rise_time=0.02, fall_time=0.03, dead_time=0.0123)),
    "walls": lambda: with_chambers(swell_share=0.3, swell_time=0.1, inflation_limit=9e5, inflation_time=0.05),
    "lengthens": lambda: arm(
        chambers=tuple(Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), axial_gain=40.0, name=f"c{k}")
                       for k, a in enumerate(AZIMUTHS)),
        extensions=(Extension(60.0, 0.4, 0.0, 0.16, "near"), Extension(90.0, 0.3, 0.16, None, "far", stiffening=0.3,
                                                                      stiffens_bending=True))),
}  # fmt: skip


def test_bodies_with_different_numbers_of_inputs_are_simulated_one_by_one():
    one = arm(chambers=arm().chambers[:1])
    inputs = [[Pulse(3e4), Pulse(0.0), Pulse(0.0)], [Pulse(3e4)]]
    for order in ((0, 1), (1, 0)):
        models = [(arm(), one)[k] for k in order]
        batch = simulate_batch(models, [inputs[k] for k in order], times=TIMES, time_step=1e-3,
                               variables=["tip_position"])  # fmt: skip
        for k, model in zip(order, models, strict=True):
            alone = simulate(model, inputs[k], times=TIMES, time_step=1e-3)["tip_position"].values
            shown = batch["tip_position"].values[order.index(k)]
            np.testing.assert_allclose(shown, alone, atol=1e-9)


@pytest.mark.slow  # compiles the steps of bodies of several sizes
@pytest.mark.parametrize("body", list(BODIES))
def test_the_motion_is_that_of_single_simulations(body):
    model = BODIES[body]()
    assert fits_lanes(model)
    rng = np.random.default_rng(3)
    values = {"stiffness": rng.uniform(0.45, 0.6, WIDTH + 3), "c1.torque_1": rng.uniform(1e-6, 3e-6, WIDTH + 3)}
    inputs = [[Pulse(3e4, 0.05 + 0.0007 * k, 0.2), Trace([0.0, 0.2, 0.4], [0.0, 2e4, 1e3 * k]), Pulse(1e4)]
              for k in range(WIDTH + 3)]  # fmt: skip
    kinds = ["joint_angle", "joint_rate", "tip_position", *["axial_strain"] * (body == "lengthens")]
    batch = simulate_batch(model, inputs, parameters=values, times=TIMES, time_step=1e-3, variables=kinds)
    for i in (0, 5, WIDTH + 2):
        one = apply(model, {name: v[i] for name, v in values.items()})
        alone = simulate(one, inputs[i], times=TIMES, time_step=1e-3)
        for name in batch.data_vars.keys() - {"failed_at"}:
            np.testing.assert_allclose(batch[name].values[i], alone[name].values, rtol=1e-12, atol=1e-12, err_msg=name)
    assert np.abs(batch.joint_angle_y).max() > 0.01
    start = {"initial_angle": np.full(model.size, 0.02), "initial_rate": np.full(model.size, -0.1)}
    moving = simulate_batch(model, inputs[0], times=TIMES, time_step=1e-3, **start)
    alone = simulate(model, inputs[0], times=TIMES, time_step=1e-3, **start)
    np.testing.assert_allclose(moving.tip_position.values[0], alone.tip_position.values, rtol=1e-12, atol=1e-12)


def test_a_sample_that_fails_leaves_its_neighbours_and_states_its_time():
    soft, still = arm(stiffening=-0.5), [Pulse(1e3)] * 3
    burst = [Pulse(1e9, 0.1), *still[1:]]
    inputs = [still, burst, still]
    with pytest.raises(SimulationError, match=r"1 of 3 samples fail, sample 1 at 0\.1"):
        simulate_batch(soft, inputs, times=TIMES, time_step=1e-3)
    batch = simulate_batch(soft, inputs, times=TIMES, time_step=1e-3, failures="mark")
    alone = simulate(soft, still, times=TIMES, time_step=1e-3)
    assert np.isnan(batch.tip_position.values[1]).all()
    assert 0.1 < float(batch.failed_at[1]) < 0.12
    for k in (0, 2):
        np.testing.assert_allclose(batch.tip_position.values[k], alone.tip_position.values, atol=1e-12)
    known = simulate_batch([soft] * 2, still, times=TIMES, time_step=1e-3, variables=())
    assert list(known.data_vars) == ["failed_at"]
    early = [Pulse(2e4, -1.0, 9.0), Pulse(0.0), Pulse(0.0)]
    rest = simulate_batch(soft, early, times=TIMES, time_step=1e-3)
    assert np.ptp(rest.tip_position.values, axis=1).max() < 1e-9, "starts in equilibrium under its first inputs"
    assert np.abs(rest.tip_position.values - alone.tip_position.values).max() > 1e-4


def test_samples_with_other_steps_are_padded_with_steps_of_no_length():
    def plan(h, keep):
        return SimpleNamespace(h=np.array(h), keep=np.array(keep), torque=np.arange(1.0, len(h) + 1)[:, None],
                               gain=np.ones((1, 4)))  # fmt: skip

    short, long = plan([0.1, 0.2], [1, 2]), plan([0.05, 0.05, 0.1, 0.1], [-2, 1, -1, 2])
    steps = shared_steps([short] * (WIDTH - 1) + [long], 3)
    np.testing.assert_array_equal(steps.h[:, 0], [0.1, 0.0, 0.2, 0.0])
    np.testing.assert_array_equal(steps.h[:, -1], long.h)
    np.testing.assert_array_equal(steps.torque[:, 0, 0], [1.0, 0.0, 2.0, 0.0])
    np.testing.assert_array_equal(steps.keep, [-1, 1, -1, 2])


def test_a_step_too_long_for_one_sample_is_refused():
    soft, stiff = arm(), arm(stiffness=50.0)
    longest = 1.0 / (STEPS_PER_PERIOD * float(modes(stiff)[0][0]))
    rest = unloaded_rest([soft, stiff, soft])
    check_steps_in_space([soft, stiff, soft], rest, 0.999 * longest)
    with pytest.raises(InputError, match="is too long: the first mode rings at"):
        check_steps_in_space([soft, stiff, soft], rest, 1.001 * longest)
    with pytest.raises(InputError, match="time_step must be a positive time"):
        check_steps_in_space([soft], rest[:1], -1.0)


def test_what_is_simulated_one_by_one():
    cord = Tendon.at_azimuth(0.0, np.ones(2), driven_by="tension", lever=9e-3, name="cord")
    for other in (arm(memory=Memory((0.1,), (0.3,))), arm(chambers=(cord,)), arm(moving_base=True),
                  chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, torque=[2e-6])):  # fmt: skip
        assert not fits_lanes(other)
