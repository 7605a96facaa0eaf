"""Jacobians of fits against differences: every kind of parameter times every option (`derivative_cases`)."""

from __future__ import annotations

import inspect
import re
import zlib
from dataclasses import MISSING, Field, fields
from functools import cache
from typing import Any

import numpy as np
import pytest
from derivative_cases import (
    BANDS,
    EXCITATIONS,
    MODELS,
    OPTIONS,
    STEP,
    VALUES,
    case,
    excitations_of,
    experiment_of,
    groups,
    problem_of,
)

from pliant.errors import InputError, PliantError
from pliant.identification import Experiment, Parameter, experiment
from pliant.identification.following import moved
from pliant.identification.forward_model import set_up
from pliant.identification.initial_guess import prepare
from pliant.identification.parameters import KNOWN
from pliant.identification.problem import Problem
from pliant.model import Chamber, Extension, Memory, Model, Valve
from pliant.model.model import DEFAULTS
from pliant.model.torque_law import law_parameters

CLOSE = 1e-5  # of the length of a column
LEAST = 1e-6  # of the longest column: what counts as the length of a shorter one
SIZES = (1e-4, 1e-3, 1e-5, 1e-6)  # of the differences, in scales of the parameter
SAMPLE = 16  # parameters of each group in a quick case of an option
FEW = 6  # and of a model, where shared ones and those of parts and records take their turn
CHOICES = [(field, what) for field, changes in OPTIONS.items() for what in changes]
PLACES = [(model, excitation) for model in MODELS for excitation in excitations_of(model)]


def mismatch(problem: Problem, k: int, column: np.ndarray, longest: float) -> float:
    """Distance of a column from differences of the forward model, relative to its length.

    Differences of two sizes, extrapolated; where the first are not close, those that agree best among themselves.
    """
    o, nearest, spread = problem.observed[1], np.inf, np.inf

    def residual(move: float) -> np.ndarray:
        x = problem.start + move * (np.arange(problem.start.size) == k)
        made = set_up(problem.model, o.exp, problem.values(x), problem.step)
        return o.residual(moved(made, made.numbers, o.exp.time.size))

    for size in SIZES:
        try:
            coarse, fine = ((residual(d) - residual(-d)) / (2.0 * d) for d in (size, 0.5 * size))
        except PliantError:
            continue
        expected = (4.0 * fine - coarse) / 3.0
        length = max(float(np.linalg.norm(expected)), LEAST * longest)
        if (off := float(np.linalg.norm(column - expected)) / length) < 0.1 * CLOSE:
            return off
        if (apart := float(np.linalg.norm(coarse - fine)) / length) < spread:
            nearest, spread = off, apart
    assert spread < 1e-2, f"{problem.free[k].name}: no difference to hold the derivative to"
    return nearest


@cache
def groups_of(model: str, excitation: str, owned: str) -> list[dict[str, float]]:
    return groups(MODELS[model], experiment_of(MODELS[model], excitation), owned)


def wrong_columns(model: str, exp: Experiment, owned: tuple[str, ...], sample: int = 0) -> dict[str, float]:
    """Parameters whose columns are off by more than `CLOSE`, with how far; of a `sample` of each group where given."""
    wrong = {}
    for values in (g for kind in owned for g in groups_of(model, exp.excitation, kind)):
        problem = problem_of(MODELS[model], exp, values, drawn(exp, values, sample))
        assert np.isfinite(problem.data_residual(problem.start)).all()
        assert not problem.broken
        J = problem.data_jacobian(problem.start)[problem.ends[0] :]
        longest = float(np.linalg.norm(J, axis=0).max())
        found = {p.name: mismatch(problem, k, J[:, k], longest) for k, p in enumerate(problem.free)}
        wrong |= {name: off for name, off in found.items() if not off < CLOSE}
    return wrong


def drawn(exp: Experiment, values: dict[str, float], sample: int) -> set[str]:
    """Names of a random sample, the same in every run and another in each case; all of them for a sample of 0."""
    names = [n for n in values if not n.endswith(BANDS)]
    if not sample or len(names) <= sample:
        return set(names)
    seed = zlib.crc32(f"{exp.excitation} {exp.stations} {exp.position.sum()} {len(values)} {names[0]}".encode())
    return set(np.random.default_rng(seed).choice(names, sample, replace=False))


@pytest.mark.parametrize(("field", "what"), CHOICES)
def test_a_sample_agrees_with_differences_for_every_option(field: str, what: str) -> None:
    """One excitation and model for each option; the others are `slow`."""
    where = next((m, e) for m, e in (("plain", x) for x in EXCITATIONS) if case(m, e, field, what)) if (
        field != "drives") else ("chambers", "trace")  # fmt: skip
    exp = case(*where, field, what)
    assert exp is not None
    assert wrong_columns(where[0], exp, ("shared", "part"), SAMPLE) == {}


