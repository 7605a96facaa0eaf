"""The reference is made from the code, and leaves nothing out."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

import pliant
from pliant.cli import app
from pliant.identification.names import families
from pliant.model import Model, chain_model
from pliant.model.file import model_to_dict

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def reference():
    spec = importlib.util.spec_from_file_location("reference", DOCS / "_extensions" / "reference.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.fixture(scope="module")
def pages(reference):
    """Every page as the site has it."""
    return {p.stem: reference.fill(p.read_text(encoding="utf-8")) for p in DOCS.glob("*.md")}


def test_every_part_has_its_place(reference):
    marked = [m for p in DOCS.glob("*.md") for m in reference.MARK.findall(p.read_text(encoding="utf-8"))]
    assert sorted(marked) == sorted(reference.PARTS)


@pytest.mark.parametrize("command", [c.name for c in app.registered_commands])
def test_every_command_stands_with_its_options(reference, pages, command):
    import typer

    found = typer.main.get_command(app).commands[command]
    section = pages["commands"].split(f"### `pliant {command}`")[1].split("\n### ")[0]
    assert f"pliant {command} " in section
    for p in found.params:
        assert all(f"`{o}" in section or f", {o}" in section for o in p.opts if o.startswith("-")), p.opts
        assert reference.cell((p.help or "").split("  [")[0].replace("*", r"\\*"))[:30] in section


def test_every_public_name_stands_in_the_reference(pages):
    told = set(re.findall(r"auto\w+:: (?:pliant\.)?([\w.]+)", pages["api"]))
    assert set(pliant.__all__) <= told
    for room in ("loop", "control", "estimation", "identification"):
        names = __import__(f"pliant.{room}", fromlist=["x"]).__all__
        missing = [n for n in names if f"`{n}`" not in pages["api"] and n not in told and f"{room}.{n}" not in told]
        assert [n for n in missing if callable(getattr(__import__(f"pliant.{room}", fromlist=["x"]), n))] == []


def test_entries_of_a_model_file_are_explained(pages):
    section = pages["files"].split("## model.json")[1].split("## metrics.json")[0]
    model = chain_model(length=0.1, mass=0.05, links=2, stiffness=1.0, damping=0.02, torque=[1e-6])
    assert isinstance(model, Model)
    for name in model_to_dict(model):
        row = re.search(rf"^\| `{name}` \|(.*)\|$", section, re.MULTILINE)
        assert row, name
        assert name.startswith("schema_") or row[1].split("|")[0].strip(), f"{name} has no meaning"


def test_every_parameter_of_a_fit_stands_with_its_unit(pages):
    section = pages["metrics"].split("## Parameters")[1]
    for name, quantity in families().items():
        assert f"| `{name}` | {quantity.unit} |" in section, name


def test_schemas_state_units_and_bounds(reference):
    made = reference.schemas()
    for schema, table in (("study", "ValveTable"), ("model", "ValveEntry")):
        row = made[f"{schema}.schema.json"]["$defs"][table]["properties"]["rise_rate"]
        assert (row["unit"], row["minimum"]) == ("Pa/s", 0)
        assert row["description"] == "fastest rise of the pressure"


def test_schemas_take_what_pliant_writes(reference):
    made = reference.schemas()
    assert {"study.schema.json", "model.schema.json", "metrics.schema.json"} == set(made)
    assert "noise" in made["study.schema.json"]["$defs"]["Recording"]["properties"]


def test_checks_terms_and_export_targets_stand_in_tables(pages):
    from pliant.exporters.registry import BUILT_IN, exporters
    from pliant.model.features import FEATURES
    from pliant.preprocessing.plausibility import CHECKS
    from pliant.selection import TERMS

    ends = [(c.name, f"{c.looks_at} | {c.threshold} |") for c in CHECKS]
    rows = [row for row in pages["what_is_checked"].splitlines() if row.startswith("| ")]
    assert [name for name, end in ends if not any(r.startswith(f"| {name} |") and r.endswith(end) for r in rows)] == []
    assert [name for name in TERMS if f"| `{name}` |" not in pages["studies"]] == []
    targets = [e for name, e in exporters().items() if name in BUILT_IN]
    for key, feature in FEATURES.items():
        words = ["yes" if key in e.can else "left out" if key in e.by_nature else "no" for e in targets]
        assert f"\n| {feature.title} | {' | '.join(words)} |\n" in pages["export"] + "\n"
