"""Batch simulation of models that SIMD vectors cannot hold: each sample alone, on several threads.

These are chains with several chambers, with torque laws that are no polynomials, or with extensible segments, and
chains in space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from pliant.batch.samples import check_alike, initial_values
from pliant.compiler.choose import free_twin
from pliant.errors import InputError
from pliant.identification.parameters import apply, kind_of
from pliant.mechanics import mechanics_of
from pliant.mechanics.lengths import check_lengths
from pliant.model import Model
from pliant.simulation import march_loops, state
from pliant.simulation.drive import drive, inputs_of
from pliant.simulation.inputs import Input
from pliant.simulation.solve import check_step

Array = np.ndarray
Made = dict[str, Array]  # joint_angle, joint_rate (T, n), tip_position (T, n, 2), strains and rates (T, S)
VARIABLES = {
    "joint_angle": ("sample", "time", "joint"), "joint_rate": ("sample", "time", "joint"),
    "tip_position": ("sample", "time", "link", "axis"),
}


def dimensions(model: Model) -> dict[str, tuple[str, ...]]:
    """Return the names of the result variables that a batch of chains like `model` offers, with their dimensions."""
    kinds = mechanics_of(model).kinds
    return {name: ("sample", "time", kind.over) for kind in kinds for name in kind.names[:2]} | {
        "tip_position": VARIABLES["tip_position"],
    }


def expanded(variables: Sequence[str], known: Mapping[str, Any]) -> list[str]:
    """Return the variable names. In space, ``joint_angle`` and ``joint_rate`` are replaced by the names for each axis,
    such as ``joint_angle_x``.
    """
    names = []
    for v in variables:
        axes = [k for k in known if v in ("joint_angle", "joint_rate") and k.startswith(f"{v}_")]
        names += axes or [v]
    return names


def motion_of(model: Model, x: Array, v: Array) -> Made:
    """Return the result variables, by name, of a motion with N coordinates x (T, N) and their rates v (T, N) at T
    instants.
    """
    chain = mechanics_of(model)
    values = {name: value for name, (_, value) in chain.variables(x, v).items()}
    return {**values, "tip_position": chain.tips(x)}


def march_alone(model: Model, steps: march_loops.Steps, angle: Array, rate: Array, rows: int) -> tuple[Made, int]:
    """Integrate one chain from the absolute angles and rates (n,) of its n links. Return its result variables by name,
    and the index of the step that failed, or -1 if none did.

    `angle` and `rate` are changed in place. For an extensible body they are (n + S,), followed by the strains; in space
    (N,), joint coordinates.
    """
    chain = mechanics_of(model)
    check_lengths(chain, x=angle, v=rate, torque=steps.gain)
    states = state.relaxed(model, chain.joint_coordinates(angle))
    out = march_loops.rows_for(rows, model.size, states.shape, 3)
    out.phi[0], out.w[0] = angle, rate
    failed = free_twin(march_loops.march, *chain.sizes)(
        angle, rate, steps, chain.body, chain.joints, chain.workspace(), out, *chain.past(states)
    )
    if failed != -1:
        return {}, failed if failed >= 0 else -2 - failed  # a link that turns too far, or no agreement
    return motion_of(model, out.phi, out.w), -1


def samples_alone(
    models: Model | Sequence[Model], sets: list[Sequence[Input]], parameters: Mapping[str, Any] | None,
) -> tuple[list[Model], list[Sequence[Input]]]:
    """Return two lists with an entry for each sample: its model, and its pressure inputs, one for each chamber. `sets`
    holds these inputs once for all samples, or for each sample.

    Raises
    ------
    InputError
        When their numbers differ, or a model cannot take its inputs.
    """
    if isinstance(models, Model):
        arrays = {k: np.asarray(v, dtype=float) for k, v in (parameters or {}).items()}
        if wrong := [k for k, v in arrays.items() if v.ndim != 1]:
            raise InputError(f"batch parameter {wrong[0]!r} must be an array with one number for each sample")
        check_names(models, {k: float(v[0]) for k, v in arrays.items() if len(v)})
        size = max([len(v) for v in arrays.values()], default=len(sets))
        if any(len(v) != size for v in arrays.values()):
            raise InputError("all parameters of a batch need the same number of samples: use arrays of equal length")
        sample_models = [models] * size
        if arrays:
            sample_models = [apply(models, {k: float(v[i]) for k, v in arrays.items()}) for i in range(size)]
    elif parameters:
        raise InputError("give a list of models, or one model with parameters, not both")
    else:
        sample_models = list(models)
    if len(sets) not in (1, len(sample_models)):
        raise InputError(
            f"{len(sample_models)} samples need one set of pressures, or one for each sample, got {len(sets)}"
        )
    shared = {
        "n": lambda m: m.n, "the names of their segments": lambda m: [e.name for e in m.extensions],
        "their joint coordinates": lambda m: (m.space is None, m.size),
    }
    check_alike(sample_models, shared)
    sets = sets * len(sample_models) if len(sets) == 1 else sets
    for model, inputs in zip(sample_models, sets, strict=True):
        inputs_of(model, inputs)
    return sample_models, sets


def sets_of(models: Model | Sequence[Model], pressures: Any) -> list[Sequence[Input]]:
    """Return a list of sets of pressure inputs, with one input for each chamber: a single set for all samples, or one
    for each sample. `pressures` is an argument of `simulate_batch`.
    """
    if callable(pressures):
        return [(pressures,)]
    counts = [m.actuation.count for m in ((models,) if isinstance(models, Model) else models)]
    if max(counts, default=1) > 1 and all(callable(p) for p in pressures):
        return [tuple(pressures)]
    return [tuple(p) if isinstance(p, Sequence) else (p,) for p in pressures]


def check_names(model: Model, values: Mapping[str, float]) -> None:
    """Raise InputError for a batch parameter that is unknown or has no effect on the model.

    Raises
    ------
    InputError
        For an unknown parameter, or one of a joint or chamber that the model does not have.
    """
    for name, value in values.items():
        kind_of(name)
        if all(apply(model, {name: v}) == model for v in (value, 0.9 * value or 1e-9)):
            raise InputError(
                f"the batch parameter {name!r} has no effect on this model, whose chambers are "
                f"{model.actuation.listing}: correct the name of the parameter"
            )


def run_alone(
    models: Sequence[Model], pressures: Sequence[Sequence[Input]], times: Array, time_step: float,
    how: Mapping[str, Any],
) -> Made:
    """Simulate N samples one by one. Return arrays (N, T, ...) over T output times by variable name and, as "failed_at"
    (N,) [s], the time at which each sample failed, NaN if it did not.
    """
    for model in models:
        check_step(model, time_step, "midpoint")
    model, size = models[0], len(models)
    n = model.size

    def start(name: str, i: int) -> Array | None:
        return None if how[name] is None else initial_values(how[name], size, n)[i]

    def one(i: int) -> tuple[Made, float]:
        model, plan = models[i], drive(models[i], pressures[i], times, time_step)
        angle, rate = start("initial_angle", i), start("initial_rate", i)
        q = state.equilibrium(model, plan.initial) if angle is None else angle
        turning = mechanics_of(model).rates(np.zeros(n) if rate is None else rate)
        motion, failed = march_alone(model, plan.steps, mechanics_of(model).coordinates(q), turning, times.size)
        return motion, np.nan if failed < 0 else float(times[0] + plan.h[: failed + 1].sum())

    with ThreadPoolExecutor(max_workers=how["threads"]) as pool:
        done = list(pool.map(one, range(size)))
    lost = motion_of(model, *np.full((2, times.size, n), np.nan))
    stacked = {k: np.stack([d.get(k, nothing) for d, _ in done]) for k, nothing in lost.items()}
    return {**stacked, "failed_at": np.array([failed_step for _, failed_step in done])}
