"""Environments of bodies in space: Gymnasium's own check, the motion of a single body, targets within reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from target_models import flat_longer, in_space, longer, pulled, twisting

from pliant.errors import InputError
from pliant.exporters.targets import SurfaceOfTargets, Tips, highest_inputs, input_pattern
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Memory, Space, chain_model, save_model
from pliant.simulation import Stepper, equilibrium

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'pliant[gym]'")
from pliant.exporters.gymnasium import EpisodeTask  # noqa: E402  registers them

SHORT = EpisodeTask(duration=0.1, bodies=2)


def arm(links=2, **fields):
    """Three chambers around an arm that hangs."""
    azimuths = np.radians([90.0, 210.0, 330.0])
    chambers = [Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"c{k}") for k, a in
                enumerate(azimuths)]  # fmt: skip
    return chain_model(length=0.3, mass=0.1, links=links, stiffness=0.5, damping=5e-3, gravity=(0.0, 0.0, 9.81),
                       chambers=chambers, space=Space(radius=0.012)).with_(**fields)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("body", [in_space, twisting, pulled, longer, lambda: arm(memory=Memory((0.1,), (0.3,)))])
@pytest.mark.parametrize("name", ["pliant/Reach-v0", "pliant/Track-v0"])
@pytest.mark.filterwarnings("ignore:.*Box observation space")
def test_clean(name, body):
    from gymnasium.utils.env_checker import check_env

    model = body()
    options = {"highest": [6e4, 6e4, 3.0]} if len(set(model.actuation.units)) > 1 and model.extensions else {}
    check_env(gymnasium.make(name, model=model, task=SHORT, fit={"stiffness": 0.02}, **options).unwrapped,
              skip_render_check=True)  # fmt: skip


@pytest.mark.parametrize("engine", ["pliant", pytest.param("jax", marks=pytest.mark.slow)])
def test_a_batch_from_a_file_moves_each_body_as_alone(engine, tmp_path):
    if engine == "jax":
        pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    model, task = arm(), EpisodeTask(duration=0.1, engine=engine)
    path = save_model(model, tmp_path / "arm.json")
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=3, model=path, highest=6e4, task=task)
    seen, info = envs.reset(seed=1)
    assert seen.shape == (3, 2 * 4 + 2 * 3 + 3)
    assert envs.observation_space.contains(seen)
    alone = [Stepper(model, task.time_step, np.zeros(3)) for _ in range(3)]
    actions = np.random.default_rng(1).uniform(-1.2, 1.2, (5, 3, 3)).astype(np.float32)
    for row in actions:
        seen, reward, lost, late, info = envs.step(row)
        for stepper, action in zip(alone, row, strict=True):
            stepper.step(3e4 * (np.clip(action.astype(float), -1.0, 1.0) + 1.0), 20)
    assert late.all()
    assert not lost.any()
    tips = np.array([s.tips()[-1] for s in alone])
    np.testing.assert_allclose(info["tip"], tips, atol=1e-12)
    assert np.abs(tips - tips[0]).max() > 1e-3
    np.testing.assert_allclose(reward, -np.linalg.norm(tips - info["target"], axis=1) / model.length, atol=1e-12)
    state = np.array([np.concatenate([s.position, 0.02 * s.velocity]) for s in alone])
    np.testing.assert_allclose(seen[:, :8], state, atol=1e-6)
    np.testing.assert_allclose(seen[:, 8:14], np.hstack([tips, info["target"]]) / model.length, atol=1e-6)
    np.testing.assert_allclose(seen[:, 14:], 0.5 * np.clip(actions[-1], -1, 1) + 0.5, atol=1e-6)
    seen, reward, _, late, _ = envs.step(actions[0])
    assert not late.any()
    assert (reward == 0.0).all()
    assert not seen[:, :8].any()


def test_targets_are_reached_at_rest_and_move_around():
    model = arm()
    highest = highest_inputs(model, 6e4)
    surface = SurfaceOfTargets(model, highest)
    chain = mechanics_of(model)
    for level, phase in ((0.5, 0.25), (1.0, 0.5), (0.0, 0.3)):
        inputs = 0.8 * level * highest * input_pattern(np.array([phase]), 3)[0]
        tip = chain.tips(equilibrium(model, inputs))[-1]
        np.testing.assert_allclose(surface.place(np.array([[level, phase]]))[0], tip, atol=1e-12)
    turns = 2 * np.pi * np.array([0.0, 0.25, 0.5, 1.0])
    round_ = surface.moved(np.tile([0.8, 0.1], (4, 1)), turns)
    np.testing.assert_allclose(round_[0], round_[3], atol=1e-12)
    assert np.linalg.norm(round_[2] - round_[0]) > 0.05
    single = input_pattern(np.array([0.0, 0.5]), 1)
    np.testing.assert_allclose(single[:, 0], [0.0, 1.0])


def test_targets_end_where_the_body_gives_way():
    soft = arm(stiffening=-0.5)
    assert len(SurfaceOfTargets(soft, np.full(3, 5e5)).points) < 5


def test_tips_of_bodies_that_differ():
    rng = np.random.default_rng(2)
    for bodies in ([arm(), arm(link_length=[0.1, 0.22])], [flat_longer(), flat_longer().with_(base_length=0.03)]):
        body = np.array([0, 1, 1, 0])
        x = 0.1 * rng.standard_normal((4, bodies[0].size))
        alone = [mechanics_of(bodies[k]).tips(row)[-1] for k, row in zip(body, x, strict=True)]
        np.testing.assert_allclose(Tips(bodies)(body, x), alone, atol=1e-14)


def test_highest_inputs():
    several = pulled(2)
    np.testing.assert_array_equal(highest_inputs(arm(), 0.0), highest_inputs(arm(), 0.0)[0])
    idle = arm(chambers=(*arm().chambers, Chamber([0.0], name="idle")))
    assert highest_inputs(idle, 0.0)[3] == highest_inputs(arm(), 0.0)[0]
    np.testing.assert_array_equal(highest_inputs(several, [1e-3, 0.2, 3.0]), [1e-3, 0.2, 3.0])
    with pytest.raises(InputError, match="several units: give one highest value for each, in m, rad, N"):
        highest_inputs(several, 2.0)
    with pytest.raises(InputError, match="one value of at least 0, or one for each of 3 inputs"):
        highest_inputs(arm(), [1.0, 2.0])
    with pytest.raises(InputError, match="at least 0"):
        highest_inputs(arm(), -1.0)
    with pytest.raises(InputError, match="pressure does not bend this model"):
        highest_inputs(arm(chambers=(Chamber([0.0]),)), 0.0)


def test_what_an_environment_refuses():
    def reset(model, **task):
        gymnasium.make("pliant/Reach-v0", model=model, highest=6e4, task=EpisodeTask(**task)).reset(seed=1)

    with pytest.raises(InputError, match="engine must be 'pliant' or 'jax', got 'torch'"):
        reset(arm(), engine="torch")
    with pytest.raises(InputError, match="measures joint angles in the plane"):
        reset(arm(), observe="fibre")
    late = [replace(c, valve=replace(c.valve, dead_time=0.05)) for c in arm().chambers]
    for engine in ("pliant", "jax"):
        with pytest.raises(InputError, match="dead time"):
            reset(arm(chambers=tuple(late)), engine=engine)


@pytest.mark.slow
def test_bodies_of_a_batch_in_jax_share_their_structure():
    pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    from pliant.exporters.jax_batch import JaxBodies

    bodies = [arm(), arm(memory=Memory((0.1,), (0.3,)))]
    with pytest.raises(InputError, match=r"must share their structure, and differ in .*BRANCHES"):
        JaxBodies(bodies, 2, 1e-3)
