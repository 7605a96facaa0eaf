"""Values of inputs that the names of files state: with their signs, or not at all where a name is ambiguous."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import invoke

from pliant.study.kinds import named_level
from pliant.study.named_levels import named_pressures

pytestmark = pytest.mark.usefixtures("untried")


@pytest.mark.parametrize(("stem", "expected"), [
    ("m1_3mm", ("displacement", 0.003)), ("m1_-3mm", ("displacement", -0.003)), ("m1_+3mm", ("displacement", 0.003)),
    ("-2.5N", ("tension", -2.5)), ("m1_\u22123mm", ("displacement", -0.003)), ("m1_2.5N", ("tension", 2.5)),
    ("run_01_3mm", ("displacement", 0.003)), ("2_-3mm", ("displacement", -0.003)),
    ("motor-20deg", None), ("m1-3mm", None), ("0,5N", None), ("2_5N", None), ("m1_2_5N", None), ("1e-2N", None),
    ("1e+2N", None), ("minus_3mm", None), ("m1_2N_motor-20deg", None), ("m1_u3", None),
])  # fmt: skip
def test_a_level_has_the_sign_of_its_name_or_is_not_read(stem, expected):
    level = named_level(SimpleNamespace(path=Path(f"{stem}.csv")))
    assert level == (expected and (expected[0], pytest.approx(expected[1])))


@pytest.mark.parametrize(("ends", "levels"), [(("_-3mm", "_3mm"), [-0.003, 0.003]), (("-3mm", "-5mm"), ["?", "?"])])
def test_a_draft_of_settled_poses_takes_the_signs_of_the_names_or_asks(tmp_path, ends, levels):
    rng, files = np.random.default_rng(0), []
    for side, end in zip((-0.05, 0.05), ends, strict=True):
        place = np.array([0.0, 0.0, 0.0, side / 3, 0.1, 0.0, side, 0.2, 0.0]) + 1e-5 * rng.standard_normal((200, 9))
        names = ",".join(["t", *(f"{p}_{a}" for p in ("base", "mid", "tip") for a in "xyz")])
        files.append(tmp_path / f"m1{end}.csv")
        np.savetxt(files[-1], np.column_stack([np.arange(200) / 100, place]), "%.9g", ",", header=names, comments="")
    done = invoke("new", tmp_path / "s.toml", "--from", *files)
    assert done.exit_code == 0, done.exception or done.output
    study = tomllib.loads((tmp_path / "s.toml").read_text(encoding="utf-8"))
    assert [value for file in files for value in study["recordings"][file.stem]["inputs"].values()] == levels


@pytest.mark.parametrize(("stem", "pressures"), [
    ("A10kPa_B0kPa", {"A": 1e4, "B": 0.0}), ("P1_20kPa_P2_-5kPa", {"P1": 2e4, "P2": -5e3}),
    ("pulse_60kPa", {}), ("10kPa_20kPa", {}), ("A10kPa_A20kPa", {}), ("A1,5bar_B2bar", {}),
])  # fmt: skip
def test_pressures_behind_labels(stem, pressures):
    assert named_pressures(stem) == pressures
