"""Tables in the habits of further instruments and loggers, with known content."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.recording import read

NAMES = ["base_x [mm]", "base_y [mm]", "base_z [mm]", "tip_x [mm]", "tip_y [mm]", "tip_z [mm]"]


def written(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def places(count: int = 60) -> np.ndarray:
    """Positions (T, 6) [mm] of a base at rest and of a tip that moves along x."""
    move = 20.0 * np.sin(np.arange(count) / 10.0)
    return np.column_stack([*np.zeros((3, count)), move, np.zeros(count), -100.0 - 0.1 * move])


def table(path: Path, clock: str, times: list[str], *more: str) -> Path:
    rows = [f"{t},{','.join(f'{v:.3f}' for v in row)}{''.join(f',{k % 7}' for _ in more)}"
            for k, (t, row) in enumerate(zip(times, places(len(times)), strict=True))]  # fmt: skip
    return written(path, ",".join([clock, *NAMES, *more]), *rows)


@pytest.mark.parametrize("step", [6.0, 30.0])
def test_days_of_a_slow_log(tmp_path: Path, step: float) -> None:
    path = table(tmp_path / "a.csv", "Date", [f"{46354.5 + step * k / 86400:.9f}" for k in range(60)])
    assert np.diff(read(path)["time"].values) == pytest.approx(step, abs=1e-3)


@pytest.mark.parametrize("rate", [1000.0, 1250.0, 2000.0, 10000.0])
def test_seconds_since_midnight_of_a_fast_log_are_no_days(tmp_path: Path, rate: float) -> None:
    path = table(tmp_path / "a.csv", "time", [f"{40000.0 + k / rate:.6f}" for k in range(60)])
    assert np.diff(read(path)["time"].values) == pytest.approx(1 / rate, rel=1e-3)


@pytest.mark.parametrize("name", ["p_atm [kPa]", "pressure_ambient [mbar]", "barometer [hPa]", "p_atm"])
def test_the_atmosphere_alone_is_no_input(tmp_path: Path, name: str) -> None:
    from pliant.study.first_reading import read_or_guess

    path = table(tmp_path / "a.csv", "time [s]", [f"{k / 50:.3f}" for k in range(60)], name)
    recording = read_or_guess(path, None).recording
    assert "pressure" not in recording
    assert name in recording.attrs["history"]
