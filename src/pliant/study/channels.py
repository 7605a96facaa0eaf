"""Sentences for the report that say which recorded channel drives which input of the model."""

from __future__ import annotations

import xarray as xr

from pliant.identification.drives import driving
from pliant.recording.inputs import recorded_inputs
from pliant.study.schema import Recording

MEANT = {"pressure": "gauge pressure, Pa", "tension": "tension, N", "displacement": "displacement, m",
         "angle": "angle of a motor, rad"}  # fmt: skip


def inputs_in_words(entry: Recording, recording: xr.Dataset, name: str) -> list[str]:
    """Return a sentence on the inputs of a recording: channels, kinds, and whether they were measured or commanded.

    The list is empty if all inputs are pressures and the study does not state whether they were measured.
    """
    inputs = recorded_inputs(recording)
    if not inputs or (entry.signal is None and all(one.kind == "pressure" for one in inputs)):
        return []
    driven = driving(name, recording, entry.drive) if entry.drive else {}
    listed = {kind: [f"{one.name} drives {to}" for to, one in driven.items() if one.kind == kind] for kind in MEANT}
    if not driven:
        listed = {kind: [one.name or "a single input" for one in inputs if one.kind == kind] for kind in MEANT}
    said = "; ".join(f"{', '.join(names)} ({MEANT[kind]})" for kind, names in listed.items() if names)
    return [f"inputs, {entry.signal or 'not stated whether measured or commanded'}: {said}"]
