"""A study of a body with two chambers: file to report, each recording saying which pressure drives which chamber."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_study import AXES, ORIGIN, TIMES, write_recording

from pliant.errors import InputError
from pliant.model import Chamber, Station, chain_model, load_model
from pliant.simulation import Trace, simulate
from pliant.study import load_study, run_study
from pliant.validation.store import load_outcome

LAWS = {"left": 6e-7, "right": 4e-7}
LEVELS = {"l": (90.0, 0.0), "r": (0.0, 110.0), "both": (80.0, 60.0)}  # kPa, of the left and the right chamber
HEADER = ["t", "p_kpa_a", "p_kpa_b", *(f"{axis}_{station}" for station in ("base", "tip") for axis in "xyz")]
CHAMBERS = [{"name": "left", "joints": [1, 2], "torque": [5e-7]},
            {"name": "right", "joints": [1, 2], "joint_gain": -1.0}]


def content(**changes: Any) -> dict[str, Any]:
    """The study; its tables carry the pressure of the right chamber first."""
    drive = {"left": "b", "right": 0}
    return {
        "name": "two", "time_step": 2e-3, "actuator": {"length": 0.12, "mass": 0.05, "links": 2, "chambers": CHAMBERS},
        "alignment": {"options": {"base": "base", "tangent": AXES[:, 1].tolist()}},
        "recordings": {name: {"file": f"{name}.csv", "drive": drive} for name in LEVELS},
        "fits": {"both_chambers": {"train": ["l", "r"], "held_out": ["both"], "starts": 1, "parameters": {
            "stiffness": "free", "damping": "free", "left.torque_1": "free", "right.torque_1": "free"}}},
        **changes,
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of the body in a folder, by a finer step than the study's."""
    made = tmp_path_factory.mktemp("two")
    chambers = tuple(Chamber(torque=np.array([LAWS[n]]), joint_gain=np.full(2, g), name=n)
                     for n, g in (("left", 1.0), ("right", -1.0)))  # fmt: skip
    body = chain_model(length=0.12, mass=0.05, links=2, stiffness=0.5, damping=3e-3, chambers=chambers,
                       stations=(Station("tip", 1, 0.06),))  # fmt: skip
    for k, (name, levels) in enumerate(LEVELS.items()):
        traces = [Trace([0.2, 0.21, 0.9, 0.91], 1e3 * p * np.array([0.0, 1.0, 1.0, 0.0])) for p in levels]
        tip = simulate(body, traces, times=TIMES, time_step=5e-4)["station_position"].values[:, 0]
        at = np.stack([np.zeros((TIMES.size, 3)), np.column_stack([tip, np.zeros(TIMES.size)])], axis=1)
        seen = at @ AXES.T + ORIGIN + 2e-5 * np.random.default_rng(k).standard_normal((TIMES.size, 2, 3))
        columns = [TIMES, traces[1](TIMES) / 1e3, traces[0](TIMES) / 1e3, seen.reshape(TIMES.size, -1)]
        write_recording(made / f"{name}.csv", np.column_stack(columns), HEADER)
    return made


def loaded(folder: Path, study: dict[str, Any]) -> Any:
    """The study, through its file."""
    path = folder / "study.json"
    path.write_text(json.dumps(study), encoding="utf-8")
    return load_study(path)


def test_two_chambers_are_identified_and_predicted_from_file_to_report(folder: Path) -> None:
    outcome = run_study(loaded(folder, content()), folder / "out")
    found = outcome.fits[0].result.values
    assert found["left.torque_1"] / found["stiffness"] == pytest.approx(LAWS["left"] / 0.5, rel=0.01)
    assert found["right.torque_1"] / found["stiffness"] == pytest.approx(LAWS["right"] / 0.5, rel=0.01)
    moved = {r.name: r.experiment.last_station[60] - r.experiment.last_station[0] for r in outcome.fits[0].records}
    assert moved["l"][0] < -0.01 < 0.01 < moved["r"][0]  # opposite sides, which each record alone would not tell
    told = outcome.to_dict()["records"]["both"]
    assert told["role"] == "held_out"
    assert told["rmse_percent_of_travel"] < 1.0
    model = load_model(folder / "out" / "model.json")
    assert [c.name for c in model.chambers] == ["left", "right"]
    again = load_outcome(folder / "out")
    for now, then in zip(again.fits[0].records, outcome.fits[0].records, strict=True):
        assert now.pressure.shape == (TIMES.size, 2)
        np.testing.assert_array_equal(now.pressure, then.pressure)
        assert {n: t.pressure.tolist() for n, t in now.experiment.drives.items()} == {
            n: t.pressure.tolist() for n, t in then.experiment.drives.items()}  # fmt: skip
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "measured, left" in page
    assert "left.torque_1" in page


