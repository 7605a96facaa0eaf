"""The two example studies on the measured recordings, held to what they claim."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from pliant.errors import InputError
from pliant.study import load_study, run_study

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow


SHOWN_ONLY = {  # fits that no test asks for: half a minute of them
    "quadratic_beyond", "linear_beyond", "rigid_beyond", "creeping_beyond", "no_settling_beyond",
    "no_fall_limit_beyond", "together_between", "together_within", "together_beyond", "together_below",
    "bounded_beyond",
}
STEP_S = {"pneumatic_arm_pulses": 5e-3}  # 25 steps a period: errors within a tenth of a per cent of the travel


def metrics_of(shared_data: Path, name: str) -> dict[str, Any]:
    """What metrics.json would hold of an example, its recordings taken from `shared_data`, one start for each fit."""
    study = load_study(ROOT / "examples" / f"{name}.toml")
    recordings = {
        key: entry.model_copy(update={"file": str(shared_data / name / Path(entry.file).name)})
        for key, entry in study.recordings.items()
    }
    held = {key: entry for key, entry in study.fits.items() if key not in SHOWN_ONLY}
    fits = {key: entry.model_copy(update={"starts": 1}) for key, entry in held.items()}
    outcome = run_study(
        study.model_copy(
            update={"recordings": recordings, "fits": fits, "time_step": STEP_S.get(name, study.time_step)}
        )
    )
    return json.loads(json.dumps(outcome.to_dict(), allow_nan=False))


@pytest.fixture(scope="module")
def arm(shared_data: Path) -> dict[str, Any]:
    """The silicone arm under pressure pulses."""
    return metrics_of(shared_data, "pneumatic_arm_pulses")


@pytest.fixture(scope="module")
def beam(shared_data: Path) -> dict[str, Any]:
    """The silicone cantilever that is let go."""
    return metrics_of(shared_data, "silicone_cantilever")


def error(metrics: dict[str, Any], fit: str, record: str) -> float:
    """RMSE of a record under a fit, % of its travel."""
    return float(metrics["fits"][fit]["records"][record]["rmse_percent_of_travel"])


def test_the_level_between_two_others_is_predicted_within_five_per_cent(arm: dict[str, Any]) -> None:
    assert arm["records"]["p200"]["role"] == "held_out"
    assert arm["records"]["p200"]["rmse_percent_of_travel"] <= 5.0
    assert error(arm, "quadratic_between", "p100") < 10
    assert error(arm, "quadratic_between", "p300") < 5
    assert "target 5 %: met" in arm["verdict"][0]


def test_a_linear_law_cannot_follow_what_grows_faster_than_pressure(arm: dict[str, Any]) -> None:
    assert error(arm, "linear_between", "p200") > 1.5 * error(arm, "quadratic_between", "p200")


def test_the_levels_between_are_predicted_within_three_per_cent(arm: dict[str, Any]) -> None:
    """A chamber that inflates and a regulator that settles late: 2.5 and 1.7 %; half the quadratic law's error."""
    assert error(arm, "inflating_between", "p200") < 3.0
    assert error(arm, "inflating_between", "p200") < 0.65 * error(arm, "quadratic_between", "p200")
    assert error(arm, "inflating_within", "p300") < 2.5


def test_the_level_beyond_is_predicted_within_twelve_per_cent(arm: dict[str, Any]) -> None:
    """400 mbar from the three below, 6.5 %, where a quadratic law misses by 28 %; said in the verdict as it is."""
    beyond = error(arm, "inflating_beyond", "p400")
    assert beyond < 12.0
    said, = [s for s in arm["verdict"] if "p400" in s and s.startswith("Inflating")]
    assert f"{beyond:.1f} % of its peak displacement" in said


@pytest.mark.parametrize("fit", ["inflating_between", "inflating_within", "inflating_beyond"])
def test_every_set_of_levels_finds_the_same_wall(arm: dict[str, Any], fit: str) -> None:
    """Shear modulus times wall over radius: a property of the body, not of the levels that it was learnt from."""
    values = {name: p["value"] for name, p in arm["fits"][fit]["parameters"].items()}
    assert values["inflation_limit"] == pytest.approx(4.8e4, rel=0.1)
    assert 0.01 < values["inflation_time"] < 0.1
    assert 1e5 < values["valve_fall_rate"] < 5e5


def test_the_arm_rings_at_about_eight_hertz(arm: dict[str, Any]) -> None:
    for name in ("p100", "p200", "p300"):  # the record of 400 mbar ends before its fall has died away
        found = arm["records"][name]["frequency_hz"]
        assert 7.5 < found["measured"] < 8.5
        assert found["modelled"] == pytest.approx(found["measured"], rel=0.05)
    assert arm["records"]["p400"]["frequency_hz"]["measured"] < 7
    for fit in arm["fits"].values():
        values = {name: p["value"] for name, p in fit["parameters"].items()}
        assert 0.1 < values["stiffness"] < 20
        assert 0 < values["damping"] < values["stiffness"] / 10
        assert abs(values["base_angle"]) < 0.5
        assert all(p["std"] is None or p["std"] > 0 for p in fit["parameters"].values() if p["free"])


def test_pulses_last_about_three_seconds(arm: dict[str, Any]) -> None:
    found = arm["fits"]["quadratic_between"]["parameters"]
    for record in ("p100", "p300"):
        assert 2.5 < found[f"{record}.stop"]["value"] - found[f"{record}.start"]["value"] < 3.5


