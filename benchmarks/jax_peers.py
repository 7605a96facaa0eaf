"""Compile times and times of a step on one core: the exported JAX module, pliant's own steps, MuJoCo, MJX and soromox.

The arm of `space_speed.py`: five links of together 0.17 m under gravity across it. "plane" (5 coordinates) and "space"
(10): steps of 1 ms in double precision from the straight shape; processor times per step and body, of the fastest of
several runs. The first call compiles: with NUMBA_CACHE_DIR set to an empty folder, also for pliant itself. The gradient
is that of the tip after the last step by all coordinates of the start, in reverse mode; the tips show that the bodies
are the same. soromox has arcs where the others have joints, and semi-implicit Euler steps of 20 µs, as longer
ones diverge.

"equal errors": the time of one second after a release from a bend in space, without and with twist, of pliant
and of soromox's solvers (semi-implicit Euler, Tsitouras' 5(4) and Kvaerno's implicit 5(4) with adaptive steps), at the
coarsest step or tolerance that keeps the tip within an error, each against itself at a far finer step.

Programs that are not installed have no row: `pip install mujoco-mjx soromox`.

"many bodies": steps per second of the exported JAX module on the device that JAX finds, on all its cores if it is asked
for by name, for 5 links in a plane, and in space with creep, slip and Bouc-Wen. With the `--bandwidth` [B/s] of the
device's memory, a column shows the percentage of it that reading and writing the states takes. The last column is the
largest difference of the coordinates from those on the CPU.

    python benchmarks/jax_peers.py [plane] [space] ["equal errors"] [--bodies 64] [--steps 100] [--gradient 0]
    python benchmarks/jax_peers.py "many bodies" --bodies 10000 [--bandwidth 3.35e12]
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from time import perf_counter, process_time
from types import ModuleType
from typing import Any

import numpy as np
import space_speed
from export import in_mujoco
from harness import Case, measured
from space_batch import arm as in_space
from space_speed import DAMPING, END, LENGTH, LINKS, LOOKS, MASS, RADIUS, STIFFNESS, TARGETS, body, to_target
from speed.timing import best, in_turn

import pliant
from pliant.actuators import chen2018
from pliant.batch.stepper import batch_stepper
from pliant.exporters.jax_batch import rest_states
from pliant.model import Memory, Model
from pliant.simulation import Pulse, Stepper

STEP, SEGMENT = 1e-3, LENGTH / LINKS  # s, m
FINER = 50  # steps of soromox for one of the others: with 20, its explicit damping diverges
TOLERANCES, EULER = [1e-2, 1e-4, 1e-6], [h for h in space_speed.STEPS if h <= 2.5e-3]
Row = dict[str, Any]
timed = partial(best, seconds=0.3, repeats=3, clock=process_time)


def first_call(job: Callable[[], Any]) -> float:
    """Return the processor time [s] of the first call."""
    return float(in_turn([job], 1)[0, 0])


def pliant_itself(turns: int, bodies: int, steps: int, **_: int) -> Row:
    """Return the times of `Stepper` and of a batch that keeps its states."""
    model, still, ends = body(turns), np.zeros((bodies, 1)), np.array([0.0, steps * STEP])
    stepper, batch = Stepper(model, STEP, 0.0), batch_stepper([model], bodies, STEP)
    jobs = partial(stepper.step, 0.0, steps), partial(batch.hold, still, steps)
    compiling, one, many = first_call(lambda: [job() for job in jobs]), timed(jobs[0]), timed(jobs[1])
    run = pliant.simulate(model, Pulse(0.0), times=ends, time_step=STEP, initial_angle=np.zeros(turns * LINKS))
    return {"first call (s)": compiling, "one (ns)": 1e9 / steps * one, "many (ns)": 1e9 / steps / bodies * many,
            "tip (mm)": 1e3 * float(run.tip_position.values[-1, -1, 0])}  # fmt: skip


def in_jax(
    last: Callable[[Any], Any], tip: Callable[[Any], Any], start: Any, *, bodies: int, steps: int, gradient: int = 1,
    **_: float,
) -> Row:
    """Return the times of a program in JAX: `last(start)` is the state after all steps, and `tip` of it the position
    of the tip along gravity.
    """
    import jax
    import jax.numpy as jnp

    starts = jax.tree_util.tree_map(lambda a: jnp.broadcast_to(a, (bodies, *jnp.shape(a))), start)
    one, slope = jax.jit(last), jax.vmap(jax.grad(lambda begun: tip(last(begun))))
    runs = [partial(lambda f, x: jax.block_until_ready(f(x)), *pair) for pair in
            ((one, start), (jax.jit(jax.vmap(last)), starts), (jax.jit(slope), starts))]  # fmt: skip
    row: Row = {"first call (s)": first_call(runs[1]), "one (ns)": 1e9 / steps * timed(runs[0]),
                "many (ns)": 1e9 / steps / bodies * timed(runs[1]), "tip (mm)": 1e3 * float(tip(one(start)))}
    if not gradient:
        return row
    row["gradient, first call (s)"] = first_call(runs[2])
    return row | {"gradient, many (ns)": 1e9 / steps / bodies * timed(runs[2])}


def module_of(model: Model) -> ModuleType:
    """Export a model to JAX, and import the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.py"
        pliant.export(model, "jax", path)
        spec = spec_from_file_location(model.name, path)
        assert spec is not None
        assert spec.loader is not None
        arm = module_from_spec(spec)
        spec.loader.exec_module(arm)
        return arm


