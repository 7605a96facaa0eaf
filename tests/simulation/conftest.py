"""A model, and the error of a run against a tight adaptive solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from chains import awkward_chain

from pliant.actuators import chen2018
from pliant.model import Model
from pliant.simulation import Input, simulate


@pytest.fixture(scope="session")
def paper() -> Model:
    """The paper's five links."""
    return chen2018.model()


@pytest.fixture(scope="session")
def awkward() -> Model:
    """See `awkward_chain`."""
    return awkward_chain()


@pytest.fixture(scope="session")
def errors_mm() -> Callable[..., list[float]]:
    """Largest tip error of the midpoint rule at each step, mm, against LSODA at 1e-10."""

    def measure(model: Model, pressure: Input, times: np.ndarray, steps: list[float]) -> list[float]:
        tight = simulate(model, pressure, times=times, method="LSODA", rtol=1e-10).tip_position
        runs = (simulate(model, pressure, times=times, time_step=h).tip_position for h in steps)
        return [1e3 * float(np.abs(run - tight).max()) for run in runs]

    return measure
