"""`pliant sweep` on a small study: from its [sweep] table to samples, alone and with its recordings."""

from __future__ import annotations

import json

import numpy as np
import pytest
import typer
import xarray as xr
from small_study import LEVELS_KPA, STUDY, table, write_recording
from typer.testing import CliRunner

from pliant.cli.sweep import sweep
from pliant.errors import InputError
from pliant.model import chain_model, save_model

APP = typer.Typer()
APP.command()(sweep)
MONTE_CARLO = {
    "kind": "monte_carlo", "samples": 9, "chunk": 4, "duration": 0.2, "rate": 50.0,
    "parameters": {"stiffness": {"low": 0.4, "high": 0.6}, "damping": 3e-3, "torque_1": 6e-7, "level": 9e4},
}


def write_study(folder, wanted):
    for name, level in LEVELS_KPA.items():
        write_recording(folder / f"{name}.csv", table(level))
    path = folder / "study.json"
    path.write_text(json.dumps({**STUDY, **({"sweep": wanted} if wanted else {})}), encoding="utf-8")
    return path


def run(*arguments):
    return CliRunner().invoke(APP, [str(a) for a in arguments])


def test_monte_carlo(tmp_path):
    path = write_study(tmp_path, MONTE_CARLO)
    done = run(path, "-o", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout.strip().splitlines()[-1])
    assert (told["samples"], told["failed_samples"], told["computed"]) == (9, 0, 3)
    first = xr.load_dataset(tmp_path / "out" / "samples.nc")
    assert first["parameter_stiffness"].values.min() > 0.4
    again = run(path, "-o", tmp_path / "out")
    assert "0 computed, 3 already on disk" in again.output
    assert xr.load_dataset(tmp_path / "out" / "samples.nc").equals(first)
    other = run(path, "-o", tmp_path / "other", "--seed", "7")
    assert other.exit_code == 0
    assert not xr.load_dataset(tmp_path / "other" / "samples.nc").equals(first)


@pytest.mark.slow
def test_bootstrap_of_the_studys_fit(tmp_path):
    path = write_study(tmp_path, {"kind": "bootstrap", "samples": 3, "chunk": 2})
    done = run(path, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    samples = xr.load_dataset(tmp_path / "out" / "samples.nc")
    assert samples["parameter_stiffness"].values == pytest.approx(0.5, rel=0.05)
    assert not samples["failed"].any()


def test_a_table_alone_runs_on_a_model_and_is_drawn(tmp_path):
    """No recordings: the spread of the deflection is that of the stiffness, to first order its inverse."""
    save_model(chain_model(length=0.1, mass=0.05, links=2, stiffness=1.0, damping=0.02, torque=[1e-6]),
               tmp_path / "model.json")
    alone = {**MONTE_CARLO, "samples": 30, "duration": 2.0,
             "parameters": {"stiffness": {"low": 0.95, "high": 1.05}, "level": 2e4}}
    path = tmp_path / "sweep.json"
    path.write_text(json.dumps({"sweep": alone}), encoding="utf-8")
    done = run(path, "--model", tmp_path / "model.json", "-o", tmp_path / "out", "--figure", tmp_path / "a.png")
    assert done.exit_code == 0, done.output
    assert "parameter stiffness" in done.output
    assert "N m/rad" in done.output
    assert (tmp_path / "a.png").stat().st_size > 10_000
    samples = xr.load_dataset(tmp_path / "out" / "samples.nc")
    k, tip = samples["parameter_stiffness"].values, samples["final_tip"].sel(axis="x").values
    assert samples["final_tip"].attrs["units"] == "m"
    assert k * tip == pytest.approx(float(np.mean(k * tip)), rel=2e-3)
    bare = run(path, "-o", tmp_path / "out2")
    assert "needs --model and kind design or monte_carlo" in str(bare.exception)


def test_a_study_without_a_sweep_is_refused(tmp_path):
    done = run(write_study(tmp_path, None), "-o", tmp_path / "out")
    assert isinstance(done.exception, InputError)
    assert "[sweep]" in str(done.exception)


def test_a_fit_is_repeated_only_where_there_is_one(tmp_path):
    path = write_study(tmp_path, {"kind": "bootstrap", "samples": 3})
    study = json.loads(path.read_text(encoding="utf-8"))
    train = next(iter(study.pop("fits").values()))["train"]
    path.write_text(json.dumps({**study, "model_selection": {"train": train}}), encoding="utf-8")
    done = run(path, "-o", tmp_path / "out")
    assert isinstance(done.exception, InputError)
    assert "has only a [model_selection]" in str(done.exception)
