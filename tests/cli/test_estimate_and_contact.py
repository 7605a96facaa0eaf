"""`pliant estimate` and `pliant contact` on the bundled recordings."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import typer
import xarray as xr
from bodies import fitted, free
from typer.testing import CliRunner

from pliant.cli.contact import contact
from pliant.cli.estimate import estimate
from pliant.model import save_model
from pliant.recording import write


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    save_model(fitted("a"), folder / "model.json")
    for name in ("pulse_60", "pulse_119", "pulse_180"):
        write(free(name), folder / f"{name}.nc")
    return folder


def run(command, *words):
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, [str(w) for w in words])


@pytest.mark.slow
def test_estimate_writes_states_figure_and_report(bench):
    done = run(
        estimate, bench / "pulse_119.nc", "--model", bench / "model.json", "--latency-ms", 7.6, "--json",
        "-o", bench / "states.nc", "--figure", bench / "states.png",
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["frames"] > 300
    assert "white" in told["innovations_are"]
    assert (bench / "states.png").stat().st_size > 5000
    with xr.open_dataset(bench / "states.nc", engine="h5netcdf") as states:
        assert np.isfinite(states.joint_rate.values).all()
        assert states.attrs["schema"] == "pliant-estimate"


@pytest.mark.slow
def test_contact_is_quiet_on_free_motion(bench):
    done = run(
        contact, bench / "pulse_119.nc", "--model", bench / "model.json", "--latency-ms", 7.6,
        "--free", bench / "pulse_60.nc", "--free", bench / "pulse_119.nc", "--free", bench / "pulse_180.nc",
        "--figure", bench / "contact.png", "--map", bench / "map.csv", "-o", bench / "contact.nc",
    )
    assert done.exit_code == 0, done.output
    assert re.search(r"^  contacts +0$", done.stdout, re.MULTILINE)
    assert float(re.search(r"highest statistic +([\d.]+)", done.stdout)[1]) < 1.0
    assert "extrapolated" in done.stdout
    assert (bench / "map.csv").stat().st_size > 1000
