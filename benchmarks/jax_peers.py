"""Times of compiling and of a step on the processor, of the exported JAX module and others, for one arm in one run.

The arm is that of space_speed.py: five links that bend in space, released from a bend, in steps of 1 ms. pliant steps
it alone (`Stepper`) and in SIMD vectors (`batch_stepper`); JAX runs the exported module, MJX the exported MJCF, and
soromox five segments of constant strain, by its semi-implicit Euler rule. All are in double precision. Processor times,
of the fastest of several runs in turn; compiling is the first call. What is not installed is left out.

python benchmarks/jax_peers.py [--bodies 256] [--steps 50] [--runs 3]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from harness import table
from jax_bodies import exported
from space_speed import LINKS, arm, start
from speed.timing import machine

import pliant
from pliant.batch.stepper import batch_stepper
from pliant.exporters.jax_batch import rest_states
from pliant.simulation import Stepper

STEP = 1e-3  # s
Run = Callable[[], Any]


def pliant_runs(bodies: int, steps: int) -> dict[str, Run]:
    """Return runs of pliant's own steps: of one body, and of a batch."""
    model = arm(2).model
    one, many = Stepper(model, STEP), batch_stepper([model], bodies, STEP)
    return {"pliant, alone": lambda: one.step(0.0, steps * bodies),
            "pliant, batch": lambda: many.hold(np.zeros((bodies, 1)), steps)}  # fmt: skip


def jax_run(bodies: int, steps: int) -> Run:
    """Return a run of the exported module."""
    model = arm(2).model
    module = exported(model)
    rest = module.BodyState(*(jnp.asarray(part[0]) for part in rest_states([model])))
    states = jax.tree_util.tree_map(lambda a: jnp.broadcast_to(a, (bodies, *a.shape)), rest)
    states = states._replace(position=jnp.broadcast_to(jnp.asarray(start(2)), states.position.shape))
    command = jnp.zeros(1)

    def rolled(state: Any) -> Any:
        def one(now: Any, _: None) -> tuple[Any, None]:
            return module.step(module.parameters, now, command, STEP), None

        return jax.lax.scan(one, state, None, steps)[0].position

    many = jax.jit(jax.vmap(rolled))
    return lambda: many(states).block_until_ready()


def mjx_run(bodies: int, steps: int) -> Run:
    """Return a run of the exported MJCF in MJX."""
    import mujoco
    from mujoco import mjx

    with tempfile.TemporaryDirectory() as folder:
        pliant.export(arm(2).model, "mjcf", Path(folder) / "arm.xml", time_step=STEP)
        m = mujoco.MjModel.from_xml_path(str(Path(folder) / "arm.xml"))
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    fixed, moving = mjx.put_model(m), mjx.put_data(m, d)
    positions = jnp.broadcast_to(moving.qpos + 0.1, (bodies, m.nq))

    def rolled(qpos: Any) -> Any:
        first = mjx.step(fixed, moving.replace(qpos=qpos))  # whose arrays have the types that steps return
        return jax.lax.scan(lambda now, _: (mjx.step(fixed, now), None), first, None, steps - 1)[0].qpos

    many = jax.jit(jax.vmap(rolled))
    return lambda: many(positions).block_until_ready()


def soromox_run(bodies: int, steps: int) -> Run:
    """Return a run of soromox."""
    from soromox.simulation import SemiImplicitEuler
    from soromox.systems.system_state import SystemState
    from space_soromox import arm as strained
    from space_soromox import begin

    robot = strained(2)
    solver = SemiImplicitEuler(robot)

    def rolled(y: Any) -> Any:
        return robot.rollout_to(SystemState(t=0.0, y=y), t1=steps * STEP, solver_dt=STEP, save_ts=[steps * STEP],
                                solver=solver, max_steps=steps + 1).y  # fmt: skip

    many, states = jax.jit(jax.vmap(rolled)), jnp.broadcast_to(begin(2), (bodies, 4 * LINKS))
    return lambda: many(states).block_until_ready()


def main(bodies: int, steps: int, runs: int) -> None:
    """Print a table of compile times and of times a step and body."""
    jax.config.update("jax_enable_x64", True)
    print(machine())
    jobs, counts = pliant_runs(bodies, steps), {}
    for name, made in (("JAX module", jax_run), ("MJX", mjx_run), ("soromox", soromox_run)):
        for count in (1, bodies):
            try:
                jobs[key := f"{name}, {count} at once"] = made(count, steps)
                counts[key] = count
            except ImportError:
                print(f"{name} is not installed")
    compiling, best = {}, dict.fromkeys(jobs, np.inf)
    for k in range(runs + 1):
        for name, job in jobs.items():
            began = process_time()
            job()
            took = process_time() - began
            compiling.setdefault(name, took)
            best[name] = min(best[name], took) if k else np.inf
            if not k:
                print(f"{name}: first call {took:.2f} s of the processor", flush=True)
    print(table({name: {"first call (s)": f"{compiling[name]:.2f}",
                        "a step and body (µs)": f"{1e6 * best[name] / counts.get(name, bodies) / steps:.3g}"}
                 for name in jobs}))  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--bodies", type=int, default=256)
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    main(options.bodies, options.steps, options.runs)
