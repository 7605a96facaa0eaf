"""The compiled regulator against its formula on matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.control import Limits, Lqr, design_lqr, design_outputs
from pliant.errors import InputError
from pliant.estimation import State, frozen
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


def test_a_regulator_of_what_no_small_pressure_moves_is_refused(body):
    with pytest.raises(InputError, match="a small change of the inputs does not move the tip"):
        design_lqr(frozen(body.with_(torque=np.array([0.0, 1e-11]))), 6e4, PERIOD)
