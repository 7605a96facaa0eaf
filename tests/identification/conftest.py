"""A known body, and recordings of it made by adaptive solvers that share no step with the fit."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest

from pliant.identification import Experiment
from pliant.model import Model, Station, Valve
from pliant.simulation import Pulse, Trace, equilibrium, simulate

RTOL = 1e-10
TIMES = np.arange(0.0, 1.0, 0.01)
Observe = Callable[..., Experiment]
SEEN: dict[bytes, np.ndarray] = {}


@pytest.fixture(scope="session")
def truth() -> Model:
    """Three unequal links behind a valve, no gravity, two markers off the axis."""
    return Model(
        link_length=[0.05, 0.04, 0.03], link_mass=[0.02, 0.015, 0.012], stiffness=0.9, damping=6e-3, torque=[6e-7],
        rest_angle=[0.1, 0.15, 0.05], valve=Valve(rise_time=0.03, fall_time=0.05),
        stations=(Station("mid", 1, 0.03, 0.008), Station("tip", 2, 0.03, -0.005)),
    )


def positions(model: Model, pressure: Pulse | Trace, times: np.ndarray, **start: np.ndarray) -> np.ndarray:
    """Observed points (T, S, 2), m, by LSODA at a tolerance of 1e-10, once for all tests that ask for the same."""
    key = pickle.dumps(([getattr(model, f.name) for f in fields(model)], pressure, times, start))
    if key not in SEEN:
        run = simulate(model, pressure, times=times, method="LSODA", rtol=RTOL, **start)
        SEEN[key] = np.asarray(run["station_position"].values)
    return SEEN[key].copy()


@pytest.fixture(scope="session")
def pulse() -> Observe:
    """`pulse(model, name, level, start, stop)`: the experiment of a pulse whose edges nobody recorded."""

    def make(
        model: Model, name: str = "p", level: float = 1e5, start: float = 0.1234, stop: float = 0.6012,
        times: np.ndarray = TIMES,
    ) -> Experiment:
        seen = positions(model, Pulse(level, start, stop - start), times)
        return Experiment(name, times, seen, tuple(s.name for s in model.points), "pulse", level=level)

    return make


@pytest.fixture(scope="session")
def traced() -> Observe:
    """`traced(model, name, level)`: the experiment of a measured pressure with ramps and a hold."""

    def make(model: Model, name: str = "t", level: float = 1e5, times: np.ndarray = TIMES) -> Experiment:
        trace = Trace([0.1, 0.13, 0.5, 0.52], [0.0, level, level, 0.0])
        seen = positions(model, trace, times)
        return Experiment(name, times, seen, tuple(s.name for s in model.points), "trace", trace)

    return make


@pytest.fixture(scope="session")
def released() -> Observe:
    """`released(model, name, release, force, turn)`: held by a force at the tip, let go; the clamp then turns."""

    def make(
        model: Model, name: str = "r", release: float = 0.2071, force: float | None = None, turn: float = 0.0,
        known: dict[str, float] | None = None,
    ) -> Experiment:
        loaded = model.with_(tip_mass=(known or {}).get("tip_mass", model.tip_mass))
        held = np.zeros(model.n) if force is None else equilibrium(loaded, 0.0, np.array([force, 0.0]))
        free = TIMES[release < TIMES]
        before = positions(loaded, Pulse(0.0), np.array([0.0, 1e-6]), initial_angle=held)[0]
        turned = loaded.with_(base_angle=loaded.base_angle + turn)
        swing = positions(
            turned, Pulse(0.0), np.concatenate([[release], free]), initial_angle=held - turn * (np.arange(model.n) == 0)
        )
        seen = np.concatenate([np.repeat(before[None], TIMES.size - free.size, axis=0), swing[1:]])
        return Experiment(
            name, TIMES, seen, tuple(s.name for s in model.points), "release", known=known or {}
        )

    return make
