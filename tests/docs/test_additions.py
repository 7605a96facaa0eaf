"""Whatever is registered stands in the documentation: a forgotten row of a table is found here."""

from __future__ import annotations

import re
import typing
from pathlib import Path

import pytest

from pliant.cli.export import export as export_command
from pliant.control import contract as controllers
from pliant.equations.spring_terms import SPRING_TERMS
from pliant.estimation import contract as estimators
from pliant.exporters import registry as exporters
from pliant.identification.names import find_path
from pliant.model.torque_law import law_parameters
from pliant.recording.registry import ENDINGS

DOCS = Path(__file__).resolve().parents[2] / "docs"


def page(name: str) -> str:
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "listed"), [
    ("studies", [f"`{kind}{term}`" for term in SPRING_TERMS for kind in ("", "axial_")]),
    ("studies", [f"`{name}`" for name in law_parameters()]),
    ("export", [f"(`{name}`)" for name in exporters.BUILT_IN]),
    ("real_time", [f"`{name}`" for name in (*estimators.BUILT_IN, *controllers.BUILT_IN)]),
    ("equations", [f"{term.letter}_iq_i" for term in SPRING_TERMS.values()]),
    ("your_own_data", [f"`{endings[0]}`" for endings in ENDINGS.values()]),
])  # fmt: skip
def test_the_page_names_each(name, listed):
    text = page(name)
    assert [word for word in listed if word not in text] == []


def test_the_page_explains_parameters_that_a_fit_has():
    section = page("studies").split("| parameter | what it means")[1].split("\n\n")[0]
    rows = re.findall(r"^\| (`[^|]*) \|", section, re.MULTILINE)
    words = [re.sub(r"<\w>", "1", word.strip('"')) for row in rows for word in re.findall(r"`([^`\s]+)`", row)]
    assert len(rows) > 20  # the others have no more to say than the generated list of metrics.md
    assert [word for word in words if find_path(word) is None] == []


def test_help_and_docstring_name_every_target():
    option = typing.get_type_hints(export_command, include_extras=True)["to"].__metadata__[0]
    for text in (option.help, exporters.export.__doc__):
        assert [name for name in exporters.BUILT_IN if name not in text] == []
