"""A kind of observation that pliant does not have: the length of a wire from a fixed point to a point of the body."""

from __future__ import annotations

import numpy as np

from pliant.compiler.twin import rebuild
from pliant.equations import observation, spatial_observation
from pliant.equations.observation import FURTHER, KINDS, RowKind, observe_rows
from pliant.identification import observation as observed_by_fits
from pliant.recording.rules import VARIABLES

NAME = "wire_of_tests"  # no name that a kind may get
WIRE = len(KINDS)


def length(p, fixed):
    """From the point `fixed` to the point p, the components along the first axis."""
    return np.sqrt(sum((p[i] - fixed[i]) ** 2 for i in range(len(fixed))))


def row_value(kind, sight, constants):
    return length(sight.p, constants) if kind == WIRE else observation.row_value(kind, sight, constants)


def add_wire(monkeypatch):
    """Add the row of the registry, with what follows from it at import, and the value."""
    monkeypatch.setitem(KINDS, WIRE, RowKind("wire", "length of a wire", "m", {2: 2, 3: 3}, NAME, 7e-4))
    monkeypatch.setitem(FURTHER, NAME, WIRE)
    monkeypatch.setitem(VARIABLES, NAME, ((("time", "station"),), "m", "length of a wire"))
    monkeypatch.setitem(VARIABLES, f"{NAME}_constants", ((("station", "constant"),), "SI", "constants"))
    monkeypatch.setattr(observed_by_fits, "row_value", row_value)


def plain_rows(dimension):
    """The text of a filter's rows in plain Python, with this kind."""
    own = {name: getattr(spatial_observation, name) for name in ("place_links", "look")} if dimension == 3 else {}
    return rebuild(observe_rows, lambda kernel: kernel, {**own, "row_value": row_value})
