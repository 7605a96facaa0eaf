"""The compiled frame of the loop, observer and regulator, against their formulas on matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.control import Limits, Lqr, design_lqr
from pliant.control.frame_loops import filter_and_steer
from pliant.equations.chamber import advance
from pliant.equations.memory import step_with_memory
from pliant.equations.symbols import Interval, Past
from pliant.errors import InputError
from pliant.estimation import AdaptiveObserver, LinkAngles, State, default_noise, frozen
from pliant.estimation import kalman_loops as filter_loops
from pliant.estimation.measurement_loops import ANGLE
from pliant.estimation.offline import chain_of, observed_chain
from pliant.estimation.symbols import FilterFrame, FilterNoise, FilterState, Prediction
from pliant.estimation.workspace import make_workspace
from pliant.mechanics import mechanics_of, planar
from pliant.model import load_model
from pliant.simulation import state

MODEL = Path(__file__).parents[2] / "examples" / "control" / "model_a.json"
PERIOD = 4e-3


@pytest.fixture(scope="module")
def body():
    return load_model(MODEL)


@pytest.fixture(scope="module")
def design(body):
    return design_lqr(frozen(body), 190e3, PERIOD, latency=PERIOD, grid=3)


def command_of(law, target, angle, rate, valve, shift, scale):
    """The regulator's wish [Pa] and the tip's error [m], with matrices."""
    design, p = law.design, law.design.pressure
    tables = law.regulator.schedule

    def at(table, where):
        flat = table.reshape(len(p), -1)
        return np.array([np.interp(where, p, column) for column in flat.T])

    gain, tip, way = (at(tables[k], target) for k in (0, 3, 4))
    hold = target - at(tables[5], target) @ np.cumsum(shift) / at(tables[6], target)[0]
    x = np.concatenate([
        angle - at(tables[2], hold) - np.cumsum(shift), rate, scale * valve - [hold, 0.0],
        scale * law.memory.waiting - hold, [law.integral],
    ])  # fmt: skip
    now = mechanics_of(design.model).tips(angle)[-1]
    return (hold - gain @ x) / scale, float((now - tip) @ way)


@pytest.mark.parametrize("slew", [np.inf, 4e5])
def test_the_regulator_is_its_formula(design, slew):
    """Feedback, limits and the count of commands at them, an integral that stops there."""
    law, rng = Lqr(design, Limits(60e3, slew)), np.random.default_rng(3)
    n, integral, before, met = design.model.n, 0.0, 0.0, 0
    for k in range(40):
        target = 2e4 + 500.0 * k
        rest = design.equilibria.at(target)[0]
        angle, rate = rest + rng.normal(0.0, 2e-2, n), rng.normal(0.0, 0.3, n)
        shift, valve, scale = rng.normal(0.0, 5e-3, n), np.array([target, 1e3]), 1.1
        wish, error = command_of(law, target, angle, rate, valve, shift, scale)
        reach = slew * PERIOD
        command = np.clip(wish, max(0.0, before - reach), min(60e3, before + reach))
        met += command != wish
        if (wish - command) * error >= 0.0:
            integral += min(1.0, (design.tuning.integral_band / abs(error)) ** 2) * error * PERIOD
        now = State(0.0, angle, rate, shift, np.zeros(n), np.eye(2 * n), scale)
        assert law.step(target, now, valve) == pytest.approx(command, rel=1e-10, abs=1e-6)
        assert (law.integral, law.error) == pytest.approx((integral, error), rel=1e-9, abs=1e-14)
        before = law.command
    assert law.saturated == met
    assert 0 < met < 40


def test_the_observer_is_its_formula(body):
    """Model ahead, factor on the torque, correction and shifts, frame by frame, with matrices."""
    ends = body.base_length + np.concatenate([[0.0], np.cumsum(body.link_length)])
    follower, rng, n = AdaptiveObserver(body, PERIOD), np.random.default_rng(5), body.n
    link_angles = LinkAngles(body, ends)
    (gain, precision, F, G, _), memory = follower.gains, state.relaxed(body, np.zeros(n))
    phi, w, own, by = mechanics_of(body).coordinates(np.zeros(n)), np.zeros(n), np.zeros(n), np.zeros(3 * n)
    slow, scale, variance, pressure = body.actuation.rest_state(0.0)[0], 1.0, 0.04, 0.0
    chamber = body.chamber.kernel()
    law, c = body.memory.law(), body.memory.instantaneous
    for k in range(4):
        seen = phi + rng.normal(0.0, 2e-3, n)
        across = body.link_length[:, None] * np.stack([-body.bend_sign * np.sin(seen), np.cos(seen)], axis=1)
        frame = np.concatenate([np.zeros((1, 2)), np.cumsum(across, axis=0)])
        follower.push_pressure(k * PERIOD, 3e4)
        pressure, now = (1.5e4 if k == 0 else 3e4), np.array(body.torque) * scale
        follower.push_frame(k * PERIOD, *link_angles.frame(frame))
        if k:
            by = F @ by + G[:, 0] * body.torque_at(pressure)
            variance += 0.02**2 * PERIOD
            joints = mechanics_of(body).joints._replace(theta0=body.rest_angle + own)
            for _ in range(2):
                made = advance(2e-3, Interval(*[pressure] * 4), chamber._replace(law=now), slow)
                past = Past(law, memory, state.held(body.with_(rest_angle=joints.theta0)))
                step_with_memory(
                    phi, w, 2e-3, made * body.joint_gain, mechanics_of(body).body, joints, past, planar.workspace(n)
                )
        nu = seen - phi
        weight = precision @ by[:n]
        part = variance / (1.0 + variance * by[:n] @ weight)
        change = part * weight @ nu
        scale, variance = scale + change, variance * (1.0 - part * weight @ by[:n])
        by = by - gain @ by[:n]
        move = gain @ nu + by * change
        phi, w, own = phi + move[:n], w + move[n : 2 * n], own + move[2 * n :]
        q = mechanics_of(body).joint_angles(phi)
        held = law.creep_share @ (q[:, None] - memory[:, : len(law.creep_share)]).T
        held = held + memory[:, len(law.creep_share) : -1] @ law.slip_share + law.boucwen_share * memory[:, -1]
        found = follower.state(k * PERIOD)
        np.testing.assert_allclose(found.angle, phi, rtol=1e-11)
        np.testing.assert_allclose(found.rate, w, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(found.rest_shift, (own + c * q - held) / (1.0 + c), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.disturbance, body.stiffness * own, rtol=1e-9, atol=1e-14)
        assert found.torque_scale == pytest.approx(scale, rel=1e-11)
        assert found.time == k * PERIOD
    assert (found.consistent, follower.missed) == (True, 0)


def test_a_law_that_begins_with_the_square_is_observed(body):
    """What a torque does to angles and rests is the chain's, whatever law gives it."""
    square = AdaptiveObserver(body.with_(torque=np.array([0.0, 1e-11])), PERIOD).gains
    for one, other in zip(square, AdaptiveObserver(body, PERIOD).gains, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_a_regulator_of_what_no_small_pressure_moves_is_refused(body):
    with pytest.raises(InputError, match="no small pressure moves the tip"):
        design_lqr(frozen(body.with_(torque=np.array([0.0, 1e-11]))), 6e4, PERIOD)


def test_filter_and_regulator_in_one_frame(body, design):
    """The plain text of the one call: what filter and regulator do one after the other."""
    n, noise = body.n, default_noise(body)
    law, apart = Lqr(design, Limits(60e3)), Lqr(design, Limits(60e3))
    rows, out = np.array([(ANGLE, i, 0.0, 0.0) for i in range(n)]), []
    z, valve, shift = mechanics_of(body).coordinates(np.full(n, 0.02)), np.zeros(2), np.zeros(n)
    for _ in range(2):
        P = noise.initial(body)
        rest = np.zeros(n)
        x = FilterState(mechanics_of(body).coordinates(rest), np.zeros(n), np.zeros(n), P, state.relaxed(body, rest))
        prediction = Prediction(1, PERIOD, np.full(n, 0.01), FilterNoise(*noise.densities(body), np.zeros(1)))
        frame = FilterFrame(body.base_angle, observed_chain(body), rows, z, np.full(n, 1e-6), np.empty(n))
        out.append((x, prediction, frame, make_workspace(body, P.shape[0], n)))
    x, prediction, frame, workspace = out[0]
    model = (chain_of(body), AdaptiveObserver(body, PERIOD).body)
    lead = np.zeros(design.gain.shape[1])
    command = filter_and_steer(x, shift, model, prediction, frame, law.inputs(3e4, valve, lead), workspace)
    own, prediction, frame, workspace = out[1]
    filter_loops.predict_span(own, chain_of(body), prediction, workspace)
    filter_loops.update(own, chain_of(body), frame, workspace)
    np.testing.assert_allclose(x.angle, own.angle, rtol=1e-12)
    assert np.abs(own.angle - z).max() < 0.3 * np.abs(z - mechanics_of(body).coordinates(np.zeros(n))).max()
    now = State(0.0, own.angle, own.rate, shift, own.disturbance, own.covariance)
    assert command == pytest.approx(apart.step(3e4, now, valve), rel=1e-12)
