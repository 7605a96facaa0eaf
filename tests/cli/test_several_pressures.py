"""Pressures of several chambers on the command line: by order, by name, from recordings that call them otherwise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from command_line import invoke
from small_study import body, write_recording

from pliant.estimation import estimate as filtered
from pliant.model import Chamber, Model, load_model, save_model
from pliant.recording import make_recording, read, write
from pliant.simulation import Pulse, Trace, simulate

CLOCK = np.linspace(0.0, 0.4, 101)
RISING = {"p1": 2e4 * CLOCK / 0.4, "p2": 3e4 * np.clip(CLOCK - 0.1, 0.0, 0.1) / 0.1}  # Pa


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two chambers, of opposite sides."""
    gains = {"left": np.ones(body().n), "right": -0.5 * np.ones(body().n)}
    chambers = tuple(Chamber([3e-6], gain, name=name) for name, gain in gains.items())
    return save_model(body().with_(chambers=chambers), tmp_path_factory.mktemp("two") / "model.json")


@pytest.fixture(scope="module")
def pressures(model: Path) -> Path:
    """A table with two pressures, in kPa."""
    rows = np.column_stack([CLOCK, *(1e-3 * p for p in RISING.values())])
    return write_recording(model.parent / "two.csv", rows, ["t", "p_kpa_p1", "p_kpa_p2"])


def final(*words: str | Path) -> np.ndarray:
    """Where the command says that the tip ends, m."""
    done = invoke("simulate", *words, "--json")
    assert done.exit_code == 0, done.output + str(done.exception)
    return 1e-3 * np.array(json.loads(done.stdout)["final_tip_mm"])


def end_of(model: Model, inputs: list[Pulse] | list[Trace], duration: float) -> np.ndarray:
    """Where the tip ends, m."""
    return simulate(model, inputs, duration=duration).tip_position.values[-1, -1]


@pytest.mark.slow
def test_a_level_for_each_chamber_in_their_order_or_by_name(model: Path, tmp_path: Path) -> None:
    own, words = load_model(model), (model, "--duration", "0.4", "--start", "0.1", "--width", "1")
    both = end_of(own, [Pulse(2e4, 0.1, 1.0), Pulse(3e4, 0.1, 1.0)], 0.4)
    right = end_of(own, [Pulse(0.0), Pulse(3e4, 0.1, 1.0)], 0.4)
    assert np.abs(both - right).max() > 5e-3
    figures = ("--figure", tmp_path / "tips.svg", "--film", tmp_path / "motion.gif", "-o", tmp_path / "path.csv")
    np.testing.assert_allclose(final(*words, "--level", "20,30", *figures), both, atol=1e-9)
    np.testing.assert_allclose(final(*words, "--level", "right=30, left=20"), both, atol=1e-9)
    np.testing.assert_allclose(final(*words, "--level", "right=30"), right, atol=1e-9)
    assert all((tmp_path / name).stat().st_size > 2000 for name in ("tips.svg", "motion.gif"))
    assert "pressure_left (Pa),pressure_right (Pa)" in (tmp_path / "path.csv").read_text().splitlines()[0]


def test_without_a_level_the_first_chamber_bends_the_body(model: Path) -> None:
    done = json.loads(invoke("simulate", model, "--duration", "3", "--json").stdout)
    high = 1e3 * done["largest_pressure_kpa"]
    np.testing.assert_allclose(1e-3 * np.array(done["final_tip_mm"]), end_of(
        load_model(model), [Pulse(high, 0.12, 2.76), Pulse(0.0)], 3.0), atol=1e-9)


def test_recorded_pressures_drive_the_chambers_that_are_named(model: Path, pressures: Path) -> None:
    own, seen = load_model(model), read(pressures)
    assert {str(c) for c in seen["chamber"].values} == set(RISING)
    straight = end_of(own, [Trace(CLOCK, p) for p in RISING.values()], 0.4)
    crossed = end_of(own, [Trace(CLOCK, p) for p in reversed(RISING.values())], 0.4)
    assert np.abs(straight - crossed).max() > 3e-3
    for drive, tip in (("left=p1,right=p2", straight), ("left=p2,right=0", crossed)):
        np.testing.assert_allclose(final(model, "--trace", pressures, "--drive", drive), tip, atol=1e-7)


def test_an_estimate_takes_the_pressures_that_are_named(model: Path, tmp_path: Path) -> None:
    own = load_model(model)
    run = simulate(own, [Trace(CLOCK, p) for p in RISING.values()], times=CLOCK[::4], method="LSODA", rtol=1e-8)
    station = [p.name for p in own.points]
    recorded = make_recording(
        run.time.values, run.tip_position.values[:, -1:], station=station, frame="planar", pressure_time=CLOCK,
        pressure=np.stack(list(RISING.values()), axis=1), chamber=list(RISING),
    )
    path, out = tmp_path / "seen.nc", tmp_path / "states.nc"
    write(recorded, path)
    for drive in ({"left": "p1", "right": "p2"}, {"left": "p2"}):
        told = ",".join(f"{a}={b}" for a, b in drive.items())
        done = invoke("estimate", path, "--model", model, "--drive", told, "-o", out, "--json")
        assert done.exit_code == 0, done.output + str(done.exception)
        with xr.open_dataset(out, engine="h5netcdf") as found:
            alone = filtered(read(path), own, drive=drive, disturbance=True)
            np.testing.assert_allclose(found.joint_angle.values, alone.joint_angle.values, atol=1e-12)
            share = np.abs(found.disturbance.values).max() / (3e-6 * 2e4)
        assert (share < 0.1) == (len(drive) == 2), "pressures at the wrong place leave torques that nothing explains"


@pytest.mark.parametrize(
    ("words", "says"),
    {
        "one level for two": (("--level", "20"), "1 value(s), but the model has 2 chamber(s), left, right"),
        "a stranger": (("--level", "middle=20"), "the chamber 'middle', but the model has left, right"),
        "twice": (("--level", "left=20,left=30"), "each chamber once"),
        "no number": (("--level", "20,high"), "must be numbers in kPa, got 'high'"),
        "drive without a pair": (("--trace", "two.csv", "--drive", "p1"), "must be pairs as left=p1,right=p2"),
        "names that are not there": (("--trace", "two.csv"), "no chamber 'left' to drive 'left': it has p1, p2"),
        "a chamber that is not there": (("--trace", "two.csv", "--drive", "low=p1"), "drive names 'low'"),
    }.values(),
)
def test_what_names_no_chamber_is_told(
    model: Path, pressures: Path, words: tuple[str, ...], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(pressures.parent)
    done = invoke("simulate", model, *words)
    assert done.exit_code != 0
    assert says in str(done.exception)
