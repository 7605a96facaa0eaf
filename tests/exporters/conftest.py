"""The models that every target is tried on, as fixtures."""

from __future__ import annotations

import pytest
from target_models import MODELS, SPATIAL, flat_longer, two_chambers

from pliant.model import Model


@pytest.fixture
def branched() -> Model:
    """Creep and two chambers."""
    return two_chambers()


@pytest.fixture(params=list(MODELS))
def model(request: pytest.FixtureRequest) -> Model:
    """Each of the three; a test may ask for one that lengthens too."""
    return {**MODELS, "flat_longer": flat_longer}[request.param]()


@pytest.fixture(params=list(SPATIAL))
def spatial(request: pytest.FixtureRequest) -> Model:
    """Each of the three in space."""
    return SPATIAL[request.param]()