def exported(turns: int, **sizes: int) -> Row:
    """Return the times of the exported JAX module."""
    from jax import lax

    arm, still = module_of(body(turns)), np.zeros(1)
    start = arm.rest(arm.parameters, still)

    def last(state: Any) -> Any:
        return lax.scan(lambda s, _: (arm.step(arm.parameters, s, still, STEP), None), state, None, sizes["steps"])[0]

    return in_jax(last, lambda s: arm.observe(arm.parameters, s)["tips"][-1, 0],
                  start._replace(position=0.0 * start.position), **sizes)  # fmt: skip


def mujoco(turns: int, bodies: int, steps: int, **_: int) -> Row:
    """Return the times of MuJoCo's step of the exported MJCF: `mj_step` and, on one thread, `rollout`."""
    import mujoco
    import mujoco.rollout

    m = in_mujoco(body(turns), STEP, "implicitfast")
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d, steps)
    mujoco.mj_kinematics(m, d)
    tip, full = float(d.site_xpos[-1, 0]), mujoco.mjtState.mjSTATE_FULLPHYSICS
    begun, still = np.zeros((bodies, mujoco.mj_stateSize(m, full))), np.zeros((bodies, steps, m.nu))
    many = timed(lambda: mujoco.rollout.rollout([m] * bodies, [d], begun, still, nstep=steps, skip_checks=True,
                                                initial_warmstart=None))  # fmt: skip
    return {"one (ns)": 1e9 / steps * timed(lambda: mujoco.mj_step(m, d, steps)),
            "many (ns)": 1e9 / steps / bodies * many, "tip (mm)": 1e3 * tip}  # fmt: skip


def mjx(turns: int, **sizes: int) -> Row:
    """Return the times of MJX, MuJoCo's version in JAX, for the exported MJCF."""
    from jax import lax, tree_util
    from mujoco import MjData, mjx

    m = in_mujoco(body(turns), STEP, "implicitfast")
    fixed, data = mjx.put_model(m), mjx.put_data(m, MjData(m))

    def advance(d: Any, _: None) -> Any:  # a step makes 32-bit indices 64-bit ones
        return tree_util.tree_map(lambda old, new: new.astype(old.dtype), d, mjx.step(fixed, d)), None

    def last(state: tuple[Any, Any]) -> Any:
        return lax.scan(advance, data.replace(qpos=state[0], qvel=state[1]), None, sizes["steps"])[0]

    start = np.zeros(m.nq), np.zeros(m.nv)
    return in_jax(last, lambda d: mjx.kinematics(fixed, d).site_xpos[-1, 0], start, **sizes)


