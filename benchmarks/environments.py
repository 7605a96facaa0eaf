"""Measure environment steps per second beside MuJoCo with the exported MJCF, in one run on one core.

    python benchmarks/environments.py -o benchmarks/results/environments.json

The task is free motion of the paper's five links, with 20 ms between actions. pliant runs its vector environment
(motion, observations, rewards, autoreset) at 1 ms. MuJoCo runs one environment by `mj_step`, and a batch by
`mujoco.rollout` on one thread, with the same observations and rewards computed by the same NumPy code. MuJoCo runs at 1
ms and at the longest step at which one of its integrators is as accurate as pliant at 1 ms. Times are processor times,
the best of several.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import gymnasium
import mujoco
import mujoco.rollout
import numpy as np

import pliant.exporters.gymnasium  # noqa: F401  registers
from pliant.actuators import chen2018
from pliant.exporters.mjcf import mjcf
from pliant.exporters.provenance import Provenance
from pliant.simulation import Trace, simulate

PERIOD, ACTIONS, HIGHEST = 0.02, 50, 1e5
INTEGRATORS = {name: int(getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")) for name in ("implicitfast", "rk4")}


def best(run, repeats=5):
    """Return the least processor time of a few runs, s."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        run()
        times.append(time.process_time() - began)
    return min(times)


def loaded(model, step, integrator="implicitfast"):
    m = mujoco.MjModel.from_xml_string(mjcf(model, Provenance(model, "mjcf", "benchmark"), time_step=step))
    m.opt.integrator = INTEGRATORS[integrator]
    m.geom_contype[:], m.geom_conaffinity[:] = 0, 0  # free motion: no collision is looked for
    return m


def pressures():
    return np.random.default_rng(1).uniform(0.0, HIGHEST, ACTIONS)


def mujoco_tips(model, step, integrator):
    m = loaded(model, step, integrator)
    d, tips = mujoco.MjData(m), []
    for p in pressures():
        d.ctrl[:] = p
        mujoco.mj_step(m, d, round(PERIOD / step))
        mujoco.mj_kinematics(m, d)
        tips.append(d.site_xpos[-1, :2].copy())
    return np.array(tips)


def pliant_tips(model, step, method):
    edges = np.arange(ACTIONS + 1) * PERIOD
    held = Trace(np.repeat(edges, 2)[1:-1], np.repeat(pressures(), 2))
    run = simulate(model, held, times=edges, time_step=step, method=method, initial_angle=np.zeros(model.n))
    return run.tip_position.values[1:, -1]


def accuracy(model):
    """Return the largest tip error [mm] of pliant at 1 ms, and MuJoCo's cheapest setting with the same accuracy."""
    true = pliant_tips(model, 1e-3, "Radau")

    def error(tips):
        return 1e3 * float(np.abs(tips - true).max())

    own = error(pliant_tips(model, 1e-3, "midpoint"))
    told = {"pliant_1ms_mm": own, "mujoco_mm": {}, "settings": {}}
    for integrator in INTEGRATORS:
        for parts in (20, 25, 32, 40, 50, 80, 100, 200, 400, 800, 2000, 4000):
            found = error(mujoco_tips(model, PERIOD / parts, integrator))
            told["mujoco_mm"][f"{integrator}, {1e3 * PERIOD / parts:.4g} ms"] = found
            if found <= own:
                told["settings"][integrator] = PERIOD / parts
                break
    return told


def by_steps(model, step, integrator):
    """Return environment steps per second of one environment by mj_step."""
    m = loaded(model, step, integrator)
    d, count = mujoco.MjData(m), round(PERIOD / step)

    def episode():
        for p in pressures():
            d.ctrl[:] = p
            mujoco.mj_step(m, d, count)
            np.concatenate([d.qpos, d.qvel * PERIOD, d.site_xpos[-1, :2], d.ctrl]).astype(np.float32)

    return ACTIONS / best(episode)


def by_rollout(model, step, integrator, size):
    """Return environment steps per second of a batch by mujoco.rollout on one thread."""
    m = loaded(model, step, integrator)
    d, count = mujoco.MjData(m), round(PERIOD / step)
    kind, C = mujoco.mjtState.mjSTATE_FULLPHYSICS, m.nu
    width = mujoco.mj_stateSize(m, kind)
    now, out = np.zeros((size, width)), np.zeros((size, count, width))
    sensed = np.zeros((size, count, m.nsensordata))
    mujoco.mj_getState(m, d, now[0], kind)
    now[:] = now[0]
    target = np.array([0.05, 0.15])

    def episode():
        for p in pressures()[:10]:
            control = np.full((size, count, C), p)
            mujoco.rollout.rollout(
                [m] * size, [d], now, control, state=out, sensordata=sensed, skip_checks=True, nstep=count,
                initial_warmstart=None,
            )
            now[:] = out[:, -1]
            tip, command = sensed[:, -1, :2], control[:, 0]
            q, dq = now[:, 1 : 1 + m.nq], now[:, 1 + m.nq : 1 + m.nq + m.nv]
            goal = np.broadcast_to(target, tip.shape)
            np.concatenate([q, dq * PERIOD, tip, goal, command], axis=1).astype(np.float32)
            np.linalg.norm(tip - target, axis=1)

    return 10 * size / best(episode, 3)


def own(model, size, **options):
    """Return environment steps per second of pliant's vector environment."""
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=size, model=model, highest=HIGHEST, **options)
    envs.reset(seed=1)
    actions = np.random.default_rng(1).uniform(-1, 1, (ACTIONS, size, 1)).astype(np.float32)

    def episode():
        for a in actions:
            envs.step(a)

    episode()
    return ACTIONS * size / best(episode)


def single(model):
    """Return environment steps per second of pliant/Reach-v0."""
    env = gymnasium.make("pliant/Reach-v0", model=model, highest=HIGHEST).unwrapped
    env.reset(seed=1)
    action = np.zeros(1, dtype=np.float32)

    def episode():
        for _ in range(ACTIONS):
            env.step(action)

    return ACTIONS / best(episode)


def measured(model):
    """Return all measurements as a dictionary."""
    near = accuracy(model)
    told = {"accuracy": near, "mujoco_env_steps_per_s": {}, "pliant_env_steps_per_s": {"one": single(model)}}
    for name, step, integrator in (
        ("1 ms", 1e-3, "implicitfast"), *((f"as near as pliant, {k}", h, k) for k, h in near["settings"].items()),
    ):
        rows = {"mj_step": by_steps(model, step, integrator)}
        rows["rollout of 256"] = by_rollout(model, step, integrator, 256)
        told["mujoco_env_steps_per_s"][f"{name} ({1e3 * step:.4g} ms)"] = rows
    for size in (64, 256, 1024):
        told["pliant_env_steps_per_s"][f"batch of {size}"] = own(model, size)
    told["pliant_env_steps_per_s"]["batch of 256, drawn bodies"] = own(model, 256, fit={"stiffness": 0.05})
    most = max(v for k, v in told["pliant_env_steps_per_s"].items() if "drawn" not in k)
    peers = told["mujoco_env_steps_per_s"]
    told["over_mujoco_at_1_ms"] = most / max(peers["1 ms (1 ms)"].values())
    told["over_mujoco_as_near"] = most / max(max(v.values()) for k, v in peers.items() if k != "1 ms (1 ms)")
    return told


def main():
    mujoco.set_mju_user_warning(lambda _: None)  # Runge-Kutta is unstable at long steps, which is what is looked for
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path)
    asked = parser.parse_args()
    text = json.dumps(measured(chen2018.model()), indent=1)
    print(text)
    if asked.output:
        asked.output.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
