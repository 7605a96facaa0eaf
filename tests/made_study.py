"""A small study that is made, not measured: a chain's own motion with noise, and awkward names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pliant.identification import Experiment, FitResult, Parameter
from pliant.identification.uncertainty import Covariance
from pliant.model import Model, chain_model
from pliant.recording import make_recording
from pliant.reduction import links_of, select_order
from pliant.simulation import Pulse, Trace, simulate
from pliant.validation.metrics import compare
from pliant.validation.outcome import Clocks, FitOutcome, Forecast, Headline, RecordOutcome, Role, Shape, StudyOutcome
from pliant.view import write_report

NASTY = '<script>alert("x")</script> & $x_1'


def motion(model: Model, level: float, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = simulate(model, Pulse(level, 0.1, 0.6), times=time, time_step=2e-3)
    return found["tip_position"].values, found["pressure"].values


def record(model: Model, name: str, role: Role, level: float, kind: str = "pulse") -> RecordOutcome:
    time = np.arange(0.0, 1.4, 0.01)
    position, pressure = motion(model, level, time)
    seen = position + np.random.default_rng(1).normal(0, 3e-4, position.shape)
    seen[40:60, 0] = np.nan
    sampled = np.arange(0.0, 1.4, 5e-3)
    trace = Trace(sampled, level * ((sampled > 0.1) & (sampled < 0.7))) if kind == "trace" else None
    stations = tuple(f"link_{i + 1}" for i in range(model.n))
    nominal = level if kind == "pulse" else 0.0
    exp = Experiment(name, time, seen, stations, kind, pressure=trace, level=nominal)  # type: ignore[arg-type]
    modelled = 1.02 * position
    return RecordOutcome(name, role, exp, modelled, pressure, compare(exp, modelled, model.length))


@pytest.fixture(scope="session")
def outcome() -> StudyOutcome:
    model = chain_model(length=0.11, mass=0.15, links=3, stiffness=1.5, damping=8e-3, torque=[3e-6])
    low, high = record(model, "low", "train", 1e4), record(model, NASTY, "held_out", 2e4, "trace")
    low = replace(low, body=np.concatenate([np.zeros((low.modelled.shape[0], 1, 2)), low.modelled], axis=1))
    bare = RecordOutcome("let go/", "held_out", record(model, "let go/", "held_out", 1e4, "release").experiment,
                         low.modelled, low.pressure, {"rmse_mm": float("nan"), "frequency_hz": None})
    parameters = (
        Parameter("stiffness", 1.5, std=0.01, source="from the ring-down"), Parameter("damping", 0.0),
        Parameter("torque_2", 3e-11, std=None), Parameter("tip_mass", 0.0, free=False, source=NASTY),
    )
    errors = 1e-4 * np.array([[1, 0.98, 0], [0.98, 1, 0], [0, 0, 0.0]])
    hidden = np.array([False, False, True])
    spread = Covariance(("stiffness", "damping", "torque_2"), errors, np.eye(3), hidden, 0.0, 400.0)
    result = FitResult(model, parameters, "The fit converged: the cost no longer fell.", {"low": 1e-4}, 12, 0.5, True,
                       spread)
    fits = (FitOutcome("linear", NASTY, result, (low, high, bare), 0.5),
            FitOutcome("square", "_polynomial law", result, (low, high), 0.6))
    forecast = Forecast("heavy", "a load that was not recorded", {"tip_mass": 0.1, "level": 1e4}, low.experiment.time,
                        low.modelled[:, -1], {"frequency_hz": 3.2, "static_drop_mm": 12.0})
    ticks = np.arange(300) / 200
    clocks = Clocks("moved by -0.1 s", low.experiment.time, low.modelled[:, -1, 0], ticks + 0.1, low.pressure.max() * (
        (ticks > 0.1) & (ticks < 0.7)), -0.1, 0.0)
    return StudyOutcome(
        "made", f"Made study {NASTY}", "", model, fits, (forecast,), verdict=("Held out: 0.3 mm, 4 % of travel.",),
        headline=Headline("beware", "Held out, in one sentence.", ("the largest error is 22 mm.",)),
        findings={"low": ("140 frames, 20 points not seen", NASTY), "unused": ()}, timing={"total_s": 1.25},
        clocks={"low": clocks},
        provenance={"pliant": "0.1.0", "low": "low.csv sha256 " + 64 * "0"},
    )


@pytest.fixture(scope="session")
def written(outcome: StudyOutcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of that study."""
    return write_report(outcome, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="session")
def shape() -> Shape:
    """A body of 0.2 m that bends as a circle of growing curvature; one frame lacks a station."""
    time, s = np.arange(40) / 20, np.linspace(0.0, 0.2, 31)
    kappa = np.linspace(0.5, 8.0, time.size)[:, None]
    position = np.stack([(np.cos(kappa * s) - 1) / kappa, np.sin(kappa * s) / kappa], axis=-1)
    position[7, 12] = np.nan
    ds = make_recording(time, position, station=[f"p{i}" for i in range(s.size)], frame="planar", arc_length=s)
    curvature = np.broadcast_to(kappa, (time.size, s.size))
    order = select_order(ds, max_order=5, bound=1e-3)
    links = links_of(ds, 3)
    return Shape("bending", s, position, curvature, curvature[0], order, links, "The tip was found by its cap.")
