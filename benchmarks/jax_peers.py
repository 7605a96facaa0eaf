"""Compile times and times of a step on one core: the exported JAX module, pliant's own steps, MuJoCo, MJX and soromox.

The arm of `space_speed.py`: five links of together 0.17 m, straight at first, under gravity across it, in a plane (5
coordinates) and in space (10). All programs take steps of 1 ms in double precision; soromox has arcs where the others
have joints, and semi-implicit Euler steps. "one" and "many" are processor times per step and body, of the fastest of
several runs; the gradient is that of the tip after the last step by all coordinates of the start, in reverse mode. The
tips after the last step show that the bodies are the same. A program that is not installed has no row: `pip install
mujoco-mjx soromox`. The first call compiles: with NUMBA_CACHE_DIR set to an empty folder, also for pliant itself.

    python benchmarks/jax_peers.py [plane] [space] [--bodies 64] [--steps 100]
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from time import process_time
from typing import Any

import numpy as np
from export import in_mujoco
from harness import Case, measured
from space_speed import LENGTH, LINKS, body
from speed.timing import best

import pliant
from pliant.batch.stepper import batch_stepper
from pliant.simulation import Pulse, Stepper

STEP = 1e-3  # s
Row = dict[str, Any]
timed = partial(best, seconds=0.3, repeats=3, clock=process_time)


def first_call(job: Callable[[], Any]) -> float:
    """Return the processor time [s] of the first call."""
    start = process_time()
    job()
    return process_time() - start


def pliant_itself(turns: int, bodies: int, steps: int) -> Row:
    """Return the times of `Stepper` and of a batch that keeps its states."""
    model, still = body(turns), np.zeros((bodies, 1))
    stepper, batch = Stepper(model, STEP, 0.0), batch_stepper([model], bodies, STEP)
    compiling = first_call(lambda: (stepper.step(0.0, steps), batch.hold(still, steps)))
    fallen = simulate_tip(model, steps)
    one, many = timed(lambda: stepper.step(0.0, steps)), timed(lambda: batch.hold(still, steps))
    return {"first call (s)": compiling, "one (ns)": 1e9 / steps * one, "many (ns)": 1e9 / steps / bodies * many,
            "tip (mm)": 1e3 * fallen}  # fmt: skip


def simulate_tip(model: pliant.Model, steps: int) -> float:
    """Return how far the tip [m] has moved along gravity after a start from the straight shape."""
    times = np.array([0.0, steps * STEP])
    run = pliant.simulate(model, Pulse(0.0), times=times, time_step=STEP, initial_angle=np.zeros(model.n * model.turns))
    return float(run.tip_position.values[-1, -1, 0])


def in_jax(last: Callable[[Any], Any], tip: Callable[[Any], Any], start: Any, bodies: int, steps: int) -> Row:
    """Return the times of a program in JAX: `last(start)` is the state after all steps, and `tip` of it the position
    of the tip along gravity.
    """
    import jax
    import jax.numpy as jnp

    starts = jax.tree_util.tree_map(lambda a: jnp.broadcast_to(a, (bodies, *jnp.shape(a))), start)
    one, many = jax.jit(last), jax.jit(jax.vmap(last))
    slope = jax.jit(jax.vmap(jax.grad(lambda begun: tip(last(begun)), allow_int=True)))
    runs = [partial(lambda f, x: jax.block_until_ready(f(x)), *pair) for pair in
            ((one, start), (many, starts), (slope, starts))]  # fmt: skip
    row: Row = {"first call (s)": first_call(runs[1]), "one (ns)": 1e9 / steps * timed(runs[0]),
                "many (ns)": 1e9 / steps / bodies * timed(runs[1])}  # fmt: skip
    row["tip (mm)"] = 1e3 * float(tip(one(start)))
    row["gradient, first call (s)"] = first_call(runs[2])
    return row | {"gradient, many (ns)": 1e9 / steps / bodies * timed(runs[2])}


def exported(turns: int, bodies: int, steps: int) -> Row:
    """Return the times of the exported JAX module."""
    from jax import lax
    from jax_bodies import exported as module_of

    arm = module_of(body(turns))
    start = arm.rest(arm.parameters, np.zeros(1))
    start = start._replace(position=0.0 * start.position)

    def last(state: Any) -> Any:
        still = np.zeros(1)
        return lax.scan(lambda s, _: (arm.step(arm.parameters, s, still, STEP), None), state, None, steps)[0]

    return in_jax(last, lambda s: arm.observe(arm.parameters, s)["tips"][-1, 0], start, bodies, steps)


def mujoco(turns: int, bodies: int, steps: int) -> Row:
    """Return the times of MuJoCo's step of the exported MJCF: `mj_step` and, on one thread, `rollout`."""
    import mujoco
    import mujoco.rollout

    m = in_mujoco(body(turns), STEP, "implicitfast")
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d, steps)
    mujoco.mj_kinematics(m, d)
    tip, full = float(d.site_xpos[-1, 0]), mujoco.mjtState.mjSTATE_FULLPHYSICS
    begun, still = np.zeros((bodies, mujoco.mj_stateSize(m, full))), np.zeros((bodies, steps, m.nu))

    def many() -> None:
        mujoco.rollout.rollout([m] * bodies, [d], begun, still, nstep=steps, skip_checks=True, initial_warmstart=None)

    return {"one (ns)": 1e9 / steps * timed(lambda: mujoco.mj_step(m, d, steps)),
            "many (ns)": 1e9 / steps / bodies * timed(many), "tip (mm)": 1e3 * tip}  # fmt: skip


