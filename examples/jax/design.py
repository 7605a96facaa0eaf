"""Design: the derivative of an arm's reach by the lengths of its links, and longer links by gradient ascent.

python examples/jax/design.py [--rounds 20]
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp

import pliant
from pliant.actuators import chen2018
from pliant.model import Model

PRESSURE = 80e3  # Pa


def exported(model: Model, **options: Any) -> ModuleType:
    """Export a model to a Python module for JAX, and import it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.py"
        pliant.export(model, "jax", path, **options)
        spec = importlib.util.spec_from_file_location("arm", path)
        if spec is None or spec.loader is None:
            raise ImportError(path)
        arm = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(arm)
        return arm


def main(rounds: int) -> dict[str, float]:
    """Print and return the sideways reach of the tip at 80 kPa before and after, at the same total length."""
    jax.config.update("jax_enable_x64", True)
    arm = exported(chen2018.model(gravity=[0.0, -9.81]))
    start = jnp.asarray(arm.parameters["link_length"])

    def reach(length: Any) -> Any:
        state = arm.rest(dict(arm.parameters, link_length=length), jnp.array([PRESSURE]))
        return -arm.observe(dict(arm.parameters, link_length=length), state)["position"][-1, 0]

    value_and_slope = jax.jit(jax.value_and_grad(reach))
    first, slope = value_and_slope(start)
    step = 1e-6
    moved = start.at[0].add(step), start.at[0].add(-step)
    difference = (value_and_slope(moved[0])[0] - value_and_slope(moved[1])[0]) / (2 * step)
    length = start
    for _ in range(rounds):
        _, slope_now = value_and_slope(length)
        even = slope_now - jnp.mean(slope_now)  # keeps the total length
        length = jnp.maximum(length + 2e-3 * even / jnp.max(jnp.abs(even)), 5e-3)
        length = length * jnp.sum(start) / jnp.sum(length)
    last = float(value_and_slope(length)[0])
    found = {
        "reach_mm": 1e3 * float(first), "reach_after_mm": 1e3 * last,
        "difference_of_slope": float(abs(slope[0] - difference)),
    }
    print({name: float(f"{value:.4g}") for name, value in found.items()})
    print("lengths in mm:", [round(1e3 * float(part), 1) for part in length])
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=20)
    main(parser.parse_args().rounds)
