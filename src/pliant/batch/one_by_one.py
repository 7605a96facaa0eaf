"""Chains that lanes cannot hold side by side: each marched alone, several of them on as many threads.

Those that remember slip at different times; those of several chambers take more torques than a lane has room for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from pliant.compiler.simd import lane_twin
from pliant.equations.symbols import Past
from pliant.errors import InputError
from pliant.identification.parameters import apply, kind_of
from pliant.model import Model, fixed_length
from pliant.simulation import march_loops, state
from pliant.simulation.drive import drive, inputs_of
from pliant.simulation.inputs import Input
from pliant.simulation.solve import check_step

Array = np.ndarray
Made = dict[str, Array]  # joint_angle, joint_rate (T, n), tip_position (T, n, 2)


def march_alone(model: Model, steps: march_loops.Steps, angle: Array, rate: Array, rows: int) -> tuple[Made, int]:
    """March one chain from absolute angles and rates (n,), in place: what it did, and the step that failed, or -1."""
    n = model.n
    phi, w = np.empty((rows, n)), np.empty((rows, n))
    phi[0], w[0] = angle, rate
    states = state.relaxed(model, state.joint_angles(model, angle))
    failed = lane_twin(march_loops.march_with_memory, n)(
        angle, rate, steps, model.body(), model.joints(),
        Past(model.memory.law(), states, state.held(model)), state.workspace(n),
        march_loops.Rows(phi, w, np.empty((rows, 3)), np.empty((rows, *states.shape))),
    )
    if failed != -1:
        return {}, failed if failed >= 0 else -2 - failed  # a link that turns too far, or no agreement
    return {
        "joint_angle": state.joint_angles(model, phi), "joint_rate": state.joint_rates(w),
        "tip_position": state.tips(model, phi),
    }, -1


def of_several_chambers(
    models: Model | Sequence[Model], pressures: Any, parameters: Mapping[str, Any] | None,
) -> tuple[list[Model], list[Sequence[Input]]]:
    """The models and the inputs (C,) of every sample.

    Raises
    ------
    InputError
        When their numbers differ, or a model cannot take its inputs.
    """
    shared = all(callable(p) for p in pressures)
    sets: list[Sequence[Input]] = [tuple(pressures)] if shared else [tuple(p) for p in pressures]
    if isinstance(models, Model):
        given = {k: np.asarray(v, dtype=float) for k, v in (parameters or {}).items()}
        if wrong := [k for k, v in given.items() if v.ndim != 1]:
            raise InputError(f"batch parameter {wrong[0]!r} of a body of several chambers has one number a sample")
        check_names(models, {k: float(v[0]) for k, v in given.items() if len(v)})
        size = max([len(v) for v in given.values()], default=len(sets))
        if any(len(v) != size for v in given.values()):
            raise InputError("all parameters of a batch need the same number of samples")
        made = [apply(models, {k: float(v[i]) for k, v in given.items()}) for i in range(size)]
    elif parameters:
        raise InputError("give a list of models, or one model with parameters, not both")
    else:
        made = list(models)
    if len(sets) not in (1, len(made)):
        raise InputError(f"{len(made)} samples take one set of pressures or one each, got {len(sets)} sets")
    if len({m.n for m in made}) > 1:
        raise InputError("the models of a batch must share n: simulate others in a batch of their own")
    sets = sets * len(made) if len(sets) == 1 else sets
    for model, inputs in zip(made, sets, strict=True):
        inputs_of(fixed_length(model), inputs)
    return made, sets


def check_names(model: Model, values: Mapping[str, float]) -> None:
    """Refuse a parameter that changes nothing of a model, since it has no such joint or chamber.

    Raises
    ------
    InputError
        For an unknown parameter, and one of something that the model does not have.
    """
    for name, value in values.items():
        kind_of(name)
        if all(apply(model, {name: v}) == model for v in (value, 0.9 * value or 1e-9)):
            raise InputError(
                f"the parameter {name!r} changes nothing of this model, whose chambers are {model.actuation.names}"
            )


def run_alone(
    models: Sequence[Model], pressures: Sequence[Sequence[Input]], times: Array, step: float, how: Mapping[str, Any],
) -> Made:
    """Variables (N, T, ...) of every sample, and failed_at (N,) [s]; `how` holds starts and threads."""
    for model in models:
        check_step(model, step, "midpoint")
    n, size = models[0].n, len(models)

    def start(name: str, i: int) -> Array | None:
        if how[name] is None:
            return None
        a = np.asarray(how[name], dtype=float)
        if a.shape not in ((n,), (size, n)) or not np.isfinite(a).all():
            raise InputError(f"initial states are {n} finite numbers, or ({size}, {n}), got shape {a.shape}")
        return np.broadcast_to(a, (size, n))[i]

    def one(i: int) -> tuple[Made, float]:
        model, plan = models[i], drive(models[i], pressures[i], times, step)
        angle, rate = start("initial_angle", i), start("initial_rate", i)
        q = state.equilibrium(model, plan.initial) if angle is None else angle
        turning = np.zeros(n) if rate is None else np.cumsum(rate)
        made, failed = march_alone(model, plan.steps, state.absolute(model, q), turning, times.size)
        return made, np.nan if failed < 0 else float(times[0] + plan.h[: failed + 1].sum())

    with ThreadPoolExecutor(max_workers=how["threads"]) as pool:
        done = list(pool.map(one, range(size)))
    lost = {"joint_angle": (times.size, n), "joint_rate": (times.size, n), "tip_position": (times.size, n, 2)}
    stacked = {k: np.stack([d.get(k, np.full(shape, np.nan)) for d, _ in done]) for k, shape in lost.items()}
    return {**stacked, "failed_at": np.array([at for _, at in done])}
