"""Each parameter of a model is declared once, on its field: no second list of names, units or bounds."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, get_type_hints

import numpy as np
import pytest

import pliant
from pliant.equations.law import LawParameter
from pliant.identification.experiment import EDGES_OF
from pliant.identification.names import declarations, families, find_path, path_of
from pliant.identification.problem import EDGE_TIMES
from pliant.model import Chamber, Extension, Memory, Model, Space, Station, Tendon, Valve
from pliant.model.file import model_to_dict, read_model
from pliant.model.parts import PARTS, declared
from pliant.model.quantity import Quantity, declaring, quantities
from pliant.units import KIND_OF

SOURCE = Path(pliant.__file__).parent
RECORDS = (Model, Chamber, Valve, Memory, Extension, Station, Space, Tendon)
UNITS = {d.quantity.unit for d in declared()} - {"1"}
HOMES = {Path(SOURCE, "model", f"{name}.py") for name in (
    "parameters", "chamber", "tendon", "valve", "memory", "extension", "space", "station", "quantity",
)}  # fmt: skip


@pytest.mark.parametrize("record", RECORDS)
def test_every_number_of_a_record_is_declared(record):
    names = [f.name for f in fields(record)] if is_dataclass(record) else record._fields
    hints = get_type_hints(record)
    numeric = {float, np.ndarray, tuple[float, ...], float | None}
    assert [name for name in names if hints[name] in numeric and name not in quantities(record)] == []


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def literals(file: Path) -> Iterator[tuple[int, set[str], list[str]]]:
    """Line, words and texts beside them of each tuple, list, set or dict that is written out in a module. A dict of
    computed values is no list.
    """
    for node in ast.walk(tree(file)):
        keys = node.keys if isinstance(node, ast.Dict) else getattr(node, "elts", [])
        values = node.values if isinstance(node, ast.Dict) else []
        if any(isinstance(part, ast.Attribute) for value in values for part in ast.walk(value)):
            continue
        words = {k.value for k in keys if isinstance(k, ast.Constant) and isinstance(k.value, str)}
        if words:
            yield node.lineno, words, [v.value for v in values if isinstance(v, ast.Constant)]


def test_no_second_list_of_fields_or_units():
    """A list of most fields of a record, or a table of units of its fields, stands nowhere but on the record."""
    parts = [{d.field for d in declared(part)} for part in PARTS]
    names = {d.name for d in declared()} | {d.field for d in declared()}
    second = []
    for file in sorted(SOURCE.rglob("*.py")):
        for line, words, beside in literals(file):
            most = any(len(part) >= 4 and len(words & part) > 0.7 * len(part) for part in parts)
            units = len(words & names) >= 3 and len([v for v in beside if v in UNITS]) >= 3
            if (most or units) and file not in HOMES:
                second.append(f"{file.relative_to(SOURCE)}:{line}")
    assert second == []


def test_no_second_list_of_edges_excitations_or_kinds_of_inputs():
    """Edge times and kinds of excitation stand on the experiment, kinds of inputs beside their units. A table that says
    something further of each is none.
    """
    homes = {SOURCE / "identification" / "experiment.py", SOURCE / "units.py"}
    wholes = ((EDGE_TIMES, 3), (set(EDGES_OF), 2), (set(KIND_OF.values()), 3))
    second = []
    for file in sorted({*SOURCE.rglob("*.py")} - homes):
        for node in ast.walk(tree(file)):
            entries = node.elts if isinstance(node, ast.Tuple | ast.List | ast.Set) else []
            words = {getattr(entry, "value", None) for entry in entries}
            if any(words <= whole and len(words) >= least for whole, least in wholes):
                second.append(f"{file.relative_to(SOURCE)}:{node.lineno}")
    assert second == []


def test_names_of_a_fit_are_parsed_in_one_module_without_patterns():
    parsing = [file.name for file in (SOURCE / "identification").glob("*.py")
               if "re" in {name.name for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
                           if isinstance(node, ast.Import) for name in node.names}]  # fmt: skip
    assert parsing == []


def test_bounds_contain_starts_and_guesses_and_lie_within_the_limits():
    for name, row in declarations().items():
        quantity = row.quantity
        for value in (quantity.start, quantity.guess):
            assert value is None or quantity.lower <= value <= quantity.upper, name
        for bound in (quantity.lower, quantity.upper):
            assert not np.isfinite(bound) or abs(bound) <= quantity.most, name
        assert quantity.lower < quantity.upper, name
        assert quantity.unit, name
        assert quantity.meaning, name


@pytest.mark.parametrize(("name", "owner", "stem", "numbers"), [
    ("stiffness", "", "stiffness", ()), ("stiffness_12", "", "stiffness", ("12",)),
    ("stiffness_*", "", "stiffness", ("*",)), ("left.creep_share_1", "left", "creep_share", ("1",)),
    ("rest_turn_x_3", "", "rest_turn", ("x", "3")), ("base_tilt_z", "", "base_tilt", ("z",)),
    ("a.tip.along", "a.tip", "along", ()), ("far.axial_stiffness", "far", "axial_stiffness", ()),
    ("saturating_lever", "", "saturating_lever", ()), ("valve_rise_time", "", "valve_rise_time", ()),
])  # fmt: skip
def test_a_name_is_a_path(name, owner, stem, numbers):
    path = path_of(name)
    assert (path.owner, path.stem, path.numbers) == (owner, stem, numbers)
    assert name == f"{owner}.{path.own}".removeprefix(".")


@pytest.mark.parametrize("name", [
    "stiffness_", "stiffness_x", "stiffness_1_2", "creep_share", "creep_share_0", "creep_share_10", "creep_share_*",
    "torque", "torque_x", "base_tilt", "base_tilt_1", "rest_turn_x", "rest_turn_1", "rest_turn_x_*", "along", ".along",
    "a.b.stiffness", "link_length", "slip_rate", "joint_gain", "tip_mass_1", "stiffness_²", "_", "", ".", "a.",
])  # fmt: skip
def test_what_is_no_path_is_no_parameter(name):
    assert find_path(name) is None
    with pytest.raises(pliant.InputError, match="unknown parameter"):
        path_of(name)


@pytest.mark.parametrize(("former", "present"), [("valve_rise", "valve_rise_time"), ("left.valve_fall",
                                                                                    "left.valve_fall_time")])
def test_a_former_name_is_refused_with_the_present_one(former, present):
    with pytest.raises(pliant.InputError, match=f"unknown parameter '{former}': use its present name, '{present}'"):
        path_of(former)


def test_each_family_is_read_as_itself():
    for family in families():
        name = family.replace("<station>", "tip").replace("<axis>", "x").replace("<i>", "2").replace("<k>", "3")
        assert path_of(name).family == family


def test_a_parameter_of_a_torque_law_is_declared_like_a_field():
    assert set(LawParameter._fields) <= set(Quantity.__dataclass_fields__)


def test_a_record_explains_a_parameter_that_its_docstring_lacks():
    @declaring
    @dataclass(frozen=True)
    class Leaking(Valve):
        """A valve that leaks.

        Parameters
        ----------
        first : float
            Stated here.

        Raises
        ------
        InputError
            Never.
        """

        first: Annotated[float, Quantity("s", "first number")] = 0.0
        leak: Annotated[float, Quantity("1/s", "rate of a leak")] = 0.0

    text = inspect.getdoc(Leaking)
    assert "leak : float\n    Rate of a leak, 1/s.\n\nRaises" in text
    assert text.count("first : float") == 1
    assert "rise_time" not in text
    assert "Annotated" not in str(inspect.signature(Leaking))


@pytest.mark.parametrize(("units", "wrong"), [
    ({"link_length": "m", "valve": "s, Hz", "valve rates": "Pa/s", "dead_band": "Pa", "memory": "1, s, rad, 1/rad^n",
      "tendons": "m, N/m, N", "space": "rad, 1, m", "extensions": "N, N s, m", "stations": "m"}, ""),
    ({"link_length": "mm"}, "link_length"), ({"valve": "ms"}, "valve"), ({"stiffness": "N"}, "stiffness"),
    ({"tip": "m"}, "tip"), ({"valve.rise_time": "Hz"}, "valve.rise_time"),
])  # fmt: skip
def test_a_model_file_may_list_the_units_of_whole_tables_but_no_others(units, wrong):
    model = pliant.chain_model(length=0.1, mass=0.05, links=2, stiffness=1.0, damping=0.02, torque=[1e-6])
    content = model_to_dict(model)
    assert content["units"]["valve.rise_time"] == "s"
    assert not any(name.startswith(("space", "tendons", "extensions")) for name in content["units"])
    text = json.dumps(content | {"units": units})
    if wrong:
        with pytest.raises(pliant.InputError, match=f"these differ: .*{wrong}"):
            read_model(text, "file")
    else:
        assert read_model(text, "file") == model


def test_an_input_states_a_field_only_where_it_has_an_effect():
    pair = Tendon(name="pair", driven_by="displacement", line_stiffness=1e3, pair=True, lever=0.01, pretension=2.0,
                  imbalance=-0.5, taper=0.01)  # fmt: skip
    pulled = Tendon(name="pulled", lever=0.01, pretension=2.0)
    values = {name: [one.value_of(name) for one in (pair, pulled, Chamber(torque=[1e-6]))]
              for name in ("pretension", "imbalance", "taper")}  # fmt: skip
    assert values == {"pretension": [2.0, 0.0, 0.0], "imbalance": [-0.5, 0.0, 0.0], "taper": [0.01, 0.0, 0.0]}
