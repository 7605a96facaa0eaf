"""Environments that Gymnasium's own check finds nothing in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.simulation import simulate
from pliant.simulation.inputs import Trace

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'pliant[gym]'")
from pliant.exporters.gymnasium import Task  # noqa: E402  registers them


@pytest.mark.parametrize("name", ["pliant/Reach-v0", "pliant/Track-v0"])
@pytest.mark.filterwarnings("ignore:.*Box observation space")
def test_clean(name, model):
    from gymnasium.utils.env_checker import check_env

    if model.valve.dead_time:
        with pytest.raises(InputError, match="ideal or first-order valve"):
            gymnasium.make(name, model=model)
        model = model.with_(valve=replace(model.valve, dead_time=0.0))
    check_env(gymnasium.make(name, model=model).unwrapped, skip_render_check=True)


def test_the_motion_is_that_of_simulate():
    model = chen2018.model()
    env = gymnasium.make("pliant/Reach-v0", model=model, highest=2e5, task=Task(duration=0.4))
    env.reset(seed=1)
    actions, tips = np.linspace(-1.0, 1.0, 20), []
    for k, a in enumerate(actions):
        seen, reward, lost, late, info = env.step(np.array([a], dtype=np.float32))
        tips.append(info["tip"])
        assert (lost, late) == (False, k == 19)
        assert reward == pytest.approx(-np.linalg.norm(info["tip"] - info["target"]) / model.length)
        assert np.isfinite(seen).all()
    edges = np.arange(21) * 0.02
    levels = (actions.astype(np.float32).astype(float) + 1) * 1e5
    run = simulate(model, Trace(np.repeat(edges, 2)[1:-1], np.repeat(levels, 2)), times=edges, step=1e-3,
                   initial_angle=np.zeros(5))  # fmt: skip
    assert np.array(tips) == pytest.approx(run.tip_position.values[1:, -1], abs=1e-10)


def test_seeds_and_drawn_bodies():
    model = chen2018.model()
    errors = {"stiffness": 0.2, "damping": 1e-3}
    env = gymnasium.make("pliant/Track-v0", model=model, standard_errors=errors)
    action = np.ones(1, dtype=np.float32)

    def episode(seed):
        first = [env.reset(seed=seed)[0]]
        return np.array(first + [env.step(action)[0] for _ in range(20)])

    one, same, other = episode(1), episode(1), episode(2)
    assert np.array_equal(one, same)
    bend = [rows[-1][:5].sum() for rows in (one, other)]
    assert bend[0] != pytest.approx(bend[1], rel=1e-3)


def test_a_vector_of_them():
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=3, vectorization_mode="sync", model=chen2018.model())
    seen, _ = envs.reset(seed=3)
    assert seen.shape == (3, 15)
    seen, reward, *_ = envs.step(np.zeros((3, 1), dtype=np.float32))
    assert (reward < 0).all()
    envs.close()


def test_bad_input():
    with pytest.raises(InputError, match="'valve_rise' is known to a fit, but no field"):
        gymnasium.make("pliant/Reach-v0", model=chen2018.model(), standard_errors={"valve_rise": 0.1})
    with pytest.raises(InputError, match="no pressure bends this model"):
        gymnasium.make("pliant/Reach-v0", model=chen2018.model(torque=[0.0]))
