"""A phone's video and a microcontroller: points in pixels, a log in psi on its own clock; `new`, two answers, `run`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from typer.testing import CliRunner

from pliant.cli import app
from pliant.study import demo_study, load_study
from pliant.study.prepare import aligned_recording
from pliant.validation.metrics_file import MetricsFile
from pliant.validation.store import load_outcome

pytestmark = pytest.mark.slow
PIXELS_PER_MM, RATE, LATE_S = 4.2, 60.0, 0.7
TARGET = "rmse_percent_of_travel = 3.0"
PLACES = {"base": 0.0, "third": 0.06, "middle": 0.11, "tip": 0.17}  # m along the body


def film(folder: Path, name: str, recorded: str, seed: int) -> None:
    """DeepLabCut's table of four points, and the log, of a bundled recording of the virtual actuator."""
    rng = np.random.default_rng(seed)
    demo = load_study(demo_study())
    body = aligned_recording(demo, recorded).body
    s, t = body["arc_length"].to_numpy(), body["time"].to_numpy()
    whole = np.isfinite(body["position"].to_numpy()).all(axis=(1, 2))
    at = np.arange(t[0], t[-1], 1 / RATE)
    places = [[np.interp(at, t[whole], [np.interp(p, s, frame) for frame in body["position"].to_numpy()[whole, :, k]])
               for k in range(2)] for p in PLACES.values()]
    pixels = np.array([960.0, 900.0]) + 1e3 * PIXELS_PER_MM * np.array([1.0, -1.0]) * np.moveaxis(places, 2, 0)
    pixels += 0.3 * rng.standard_normal(pixels.shape)
    likelihood = np.where(rng.random(pixels.shape[:2]) < 0.01, 0.1, 0.98)
    pixels[likelihood < 0.5] += 80.0
    columns = pd.MultiIndex.from_product([["net"], PLACES, ["x", "y", "likelihood"]],
                                         names=["scorer", "bodyparts", "coords"])  # fmt: skip
    values = np.concatenate([pixels, likelihood[..., None]], axis=2).reshape(len(at), -1)
    pd.DataFrame(values, columns=columns).to_csv(folder / f"{name}.csv")
    clock = body["pressure_time"].to_numpy()
    log = np.arange(clock[0], clock[-1], 0.01)
    psi = np.interp(log, clock, body["pressure"].to_numpy()) / 6894.757293168361 + 0.01 * rng.standard_normal(log.size)
    rows = zip(np.round(1e3 * (log - t[0] + LATE_S)).astype(int), np.round(psi, 2), strict=True)
    (folder / f"{name}_log.csv").write_text("t_ms,psi\n" + "".join(f"{a},{b}\n" for a, b in rows), encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("phone")
    for seed, (name, recorded) in enumerate({"low": "pulse_60", "middle": "pulse_119", "high": "pulse_180"}.items()):
        film(folder, name, recorded, seed)
    files = [f"--from={folder / name}{log}.csv" for name in ("low", "middle", "high") for log in ("", "_log")]
    drafted = invoke("new", folder / "phone.toml", *files, "--length", 0.17, "--mass", 0.069)
    assert drafted.exit_code == 0, drafted.output
    assert [line.split(":")[0] for line in drafted.stdout.splitlines() if line[0] == "?"] == ["? rate_hz",
                                                                                             "? pixels_per_mm"]
    text = (folder / "phone.toml").read_text(encoding="utf-8").replace("rmse_percent_of_travel = 5.0", TARGET)
    for question, answer in (("rate_hz", RATE), ("pixels_per_mm", PIXELS_PER_MM)):
        text = text.replace(f'{question} = "?"', f"{question} = {answer}")
    (folder / "phone.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def ran(folder: Path) -> Path:
    """The folder that the second command leaves."""
    done = invoke("run", folder / "phone.toml", "-o", folder / "out", "--strict")
    assert done.exit_code == 0, done.output
    return folder / "out"


def test_a_camera_is_enough(folder: Path, ran: Path) -> None:
    mapping = 'header = true\ntime = "t_ms"\ntime_unit = "ms"\npressure = { columns = ["psi"], unit = "psi" }\n'
    (folder / "log.toml").write_text(mapping, encoding="utf-8")
    (folder / "camera.toml").write_text("[camera]\nrate_hz = 60.0\npixels_per_mm = 4.2\n", encoding="utf-8")
    seen = invoke("sync", folder / "middle.csv", folder / "middle_log.csv", "--mapping", folder / "camera.toml",
                  "--pressure-mapping", folder / "log.toml", "--json")  # fmt: skip
    assert seen.exit_code == 0, seen.output
    assert json.loads(seen.stdout)["delay_s"] == pytest.approx(-LATE_S, abs=0.01)
    metrics = json.loads((ran / "metrics.json").read_text(encoding="utf-8"))
    MetricsFile.model_validate(metrics)
    assert metrics["records"]["middle"]["role"] == "held_out"
    assert metrics["records"]["middle"]["rmse_percent_of_travel"] < 3.0
    for clocks in metrics["clocks"].values():
        assert clocks["delay_s"] == pytest.approx(-LATE_S, abs=0.01)
    told = " ".join(metrics["findings"]["middle"])
    assert "the pressure's clock is moved by" in told
    steady = metrics["records"]["middle"]["steady_state_mm"]
    assert steady["measured"] == pytest.approx(59.3, rel=0.02)  # as on one clock; on the log's own, it would be 8 mm


@pytest.mark.parametrize(("state", "code"), [("missed", 1), ("good", 0), ("beware", 0)])
def test_a_target_that_is_missed_fails_a_strict_run_alone(
    folder: Path, ran: Path, monkeypatch: pytest.MonkeyPatch, state: str, code: int,
) -> None:
    found = load_outcome(ran)
    assert found.headline is not None
    ended = replace(found, headline=found.headline._replace(state=state))
    monkeypatch.setattr("pliant.study.run_study", lambda *_args, **_options: ended)
    arguments = ["run", str(folder / "phone.toml"), "-o", str(folder / "again")]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert CliRunner().invoke(app, [*arguments, "--strict"]).exit_code == code
