"""Recordings as different laboratories write them, from the file to a prediction, by the console script alone.

Typed are the lines of the mapping and the answers to "?"; the pressure that is held out must be predicted nearly as
well as by a study made by hand from the same motion in pliant's own table.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import habits
import pytest
from command_line import invoke
from habits import LENGTH, MASS, ORIGIN, TANGENT
from small_study import LEVELS_KPA, STUDY, table, write_recording

MOST_LINES = 6  # of a mapping
MOST_ERROR = 1.3  # times that of the study made by hand


class Journey(NamedTuple):
    """What a person types for one habit: lines of a mapping, the files that it is for, answers; and what is read."""

    mapping: str = ""
    of: str = ""
    answers: Mapping[str, str] = MappingProxyType({})
    says: str = ""
    held_out: str = ""
    of_files: Mapping[str, Mapping[str, str]] = MappingProxyType({})  # answers in the table of one recording
    error: float | None = None  # % that a study made by hand reaches with these sensors; None: that of `by_hand`


JOURNEYS = {
    "vrpn": Journey(answers={"origin": str(ORIGIN.tolist()), "tangent": str(TANGENT.tolist())}, says="body 3",
                    held_out="arm_90"),
    "motive": Journey('pressure = ["ai0"]\npressure_unit = "kPa"\nscale = 0.05\nzero = 512', ".tdms",
                      held_out="take_90"),
    "matlab": Journey('struct = "train"\nlength_unit = "mm"\npressure = "p"\npressure_unit = "bar"', held_out="arm_2"),
    "bag": Journey('[linear.pressure]\noffset = -101.325\nunit = "kPa"', held_out="arm_90", error=0.69),
    "coils": Journey(
        'time = "Time"\nna = ["MISSING"]\nlength_unit = "mm"\n'
        'pressure = { columns = ["Encoder"], unit = "kPa", scale = 0.01, zero = 2048 }\n'
        'stations.base = { position = ["Bx", "By", "Bz"] }\n'
        'stations.tip = { position = ["Tx", "Ty", "Tz"], quaternion = ["Qx", "Qy", "Qz", "Q0"], status = "Tip State" }',
        says="drop-outs: tip 4", held_out="coil_90"),
    "bars": Journey(says="jumps of orientation", held_out="bench_90"),
    "film": Journey("camera = { pixels_per_mm = 4.0 }", "film", says="typed steps", held_out="film_90"),
    "gratings": Journey('curvature = "Curvature "\ncurvature_unit = "1/cm"', held_out="fbg_50kPa", error=3.1),
    "poses": Journey(answers={"driven_by": '"tension"', "lever": "5e-3", "gravity": "[0.0, 0.0, 0.0]"},
                     of_files={f"m{m}_u{k}": {f"m{m}": f"{k}.0"} for m in (1, 2) for k in (1, 2, 3, 4)},
                     says="the order of the stations in this file", held_out="m2_u2", error=0.25),
    "sessions": Journey(answers={"scale": "0.019635", "lever": "6e-3", "origin": "[0.12, -0.04, 0.305]",
                                 "tangent": '"+z"', "gravity": "[0.0, 0.0, 0.0]"},
                        says="only ratios of stiffnesses", held_out="session3", error=0.26),
}  # fmt: skip


def drafted(folder: Path, name: str) -> tuple[Path, str]:
    """Write the files of a habit, their mapping and the draft of a study; return its path and what the program says."""
    journey = JOURNEYS[name]
    files = getattr(habits, name)(folder)
    options = ["--length", str(LENGTH), "--mass", str(MASS)]
    if journey.mapping:
        assert len(journey.mapping.splitlines()) <= MOST_LINES
        (folder / "mapping.toml").write_text(journey.mapping)
        options += ["--mapping", f"{journey.of}={folder / 'mapping.toml'}".removeprefix("=")]
    study = folder / "study.toml"
    done = invoke("new", study, *(part for file in files for part in ("--from", file)), *options)
    assert done.exit_code == 0, done.output
    return study, done.output


def checked(folder: Path, name: str) -> str:
    """Draft the study of a habit, check what it says and asks, and return its text."""
    study, output = drafted(folder, name)
    text = study.read_text()
    assert JOURNEYS[name].says in text + output
    assert "alignment fails" not in text
    asked = set(re.findall(r'(\w+) = "\?"', text))
    of_files = {entry for answers in JOURNEYS[name].of_files.values() for entry in answers}
    assert asked == {*JOURNEYS[name].answers, *of_files}
    return text


def answered(text: str, journey: Journey) -> str:
    """The text of a draft with the answers of a journey in place of its open questions."""
    for entry, value in journey.answers.items():
        text = text.replace(f'{entry} = "?"', f"{entry} = {value}")
    for file, answers in journey.of_files.items():
        before, head, table = text.partition(f"[recordings.{file}]")
        for entry, value in answers.items():
            table = table.replace(f'{entry} = "?"', f"{entry} = {value}", 1)
        text = before + head + table
    return text


@pytest.mark.parametrize("name", ["coils", "bars", "sessions"])
def test_a_draft_asks_only_what_the_laboratory_knows(tmp_path, name):
    checked(tmp_path, name)


def errors_of(study: Path, folder: Path) -> dict[str, float]:
    """Run a study and return the error of each record, % of the peak displacement."""
    done = invoke("run", study, "-o", folder, "--json", "--quiet")
    assert done.exit_code == 0, done.output
    metrics = json.loads((folder / "metrics.json").read_text())
    return {name: record["rmse_percent_of_travel"] for name, record in metrics["records"].items()}


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory) -> float:
    """The error of the pressure held out by a study made by hand, % of the peak displacement."""
    folder = tmp_path_factory.mktemp("by_hand")
    for name, level in LEVELS_KPA.items():
        write_recording(folder / f"{name}.csv", table(level))
    free = dict.fromkeys(("stiffness", "damping", "torque_1", "base_angle", "tip.along", "tip.across"), "free")
    fit = {"train": ["low", "high"], "held_out": ["middle"], "parameters": free}
    body = {"length": LENGTH, "mass": MASS, "links": 5, "joint_placement": "midsegment"}
    content = {**STUDY, "actuator": body, "fits": {"first": fit}}
    (folder / "study.json").write_text(json.dumps(content))
    return errors_of(folder / "study.json", folder / "out")["middle"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n, journey in JOURNEYS.items() if journey.held_out])
def test_the_drafts_prediction_is_nearly_that_of_a_study_made_by_hand(tmp_path, name, by_hand):
    text, study = checked(tmp_path, name), tmp_path / "study.toml"
    study.write_text(answered(text, JOURNEYS[name]))
    error = errors_of(study, tmp_path / "out")[JOURNEYS[name].held_out]
    assert error < MOST_ERROR * (JOURNEYS[name].error or by_hand)
