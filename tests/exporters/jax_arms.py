"""Exported JAX modules for tests: loaded under a name of their own, in 64 bit."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from target_models import flat_longer, paper, pulled, tied, twisting

import pliant
from pliant.model import Chamber, Memory, Model, Valve

NUMBER = count()
BODIES = {"plane": lambda: paper().with_(gravity=[0.4, -9.7], stiffening=-0.2, stiffening_bound=0.6, tip_mass=0.004,
                                         tip_inertia=2e-6),
          "flat_longer": flat_longer, "twisting": lambda: twisting(2).with_(cubic_stiffening=0.2),
          "tied": lambda: tied(2), "pulled": lambda: pulled(2)}  # fmt: skip
PASTS = {
    "none": Memory(), "creep": Memory((0.1, 0.2), (0.1, 3.0)), "slip": Memory((), (), (0.2, 0.1), (0.003, 0.01)),
    "boucwen": Memory(boucwen_share=0.2, boucwen_gamma=20.0),
    "all": Memory((0.1,), (0.5,), (0.1,), (0.004,), boucwen_share=0.2, boucwen_exponent=1.7),
}
AXIAL = {"axial_creep_share": (0.2, 0.1), "axial_creep_time": (3.0, 0.1), "axial_slip_share": (0.1,),
         "axial_slip_strain": (0.004,)}  # fmt: skip
INPUTS: dict[str, dict[str, Any]] = {
    "plain": {}, "lag": {"valve": Valve(rise_time=0.01, fall_time=0.02)},
    "limited": {"valve": Valve(rise_time=0.02, fall_time=0.01, rise_rate=2e6)},
    "swelling": {"swell_share": 0.3, "swell_time": 0.1, "torque_2": 0.5},
    "inflation": {"inflation_limit": 9e5, "inflation_time": 0.05},
    "gent": {"inflation_limit": 4e5, "inflation_time": 0.02, "inflation_jm": 0.5, "swell_share": 0.2},
    "saturating": {"law": "saturating"}, "saturating swelling": {"law": "saturating", "swell_share": 0.3},
}


def with_inputs(model: Model, kind: str) -> Model:
    """The model with its chambers of another kind; tendons with guides rub, hang slack or pull against each other
    instead.
    """
    given = dict(INPUTS[kind])
    law, second = given.pop("law", None), given.pop("torque_2", 0.0)

    def other(c: Chamber) -> Chamber:
        if c.kind != "pressure":
            friction = {"friction": 0.2, "entry_friction": 0.27}  # no tension of `levels`: there it has a kink
            path = {"pretension": 3.0 if c.pair else -0.5, "spacing": 0.05}
            more = friction | path if kind != "plain" else {}
            return replace(c, **more if c.elastic else {k: more.get(k, 0.0) for k in ("friction", "entry_friction")})
        torque = [c.torque[0], 1e5] if law else [c.torque[0], second * c.torque[0] / 1e5]
        return replace(c, torque=np.array(torque), law=law or "polynomial", **given)

    return model.with_(chambers=tuple(other(c) for c in model.chambers))


def combined(body: str, past: str, inputs: str) -> Model:
    """A body with hysteresis and inputs; segments of a planar body remember too."""
    memory = PASTS[past]
    if body == "flat_longer" and past in ("slip", "all"):
        memory = replace(memory, **AXIAL)
    return with_inputs(BODIES[body](), inputs).with_(memory=memory)


def levels(model: Model, steps: int) -> np.ndarray:
    """Inputs (steps, C): up, held and down again, another size for each."""
    sizes = {"Pa": 9e4, "N": 2.0, "m": 2e-3, "rad": 0.3}
    peak = np.array([sizes[unit] for unit in model.actuation.units]) * np.linspace(1.0, 0.5, model.actuation.count)
    rise = np.interp(np.arange(steps), [0, 0.4 * steps, 0.6 * steps, steps], [0.0, 1.0, 1.0, -0.1])
    return rise[:, None] * peak


def jax_arm(model: Model, folder: Path, **options: Any) -> Any:
    """The module that an export of the model writes."""
    path = folder / f"arm_{next(NUMBER)}.py"
    pliant.export(model, "jax", path, **options)
    return loaded(path)


def loaded(path: Path) -> Any:
    """A Python file as a module of its own."""
    spec = importlib.util.spec_from_file_location(f"{path.stem}_{next(NUMBER)}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