def soromox_arm(turns: int) -> Any:
    """Return the arm in soromox, with twist if `turns` is 3 and in a plane if it is 1. Its base points along z and
    gravity is along x, in a plane along y and x.
    """
    import jax.numpy as jnp
    from soromox.systems import PCS, PlanarPCS
    from soromox.systems.components import LinkSpec
    from soromox.systems.pcs.structures import PCSStructure, PlanarPCSStructure

    flat = turns == 1
    size, turning = (3, 1) if flat else (6, 3)  # strains, and those that turn
    scale = np.where(np.arange(size) < turning, SEGMENT**2, 0.0)  # from angles of a segment to strains
    active = [True] if flat else [turns == 3, True, True]
    link = LinkSpec.circular(
        length=SEGMENT, radius=RADIUS, density=MASS / (np.pi * RADIUS**2 * LENGTH),
        reference_strain=np.eye(size)[turning], stiffness=jnp.diag(STIFFNESS * scale),
        damping=jnp.diag(DAMPING * scale),
    )  # fmt: skip
    select = jnp.tile(jnp.array(active + [False] * (size - turning)), LINKS)
    kind, plan = (PlanarPCS, PlanarPCSStructure) if flat else (PCS, PCSStructure)
    return kind.from_links([link] * LINKS, structure=plan(strain_selector=select),
                           gravity=jnp.array([9.81, 0.0] if flat else [9.81, 0.0, 0.0]))  # fmt: skip


def soromox(turns: int, **sizes: int) -> Row:
    """Return the times of soromox."""
    import jax.numpy as jnp
    from soromox.simulation import SemiImplicitEuler
    from soromox.systems.system_state import SystemState

    robot, end, steps = soromox_arm(turns), jnp.array([sizes["steps"] * STEP]), FINER * sizes["steps"]

    def last(state: Any) -> Any:
        return robot.rollout_to(SystemState(t=0.0, y=state), t1=end[0], solver_dt=STEP / FINER, save_ts=end,
                                solver=SemiImplicitEuler(robot), max_steps=steps + 1).y[0]  # fmt: skip

    def tip(state: Any) -> Any:
        reached = robot.forward_kinematics(state[: turns * LINKS], jnp.array(LENGTH))
        return reached[0, 3] if turns > 1 else reached[1]

    return in_jax(last, tip, np.zeros(2 * turns * LINKS), **sizes | {"steps": steps})


def released(robot: Any, turns: int, solver: Any, size: Any, *, adaptive: bool) -> Any:
    """Return the tips (LOOKS, 3) after the release, by steps of `size` [s], or to a tolerance."""
    import diffrax
    import jax
    import jax.numpy as jnp
    from soromox.systems.system_state import SystemState

    a, b = space_speed.start(2).reshape(LINKS, 2).T / SEGMENT
    strains = np.column_stack([0.0 * a, b, -a])[:, 3 - turns :]  # twist, if any, curvatures about y and -x
    run = robot.rollout_to(
        SystemState(t=0.0, y=np.concatenate([strains.ravel(), np.zeros(strains.size)])), t1=END,
        solver_dt=1e-4 if adaptive else size, save_ts=jnp.linspace(0.0, END, LOOKS + 1)[1:], solver=solver,
        stepsize_controller=diffrax.PIDController(rtol=size, atol=size) if adaptive else diffrax.ConstantStepSize(),
        max_steps=10**6,
    )  # fmt: skip
    tips = jax.vmap(lambda q: robot.forward_kinematics(q, jnp.array(LENGTH)))(run.y[:, : turns * LINKS])
    return tips[:, :3, 3]


def equal_errors(turns: int, **_: int) -> Row:
    """Return the time of both programs for each error of the tip."""
    import diffrax
    import jax
    from soromox.simulation import SemiImplicitEuler

    robot, chain, row = soromox_arm(turns), partial(space_speed.pliant_tips, turns=turns), {}
    ours, each, solvers = chain(space_speed.FINEST), space_speed.step_ns(turns, 1.0), {}
    for solver, sizes in ((SemiImplicitEuler(robot), EULER), (diffrax.Tsit5(), TOLERANCES),
                          (diffrax.Kvaerno5(), TOLERANCES)):  # fmt: skip
        jitted = jax.jit(partial(released, robot, turns, solver, adaptive=sizes is TOLERANCES))
        solvers[type(solver).__name__] = (lambda size, run=jitted: np.asarray(run(size)), sizes)
    theirs = solvers["Tsit5"][0](1e-8)
    for target in TARGETS:
        row[f"pliant, {target} mm (ms)"] = END / to_target(chain, ours, target, space_speed.STEPS)[0] * each / 1e6
        for name, (solve, sizes) in solvers.items():
            size, _ = to_target(solve, theirs, target, sizes)
            if np.isfinite(size):
                row[f"{name}, {target} mm (ms)"] = 1e3 * timed(partial(solve, size))
    return row


