"""From the bundled film to a prediction, as `pliant demo --camera` goes; the fit never sees the pulse of 119 kPa."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.cli.demo import filmed
from pliant.recording import read
from pliant.study import camera_study, load_study, run_study
from pliant.testbed.bundle import FOLDER


@pytest.mark.slow
def test_from_film_to_prediction(tmp_path: Path) -> None:
    study = load_study(filmed(tmp_path))
    followed, bundled = read(tmp_path / "film.nc"), read(FOLDER / "film.csv")
    apart = np.linalg.norm(followed["position"].to_numpy() - bundled["position"].to_numpy(), axis=2)
    assert np.nanmax(apart) < 1e-4  # decoders may round differently
    assert (np.isnan(apart) == np.isnan(bundled["position"].to_numpy()[..., 0])).all()
    assert 5 < np.isnan(apart).any(axis=1).sum() < 30  # the hand
    fits = {name: fit.model_copy(update={"starts": 1}) for name, fit in study.fits.items()}
    told = run_study(study.model_copy(update={"fits": fits}), tmp_path / "out").to_dict()
    assert told["records"]["pulse_119"]["role"] == "held_out"
    assert told["records"]["pulse_119"]["rmse_percent_of_travel"] < 3.0
    assert told["clocks"]["pulse_119"]["delay_s"] == pytest.approx(-0.35, abs=0.01)


def test_the_study_by_itself_takes_what_was_followed_before() -> None:
    study = load_study(camera_study())
    assert {Path(entry.file).name for entry in study.recordings.values()} == {"film.csv"}
