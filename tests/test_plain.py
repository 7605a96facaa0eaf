"""Records that become plain values for JSON, and come back: nested, with arrays, gaps and defaults."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pytest

from pliant.plain import by_name, plain, record_of, records_of


class Part(NamedTuple):
    name: str
    size: float | None
    rows: np.ndarray | None = None


@dataclass(frozen=True)
class Whole:
    title: str
    parts: tuple[Part, ...]
    best: Part | None
    nodes: tuple[np.ndarray, ...]
    errors: Mapping[str, float] = field(default_factory=dict)
    complete: bool = True


WHOLE = Whole("two", (Part("a", 1.5, np.array([[1.0, 2.0]])), Part("b", None)), None, (np.arange(2.0),), {"a": 0.1})


def test_a_record_comes_back_from_a_file():
    content = json.loads(json.dumps(plain(WHOLE)))
    assert content == {
        "title": "two", "best": None, "nodes": [[0.0, 1.0]], "errors": {"a": 0.1}, "complete": True,
        "parts": [{"name": "a", "size": 1.5, "rows": [[1.0, 2.0]]}, {"name": "b", "size": None, "rows": None}],
    }
    again = record_of(Whole, content)
    assert (again.title, again.best, again.errors, again.complete) == (WHOLE.title, None, WHOLE.errors, True)
    assert [part[:2] for part in again.parts] == [part[:2] for part in WHOLE.parts]
    assert isinstance(again.parts, tuple)
    assert isinstance(again.parts[1], Part)
    np.testing.assert_array_equal(again.parts[0].rows, [[1.0, 2.0]])
    np.testing.assert_array_equal(again.nodes[0], [0.0, 1.0])


def test_fields_that_a_file_lacks_have_their_defaults_and_others_are_named():
    content = {**plain(WHOLE, but=("errors", "complete")), "unknown": 1, "best": plain(WHOLE.parts[1])}
    again = record_of(Whole, content)
    assert (again.errors, again.complete, again.best) == ({}, True, Part("b", None))
    with pytest.raises(TypeError, match="nodes"):
        record_of(Whole, {k: v for k, v in content.items() if k != "nodes"})


@pytest.mark.parametrize("damage", [{"parts": [5]}, {"parts": "ab"}, {"parts": {"a": 1}}, {"best": "x"}, {"nodes": 5}])
def test_values_where_a_record_or_a_sequence_is_declared_are_refused(damage):
    with pytest.raises(TypeError):
        record_of(Whole, {**plain(WHOLE), **damage})


def test_named_records_are_a_table():
    table = by_name(WHOLE.parts[1:])
    assert table == {"b": {"size": None, "rows": None}}
    assert records_of(Part, table) == WHOLE.parts[1:]
