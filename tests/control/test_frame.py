"""The compiled frame of the loop, observer and regulator, against their formulas on matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.compiler.trace import planar_workspace
from pliant.control import Limits, Lqr, design_lqr, design_outputs
from pliant.equations.chamber import advance
from pliant.equations.memory import step_with_memory
from pliant.equations.symbols import Interval, Past
from pliant.errors import InputError
from pliant.estimation import AdaptiveObserver, LinkAngles, State, frozen
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Valve, chain_model, load_model
from pliant.simulation import state

MODEL = Path(__file__).parents[2] / "examples" / "control" / "model_a.json"
PERIOD = 4e-3


@pytest.fixture(scope="module")
def body():
    return load_model(MODEL)


def formula(law, k, now, behind):
    """Commands before their limits [Pa] and errors of the outputs [m], with matrices."""
    design, gains, scale, n = law.design, law.design.gains[law.design.at[k]], now.torque_scale, law.design.model.size
    turn = np.append(np.cumsum(now.rest_shift), now.strain_shift)
    more = -gains.inverse @ (gains.rest.row[:, :n] @ turn)
    x = np.concatenate([
        now.angle, now.strain, now.rate, now.strain_rate, scale * np.concatenate([behind, *law._waiting]) / 1e3,
        law._integral,
    ])  # fmt: skip
    rest = design.resting @ (design.pressure[k] + more) / 1e3 + design.beside[k]
    rest[:n] += design.angle[k] + turn + gains.slope @ more
    wish = design.pressure[k] + more + 1e3 * (design.lead[k] - gains.K @ (x - rest))
    tip = mechanics_of(design.model).tips(np.append(now.angle, now.strain))[-1]
    return wish / scale, tip - design.still - design.wanted[k]


def designs():
    """One chamber, and two of a body that lengthens, along a path."""
    one = frozen(load_model(MODEL))
    lag = Valve(rise_time=0.02, fall_time=0.02, dead_time=6e-3)
    pair = [Chamber.at_offset(2e-4, r, np.ones(3), name=n, valve=lag) for r, n in ((0.02, "a"), (-0.02, "b"))]
    two = chain_model(
        length=0.2, mass=0.1, links=3, joint_placement="midsegment", stiffness=1.0, damping=0.015, chambers=pair,
        gravity=[0.0, 9.81], base_angle=0.1, extensions=(Extension(130.0, 0.6, 0.0, 0.2),),
    )
    for body, pressure in ((one, [4e4]), (two, [5e4, 2e4])):
        mechanics, scales = mechanics_of(body), np.linspace(0.0, 1.0, 30)
        rests = [state.equilibrium(body, float(p) if len(pressure) == 1 else p)
                 for p in (np.squeeze(scale * np.array(pressure)) for scale in scales)]  # fmt: skip
        tips = np.array([mechanics.tips(mechanics.coordinates(q))[-1] for q in rests])
        yield design_outputs(body, ("tip_x", "tip_y"), tips - tips[0], Limits(190e3), PERIOD, latency=PERIOD, path=True)


@pytest.mark.parametrize("slew", [np.inf, 4e5])
@pytest.mark.parametrize("which", [0, 1])
def test_the_regulator_is_its_formula(which, slew):
    """Feedback, limits and the count of commands at them, integrals that stop there."""
    design, rng = list(designs())[which], np.random.default_rng(3)
    law, C, n, S = Lqr(design, Limits(60e3, slew)), which + 1, design.model.n, len(design.model.extensions)
    integral, met, before = np.zeros(2), 0, np.zeros(C)
    for step in range(40):
        k = min(max(step - 1, 0), len(design.at) - 1)
        strain, speed, drawn = 1e-2 * rng.standard_normal((3, S))
        now = State(
            0.0, design.angle[k][:n] + rng.normal(0.0, 2e-2, n), rng.normal(0.0, 0.3, n), rng.normal(0.0, 5e-3, n),
            np.zeros(n), np.eye(2 * n), 1.1, "", design.angle[k][n:] + strain, speed, 0.1 * drawn,
        )
        queues = [list(valve._queue) for valve in law._valves]
        values = [valve.value.copy() for valve in law._valves]
        behind = np.concatenate([
            followed(valve, queue, value, asked)
            for valve, queue, value, asked in zip(law._valves, queues, values, before, strict=True)
        ])
        wish, error = formula(law, k, now, behind)
        reach = slew * PERIOD
        command = np.clip(wish, np.maximum(0.0, before - reach), np.minimum(60e3, before + reach))
        met += (command != wish).any()
        gains = design.gains[design.at[k]]
        driven = gains.driven @ error
        grown = min(1.0, (design.tuning.integral_band / np.linalg.norm(driven)) ** 2) * driven * PERIOD
        if (wish - command) @ (gains.K[:, -2:] @ grown) >= 0.0:
            integral = integral + grown
        np.testing.assert_allclose(law.step(step * PERIOD, now, np.full(C, np.nan)), command, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(law._integral, integral, rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(law.error, error, rtol=1e-9, atol=1e-14)
        before = law.command.copy()
    assert law.saturated == met
    assert 0 < met <= 40


def followed(valve, queue, value, asked):
    """States of a valve after a period, without a gauge, from its matrices."""
    return (valve._A @ value + valve._B * [*queue, asked][0])[: valve.order]


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
        across = body.link_length[:, None] * np.stack([-np.sin(seen), np.cos(seen)], axis=1)
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
                past = Past(law, memory, mechanics_of(body.with_(rest_angle=joints.theta0)).held())
                step_with_memory(
                    phi, w, 2e-3, made * body.joint_gain, mechanics_of(body).body, joints, past, planar_workspace(n)
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
    with pytest.raises(InputError, match="a small change of the inputs does not move the tip"):
        design_lqr(frozen(body.with_(torque=np.array([0.0, 1e-11]))), 6e4, PERIOD)
