"""A body filmed from the other side: the same model, and positions in the recordings' own axes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_study import AXES, LEVELS_KPA, ORIGIN, changed, table, write_study

from pliant.recording import make_recording, write
from pliant.study import load_study, run_study
from pliant.study.prepare import all_aligned
from pliant.validation.outcome import StudyOutcome
from pliant.validation.store import load_outcome
from pliant.view.live import page_content

MIRROR = np.array([-1.0, 1.0])
GRAVITY = np.array([0.5, -9.0])
FORCE = np.array([0.02, 0.01])


def study_of(folder: Path, mirror: np.ndarray, **alignment: Any) -> Path:
    """Write the small study with planar recordings, gravity and a known force, x as `mirror` says; return its path."""
    folder.mkdir()
    for name, level in LEVELS_KPA.items():
        columns = table(level)
        place = (columns[:, 2:].reshape(len(columns), 2, 3) - ORIGIN) @ AXES
        seen = make_recording(
            columns[:, 0], place[..., :2] * mirror, station=["base", "tip"], frame="planar",
            angle=columns[:, :1] * [0.0, 0.1] * mirror[0], pressure=1e3 * columns[:, 1],
        )
        write(seen, folder / f"{name}.csv")
    pull = {"station": "tip", "time_s": [0.0], "force_n": [(FORCE * mirror).tolist()]}
    recordings = {n: {"file": f"{n}.csv", "stations": ["tip"], "forces": [pull]} for n in LEVELS_KPA}
    content = changed("recordings", value=recordings) | {"alignment": {"options": alignment}}
    content["actuator"]["gravity"] = (GRAVITY * mirror).tolist()
    del content["fits"]["linear"]["parameters"]["damping"]
    content["forecasts"] = {"heavier": {"like": "high", "known": {"tip_mass": 0.02}}}
    return write_study(folder, content, recordings=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sides")


@pytest.fixture(scope="module")
def both(folder: Path) -> tuple[StudyOutcome, StudyOutcome]:
    """What the study finds in the recordings, and in their mirror images."""
    plain = run_study(load_study(study_of(folder / "plain", np.ones(2))))
    return plain, run_study(load_study(study_of(folder / "mirrored", MIRROR)), folder / "out")


def test_the_model_does_not_depend_on_the_side(both: tuple[StudyOutcome, StudyOutcome]) -> None:
    plain, mirrored = both
    assert plain.model.with_(source={}) == mirrored.model.with_(source={})
    assert plain.fits[0].result.values == mirrored.fits[0].result.values
    assert plain.fits[0].result.values["torque_1"] > 0
    assert plain.model.gravity == pytest.approx(GRAVITY)
    assert "base_frame" not in plain.model.source
    assert mirrored.model.source["base_frame"].endswith("its x is minus that of the recordings")
    assert all("turned by pi" in found[-1] for found in mirrored.findings.values())
    for one, other in zip(plain.fits[0].records, mirrored.fits[0].records, strict=True):
        assert one.metrics == other.metrics


def test_positions_are_in_the_axes_of_the_recordings(both: tuple[StudyOutcome, StudyOutcome], folder: Path) -> None:
    plain, mirrored = both
    for found in (mirrored, load_outcome(folder / "out")):
        for one, other in zip(plain.fits[0].records, found.fits[0].records, strict=True):
            assert one.experiment.position[60, -1, 0] < -0.01  # under pressure
            for name in ("modelled", "body"):
                np.testing.assert_array_equal(getattr(one, name) * MIRROR, getattr(other, name))
            np.testing.assert_array_equal(one.experiment.position * MIRROR, other.experiment.position)
            if one.band is not None and other.band is not None:
                np.testing.assert_array_equal(one.band.upper[..., 0], -other.band.lower[..., 0])
                np.testing.assert_array_equal(one.band.upper[..., 1], other.band.upper[..., 1])
        assert any(r.band is not None for r in found.fits[0].records)
        np.testing.assert_array_equal(plain.forecasts[0].tip * MIRROR, found.forecasts[0].tip)


def test_the_live_page_plays_recordings_where_the_model_is(
    both: tuple[StudyOutcome, StudyOutcome], folder: Path,
) -> None:
    plain, _ = both
    shown = page_content(folder / "out").records
    for record in plain.fits[0].records:
        np.testing.assert_array_equal(shown[record.name].position, record.experiment.position)


def test_a_side_that_is_stated_and_bodies_of_several_chambers_stay(folder: Path) -> None:
    stated = load_study(study_of(folder / "stated", MIRROR, bend="negative"))
    turned = load_study(study_of(folder / "turned", np.ones(2), bend="negative"))
    several = stated.model_copy(update={"actuator": stated.actuator.model_copy(update={"chambers": [None, None]})})
    for study, sign in ((stated, 1), (turned, -1), (several, 1)):
        recording = all_aligned(study)["high"].body
        assert recording.attrs.get("x_sign", 1) == sign
        assert recording["position"].values[60, -1, 0] > 0.01
        assert recording["angle"].values[-1, -1] < 0