def test_every_figure_of_two_chambers_is_drawn(folder: Path) -> None:
    from pliant.validation.figures import record_figure, torque_figure

    fit = run_study(loaded(folder, content())).fits[0]
    assert len(torque_figure([fit]).axes[0].lines) == 2 + 6  # a law for each chamber, its levels in three records
    labels = {h.get_label() for ax in record_figure(fit.records[2]).axes for h in ax.lines}
    assert {"measured pressure, left", "measured pressure, right"} <= labels


def test_a_chamber_that_nothing_drives_rests_and_is_told(folder: Path) -> None:
    recordings = {n: {"file": f"{n}.csv", "drive": {"left": "b", "right": "a"}} for n in LEVELS}
    recordings["l"]["drive"] = {"left": "b"}
    said: list[str] = []
    outcome = run_study(loaded(folder, content(recordings=recordings)), progress=said.append)
    sentence = "In l no pressure drives right: assumed constant at 0 Pa."
    assert sentence in said
    assert sentence in outcome.findings["l"]


def driving(**drive: Any) -> dict[str, Any]:
    """Entries of a study with one recording."""
    return {"recordings": {"l": {"file": "l.csv", "drive": drive}}}


BODY = {"length": 0.12, "mass": 0.05, "links": 2}


@pytest.mark.parametrize(("changes", "sentence"), [
    (driving(up=0), "recording l drives the chamber 'up', but the actuator has left, right"),
    (driving(left="c"), "no chamber 'c' to drive 'left': it has a, b"),
    (driving(), "with drive which of them drives which"),
    ({"actuator": {**BODY, "chambers": [{"name": "left", "joints": [3]}]}}, "acts on joint 3, but the chain has"),
    ({"actuator": {**BODY, "torque": [1e-7], "chambers": CHAMBERS}}, "or .*actuator.chambers"),
])  # fmt: skip
def test_what_does_not_fit_together_is_refused(folder: Path, changes: dict[str, Any], sentence: str) -> None:
    fits = {"one": {"train": ["l"], "parameters": {"stiffness": "free"}}}
    base = {"recordings": {"l": {"file": "l.csv", "drive": {"left": "b"}}}, "fits": fits}
    with pytest.raises(InputError, match=sentence):
        run_study(loaded(folder, content(**{**base, **changes})))


def test_the_wiring_that_moves_the_body_is_named_and_a_wrong_one_is_warned_of(folder: Path) -> None:
    """The recordings state the pressures exchanged; training records alone tell, by the difference of 2 ln L."""
    wrong = content(wiring={})
    law = {"value": 4e-7, "lower": 1e-8}  # a law of either sign would turn a chamber to the other side
    wrong["fits"]["both_chambers"]["parameters"] |= {"left.torque_1": law, "right.torque_1": law}
    for entry in wrong["recordings"].values():
        entry["drive"] = {"left": "a", "right": "b"}
    outcome = run_study(loaded(folder, wrong), folder / "wired")
    winner, other = outcome.wirings.rows
    assert winner.name == "left = b, right = a"
    assert other.name == "as stated"
    assert winner.train_percent < 0.5 < 5.0 < other.train_percent
    assert other.behind > 100.0
    assert any("check which pressure drives which chamber" in line for line in outcome.headline.warnings)
    assert outcome.wirings.sentence in outcome.verdict
    assert load_outcome(folder / "wired").wirings == outcome.wirings


def test_no_wiring_is_warned_of_where_the_stated_one_wins(folder: Path) -> None:
    drives = {"exchanged": {"left": "a", "right": "b"}, "of no recording": {"left": "c", "right": "b"}}
    outcome = run_study(loaded(folder, content(wiring={"drives": drives})))
    assert [r.name for r in outcome.wirings.rows] == ["as stated", "exchanged", "of no recording"]
    assert "no chamber 'c'" in outcome.wirings.rows[-1].reason
    assert not any("wiring" in line.lower() for line in outcome.headline.warnings)


def test_a_wiring_of_an_unknown_chamber_or_fit_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"wiring other drives the chamber 'middle'"):
        loaded(folder, content(wiring={"drives": {"other": {"middle": "a"}}}))
    with pytest.raises(InputError, match=r"\[wiring\] uses unknown fit 'none': use one of both_chambers"):
        loaded(folder, content(wiring={"fit": "none"}))


def test_a_rigid_part_lies_before_the_first_segment() -> None:
    from pliant.study.body import study_model
    from pliant.study.body_tables import ActuatorEntry

    entry = ActuatorEntry(length=0.12, base_length=0.05, mass=0.05, links=2, joint_placement="midsegment")
    model = study_model(entry, None)
    assert model.length == pytest.approx(0.17)
    assert model.base_length == pytest.approx(0.05 + 0.03)  # the fitting and half a segment
    assert model.mass == pytest.approx(0.05 * 0.09 / 0.12)  # the stub before the first joint does not move
