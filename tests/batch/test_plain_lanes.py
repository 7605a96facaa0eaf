"""The text of the SIMD loops run uncompiled, each vector an array of eight: the numbers of single chains."""

from __future__ import annotations

import numpy as np
import pytest
from chains import awkward_chain

from pliant.batch import simd, simd_loops, stepper
from pliant.batch import simd as schedule
from pliant.batch.batch import simulate_batch
from pliant.batch.stepper import batch_stepper
from pliant.compiler import WIDTH
from pliant.equations.symbols import Joints
from pliant.model import Valve
from pliant.simulation import Pulse, Stepper, Trace, simulate

TIMES = np.array([0.0, 0.004, 0.01])


def within(x, limit):
    """Bit k is set where lane k of |x| is at most `limit`."""
    good = np.broadcast_to(np.abs(x) <= limit, (WIDTH,))
    return int(sum(1 << k for k in range(WIDTH) if good[k]))


@pytest.fixture
def uncompiled(monkeypatch):
    """Loops in plain Python; memory that is not written is not a number."""

    def aligned(shape):
        return np.full(shape, np.nan)

    for module in (simd, schedule, stepper):
        monkeypatch.setattr(module, "lane_twin", lambda kernel, *_: kernel)
        monkeypatch.setattr(module, "aligned", aligned)
    monkeypatch.setattr(simd_loops, "as_lanes", lambda a: a)
    monkeypatch.setattr(simd_loops, "within", within)


@pytest.mark.parametrize("law", [[5e-7], [5e-7, 2e-12]], ids=["line", "parabola"])
def test_a_march_in_plain_text_is_that_of_single_chains(uncompiled, law):
    """Steps of one interval and of several, a valve, gravity, springs that harden, rows between which steps lie."""
    chain = awkward_chain(stiffening=-0.2, cubic_stiffening=0.3, stiffening_bound=0.5).with_(torque=law)
    models = [chain.with_(stiffness=k * chain.stiffness, valve=Valve(rise_time=r)) for k, r in ((1.0, 0.02), (1.5, 0))]
    source = Trace([0.0, 0.0013, 0.002, 0.0021, 0.5], [0.0, 2e4, 6e4, 1e4, 3e4])
    kept = ("joint_angle", "joint_rate", "tip_position")
    found = simulate_batch(models, source, times=TIMES, time_step=2e-3, variables=kept, threads=1)
    for k, model in enumerate(models):
        alone = simulate(model, source, times=TIMES, time_step=2e-3)
        for name in kept:
            np.testing.assert_allclose(found[name][k], alone[name], rtol=1e-10, atol=1e-12, err_msg=name)
    assert np.isnan(found["failed_at"]).all()


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid")
def test_a_chain_that_fails_in_its_first_step_is_marked_there(uncompiled):
    """The others go on; a step that fails later has its own time."""
    chain = awkward_chain()
    sources = [Pulse(1e4, -1.0, 9.0), Pulse(1e9, 0.0), Pulse(1e9, 0.004)]
    found = simulate_batch([chain] * 3, sources, times=TIMES, time_step=2e-3, failures="mark", threads=1)
    assert np.isnan(found["failed_at"][0])
    assert found["failed_at"][1:].values.tolist() == pytest.approx([0.002, 0.006])
    assert np.isfinite(found["joint_angle"].values).all(axis=(1, 2)).tolist() == [True, False, False]
    alone = simulate(chain, sources[0], times=TIMES, time_step=2e-3)
    np.testing.assert_allclose(found["joint_angle"][0], alone["joint_angle"], rtol=1e-10, atol=1e-12)


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid")
def test_held_chains_in_plain_text_are_steppers(uncompiled):
    chain = awkward_chain(stiffening=-0.2, cubic_stiffening=0.3, stiffening_bound=0.5)
    models = [chain.with_(valve=Valve(rise_time=0.02)), chain.with_(swell_share=0.5, swell_time=0.01, stiffness=2.0)]
    batch = batch_stepper(models, 3, 1e-3)
    batch.reset(np.array([1]), np.array([1]))
    pressure = np.array([[2e4], [4e4], [1e9]])
    assert batch.hold(pressure, 5).tolist() == [False, False, True]
    for k, model in enumerate(models):
        alone = Stepper(model, 1e-3)
        alone.step(float(pressure[k, 0]), 5)
        np.testing.assert_allclose(batch.position[k], alone.angle, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(batch.velocity[k], alone.rate, rtol=1e-9, atol=1e-11)


def test_sound_chains_turn_by_less_than_a_radian_and_have_springs_that_hold(uncompiled):
    """A lane each: at rest, turning slowly, too fast either way, bent to where a spring softens away, not a number."""
    K, K2 = 2.0, -2.0  # a slope of K + 2 K2 q: gone at half a radian
    hardening = np.zeros((3, 2, WIDTH))
    hardening[0] = K2
    rows = np.zeros((2, WIDTH))
    joint = Joints(np.zeros(WIDTH), rows, np.full((2, WIDTH), K), rows, hardening, rows)
    phi, w = np.zeros((2, WIDTH)), np.zeros((2, WIDTH))
    w[1, 1:4] = 99.0, 101.0, -101.0
    phi[:, 4], phi[:, 5] = 0.49, 0.51
    phi[1, 6], w[0, 7] = 0.52, np.nan
    good = simd_loops.sound(phi, w, 0.01, joint, (1 << WIDTH) - 1)
    assert [bool(good >> k & 1) for k in range(8)] == [True, True, False, False, True, False, False, False]
    assert not simd_loops.sound(phi, w, 0.01, joint, 0b10) & ~0b10
