"""Jacobians of fits against differences: every kind of parameter times every option (`derivative_cases`)."""

from __future__ import annotations

import inspect
from dataclasses import MISSING, Field, fields, replace
from typing import Any

import numpy as np
import pytest
from derivative_cases import (
    BANDS,
    CHOICES,
    EXCITATIONS,
    MODELS,
    OPTIONS,
    PLACES,
    STEP,
    VALUES,
    case,
    excitations_of,
    experiment_of,
    groups_of,
    problem_of,
    wrong_columns,
)
from space_cases import OF_TENDONS, SOUND, arm, rich_arm

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, experiment
from pliant.identification.forward_model import forward_problem
from pliant.identification.initial_guess import prepare
from pliant.identification.names import families, path_of
from pliant.identification.problem import Problem
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Model, Valve, chain_model
from pliant.model.model import DEFAULTS

SAMPLE = 4  # parameters of each group in a quick case of an option
FEW = 3  # and of a model, where shared ones and those of parts and records take their turn


@pytest.mark.parametrize(("field", "what"), CHOICES)
def test_a_sample_agrees_with_differences_for_every_option(field: str, what: str) -> None:
    """One excitation and model for each option."""
    where = next((m, e) for m, e in (("plain", x) for x in EXCITATIONS) if case(m, e, field, what)) if (
        field != "drives") else ("chambers", "trace")  # fmt: skip
    exp = case(*where, field, what)
    assert exp is not None
    assert wrong_columns(where[0], exp, ("shared", "part"), SAMPLE) == {}


FIXED = [name for name, model in MODELS.items() if not model.extensions]
QUICK = {(name, (possible := excitations_of(name))[k % len(possible)]) for k, name in enumerate(FIXED)}  # one of each


@pytest.mark.parametrize(
    ("model", "excitation"),
    [pytest.param(*p, marks=() if p in QUICK else pytest.mark.slow) for p in PLACES],
)
def test_a_sample_agrees_with_differences_for_every_model(model: str, excitation: str) -> None:
    exp = experiment_of(MODELS[model], excitation)
    assert wrong_columns(model, exp, ("shared", "part", "record"), FEW) == {}


def test_every_kind_of_parameter_is_among_the_cases() -> None:
    present = {path_of(name).family for name in (*VALUES, *SOUND, *OF_TENDONS)}  # in space: test_fit_in_space.py
    assert [family for family in families() if family not in present] == []


@pytest.mark.slow
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
        with pytest.raises(InputError, match="cannot be fitted"):
            prepare([exp], MODELS["plain"], [Parameter(n, VALUES[n]) for n in names])


@pytest.mark.parametrize("space", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["plane", "space"])
@pytest.mark.parametrize("distance", [0.96, 1.0, 1.03])
def test_differences_of_all_steps_agree_with_the_derivative_of_a_held_pose(space: bool, distance: float) -> None:
    """A tip alone, inside, at and beyond the reach of the straight body; steps from 1e-3 to 1e-6 of a scale."""
    model = chain_model(length=0.1, mass=0.03, links=4, stiffness=0.1, damping=1e-3, torque=[1e-6], space=space)
    model = model.with_(stations=model.points)
    ahead, times = np.eye(2 + space)[-1], np.arange(0.0, 0.3, 0.01)
    held = 0.1 * distance * (np.cos(0.1) * ahead - np.sin(0.1) * np.eye(2 + space)[0])
    swing = held + 0.01 * np.sin(9.0 * times)[:, None] * np.eye(2 + space)[0]
    exp = Experiment("e", times, swing[:, None], ("link_4",), "release", held=held[None])
    values = {"stiffness_2": 0.12, "link_4.along": 0.0251, "link_4.across": 1e-3, "base_x": 1e-4}
    values |= {"base_tilt_y": 0.02, "rest_turn_y_1": 0.03} if space else {"base_angle": 0.02, "rest_angle_1": 0.03}
    released = Parameter("e.release", 0.05, free=False)
    problem = Problem([exp], model, [Parameter(n, v) for n, v in values.items()] + [released], STEP, "travel")
    J = problem.data_jacobian(problem.start)
    assert np.linalg.norm(J, axis=0).max() < 300.0
    for k, p in enumerate(problem.free):
        for step in (1e-3, 1e-4, 1e-5, 1e-6):
            ends = [problem.data_residual(problem.start + side * step * np.eye(len(values))[k]) for side in (1.0, -1.0)]
            off = np.linalg.norm((ends[0] - ends[1]) / (2.0 * step) - J[:, k]) / np.linalg.norm(J[:, k])
            assert off < (0.05 if step == 1e-3 else 2e-3), (p.name, step)


def test_a_body_that_lengthens_starts_in_its_held_pose() -> None:
    model, exp = MODELS["lengthens"], case("lengthens", "release", "held", "measured")
    assert exp is not None
    chain = mechanics_of(model.with_(stations=[p for p in model.points if p.name in exp.stations]))
    q = np.append(0.1 * np.arange(1, model.n + 1), 0.05 * np.ones(model.size - model.n))
    held = chain.stations(chain.coordinates(q))[0]
    start = forward_problem(model, replace(exp, held=held), {"e.release": 0.15}, STEP).numbers.phi
    np.testing.assert_allclose(chain.stations(start)[0], held, atol=5e-3 * model.length)
    assert np.all(start[model.n :] > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["measured", "1 of its reach"])
def test_a_held_pose_of_a_body_that_lengthens_has_the_derivatives_of_differences(what: str) -> None:
    exp = case("lengthens", "release", "held", what)
    assert exp is not None
    assert wrong_columns("lengthens", exp, ("shared", "part"), SAMPLE) == {}


def test_every_entry_of_an_experiment_is_among_the_options() -> None:
    shown = {"x_sign", "input_kinds"}  # no computation asks for them
    shown |= {"orientation", "orientation_noise"}  # in space: test_orientation.py
    shown |= {"further"}  # held to differences: test_further_kinds.py
    shown |= {"start", "warm_up"}  # held to differences in test_start_in_motion.py; frames without weight
    shown |= {"base"}  # held to differences in test_moving_base.py
    shown |= {"poses"}  # in space, held to differences: equations/test_poses.py
    assert {f.name for f in fields(Experiment) if f.init} - shown == set(OPTIONS)
    given = set(inspect.signature(experiment).parameters) - {"recording"}
    # they become angle and angles_alone, and drives
    assert given - shown - set(OPTIONS) == {"angles", "drive", "inputs"}


@pytest.mark.parametrize(("field", "what"), CHOICES)
def test_every_option_is_possible_and_no_two_are_one(field: str, what: str) -> None:
    assert any(case(*place, field, what) is not None for place in PLACES)


@pytest.mark.parametrize("kind", [Model, Chamber, Valve, Memory, Extension])
def test_every_entry_of_a_model_is_among_the_models(kind: type) -> None:
    """Of each there are two values at least, so that its default is not the only one."""
    parts: list[Any] = [*MODELS.values(), arm(), rich_arm()]
    if kind in (Chamber, Valve):
        parts = [c for m in parts for c in m.chambers]
    if kind in (Extension, Memory):
        parts = [one for m in parts for one in (m.extensions if kind is Extension else (m.memory,))]
    if kind is Valve:
        parts = [c.valve for c in parts]
    elsewhere = {"moving_base"}  # test_moving_base.py
    same = {f.name for f in fields(kind) if all(is_default(getattr(p, f.name), f) for p in parts)}
    assert same <= elsewhere


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
