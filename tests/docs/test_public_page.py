"""Every documented name tells what it takes, in which shape and unit, and how it fails."""

from __future__ import annotations

import importlib
import inspect
import re
import typing
from pathlib import Path

import pytest

import pliant
from pliant.model.chamber import FIELDS
from pliant.model.model import KEYWORD_DEFAULTS

ROOT = Path(__file__).resolve().parents[2]
UNIT = re.compile(r"\b(m|mm|s|Hz|Pa|kPa|rad|kg|N m|N m/rad|1/m|SI)\b")
NO_QUANTITY = {  # names without a number of their own
    "read", "write", "quality", "load_study", "run_study", "load_model", "save_model", "Experiment", "predict_held_out",
    "PliantError", "InputError", "SimulationError", "FitError",
}
NEVER_REFUSES = {  # plain containers, and what only passes on what was refused before
    "quality", "Station", "save_model", "equilibrium", "Experiment",
}
FROM_THE_PAPER = {"select_order", "Model", "chain_model", "simulate", "equilibrium", "modes", "Stepper"}
SHAPE = re.compile(r"\((\w+,\s*\w*(,\s*\w+)*)\)")  # (n,) or (T, S, 2)


REFERENCE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
PLACES = re.findall(r"auto(?:function|class|exception):: pliant\.([\w.]+)$", REFERENCE, re.MULTILINE)
BESIDE = {  # documented with the packages of their own, which have tests of their docstrings
    "OrderResult", "Identifiability", "FitResult", "ModelSelection", "SelectionStep", "TriedTerm", "Band",
    "SweepResult", "Exported",
}
HELD = ("control", "loop", "estimation", "exporters")  # checked beside their packages


def resolve(place):
    module, _, name = f"pliant.{place}".rpartition(".")
    return getattr(importlib.import_module(module), name)


DOCUMENTED = {
    place.rpartition(".")[2]: resolve(place) for place in PLACES
    if not place.startswith(tuple(f"{package}." for package in HELD)) and place.rpartition(".")[2] not in BESIDE
}


def document(name):
    return inspect.getdoc(DOCUMENTED[name]) or ""


LEFT_TO = {  # parameters that the pages of other names explain
    "Model": set(FIELDS), "chain_model": set(KEYWORD_DEFAULTS) | {"stiffness", "damping", "torque"},
}


def parameters(name):
    """Names that a caller may pass."""
    thing = DOCUMENTED[name]
    elsewhere = LEFT_TO.get(name, set())
    taken = [p for p in inspect.signature(thing).parameters.values() if p.name not in elsewhere]
    return [
        name for p in taken if not p.name.startswith("_")
        for name in (named_options(thing, p.name) if p.kind is p.VAR_KEYWORD else [p.name])
    ]


def named_options(thing, keywords):
    """Names of the options of a function that a `TypedDict` holds; none where any keyword goes.

    `Model` leaves those of a chamber to the page of `Chamber`.
    """
    if inspect.isclass(thing):
        return []
    (names,) = typing.get_args(typing.get_type_hints(thing)[keywords]) or ({},)
    return list(names.__annotations__) if typing.is_typeddict(names) else []


def public(*, errors=True):
    return [n for n in DOCUMENTED if errors or not n.endswith("Error")]


def test_a_model_shows_its_keywords():
    shown = inspect.signature(pliant.Model).parameters
    assert shown["tip_mass"].default == 0.0
    assert shown["stiffness"].default is inspect.Parameter.empty
    assert {*shown} - {*inspect.signature(pliant.chain_model).parameters} == {"link_length", "link_mass"}


def test_dir_shows_the_journey_in_order():
    assert dir(pliant) == sorted([*pliant.__all__, "__version__"])
    assert pliant.__all__.index("read") < pliant.__all__.index("align") < pliant.__all__.index("simulate")


@pytest.mark.parametrize("name", public())
def test_a_public_name_has_a_docstring(name):
    text = document(name)
    assert text, f"pliant.{name} has no docstring"
    assert not text.startswith(f"{name}("), f"pliant.{name} shows only its signature"


@pytest.mark.parametrize("name", public())
def test_bars_stand_in_code(name):
    words = re.sub(r"``.*?``|`.*?`", "", document(name), flags=re.DOTALL)
    assert not re.search(r"\|\w", words), f"the site takes |a| in the docstring of pliant.{name} for a substitution"


@pytest.mark.parametrize("name", public(errors=False))
def test_every_argument_is_explained(name):
    text = document(name)
    missing = [p for p in parameters(name) if not re.search(rf"\b{re.escape(p)}\b", text)]
    assert not missing, f"the docstring of pliant.{name} does not mention {', '.join(missing)}"


@pytest.mark.parametrize("name", [n for n in public() if n not in NO_QUANTITY])
def test_units_are_stated(name):
    assert UNIT.search(document(name)), f"the docstring of pliant.{name} names no unit"


@pytest.mark.parametrize("name", public(errors=False))
def test_shapes_of_arrays_are_stated(name):
    if re.search(r"Array|ndarray", str(inspect.signature(DOCUMENTED[name]))):
        assert SHAPE.search(document(name)), f"the docstring of pliant.{name} gives no shape"


@pytest.mark.parametrize("name", sorted(FROM_THE_PAPER))
def test_what_comes_from_the_paper_says_where(name):
    assert re.search(r"Eqs?\. \(|Sec\. |[Pp]aper", document(name)), f"the docstring of pliant.{name} names no source"


@pytest.mark.parametrize("name", [n for n in public(errors=False) if n not in NEVER_REFUSES])
def test_errors_are_stated(name):
    source = inspect.getsource(DOCUMENTED[name])
    refuses = "raise " in source or "check_" in source
    assert not refuses or "Error" in document(name), f"the docstring of pliant.{name} does not say how it fails"


def test_the_reference_holds_the_whole_page_in_its_order():
    shown = {place for place in PLACES if "." not in place}
    assert shown == set(pliant.__all__), shown ^ set(pliant.__all__)
    assert len(pliant.__all__) <= 24
