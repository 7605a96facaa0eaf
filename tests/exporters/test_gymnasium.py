"""Environments that Gymnasium's own check finds nothing in, alone and as one batch of lanes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.exporters.gymnasium import FibreView
from pliant.exporters.randomisation import draw_models
from pliant.model import save_model
from pliant.simulation import simulate
from pliant.simulation.inputs import Trace
from pliant.testbed import fibre

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'pliant[gym]'")
from pliant.exporters.gymnasium import EpisodeTask  # noqa: E402  registers them

ERRORS = {"stiffness": 0.2, "damping": 1e-3}


@pytest.mark.parametrize("name", ["pliant/Reach-v0", "pliant/Track-v0"])
@pytest.mark.filterwarnings("ignore:.*Box observation space")
def test_clean(name, model):
    from gymnasium.utils.env_checker import check_env

    if model.valve.dead_time:
        with pytest.raises(InputError, match="ideal or first-order valve"):
            gymnasium.make(name, model=model).reset(seed=1)
        model = model.with_(valve=replace(model.valve, dead_time=0.0))
    for observe in ("perfect", "fibre"):
        task = EpisodeTask(observe=observe, bodies=2)
        check_env(gymnasium.make(name, model=model, task=task, fit=ERRORS).unwrapped, skip_render_check=True)


def test_the_motion_is_that_of_simulate():
    model = chen2018.model()
    env = gymnasium.make("pliant/Reach-v0", model=model, highest=2e5, task=EpisodeTask(duration=0.4))
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
    run = simulate(model, Trace(np.repeat(edges, 2)[1:-1], np.repeat(levels, 2)), times=edges, time_step=1e-3,
                   initial_angle=np.zeros(5))  # fmt: skip
    assert np.array(tips) == pytest.approx(run.tip_position.values[1:, -1], abs=1e-10)


def test_seeds_and_drawn_bodies():
    model = chen2018.model()
    env = gymnasium.make("pliant/Track-v0", model=model, fit=ERRORS)
    action = np.ones(1, dtype=np.float32)

    def episode(seed):
        first = [env.reset(seed=seed)[0]]
        return np.array(first + [env.step(action)[0] for _ in range(20)])

    one, same, other = episode(1), episode(1), episode(2)
    assert np.array_equal(one, same)
    bend = [rows[-1][:5].sum() for rows in (one, other)]
    assert bend[0] != pytest.approx(bend[1], rel=1e-3)


def test_a_batch_moves_each_body_as_alone(model):
    """Eleven bodies, more than a group of lanes holds; an episode that ends begins anew at the next step."""
    model = model.with_(valve=replace(model.valve, dead_time=0.0))
    task = EpisodeTask(duration=0.1)
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=11, model=model, task=task)
    seen, info = envs.reset(seed=3)
    assert seen.shape == (11, envs.single_observation_space.shape[0])
    assert envs.observation_space.contains(seen)
    actions = np.random.default_rng(1).uniform(-1, 1, (5, 11, 1)).astype(np.float32)
    for row in actions:
        seen, reward, lost, late, info = envs.step(row)
    assert late.all()
    assert not lost.any()
    for k in (0, 7, 8, 10):
        one = gymnasium.make("pliant/Reach-v0", model=model, task=task)
        one.reset(seed=k)
        for row in actions:
            told = one.step(row[k])[-1]
        assert info["tip"][k] == pytest.approx(told["tip"], abs=1e-14)
    seen, reward, lost, late, info = envs.step(actions[0])
    assert not late.any()
    assert (reward == 0).all()
    assert np.abs(seen[:, model.n : 2 * model.n]).max() == 0.0, "at rest"
    assert (envs.step(actions[0])[1] < 0).all()


def test_a_body_that_gives_way_ends_alone():
    """Springs that soften give way under the highest pressure; the neighbour in the next lane moves on."""
    model = chen2018.model(stiffening=-0.9)
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=2, model=model, highest=1e6)
    envs.reset(seed=1)
    for _ in range(20):
        seen, reward, lost, _, _ = envs.step(np.array([[1.0], [-1.0]], dtype=np.float32))
        assert np.isfinite(seen).all()
        if lost.any():
            break
    assert lost.tolist() == [True, False]
    assert reward[0] == -10
    assert -2 < reward[1] < 0


def test_bodies_of_the_covariance(tmp_path):
    """Drawn bodies have the covariance that the fit tells, its correlation included; records' own are left out."""
    model, n = chen2018.model(), 600
    stiffness, damping = float(model.stiffness[0]), float(model.damping[0])
    spread = np.array([[0.02 * stiffness, 0.8], [0.0, 0.1 * damping]])
    spread[0, 1] = 0.8 * spread[0, 0] * spread[1, 1]
    C = np.diag([spread[0, 0] ** 2, spread[1, 1] ** 2, 1.0]) + np.pad(np.diag([spread[0, 1]], 1), (0, 1))
    C = np.maximum(C, C.T)
    rows = {"stiffness": {"value": stiffness}, "damping": {"value": damping}, "pulse.start": {"value": 0.1}}
    told = {"parameters": rows, "covariance": {"names": list(rows), "matrix": C.tolist(), "hidden": [False] * 3}}
    (tmp_path / "metrics.json").write_text(json.dumps({"fits": {"one": told}}), encoding="utf-8")
    bodies = draw_models(model, tmp_path / "metrics.json", n, 1)
    read = draw_models(str(save_model(model, tmp_path / "model.json")), str(tmp_path / "metrics.json"), 2, 1)
    assert [m.stiffness[0] for m in read] == [m.stiffness[0] for m in bodies[:2]]
    for wrong, words in ((tmp_path / "none.json", "cannot read the model file"), ({}, "expected a Model or the path"),
                         (tmp_path / "metrics.json", "metrics.json is a study, not a model")):  # fmt: skip
        with pytest.raises(InputError, match=words):
            draw_models(wrong, tmp_path / "metrics.json", 2)
    drawn = np.array([[m.stiffness[0], m.damping[0]] for m in bodies])
    assert np.std(drawn, axis=0) == pytest.approx(np.sqrt(np.diag(C)[:2]), rel=4 / np.sqrt(2 * n))
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.8, abs=4 * (1 - 0.8**2) / np.sqrt(n))
    assert all(m.tip_mass == model.tip_mass for m in bodies[:10])