@pytest.mark.parametrize(("model", "excitation"), PLACES)
def test_a_sample_agrees_with_differences_for_every_model(model: str, excitation: str) -> None:
    exp = experiment_of(MODELS[model], excitation)
    assert wrong_columns(model, exp, ("shared", "part", "record"), FEW) == {}


@pytest.mark.slow
@pytest.mark.parametrize(("model", "excitation"), PLACES)
def test_every_parameter_agrees_with_differences_for_every_option(model: str, excitation: str) -> None:
    wrong = {"as it is": wrong_columns(model, experiment_of(MODELS[model], excitation), ("shared", "part", "record"))}
    for field, what in CHOICES:
        if (exp := case(model, excitation, field, what)) is not None:
            wrong[f"{field}: {what}"] = wrong_columns(model, exp, ("shared", "part"))
    assert {k: v for k, v in wrong.items() if v} == {}


def test_every_kind_of_parameter_is_among_the_cases() -> None:
    kinds = (*KNOWN, *law_parameters())
    assert [kind for kind in kinds if not any(re.fullmatch(kind, name) for name in VALUES)] == []


def test_every_parameter_moves_some_case() -> None:
    """No parameter is left out of all cases, and none is compared where it does nothing alone."""
    moving: set[str] = set()
    for model, excitation in (("plain", "pulse"), ("plain", "trace"), ("lengthens", "release"), ("lengthens", "step")):
        for values in groups_of(model, excitation, "shared"):
            problem = problem_of(MODELS[model], experiment_of(MODELS[model], excitation), values)
            J = problem.data_jacobian(problem.start)[problem.ends[0] :]
            moving |= {p.name.removeprefix("e.") for p, column in zip(problem.free, J.T, strict=True) if column.any()}
    assert set(VALUES) - moving == set(BANDS)


def test_a_band_that_lays_out_branches_is_never_free() -> None:
    exp = experiment_of(MODELS["plain"], "trace")
    for law in ("fractional", "payne"):
        names = [n for n in VALUES if n.startswith(law)]
        with pytest.raises(InputError, match="chosen, not fitted"):
            prepare([exp], MODELS["plain"], [Parameter(n, VALUES[n]) for n in names])


def test_a_held_pose_of_a_body_that_lengthens_is_refused() -> None:
    model, exp = MODELS["lengthens"], case("plain", "release", "held", "measured")
    assert exp is not None
    with pytest.raises(InputError, match=r"experiment e: a pose that was held .* the model 'model' lengthens"):
        set_up(model, exp, {"e.release": 0.15}, STEP)


def test_every_entry_of_an_experiment_is_among_the_options() -> None:
    assert {f.name for f in fields(Experiment) if f.init} == set(OPTIONS)
    given = set(inspect.signature(experiment).parameters) - {"recording"}
    assert given - set(OPTIONS) == {"angles", "drive"}  # which become angle and angles_alone, and drives


@pytest.mark.parametrize(("field", "what"), CHOICES)
def test_every_option_is_possible_and_no_two_are_one(field: str, what: str) -> None:
    assert any(case(*place, field, what) is not None for place in PLACES)


@pytest.mark.parametrize("kind", [Model, Chamber, Valve, Memory, Extension])
def test_every_entry_of_a_model_is_among_the_models(kind: type) -> None:
    """Of each there are two values at least, so that its default is not the only one."""
    parts: list[Any] = list(MODELS.values())
    if kind in (Chamber, Valve):
        parts = [c for m in parts for c in m.chambers]
    if kind in (Extension, Memory):
        parts = [one for m in parts for one in (m.extensions if kind is Extension else (m.memory,))]
    if kind is Valve:
        parts = [c.valve for c in parts]
    same = [f.name for f in fields(kind) if all(is_default(getattr(p, f.name), f) for p in parts)]
    assert same == []


def is_default(value: Any, entry: Field[Any]) -> bool:
    """Whether an entry is as it is when nobody sets it."""
    default = DEFAULTS.get(entry.name) if entry.default is MISSING else entry.default
    if entry.default_factory is not MISSING:
        default = entry.default_factory()
    if default is None:
        return entry.default is None and value is None
    a, b = np.asarray(value), np.asarray(default)
    comparable = a.size == b.size or (a.size > 0 and b.size == 1)
    return comparable and bool(np.all(a == b))
