"""Every bad input gets one clear sentence and exit code 2, and nothing is written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import invoke, program
from small_study import HEADER, STUDY, body, changed, table, write_recording, write_study

from pliant.actuators import chen2018
from pliant.errors import InputError, PliantError
from pliant.model import Chamber, chain_model, save_model


def refused(*arguments: str | Path) -> str:
    """The one sentence with which a command leaves with exit code 2, nothing on standard output."""
    result = invoke(*arguments)
    assert isinstance(result.exception, PliantError), result.output
    assert result.exception.exit_code == 2
    sentence = str(result.exception)
    assert "\n" not in sentence
    assert 20 < len(sentence) < 400
    return sentence


# Each builds one bad input in a folder and returns the command that meets it, and words of the sentence that it gets.
Case = Callable[[Path], tuple[tuple[str | Path, ...], str]]


def study_with(**low: Any) -> Case:
    """The small study whose recording `low` is damaged: other columns, header, or entries of the study."""

    def case(folder: Path) -> tuple[tuple[str | Path, ...], str]:
        study = write_study(folder, low.get("content"))
        if "table" in low:
            write_recording(folder / "low.csv", *low["table"]())
        return ("run", study, "-o", folder / "out"), low["says"]

    return case


def without_tip_z() -> tuple[Any, list[str]]:
    return table(60.0)[:, :-1], HEADER[:-1]


def in_psi() -> tuple[Any, list[str]]:
    columns = table(60.0).copy()
    columns[:, 1] *= 1e3 / 6894.757
    return columns, [HEADER[0], "p_pa", *HEADER[2:]]


def nan_pressure() -> tuple[Any, list[str]]:
    columns = table(60.0).copy()
    columns[30:34, 1] = float("nan")
    return columns, HEADER


def all_nan() -> tuple[Any, list[str]]:
    columns = table(60.0).copy()
    columns[:, 5:] = float("nan")
    return columns, HEADER


def truncated_c3d(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    (folder / "cut.c3d").write_bytes(b"\x02\x50" + bytes(700))
    return ("inspect", folder / "cut.c3d"), "cut.c3d"


def model_with(says: str, **entries: Any) -> Case:
    """A model file with entries that are wrong."""

    def case(folder: Path) -> tuple[tuple[str | Path, ...], str]:
        path = save_model(body(), folder / "model.json")
        path.write_text(json.dumps({**json.loads(path.read_text()), **entries}))
        return ("simulate", path, "-o", folder / "out.nc"), says

    return case


def folder_is_a_file(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    (folder / "results").write_text("in the way")
    return ("run", write_study(folder), "-o", folder / "results"), "cannot write into the output folder"


def folder_below_a_file(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    (folder / "results").write_text("in the way")
    return ("run", write_study(folder), "-o", folder / "results" / "small"), "cannot write into the output folder"


def trajectory_below_a_file(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    (folder / "file").write_text("in the way")
    model = save_model(body(), folder / "model.json")
    return ("simulate", model, "--duration", "0.1", "-o", folder / "file" / "out.nc"), "cannot write"


def figure_without_a_kind(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    model = save_model(body(), folder / "model.json")
    return ("simulate", model, "--duration", "0.1", "--figure", folder / "tips.jpeg2"), "must end in .png, .svg or .pdf"


def trace_without_pressure(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    model = save_model(body(), folder / "model.json")
    path = write_recording(folder / "still.csv", table(60.0)[:, [0, *range(2, 8)]], [HEADER[0], *HEADER[2:]])
    return ("simulate", model, "--trace", path), "holds no measured pressure"


def trace_of_two_chambers(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    model = save_model(body(), folder / "model.json")
    path = write_recording(folder / "two.csv", table(60.0)[:, [0, 1, 1]], ["t", "p_kpa_left", "p_kpa_right"])
    return ("simulate", model, "--trace", path), "has several pressures (left, right)"


def model_of_two_chambers(folder: Path) -> Path:
    chambers = tuple(Chamber([1e-7], np.ones(body().n), name=name) for name in ("left", "right"))
    return save_model(body().with_(chambers=chambers), folder / "model.json")


def one_pressure_for_two_chambers(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    return ("simulate", model_of_two_chambers(folder), "--level", "20"), "the model has 2 chamber(s), left, right"


def two_chambers_on_a_plant_of_one(folder: Path) -> tuple[tuple[str | Path, ...], str]:
    task = folder / "task.toml"
    limits = "duration_s = 1.0\nperiod_ms = 4.0\nhighest_kpa = 100.0\n"
    task.write_text(limits + "[[setpoint]]\ntime_s = 0.1\ntip_x_mm = -5.0\n")
    arguments = ("control", "--model", model_of_two_chambers(folder), "--task", task, "-o", folder / "results")
    return arguments, "the virtual actuator has one chamber, got 2 commands"


def simulate_with(says: str, *options: str) -> Case:
    """A simulation with options that cannot be."""

    def case(folder: Path) -> tuple[tuple[str | Path, ...], str]:
        return ("simulate", save_model(body(), folder / "model.json"), *options), says

    return case


TWO_BASES = {"base_left": ["base"], "base_right": ["tip"], "tip": ["tip"]}
BAD: dict[str, Case] = {
    "truncated C3D": truncated_c3d,
    "CSV with a missing column": study_with(table=without_tip_z, says="lacks the column(s) z_tip"),
    "NaN in the middle of the pressure": study_with(table=nan_pressure, says="4 of 160 samples are not"),
    "a station that is never seen": study_with(table=all_nan, says="tip"),
    "psi read as Pa": study_with(table=in_psi, says="too low to move a soft body; state its unit (psi"),
    "two base clusters": study_with(content=changed("alignment", stations=TWO_BASES), says="base"),
    "zero-length links in the study": study_with(content=changed("actuator", length=0.0), says="must be positive"),
    "zero-length links in a model": model_with("link_length must be positive", link_length=[0.06, 0.0]),
    "negative stiffness in a model": model_with("stiffness must be positive", stiffness=[0.5, -0.5]),
    "another schema": model_with("schema_name", schema_name="urdf"),
    "unknown key in a model": model_with("'weight' is not a known entry", weight=1.0),
    "unknown key in a study": study_with(content={**STUDY, "colour": "red"}, says="'colour' is not a known entry"),
    "missing recording": study_with(content=changed("recordings", "low", file="no.csv"), says="no.csv"),
    "output folder is a file": folder_is_a_file,
    "output folder below a file": folder_below_a_file,
    "trajectory below a file": trajectory_below_a_file,
    "figure of no known kind": figure_without_a_kind,
    "trace without pressure": trace_without_pressure,
    "trace of two chambers": trace_of_two_chambers,
    "one pressure for two chambers": one_pressure_for_two_chambers,
    "two chambers on a plant of one": two_chambers_on_a_plant_of_one,
    "trace and level": simulate_with("not both", "--trace", "any.csv", "--level", "30"),
    "trajectory in another format": simulate_with("must end in .nc", "--duration", "0.1", "-o", "no-such-file.txt"),
    "time that runs backwards": simulate_with("positive time in seconds", "--duration", "-1"),
    "step that is too long": simulate_with("too long: the first mode rings at", "--time-step-ms", "50"),
    "unknown method": simulate_with("use midpoint, extrapolated, accurate, LSODA, BDF, Radau", "--method", "ode45"),
    "pressure that is not a number": simulate_with("level must be finite", "--level", "nan"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_clear_sentence(case: str, tmp_path: Path) -> None:
    arguments, says = BAD[case](tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert says in refused(*arguments)
    after = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert after == before  # nothing written, nothing half written, nothing changed


@pytest.mark.parametrize("case", ["truncated C3D", "negative stiffness in a model", "output folder is a file"])
def test_the_program_itself_prints_the_sentence_and_leaves_with_two(case: str, tmp_path: Path) -> None:
    arguments, says = BAD[case](tmp_path)
    done = program(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    line, = done.stderr.strip().splitlines()
    assert line.startswith("pliant: ")
    assert says in line


@pytest.mark.parametrize("entries", [
    {"extensions": [{"stiffness": 300.0, "damping": 1.0, "name": "body"}] * 200},
    {"stations": [{"name": "s" * 60, "link": 0, "along": 0.01, "across": 0.0}] * 200},
    {"mass_at": "x" * 5000}, {"unknown": ["y" * 70] * 300}, {"name": "n" * 4000, "link_mass": [-1.0]},
    {"memory": {"boucwen_share": 0.1, "boucwen_beta": 0.5, "boucwen_gamma": 0.5, "slip_share": [0.001] * 81,
                "slip_angle": [0.1] * 81, "creep_share": [0.001] * 81, "creep_time": [0.1] * 81}},
])  # fmt: skip
def test_a_refused_model_file_takes_one_readable_line(entries, tmp_path):
    content = json.loads(save_model(chen2018.model(), tmp_path / "model.json").read_text()) | entries
    del content["checksum"]
    (tmp_path / "model.json").write_text(json.dumps(content))
    path = tmp_path / "arm.mat"
    assert len(refused("export", tmp_path / "model.json", "--to", "state-space", "-o", path)) < 400
    assert not path.exists()


def test_the_middle_of_a_long_message_is_left_out_and_counted():
    message = str(InputError("first " + "x" * 5000 + " do this"))
    assert len(message) < 1000
    assert message.startswith("first xx")
    assert "(4114 characters left out)" in message
    assert message.endswith("xx do this")


def test_an_approximate_export_says_by_how_much_its_second_chamber_differs(tmp_path):
    """Through the command: the feature that is left out belongs to a chamber that the first input does not drive."""
    chambers = Chamber(torque=(6.7e-7,), name="a"), Chamber(torque=(6.7e-7,), name="b", inflation_limit=3e5)
    model = chain_model(length=0.17, mass=0.069, links=3, stiffness=1.6, damping=8e-3, chambers=chambers)
    save_model(model, tmp_path / "arm.json")
    path = tmp_path / "arm.xml"
    done = invoke("export", tmp_path / "arm.json", "--to", "mjcf", "-o", path, "--approximate", "--json")
    assert done.exit_code == 0, done.output
    difference = json.loads(done.stdout)["difference"]
    assert "kPa in b from 0.1 s" in difference["input"]
    assert difference["largest_tip_difference_mm"] > 10.0
