"""Steps per second of many bodies at once in the exported JAX module, on the device that JAX finds.

python benchmarks/jax_bodies.py [--bodies 1000 10000] [--steps 100] [--float 32 64] [--bandwidth 3.35e12]

Bodies: 5 links in a plane; 5 links in space with creep, slip and Bouc-Wen. With the `--bandwidth` [B/s] of the device's
memory, a column shows the fraction of it that reading and writing the states takes. The last column is the largest
difference of the coordinates from those on the CPU.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from harness import parser_of
from space_batch import arm as in_space

import pliant
from pliant.actuators import chen2018
from pliant.exporters.jax_batch import rest_states
from pliant.model import Memory, Model

STEP = 1e-3  # s
MEMORY = Memory((0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.1)


def exported(model: Model) -> ModuleType:
    """Export a model to JAX, and import the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.py"
        pliant.export(model, "jax", path)
        spec = importlib.util.spec_from_file_location(model.name, path)
        assert spec is not None
        assert spec.loader is not None
        arm = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(arm)
        return arm


def run(model: Model, arm: Any, bodies: int, steps: int, kind: Any, device: Any) -> tuple[float, float, Any, int]:
    """Return the seconds of compiling and of one run, the last coordinates, and the bytes of all states."""
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

        began = time.perf_counter()
        many = jax.jit(jax.vmap(last)).lower(states, levels).compile()
        compiled = time.perf_counter()
        jax.block_until_ready(many(states, levels))
        warm = time.perf_counter()
        done = jax.block_until_ready(many(states, levels))
        took = time.perf_counter() - warm
        failed = int(jnp.sum(done.failed > 0))
        if failed:
            print(f"  {failed} of {bodies} bodies failed")
        size = sum(a.size * a.dtype.itemsize for a in jax.tree_util.tree_leaves(states))
        return compiled - began, took, np.asarray(done.position), size


def main(given: argparse.Namespace) -> None:
    """Print one row for each body, number of bodies and precision."""
    jax.config.update("jax_enable_x64", True)
    device, cpu = jax.devices()[0], jax.devices("cpu")[0]
    print(f"device: {device.device_kind} ({device.platform}), jax {jax.__version__}")
    print("body      float   bodies  compile s  steps/s   of bandwidth  difference from the CPU")
    for name, model in (("planar", chen2018.model()), ("space", in_space().with_(memory=MEMORY))):
        arm = exported(model)
        for bits in given.float:
            kind = jnp.float32 if bits == 32 else jnp.float64
            for bodies in given.bodies:
                compiling, took, position, size = run(model, arm, bodies, given.steps, kind, device)
                rate = bodies * given.steps / took
                share = f"{2 * size * given.steps / took / given.bandwidth:.2%}" if given.bandwidth else "-"
                off = "-"
                if device.platform != "cpu" and bodies == min(given.bodies):
                    *_, same, _ = run(model, arm, bodies, given.steps, kind, cpu)
                    off = f"{np.abs(position - same).max():.1e}"
                numbers = f"{bits:5d}  {bodies:7d}  {compiling:9.1f}  {rate:8.3g}  {share:>12s}  {off}"
                print(f"{name:8s}  {numbers}", flush=True)


if __name__ == "__main__":
    parser = parser_of(__doc__, bodies=[1000, 10_000], steps=100, bandwidth=0.0)
    parser.add_argument("--float", type=int, nargs="+", choices=(32, 64), default=[32, 64])
    main(parser.parse_args())
