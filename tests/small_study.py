"""A small study for tests: recordings of a known two-link body, seen by a tracker, and the study of them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from pliant.model import Model, Station, chain_model
from pliant.simulation import Trace, simulate

LEVELS_KPA = {"low": 60.0, "middle": 90.0, "high": 120.0}
TIMES = np.arange(0.0, 1.6, 0.01)
STIFFNESS, DAMPING, TORQUE = 0.5, 3e-3, 6e-7
AXES = np.array([[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]])  # columns: x, y and z of the base in the tracker
ORIGIN = np.array([0.3, -0.2, 1.1])
STUDY: dict[str, Any] = {
    "name": "small", "time_step": 2e-3,
    "actuator": {"length": 0.12, "mass": 0.05, "links": 2},
    "alignment": {"options": {"base": "base", "tangent": AXES[:, 1].tolist()}},
    "recordings": {name: {"file": f"{name}.csv"} for name in LEVELS_KPA},
    "fits": {"linear": {"train": ["low", "high"], "held_out": ["middle"], "starts": 1, "parameters": {
        "stiffness": "free", "damping": "free", "torque_1": "free",
    }}},
    "targets": {"rmse_percent_of_travel": 5.0},
}


def body() -> Model:
    """The body that the recordings show."""
    return chain_model(
        length=0.12, mass=0.05, links=2, stiffness=STIFFNESS, damping=DAMPING, torque=[TORQUE],
        stations=(Station("tip", 1, 0.06),),
    )


@cache
def table(level_kpa: float) -> np.ndarray:
    """Columns t, p_kpa, then x y z of base and tip in the tracker's frame, m; the same in every run."""
    trace = Trace([0.2, 0.21, 0.9, 0.91], [0.0, level_kpa * 1e3, level_kpa * 1e3, 0.0])
    run = simulate(body(), trace, times=TIMES, time_step=5e-4)
    tip = run["station_position"].values[:, 0]
    seen = np.stack([np.zeros((TIMES.size, 3)), np.column_stack([tip, np.zeros(TIMES.size)])], axis=1) @ AXES.T + ORIGIN
    noise = 2e-5 * np.random.default_rng(int(level_kpa)).standard_normal(seen.shape)
    return np.column_stack([TIMES, trace(TIMES) / 1e3, (seen + noise).reshape(TIMES.size, -1)])


HEADER = ["t", "p_kpa", *(f"{axis}_{station}" for station in ("base", "tip") for axis in "xyz")]


def write_recording(path: Path, columns: np.ndarray, header: list[str] = HEADER) -> Path:
    """Write a wide CSV."""
    rows = [",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in columns]
    path.write_text("\n".join([",".join(header), *rows]) + "\n", encoding="utf-8")
    return path


def write_study(folder: Path, content: dict[str, Any] | None = None, recordings: bool = True) -> Path:
    """Write the study, as the JSON that `pliant run` takes too, and its recordings into a folder."""
    if recordings:
        for name, level in LEVELS_KPA.items():
            write_recording(folder / f"{name}.csv", table(level))
    path = folder / "study.json"
    path.write_text(json.dumps(STUDY if content is None else content), encoding="utf-8")
    return path


def changed(*path: str, value: Any = None, **entries: Any) -> dict[str, Any]:
    """The small study with the table at `path` updated by `entries`, or the entry at `path` replaced by `value`."""
    content: dict[str, Any] = json.loads(json.dumps(STUDY))
    table: Any = content
    for key in path[:-1] if value is not None else path:
        table = table.setdefault(key, {})
    if value is not None:
        table[path[-1]] = value
    table.update(entries)
    return content
