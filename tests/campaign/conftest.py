"""A model, a small sweep, and executors that break."""

from __future__ import annotations

import pytest
from chains import awkward_chain

from pliant.actuators import chen2018
from pliant.campaign.spec import Sweep, sweep_from
from pliant.model import Model


@pytest.fixture(scope="session")
def paper() -> Model:
    return chen2018.model()


@pytest.fixture(scope="session")
def awkward() -> Model:
    """See `awkward_chain`, bending to the other side."""
    return awkward_chain(bend_sign=-1)


@pytest.fixture
def monte_carlo() -> Sweep:
    return sweep_from({
        "kind": "monte_carlo", "samples": 22, "chunk": 4, "seed": 5, "duration": 0.3, "rate": 50.0, "step": 2e-3,
        "parameters": {
            "stiffness": {"mean": 1.6, "std": 0.1}, "damping": {"low": 6e-3, "high": 1e-2}, "level": 5e4,
        },
    })
