"""Logs of small loggers: counters that wrap, stamps that repeat, a table of pressure alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read

LOG = {"header": True, "time": "t_ms", "time_unit": "ms", "pressure": {"columns": ["psi"], "unit": "psi"}}


def write(path: Path, ticks: list[int], values: list[float], header: str = "t_ms,psi") -> Path:
    path.write_text("\n".join([header, *(f"{t},{v}" for t, v in zip(ticks, values, strict=True))]) + "\n")
    return path


def test_a_log_of_pressure_alone_is_read_by_its_columns(tmp_path: Path) -> None:
    ds = read(write(tmp_path / "log.csv", [10, 20, 30], [0.0, 1.0, 2.0]), mapping=LOG)
    np.testing.assert_allclose(ds["pressure_time"], [0.01, 0.02, 0.03])
    np.testing.assert_allclose(ds["pressure"], 6894.757293168361 * np.array([0.0, 1.0, 2.0]))
    assert "position" not in ds


@pytest.mark.parametrize(("unit", "counter"), [("ms", 2**32), ("us", 2**32), ("ms", 2**16), ("us", 2**31)])
def test_a_counter_that_wraps_goes_on(tmp_path: Path, unit: str, counter: int) -> None:
    ticks = [(counter - 25 + 10 * k) % counter for k in range(8)]
    ds = read(write(tmp_path / "log.csv", ticks, list(range(8))), mapping={**LOG, "time_unit": unit})
    step = {"ms": 0.01, "us": 1e-5}[unit]
    np.testing.assert_allclose(np.diff(ds["pressure_time"]), step, rtol=1e-6)
    assert f"wrapped around 1 time(s), after {counter} {unit}" in ds.attrs["history"]
    wide = read(write(tmp_path / "wide.csv", ticks, list(range(8)), f"t_{unit},p_kpa"))
    np.testing.assert_array_equal(wide["pressure_time"], ds["pressure_time"])


def test_a_logger_that_was_started_again_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", [10, 20, 30, 0, 10], [0, 1, 2, 3, 4])
    with pytest.raises(InputError, match=r"goes back from 30 to 0 ms at row 4 .* rows = \[first, last\]"):
        read(path, mapping=LOG)
    assert read(path, mapping={**LOG, "rows": [0, 3]}).sizes["pressure_time"] == 3


def test_stamps_that_repeat_are_left_out_and_told(tmp_path: Path) -> None:
    ds = read(write(tmp_path / "log.csv", [10, 10, 20, 20, 30], [0, 1, 2, 3, 4]), mapping=LOG)
    assert ds["pressure"].values[1] == pytest.approx(2 * 6894.757293168361)
    assert "2 of 5 rows of log.csv repeat the previous time stamp" in ds.attrs["history"]


def test_a_mapping_says_what_it_lacks(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", [10, 20], [0, 1])
    with pytest.raises(InputError, match="stations, points or angles; or, for a log without a shape, pressure"):
        read(path, mapping={"header": True, "time": "t_ms"}, format="columns")
    with pytest.raises(InputError, match="positions need length_unit"):
        read(path, mapping={"header": True, "time": "t_ms", "stations": {"a": {"position": [0, 1]}}})