def test_the_fibre_is_that_of_the_laboratory():
    """Noise and bias of a joint angle are those of the emulator's curvature, summed over the joint's stretch."""
    model, sensor = chen2018.model(), fibre.FibreSensor()
    view, rng = FibreView(model, 5000, 0.02, sensor), np.random.default_rng(1)
    view.reset(np.arange(5000), rng)
    straight = np.tile(model.base_angle + np.cumsum(model.rest_angle), (5000, 1))
    seen = np.diff(view.see(straight, rng), axis=1, prepend=model.base_angle) - model.rest_angle
    station = np.arange(0.0, model.length, sensor.spacing)
    fields = [
        fibre.wandering_bias(sensor, station, np.zeros(1), rng)[0] + sensor.noise * rng.standard_normal(station.size)
        for _ in range(1500)
    ]
    link = np.minimum((station / model.link_length[0]).astype(int), model.n - 1)
    angles = np.array([[f[link == i].sum() * sensor.spacing for i in range(model.n)] for f in fields])
    assert seen.std(axis=0) == pytest.approx(angles.std(axis=0), rel=0.08)
    neighbours = [np.corrcoef(a[:, 1], a[:, 2])[0, 1] for a in (seen, angles)]
    assert neighbours[0] == pytest.approx(neighbours[1], abs=0.1)
    assert neighbours[0] > 0.2


def test_bad_input(tmp_path):
    model = chen2018.model()

    def reset(**options):
        gymnasium.make("pliant/Reach-v0", model=model, **options).reset(seed=1)

    with pytest.raises(InputError, match="'valve_rise_time' is not a field"):
        reset(fit={"valve_rise_time": 0.1})
    with pytest.raises(InputError, match=r"the result of a fit .*none\.json"):
        reset(fit=tmp_path / "none.json")
    with pytest.raises(InputError, match="50 consecutive draws gave no valid model"):
        reset(fit={"stiffness": 1e18})
    with pytest.raises(InputError, match="observe must be 'perfect' or 'fibre'"):
        reset(task=EpisodeTask(observe="camera"))
    with pytest.raises(InputError, match="pressure does not bend this model"):
        gymnasium.make("pliant/Reach-v0", model=chen2018.model(torque=[0.0]))