def run_many(model: Model, arm: Any, bodies: int, steps: int, kind: Any, device: Any) -> tuple[float, float, Any, int]:
    """Return the seconds of compiling and of one run, the last coordinates, and the bytes of all states."""
    import jax
    import jax.numpy as jnp

    with jax.default_device(device):
        parameters = jax.tree_util.tree_map(lambda a: jnp.asarray(a, kind), arm.parameters)
        count = len(arm.inputs)
        rest = arm.BodyState(*(part[0] for part in rest_states([model])))
        start = jax.tree_util.tree_map(lambda a: jnp.asarray(a, kind), rest)
        states = jax.tree_util.tree_map(lambda a: jnp.broadcast_to(a, (bodies, *a.shape)), start)
        levels = jnp.asarray(np.random.default_rng(0).uniform(0.0, 6e4, (bodies, count)), kind)

        def last(state: Any, level: Any) -> Any:
            advanced = jax.lax.scan(lambda s, _: (arm.step(parameters, s, level, STEP), None), state, None, steps)
            return advanced[0]

        began = perf_counter()
        many = jax.jit(jax.vmap(last)).lower(states, levels).compile()
        compiling, done = perf_counter() - began, many(states, levels)
        took = best(lambda: jax.block_until_ready(many(states, levels)), seconds=0.0, repeats=1)
        failed = int(jnp.sum(done.failed > 0))
        if failed:
            print(f"  {failed} of {bodies} bodies failed")
        size = sum(a.size * a.dtype.itemsize for a in jax.tree_util.tree_leaves(states))
        return compiling, took, np.asarray(done.position), size


def many_bodies(model: Model, bits: int, *, bodies: int, steps: int, bandwidth: float, **_: int) -> Row:
    """Return the times of a model in single or double precision on the device that JAX finds."""
    import jax

    device, cpu = jax.devices()[0], jax.devices("cpu")[0]
    arm, kind = module_of(model), np.dtype(f"float{bits}")
    compiling, took, position, size = run_many(model, arm, bodies, steps, kind, device)
    row = {"device": f"{device.device_kind} ({device.platform}), jax {jax.__version__}", "compile (s)": compiling,
           "steps/s": bodies * steps / took,
           "of bandwidth (%)": 200 * size * steps / took / bandwidth if bandwidth else None}  # fmt: skip
    if device.platform != "cpu":
        *_, same, _ = run_many(model, arm, bodies, steps, kind, cpu)
        row["difference from the CPU"] = float(np.abs(position - same).max())
    return row


MEMORY = Memory((0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.1)
BODIES = {"planar": chen2018.model(), "space": in_space().with_(memory=MEMORY)}
PROGRAMS = {"pliant": (pliant_itself, "pliant"), "exported JAX module": (exported, "jax"), "MuJoCo": (mujoco, "mujoco"),
            "MJX": (mjx, "mujoco.mjx"), "soromox": (soromox, "soromox")}  # fmt: skip


def there(module: str) -> bool:
    """Return whether a module can be imported."""
    return find_spec(module.partition(".")[0]) is not None and find_spec(module) is not None


def cases(turns: int) -> list[Case]:
    """Return the cases of the programs that are installed."""
    return [Case(name, partial(run, turns)) for name, (run, module) in PROGRAMS.items() if there(module)]


if __name__ == "__main__":
    if "many bodies" not in sys.argv:
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
    if there("jax"):
        import jax

        jax.config.update("jax_enable_x64", True)
    races = [Case(name, partial(equal_errors, k)) for name, k in (("bending", 2), ("twist", 3)) if there("soromox")]
    many = [Case(f"{name}, {bits} bits", partial(many_bodies, model, bits))
            for name, model in BODIES.items() for bits in (32, 64) if there("jax")]  # fmt: skip
    measured(__doc__, {"plane": cases(1), "space": cases(2), "equal errors": races, "many bodies": many}, bodies=64,
             steps=100, gradient=1, bandwidth=0.0)  # fmt: skip
