"""Shapes in annotations: those of the interface `Mechanics` and of `Stepper` are the shapes of real arrays."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.mechanics import Mechanics, mechanics_of
from pliant.model import Chamber, Extension, Model, Station, chain_model

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

SHAPED = re.compile(r"""(?:Float|Inexact)\[Array, ['"]([^'"]*)['"]\]""")
HALVES = (Extension(60.0, 0.05, 0.0, 0.15, "lower"), Extension(40.0, 0.03, 0.15, None, "upper"))
CHAMBERS = (Chamber((1e-6,), axial_gain=30.0, name="a"), Chamber((4e-7,), joint_gain=(0, 0, 1, 1), name="b"))
BODY = {"length": 0.3, "mass": 0.1, "links": 4, "stiffness": 0.5, "damping": 2e-3, "chambers": CHAMBERS,
        "stations": (Station("mid", 1, 0.02), Station("tip", 3, 0.05), Station("side", 3, 0.05, 0.01))}  # fmt: skip
MODELS = {
    f"{'space' if space else 'plane'} {'lengthens' if longer else 'fixed'}": chain_model(
        **BODY, extensions=longer, space=space, gravity=(0.0, 0.3, -9.81) if space else (0.3, -9.81)
    )
    for space in (False, True) for longer in ((), HALVES)
}  # fmt: skip


def sizes(model: Model) -> dict[str, int]:
    """The letters of the shapes, each with a size of its own where the model leaves it open."""
    return {"N": model.size, "n": model.n, "J": model.size - len(model.extensions), "S": len(model.points),
            "C": len(model.chambers), "R": len(model.actuation.levers), "d": mechanics_of(model).dimension,
            "T": 5, "K": 6, "P": 7}  # fmt: skip


def shape(text: str, letters: dict[str, int], leading: tuple[int, ...] = (5,)) -> tuple[int, ...]:
    sides = [leading if part == "..." else (eval(part, {}, letters),) for part in text.split()]
    return sum(sides, ())


def arguments(call: Callable[..., Any], model: Model, letters: dict[str, int]) -> dict[str, Any] | None:
    """Arrays of the annotated shapes for the parameters of a method; None if it takes other arrays too."""
    rng, given = np.random.default_rng(4), {}
    for name, parameter in list(inspect.signature(call).parameters.items())[1:]:
        kind = str(parameter.annotation)
        if found := SHAPED.search(kind):
            given[name] = rng.normal(0.0, 0.05, shape(found[1], letters))
            if name == "covariance":  # symmetric and positive
                given[name] = given[name] @ given[name].T
        elif kind == "Station":
            given[name] = model.points[-1]
        elif kind == "list[Station]":
            given[name] = [model.points[-1]] * letters["P"]
        elif "None" in kind or parameter.default is not parameter.empty:
            given[name] = None
        else:
            return None
    return given


def returned(call: Callable[..., Any]) -> list[str]:
    return SHAPED.findall(str(inspect.signature(call).return_annotation))


METHODS = {
    name: getattr(member, "func", getattr(member, "fget", member)) for name, member in vars(Mechanics).items()
    if not name.startswith("_")
}  # fmt: skip
ANY = MODELS["plane fixed"]
SHAPES = [  # without those that also take loads or tables, whose shape depends on the kind of chain
    name for name, call in METHODS.items()
    if callable(call) and returned(call) and arguments(call, ANY, sizes(ANY)) is not None
]  # fmt: skip


@pytest.mark.parametrize("case", MODELS)
@pytest.mark.parametrize("name", SHAPES)
def test_arrays_of_the_mechanics_have_the_annotated_shapes(case: str, name: str) -> None:
    model, call = MODELS[case], METHODS[name]
    body, letters = mechanics_of(model), sizes(MODELS[case])
    result = getattr(body, name)
    if inspect.isfunction(vars(Mechanics)[name]):
        result = result(**(arguments(call, model, letters) or {}))
    made = [a for a in (result if isinstance(result, tuple) else (result,)) if not isinstance(a, float)]
    assert [np.shape(a) for a in made] == [shape(text, letters) for text in returned(call)]


def test_most_methods_are_compared() -> None:
    assert {"tips", "stations", "position_jacobian", "inertia", "turning_moments", "equilibrium"} < set(SHAPES)
    assert len(SHAPES) > 20


@pytest.mark.parametrize("case", [name for name in MODELS if name.endswith("fixed")])
def test_statics_and_inputs_have_the_annotated_shapes(case: str) -> None:
    model, letters = MODELS[case], sizes(MODELS[case])
    pressure = np.full(letters["C"], 2e4)
    for call, result in (
        (pliant.equilibrium, pliant.equilibrium(model, pressure)), (pliant.modes, pliant.modes(model)),
        (type(model.actuation).pressures, model.actuation.pressures(pressure)),
        (type(model.actuation).torques, model.actuation.torques(pressure)),
        (type(model.actuation).rest_state, model.actuation.rest_state(pressure)),
        (vars(type(model.actuation))["gain"].func, model.actuation.gain),
    ):
        made = result if isinstance(result, tuple) else (result,)
        assert [np.shape(a) for a in made] == [shape(text, letters) for text in returned(call)], call
