"""Two models to run in batches."""

from __future__ import annotations

import pytest
from chains import awkward_chain

from pliant.actuators import chen2018
from pliant.model import Model


@pytest.fixture(scope="session")
def paper() -> Model:
    return chen2018.model()


@pytest.fixture(scope="session")
def awkward() -> Model:
    """See `awkward_chain`."""
    return awkward_chain()