@pytest.mark.parametrize("record", ["alone", "load52"])
def test_one_stiffness_and_damping_follow_both_loads(beam: dict[str, Any], record: str) -> None:
    """And a slow hand and creep do better than what lets go at once, in error and in frequency."""
    m, at_once = (beam["fits"][fit]["records"][record] for fit in ("hand", "both"))
    off = [abs(r["frequency_hz"]["modelled"] / r["frequency_hz"]["measured"] - 1.0) for r in (m, at_once)]
    assert off[0] < 0.03
    assert off[0] < off[1]
    assert m["steady_state_mm"]["modelled"] == pytest.approx(m["steady_state_mm"]["measured"], rel=0.03)
    assert m["rmse_percent_of_travel"] < 3.5
    assert m["rmse_percent_of_travel"] < at_once["rmse_percent_of_travel"] < 6


@pytest.mark.parametrize(("fit", "record", "most"), [("hand_heavier", "load52", 8), ("hand_lighter", "alone", 8),
                                                     ("heavier", "load52", 9)])  # fmt: skip
def test_one_load_predicts_the_other(beam: dict[str, Any], fit: str, record: str, most: float) -> None:
    m = beam["fits"][fit]["records"][record]
    assert m["role"] == "held_out"
    assert m["frequency_hz"]["modelled"] == pytest.approx(m["frequency_hz"]["measured"], rel=0.03)
    assert m["rmse_percent_of_travel"] < most


def test_creep_and_a_slow_hand_earn_on_a_load_that_they_have_not_seen(beam: dict[str, Any]) -> None:
    """A tenth of the error, more than half of the error of the deflection; every term is determined or has a prior."""
    with_them, without = (beam["fits"][fit]["records"]["load52"] for fit in ("hand_heavier", "heavier"))
    assert with_them["rmse_percent_of_travel"] < 0.9 * without["rmse_percent_of_travel"]
    drops = (m["steady_state_mm"] for m in (with_them, without))
    off = [abs(drop["modelled"] / drop["measured"] - 1.0) for drop in drops]
    assert off[0] < 0.5 * off[1]


@pytest.mark.parametrize("fit", ["hand", "hand_heavier", "hand_lighter", "both", "nominal", "heavier"])
def test_the_recordings_or_a_stated_prior_determine_each_term_of_the_beam(beam: dict[str, Any], fit: str) -> None:
    for name, p in beam["fits"][fit]["parameters"].items():
        if p["free"] and p["prior_std"] is None:
            assert p["std"] < 0.5 * abs(p["value"]), name


def test_a_load_that_was_never_hung_on_is_forecast(beam: dict[str, Any]) -> None:
    forecast, heavy = beam["forecasts"]["load101"], beam["records"]["load52"]
    assert forecast["stated"] == {"tip_mass": 0.101}
    assert forecast["frequency_hz"] < heavy["frequency_hz"]["modelled"]
    assert forecast["steady_state_mm"] > heavy["steady_state_mm"]["modelled"] * 0.9
    assert all(math.isfinite(v) for k, v in forecast.items() if isinstance(v, float))
    said, = [s for s in beam["verdict"] if s.startswith("Forecast") and "101 g at the tip" in s]
    half = forecast["half_width_95"]["frequency_hz"]
    assert 0.001 < half < 0.3
    assert f"{forecast['frequency_hz']:.3g} +- {half:.2g} Hz" in said


@pytest.fixture(scope="module")
def trunk(shared_data: Path) -> dict[str, Any]:
    """The hanging trunk, by its linear fit to two of the trials."""
    study = load_study(ROOT / "examples" / "trunk_free_decay.toml")
    file = str(shared_data / "trunk_free_decay" / "observations_manual_decay_200g.csv")
    recordings = {k: study.recordings[k].model_copy(update={"file": file}) for k in ("t_1", "t_4", "t_11")}
    linear = study.fits["unknown_mass"].model_copy(update={"train": ["t_4", "t_11"], "held_out": ["t_1"]})
    outcome = run_study(study.model_copy(update={"recordings": recordings, "fits": {"unknown_mass": linear}}))
    return json.loads(json.dumps(outcome.to_dict(), allow_nan=False))


def test_a_trunk_released_from_a_hand_is_followed_from_the_pose_it_was_held_in(trunk: dict[str, Any]) -> None:
    found = trunk["records"]["t_1"]
    assert found["role"] == "held_out"
    assert found["rmse_percent_of_travel"] < 4  # 2.1
    assert found["frequency_hz"]["modelled"] == pytest.approx(found["frequency_hz"]["measured"], rel=0.1)


def test_what_an_unknown_mass_leaves_open_is_said_and_carried_into_the_forecasts(trunk: dict[str, Any]) -> None:
    said = " ".join(trunk["verdict"])
    assert "mass is set by its prior" in said
    assert "damping and mass make up for each other: mass 10 % higher with" in said
    light, heavy = trunk["forecasts"]["payload300"], trunk["forecasts"]["payload400"]
    for forecast in (light, heavy):
        assert 0.01 < forecast["half_width_95"]["frequency_hz"] < 0.4
    assert heavy["frequency_hz"] < light["frequency_hz"] < 1.5


def test_a_truncated_recording_is_refused(shared_data: Path, tmp_path: Path) -> None:
    from pliant.recording import read

    whole = (shared_data / "pneumatic_arm_pulses" / "100mbar_V3.c3d").read_bytes()
    for size in (100, 600, 5000, len(whole) // 2, len(whole) - 700):
        (tmp_path / "cut.c3d").write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"cut\.c3d"):
            read(tmp_path / "cut.c3d")