def mjx(turns: int, bodies: int, steps: int) -> Row:
    """Return the times of MJX, MuJoCo's version in JAX, for the exported MJCF."""
    from jax import lax, tree_util
    from mujoco import MjData, mjx

    m = in_mujoco(body(turns), STEP, "implicitfast")
    fixed, data = mjx.put_model(m), mjx.put_data(m, MjData(m))

    def advance(d: Any, _: None) -> Any:  # a step makes 32-bit indices 64-bit ones
        return tree_util.tree_map(lambda old, new: new.astype(old.dtype), d, mjx.step(fixed, d)), None

    def last(state: tuple[Any, Any]) -> Any:
        return lax.scan(advance, data.replace(qpos=state[0], qvel=state[1]), None, steps)[0]

    start = np.zeros(m.nq), np.zeros(m.nv)
    return in_jax(last, lambda d: mjx.kinematics(fixed, d).site_xpos[-1, 0], start, bodies, steps)


def soromox(turns: int, bodies: int, steps: int) -> Row:
    """Return the times of soromox."""
    import jax.numpy as jnp
    from soromox.simulation import SemiImplicitEuler
    from soromox.systems.system_state import SystemState
    from space_soromox import arm, planar_arm

    robot = arm(turns) if turns > 1 else planar_arm()
    end = jnp.array([steps * STEP])

    def last(state: Any) -> Any:
        return robot.rollout_to(SystemState(t=0.0, y=state), t1=end[0], solver_dt=STEP, save_ts=end,
                                solver=SemiImplicitEuler(robot), max_steps=steps + 1).y[0]  # fmt: skip

    def tip(state: Any) -> Any:
        reached = robot.forward_kinematics(state[: turns * LINKS], jnp.array(LENGTH))
        return reached[0, 3] if turns > 1 else -reached[2]

    return in_jax(last, tip, np.zeros(2 * turns * LINKS), bodies, steps)


PROGRAMS = {"pliant": (pliant_itself, "pliant"), "exported JAX module": (exported, "jax"), "MuJoCo": (mujoco, "mujoco"),
            "MJX": (mjx, "mujoco.mjx"), "soromox": (soromox, "soromox")}  # fmt: skip


def there(module: str) -> bool:
    """Return whether a module can be imported."""
    return find_spec(module.partition(".")[0]) is not None and find_spec(module) is not None


def cases(turns: int) -> list[Case]:
    """Return the cases of the programs that are installed."""
    return [Case(name, partial(run, turns)) for name, (run, module) in PROGRAMS.items() if there(module)]


if __name__ == "__main__":
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if there("jax"):
        import jax

        jax.config.update("jax_enable_x64", True)
    measured(__doc__ or "", {"plane": cases(1), "space": cases(2)}, bodies=64, steps=100)
