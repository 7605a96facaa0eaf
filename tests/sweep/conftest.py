"""A model and a small sweep."""

from __future__ import annotations

import pytest

from pliant.actuators import chen2018
from pliant.model import Model
from pliant.sweep.spec import Sweep, sweep_from


@pytest.fixture(scope="session")
def paper() -> Model:
    return chen2018.model()


@pytest.fixture(scope="session")
def monte_carlo() -> Sweep:
    return sweep_from({
        "kind": "monte_carlo", "samples": 22, "chunk": 4, "seed": 5, "duration": 0.3, "rate": 50.0, "time_step": 2e-3,
        "parameters": {
            "stiffness": {"mean": 1.6, "std": 0.1}, "damping": {"low": 6e-3, "high": 1e-2}, "level": 5e4,
        },
    })
