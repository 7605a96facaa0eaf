"""Drafts for set points, moving bases and unequal segments: what is asked, and what is not."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import invoke
from unit_tables import bending

from pliant.study.prepare import all_aligned
from pliant.study.schema import load_study

pytestmark = pytest.mark.usefixtures("untried")
BODY = ("--length", "120mm", "--mass", "50g")
PLACES = [f"{s}_{a} [mm]" for s in ("base", "tip") for a in "xyz"]


def written(path: Path, names: list[str], *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.5f",
               encoding="utf-8")  # fmt: skip
    return path


def drafted(folder: Path, *files: Path, body: tuple[str, ...] = BODY) -> tuple[dict[str, Any], list[str]]:
    study = folder / "study.toml"
    done = invoke("new", study, "--from", *files, *body)
    assert done.exit_code == 0, done.exception or done.output
    asked = [line[2:].partition(":")[0] for line in done.output.splitlines() if line.startswith("? ")]
    return tomllib.loads(study.read_text()), asked


@pytest.mark.parametrize("name", ["soll [kPa]", "desired_kPa", "target p [kPa]", "Sollwert / kPa", "P_set [kPa]"])
@pytest.mark.parametrize("alone", [True, False])
def test_a_set_point_is_a_command_where_nothing_was_measured(tmp_path: Path, name: str, alone: bool) -> None:
    time, pressure, base, tip = bending()
    inputs = [np.round(pressure)] if alone else [np.round(pressure), pressure]
    names = ["t", *PLACES, name, *([] if alone else ["P [kPa]"])]
    study, asked = drafted(tmp_path, written(tmp_path / "arm.csv", names, time, 1e3 * base, 1e3 * tip, *inputs))
    entry = study["recordings"]["arm"]
    assert asked == []
    assert entry.get("signal") == ("commanded" if alone else None)
    assert "chambers" not in study["actuator"]


def test_a_set_point_in_a_log_of_its_own_is_a_command(tmp_path: Path) -> None:
    time, pressure, base, tip = bending()
    track = written(tmp_path / "arm.csv", ["t", *PLACES], time, 1e3 * base, 1e3 * tip)
    log = written(tmp_path / "arm_log.csv", ["t", "Sollwert [kPa]"], time, np.round(pressure))
    study, asked = drafted(tmp_path, track, log)
    assert asked == []
    assert study["recordings"]["arm"]["signal"] == "commanded"


def test_a_base_that_moves_from_the_first_frame_is_an_input(tmp_path: Path) -> None:
    time, pressure, base, tip = bending()
    carried = 0.04 * np.column_stack([np.sin(3.0 * time + 0.7), np.cos(2.0 * time), 0.0 * time])
    still = written(tmp_path / "still.csv", ["t", *PLACES, "p [kPa]"], time, 1e3 * base, 1e3 * tip, pressure)
    path = written(tmp_path / "arm.csv", ["t", *PLACES, "p [kPa]"], time, 1e3 * (base + carried),
                   1e3 * (tip + carried), pressure)  # fmt: skip
    study, asked = drafted(tmp_path, path, still)
    assert asked == []
    assert study["alignment"]["options"]["base_motion"] is True
    assert "space" not in study["actuator"]
    bodies = all_aligned(load_study(tmp_path / "study.toml"))
    moved, rested = (bodies[name].body["position"].values[:, -1] for name in ("arm", "still"))
    assert np.abs(moved - rested).max() < 4e-4
    assert float(np.ptp(bodies["arm"].body["base_position"].values[:, 0])) > 0.05
    assert "has no orientation" in "".join(bodies["arm"].findings)


def test_unequal_segments_are_stated_once(tmp_path: Path) -> None:
    time, pressure, base, tip = bending()
    path = written(tmp_path / "arm.csv", ["t", *PLACES, "p [kPa]"], time, 1e3 * base, 1e3 * tip, pressure)
    parts = ("--length", "30mm,0.05m,40mm", "--mass", "50g")
    study, asked = drafted(tmp_path, path, body=parts)
    assert asked == []
    assert study["actuator"]["segments"] == pytest.approx([0.03, 0.05, 0.04])
    assert not {"length", "links"} & set(study["actuator"])
    assert load_study(tmp_path / "study.toml").actuator.links == 6
    (tmp_path / "study.toml").unlink()
    for text, why in (("30mm,50kPa", "50kPa"), ("0,17", "decimal comma"), ("0mm,100mm", "above 0"),
                      ("-50mm,150mm", "above 0"), ("nan,.1", "nan"), ("60mm,62.5,64mm", "unit for each")):  # fmt: skip
        wrong = invoke("new", tmp_path / "study.toml", "--from", path, f"--length={text}")
        assert wrong.exit_code
        assert why in " ".join(wrong.output.replace("│", "").split())


def test_ticks_of_a_computer_are_times_in_a_unit_that_is_asked(tmp_path: Path) -> None:
    time, pressure, base, tip = bending()
    rows = [",".join([str(638 * 10**15 + round(1e7 * t)), *(f"{1e3 * v:.3f}" for v in (*b, *e)), f"{p:.2f}"])
            for t, b, e, p in zip(time, base, tip, pressure, strict=True)]  # fmt: skip
    path = tmp_path / "arm.csv"
    path.write_text("\n".join([",".join(["ticks", *PLACES, "p [kPa]"]), *rows, ""]))
    study, asked = drafted(tmp_path, path)
    assert asked == ["time_unit"]
    assert "inputs" not in study["mapping"]
    text = (tmp_path / "study.toml").read_text().replace('time_unit = "?"', 'time_unit = "100ns"')
    (tmp_path / "study.toml").write_text(text)
    body = all_aligned(load_study(tmp_path / "study.toml"))["arm"].body
    assert float(np.ptp(body["time"].values)) == pytest.approx(np.ptp(time), abs=1e-3)


@pytest.mark.parametrize("name", ["p_bar", "p_soll"])
def test_an_array_that_a_mapping_names_is_a_set_point_by_its_name(tmp_path: Path, name: str) -> None:
    time, pressure, base, tip = bending()
    np.savez(tmp_path / "arm.npz", t=time, position=np.stack([base, tip], axis=1), **{name: pressure / 100.0})
    (tmp_path / "m.toml").write_text(f'pressure = "{name}"\npressure_unit = "bar"\n')
    study, _ = drafted(tmp_path, tmp_path / "arm.npz", body=(*BODY, "--mapping", str(tmp_path / "m.toml")))
    assert study["recordings"]["arm"].get("signal") == ("commanded" if name == "p_soll" else None)


def test_the_first_unit_of_a_station_counts(tmp_path: Path) -> None:
    time, pressure, _, tip = bending()
    path = written(tmp_path / "arm.csv", ["t", "p_kpa", "x [mm]", "y", "z"], time, pressure, 1e3 * tip)
    study, _ = drafted(tmp_path, path)
    assert study["mapping"]["length_unit"] == "mm"
    names = ["t", "p_kpa", *(f"base_{a} [mm]" for a in "xyz"), "tip_x", "tip_y", "tip_z"]
    (tmp_path / "study.toml").unlink()
    written(path, names, time, pressure, 0.0 * tip, 1e3 * tip)
    refused = invoke("new", tmp_path / "study.toml", "--from", path, *BODY)
    assert "several units of length" in str(refused.exception or refused.output)


def test_ticks_of_an_encoder_are_no_times(tmp_path: Path) -> None:
    time, _, base, tip = bending()
    names = [*PLACES, "motor_ticks"]
    path = written(tmp_path / "arm.csv", names, 1e3 * base, 1e3 * tip, np.arange(len(time)) ** 2.0)
    study, asked = drafted(tmp_path, path)
    assert "rate_hz" in asked
    assert "time" not in study["mapping"]


def test_a_release_on_a_moving_base_is_drafted_without_its_motion(tmp_path: Path) -> None:
    time = np.arange(600) * 0.01
    angle = np.where(time < 0.5, 1.0, np.exp((0.5 - time) / 0.6) * np.cos(14.0 * (time - 0.5)))
    rng = np.random.default_rng(2)
    files = []
    for k, bent in enumerate([0.5, 0.4]):
        turn = bent * angle
        carried = 0.015 * np.column_stack([np.sin(turn), 0.0 * time, 0.0 * time])
        places = [length * np.column_stack([np.sin(part * turn), 0.0 * time, -np.cos(part * turn)]) + carried
                  + 2e-5 * rng.normal(size=(len(time), 3)) for length, part in ((0.0, 0.0), (0.05, 0.5), (0.1, 1.0))]
        names = ["t", *(f"{a}_{s}" for s in ("base", "mid", "tip") for a in "xyz")]
        files.append(written(tmp_path / f"r{k}.csv", names, time, *places))
    study, _ = drafted(tmp_path, *files)
    assert "base_motion" not in study["alignment"]["options"]
