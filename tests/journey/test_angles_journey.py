"""One angle and one pressure: from a small logger's text to a prediction, and what is told that angles cannot tell."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.angles import from_rest
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording, read
from pliant.study import angles_study, load_study, run_study
from pliant.study.draft import draft_study
from pliant.study.prepare import all_aligned
from pliant.testbed.bundle import LOGGED, angle_log, bundled_log
from pliant.validation.draw import figures_of
from pliant.validation.metrics_file import MetricsFile
from pliant.validation.store import load_outcome

UNITS = {"angle_unit": "deg", "pressure_unit": "kPa"}


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The study that `pliant new` drafts for the bundled logs, answered, and what its run found."""
    folder = tmp_path_factory.mktemp("angles")
    draft = draft_study([bundled_log(name) for name in LOGGED], folder / "flex.toml", length=0.17, mass=0.075)
    assert {q.partition(":")[0] for q in draft.questions} == {"angle_unit", "pressure_unit"}
    text = draft.text.replace('angle_unit = "?"', 'angle_unit = "deg"')
    text = text.replace('pressure_unit = "?"', 'pressure_unit = "kPa"')
    (folder / "flex.toml").write_text(text, encoding="utf-8")
    told: list[str] = []
    return text, folder, run_study(load_study(folder / "flex.toml"), folder / "out", progress=told.append), told


def test_a_drafted_study_predicts_the_pulse_between(ran):
    text, _, outcome, told = ran
    assert "links" not in tomllib.loads(text)["actuator"]
    held = {r.name: r.metrics for r in outcome.fits[0].records if r.role == "held_out"}
    assert list(held) == ["angle_pulse_119"]
    metrics = held["angle_pulse_119"]
    assert metrics["rmse_percent_of_travel"] < 4
    assert metrics["frequency_hz"]["modelled"] == pytest.approx(metrics["frequency_hz"]["measured"], rel=0.03)
    assert metrics["sensor_step_deg"] == pytest.approx(0.8)
    assert "rmse_mm" not in metrics
    assert outcome.fits[0].result.values["sensor_lag"] == pytest.approx(0.08, abs=0.03)  # as the virtual sensor has it
    assert outcome.model.n == 1
    assert any("peak displacement 41.6 deg" in line for line in told)


@pytest.mark.slow
def test_what_angles_cannot_tell_is_told(ran):
    _, folder, outcome, _ = ran
    said = " ".join(outcome.verdict)
    assert "shapes, order and path are left out" in said
    assert "One angle determines one link, as many as the chain has." in said
    assert "do not determine the mass" in said
    said = " ".join(outcome.findings["angle_pulse_60"])
    assert "has a resolution of 0.8 degrees, which acts as 0.23 degrees of noise" in said
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "shapes, order and path are left out" in page
    assert 'id="plot-angle"' in page
    assert 'id="plot-x"' not in page


def test_results_come_back_and_are_drawn_without_a_path(ran):
    _, folder, outcome, _ = ran
    again = load_outcome(folder / "out")
    for mine, theirs in zip(outcome.fits[0].records, again.fits[0].records, strict=True):
        np.testing.assert_array_equal(mine.modelled, theirs.modelled)
        np.testing.assert_array_equal(mine.experiment.compared, theirs.experiment.compared)
    assert repr(again) == repr(outcome)
    MetricsFile.model_validate(json.loads((folder / "out" / "metrics.json").read_text(encoding="utf-8")))
    names = [name for name, figure in figures_of(again, ["angle_pulse_119"], only=True)]
    assert names[:2] == [
        "model_selection-angle_pulse_119-motion", "model_selection-angle_pulse_119-residual"]


@pytest.mark.slow
def test_the_bundled_logs_are_those_of_the_virtual_laboratory():
    assert bundled_log("pulse_60").read_bytes().decode() == angle_log("pulse_60")
    study = load_study(angles_study())
    assert all(aligned.body["angle"].attrs["reference"] == "rest" for aligned in all_aligned(study).values())
    with pytest.raises(InputError, match="use one of"):
        bundled_log("none")


def test_zero_and_sign_of_a_sensor_are_taken_off_and_told():
    ds = read(bundled_log("pulse_119"), mapping=UNITS)
    backward = ds.assign(angle=ds["angle"].copy(data=1.0 - ds["angle"].values))
    np.testing.assert_allclose(from_rest(backward)["angle"].values, from_rest(ds)["angle"].values, atol=1e-12)
    assert "the sign was changed" in from_rest(backward).attrs["history"]
    assert "subtracted degrees: tip 42.4" in from_rest(ds).attrs["history"]
    assert quality(ds).step_deg["tip"] == pytest.approx(0.8)


def test_places_and_angles_are_not_mixed_in_a_study(tmp_path):
    t = np.arange(0.0, 2.0, 0.05)
    swing = np.where(t > 0.5, 0.3, 0.0)[:, None]
    place = np.stack([np.sin(swing), np.cos(swing)], axis=-1) * 0.17
    ds = make_recording(t, place, station=["tip"], frame="planar", pressure=1e5 * swing[:, 0], pressure_time=t)
    from pliant.recording import write

    write(ds, tmp_path / "placed.nc")
    study = load_study(angles_study())
    entry = next(iter(study.recordings.values()))
    placed = entry.model_copy(update={"file": str(tmp_path / "placed.nc"), "mapping": None})
    mixed = study.model_copy(update={"recordings": {**study.recordings, "placed": placed}, "mapping": {}})
    bare = {name: r.model_copy(update={"mapping": UNITS}) for name, r in study.recordings.items()}
    mixed = mixed.model_copy(update={"recordings": {**bare, "placed": placed}})
    with pytest.raises(InputError, match="holds angles and no positions, but others hold positions"):
        run_study(mixed)


def test_a_body_that_hardly_turns_is_dropped(ran):
    from pliant.study.prepare import without_motion

    record = ran[2].fits[0].records[0].experiment
    still = replace(record, angle=1e-3 * record.angle)
    assert "its angle moves by" in without_motion({"still": still}, 0.17)["still"]
