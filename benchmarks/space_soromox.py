"""Time one second of motion in space with pliant and soromox at equal errors of the tip, in one run.

The body is that of space_speed.py: five segments with a total of 0.17 m and 69 g, released from a bend in space under
gravity across it, first with bending alone, then with twist. soromox (piecewise constant strain, JAX compiled for the
processor, double precision) has the same stiffness and dampers on the same coordinates, with arcs where pliant has
joints. Each program is compared with itself at a far finer step. The fastest solver of soromox counts: semi-implicit
Euler, Tsitouras' 5(4) or Kvaerno's implicit 5(4) with adaptive steps. Times are wall-clock times without compiling.
Needs `pip install soromox`; `--seconds S` sets the time of each measurement.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from soromox.simulation import SemiImplicitEuler
from soromox.systems import PCS, PlanarPCS
from soromox.systems.components import LinkSpec
from soromox.systems.pcs.structures import PCSStructure, PlanarPCSStructure
from soromox.systems.system_state import SystemState
from space_speed import (
    DAMPING,
    END,
    FINEST,
    LENGTH,
    LINKS,
    LOOKS,
    MASS,
    RADIUS,
    STEPS,
    STIFFNESS,
    TARGETS,
    pliant_tips,
    start,
    step_ns,
    to_target,
)
from speed.timing import best, machine

jax.config.update("jax_enable_x64", True)
Array = np.ndarray
SEGMENT = LENGTH / LINKS  # m
TOLERANCES = [1e-2, 1e-4, 1e-6]
EULER = [h for h in STEPS if h <= 2.5e-3]  # s


def arm(turns: int) -> PCS:
    """Return the arm, with twist if `turns` is 3; its base points along z as pliant's does, and gravity is along x."""
    turning = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * SEGMENT**2  # from angles of a segment to strains
    density = MASS / (np.pi * RADIUS**2 * LENGTH)
    link = LinkSpec.circular(
        length=SEGMENT, radius=RADIUS, density=density, reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        stiffness=jnp.diag(STIFFNESS * turning), damping=jnp.diag(DAMPING * turning),
    )  # fmt: skip
    active = jnp.tile(jnp.array([turns == 3, True, True, False, False, False]), LINKS)
    return PCS.from_links([link] * LINKS, structure=PCSStructure(strain_selector=active),
                          gravity=jnp.array([9.81, 0.0, 0.0]))  # fmt: skip


def planar_arm() -> PlanarPCS:
    """Return the arm in a plane, that bends alone; its base points along x, and gravity is along -y."""
    link = LinkSpec.circular(
        length=SEGMENT, radius=RADIUS, density=MASS / (np.pi * RADIUS**2 * LENGTH), reference_strain=[0.0, 1.0, 0.0],
        stiffness=jnp.diag(jnp.array([STIFFNESS * SEGMENT**2, 0.0, 0.0])),
        damping=jnp.diag(jnp.array([DAMPING * SEGMENT**2, 0.0, 0.0])),
    )  # fmt: skip
    bends = jnp.tile(jnp.array([True, False, False]), LINKS)
    return PlanarPCS.from_links([link] * LINKS, structure=PlanarPCSStructure(strain_selector=bends),
                                gravity=jnp.array([0.0, -9.81]))  # fmt: skip


def begin(turns: int) -> Array:
    """Return strains and rates of the bend of `space_speed.start`: per segment twist, if any, curvatures about y and
    -x.
    """
    a, b = start(2).reshape(LINKS, 2).T / SEGMENT
    strains = np.column_stack([0.0 * a, b, -a])[:, 3 - turns :]
    return np.concatenate([strains.ravel(), np.zeros(strains.size)])


def runner(robot: PCS, turns: int, solver: Any, *, adaptive: bool) -> Callable[[float], Array]:
    """Return a function from a step [s], or a tolerance, to tips (LOOKS, 3)."""
    looks = jnp.linspace(0.0, END, LOOKS + 1)[1:]

    @jax.jit
    def rolled(y: Array, size: Array) -> Array:
        steps = diffrax.PIDController(rtol=size, atol=size) if adaptive else diffrax.ConstantStepSize()
        found = robot.rollout_to(
            SystemState(t=0.0, y=y), t1=END, solver_dt=1e-4 if adaptive else size, save_ts=looks, solver=solver,
            stepsize_controller=steps, max_steps=10**6,
        )  # fmt: skip
        q = found.y[:, : turns * LINKS]
        return jax.vmap(lambda one: robot.forward_kinematics(one, jnp.array(LENGTH)))(q)[:, :3, 3]

    def solve(size: float) -> Array:
        return np.asarray(rolled(begin(turns), size))

    return solve


def compare(turns: int, seconds: float) -> None:
    """Print the time of both programs for each error of the tip."""
    robot, chain = arm(turns), partial(pliant_tips, turns=turns)
    solvers = {
        "semi-implicit Euler": (runner(robot, turns, SemiImplicitEuler(robot), adaptive=False), EULER),
        "Tsit5": (runner(robot, turns, diffrax.Tsit5(), adaptive=True), TOLERANCES),
        "Kvaerno5": (runner(robot, turns, diffrax.Kvaerno5(), adaptive=True), TOLERANCES),
    }
    ours, theirs = chain(FINEST), solvers["Tsit5"][0](1e-8)
    each = step_ns(turns, seconds)
    for target in TARGETS:
        h, _ = to_target(chain, ours, target, STEPS)
        mine = END / h * each / 1e6
        print(f"{target} mm: pliant {mine:.2f} ms, step {1e3 * h:.3g} ms", flush=True)
        for name, (solve, sizes) in solvers.items():
            size, error = to_target(solve, theirs, target, sizes)
            if not np.isfinite(size):
                print(f"    soromox {name}: not reached", flush=True)
                continue
            took = 1e3 * best(lambda solve=solve, size=size: solve(size), seconds=seconds, clock=perf_counter)
            print(f"    soromox {name}: {took:.0f} ms at {size:.2g}, error {error:.2g} mm, {took / mine:.0f} times as "
                  "long", flush=True)  # fmt: skip


def main() -> None:
    """Print the comparison."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--seconds", type=float, default=2.0)
    seconds = asked.parse_args().seconds
    print(machine())
    for turns in (2, 3):
        print("bending and twist" if turns == 3 else "bending alone")
        compare(turns, seconds)


if __name__ == "__main__":
    main()
