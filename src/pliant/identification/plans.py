"""What set-ups of a fit share, from one recording, derivative and evaluation to the next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from pliant.equations.symbols import Body, ExtensibleBody, Joints, Memory
from pliant.identification.parameters import apply, of_the_model
from pliant.model import Model
from pliant.simulation.drive import Drive


class ModelAt(NamedTuple):
    """A model at some values of its parameters, and its constants for the kernels."""

    model: Model
    body: Body | ExtensibleBody
    joints: Joints
    memory: Memory


class Plans:
    """What set-ups share: the model at some values, and steps and torques under some pressure.

    Recordings ask for the same model one after the other, and derivatives by what moves no pressure for the same drive.
    """

    def __init__(self) -> None:
        self.models: dict[Any, ModelAt] = {}
        self.drives: dict[Any, Drive] = {}

    def at(self, model: Model, values: Mapping[str, float]) -> ModelAt:
        """The `model` with the values of one recording put in; always the same model."""
        key = of_the_model(values)
        if key not in self.models:
            m = apply(model, dict(key))
            self.models[key] = ModelAt(m, m.mechanics(), m.joints(), m.memory.law())
        return self.models[key]

    def forget(self, most: int) -> None:
        """Drop everything of a kind of which there are more than so many."""
        for kept in (self.models, self.drives):
            if len(kept) > most:
                kept.clear()
