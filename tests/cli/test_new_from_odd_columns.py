"""Drafts of tables whose columns mislead or go on in a series: numbers of markers that change places, curvatures by arc
length, numbers that mark missing values; and of points in pixels, whose scale is open.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from unit_tables import bending

from pliant.study.draft import checked, draft_study
from pliant.study.draft_check import DraftCheck, answered
from pliant.study.inspected import orders_of

pytestmark = pytest.mark.usefixtures("untried")
LENGTH, BASE = 0.12, np.array([0.3, -0.2, 1.1])


def pose(path: Path, curvature: float, order: list[int]) -> Path:
    """A table of one pose [mm] of a body of even curvature: markers every 40 mm, in any order of numbers."""
    s = LENGTH * np.array([0.0, 1 / 3, 2 / 3, 1.0])
    points = np.column_stack([(1 - np.cos(curvature * s)) / curvature, 0 * s, np.sin(curvature * s) / curvature])
    rng = np.random.default_rng(int(10 * curvature))
    frames = 1e3 * (BASE + points + 5e-5 * rng.standard_normal((30, 4, 3)))[:, order]
    head = ["t_s", *(f"M{m}_{a}_mm" for m in (1, 2, 3, 4) for a in "xyz")]
    rows = [f"{k / 50:.2f}," + ",".join(f"{v:.3f}" for v in frame.ravel()) for k, frame in enumerate(frames)]
    path.write_text("\n".join([",".join(head), *rows, ""]))
    return path


def drafted(study: Path, *files: Path) -> tuple[dict, str]:
    done = invoke("new", study, "--from", *files, "--length", "120mm", "--mass", "50g")
    assert done.exit_code == 0, done.exception or done.output
    return tomllib.loads(study.read_text()), done.output


@pytest.mark.parametrize("largest", [4.0, 14.0])  # 1/m; bent by 96 degrees, the markers are on no line
def test_markers_whose_numbers_change_places_come_in_one_order(tmp_path: Path, largest: float) -> None:
    orders = [[0, 1, 2, 3], [2, 0, 3, 1], [3, 2, 1, 0]]
    files = [pose(tmp_path / f"cable_{k + 1}.0N.csv", largest * (k + 2) / 4, order) for k, order in enumerate(orders)]
    study, _ = drafted(tmp_path / "s.toml", *files)
    stated = study["mapping"]["stations"]
    for k, order in enumerate(orders):
        stations = study["recordings"][f"cable_{k + 1}_0N"].get("mapping", {}).get("stations", stated)
        assert [*stations] == ["base", "p1", "p2", "tip"]
        assert [column["position"][0] for column in stations.values()] == [
            f"M{order.index(marker) + 1}_x_mm" for marker in range(4)]  # fmt: skip
    assert "the names M1, M2, M3, M4 change places between the files" in (tmp_path / "s.toml").read_text()


@pytest.mark.parametrize(("bends", "unsure"), [((1.0, 2.0, 3.0), ""), ((5.2, 3.0, 1.0), "cable_1.0N.csv")])  # rad
def test_an_order_that_the_distances_do_not_show_is_asked_for(tmp_path: Path, bends, unsure: str) -> None:
    orders = [[3, 1, 0, 2], [0, 1, 2, 3], [3, 2, 1, 0]]
    files = [pose(tmp_path / f"cable_{k + 1}.0N.csv", bend / LENGTH, order)
             for k, (bend, order) in enumerate(zip(bends, orders, strict=True))]  # fmt: skip
    _, said = drafted(tmp_path / "s.toml", *files)
    assert f"? stations: the markers of {unsure} fit two orders nearly alike" in said if unsure else \
        "? stations" not in said


def test_poses_are_ordered_one_after_another_from_the_least_bent() -> None:
    s, poses, orders = np.linspace(0.0, 1.0, 6), [], [[3, 1, 4, 0, 2, 5], [0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]]
    for bend, order in zip((4.6, 3.0, 1.0), orders, strict=True):
        points = np.column_stack([1 - np.cos(bend * s), 0 * s, np.sin(bend * s)]) / bend
        poses.append(points[order])
    listed, unsure = orders_of(poses, np.zeros(3))
    assert [[order[k] for k in by] for order, by in zip(orders, listed, strict=True)] == 3 * [[*range(6)]]
    assert unsure == []


def test_markers_whose_numbers_stay_keep_their_names(tmp_path: Path) -> None:
    files = [pose(tmp_path / f"cable_{k}.0N.csv", 2.0 * k, [0, 1, 2, 3]) for k in (1, 2, 3)]
    study, _ = drafted(tmp_path / "s.toml", *files)
    assert study["alignment"]["options"]["base"] == "M1"
    assert "mapping" not in study


def test_a_rigid_plate_stays_one_station_beside_markers_of_a_soft_body(tmp_path: Path) -> None:
    plate = np.array([[12.0, 2.0, 1.0], [-11.0, 4.0, 0.0], [1.0, -13.0, 0.0]])  # mm
    rng, files = np.random.default_rng(3), []
    for k, angle in enumerate((0.6, 1.2, 1.9)):
        s = np.array([0.4, 0.7, 1.0]) * angle
        body = 120 / angle * np.column_stack([1 - np.cos(s), 0 * s, -np.sin(s)])
        frames = np.concatenate([plate, body]) + 0.02 * rng.standard_normal((30, 6, 3))
        head = ["t_s", *(f"{part}{m}_{a}_mm" for part in ("Base", "Body") for m in (1, 2, 3) for a in "xyz")]
        rows = [f"{j / 50:.2f}," + ",".join(f"{v:.3f}" for v in frame.ravel()) for j, frame in enumerate(frames)]
        files.append(tmp_path / f"pose_{20 * (k + 1)}kPa.csv")
        files[-1].write_text("\n".join([",".join(head), *rows, ""]))
    study, _ = drafted(tmp_path / "s.toml", *files)
    assert study["alignment"]["stations"] == {
        "base": ["Base1", "Base2", "Base3"], "Body1": ["Body1"], "Body2": ["Body2"], "Body3": ["Body3"]}  # fmt: skip


@pytest.mark.parametrize("marker", ["-3.697314E+28", "3.4028235e+38", "-3.7E28"])
def test_numbers_that_mark_missing_values_are_gaps_and_counted(tmp_path: Path, marker: str) -> None:
    time, pressure, base, tip = bending()
    rows = []
    for k, t in enumerate(time):
        cells = [f"{1e3 * v:.3f}" for v in tip[k]] if k not in (50, 51) else [marker] * 3
        rows.append(",".join([f"{t:.3f}", *(f"{1e3 * v:.3f}" for v in base[k]), *cells, f"{pressure[k]:.3f}"]))
    names = ["t", *(f"{s}_{a}_mm" for s in ("base", "tip") for a in "xyz"), "p_kpa"]
    path = tmp_path / "coil.csv"
    path.write_text("\n".join([",".join(names), *rows, ""]))
    shown = invoke("inspect", path)
    assert shown.exit_code == 0, shown.exception or shown.output
    assert "6 value(s) of coil.csv are 3." in shown.output
    assert "the number by which instruments mark a missing value: they are gaps" in " ".join(shown.output.split())
    assert "drop-outs: tip 2" in shown.output


def gratings(path: Path, start: str, behind: str, arcs: list[str]) -> Path:
    """Text of an interrogator: a body of even curvature that a pressure bends."""
    time = np.arange(0.0, 2.0, 0.02)
    level = np.where((time > 0.5) & (time < 1.5), 40.0, 0.0)
    names = ["Time [s]", *(f"{start}{arc}{behind}" for arc in arcs), "Pressure [kPa]"]
    rows = ["\t".join([f"{t:.2f}", *[f"{0.2 * p:.4f}"] * len(arcs), f"{p:.2f}"])
            for t, p in zip(time, level, strict=True)]  # fmt: skip
    path.write_text("\n".join(["Interrogator", "", "\t".join(names), *rows, ""]))
    return path


@pytest.mark.parametrize(("start", "behind", "arcs", "asked", "unit"), [
    ("K @ ", " cm", ["0.0", "2.5", "5.0", "7.5", "10"], {"curvature_unit"}, "cm"),
    ("Curvature ", " mm (1/m)", ["0", "25", "50", "75", "100"], set(), "mm"),
    ("kappa_", "", ["0", "25", "50", "75", "100"], {"curvature_unit", "arc_unit"}, "?"),
])  # fmt: skip
def test_curvatures_by_arc_length_need_no_mapping(tmp_path: Path, start, behind, arcs, asked, unit) -> None:
    study, said = drafted(tmp_path / "s.toml", gratings(tmp_path / "fbg.txt", start, behind, arcs))
    assert {line[2:].partition(":")[0] for line in said.splitlines() if line.startswith("? ")} == asked
    assert study["mapping"]["curvature"] == start
    assert study["mapping"]["arc_unit"] == unit


def test_curvatures_of_numbered_segments_are_at_no_arc_lengths(tmp_path: Path) -> None:
    for start, first in (("kappa", 1), ("Curvature_", 1), ("k", 0)):
        path = gratings(tmp_path / f"{start}.txt", start, "", [str(first + k) for k in range(5)])
        done = invoke("new", tmp_path / "s.toml", "--from", path)
        assert done.exit_code
        assert not (tmp_path / "s.toml").exists()


@pytest.mark.parametrize(("behind", "unit"), [(" mm (rad)", "rad"), (" mm [deg]", "deg"), (" mm", "?")])
def test_directions_of_curvatures_keep_their_unit(tmp_path: Path, behind: str, unit: str) -> None:
    arcs = ["0", "25", "50", "75", "100"]
    path = gratings(tmp_path / "fbg.txt", "Curvature ", " mm (1/m)", arcs)
    lines = path.read_text().splitlines()
    added = "".join(f"\tAngle {arc}{behind}" for arc in arcs)
    path.write_text("\n".join([lines[2] + added, *(line + 5 * "\t0.5" for line in lines[3:]), ""]))
    study, said = drafted(tmp_path / "s.toml", path)
    assert study["mapping"]["direction"] == "Angle "
    assert study["mapping"]["direction_unit"] == unit
    assert ("? direction_unit: unit of the directions" in said) == (unit == "?")


def test_a_pressure_without_a_unit_beside_curvatures_is_asked_for_it(tmp_path: Path) -> None:
    path = gratings(tmp_path / "fbg.txt", "kappa_", "", ["0", "25", "50", "75", "100"])
    path.write_text(path.read_text().replace("Pressure [kPa]", "pressure"))
    study, said = drafted(tmp_path / "s.toml", path)
    assert study["mapping"]["pressure_unit"] == "?"
    assert "? pressure_unit: unit (gauge) of pressure: kPa" in said
    assert all("nominal_pressure" not in recording for recording in study["recordings"].values())
    assert "length_unit" not in (tmp_path / "s.toml").read_text()


def test_numbered_channels_are_no_curvatures(tmp_path: Path) -> None:
    path = gratings(tmp_path / "log.txt", "Channel ", "", ["1", "2", "3", "4"])
    done = invoke("new", tmp_path / "s.toml", "--from", path)
    assert done.exit_code
    assert "holds inputs alone" in str(done.exception)


def test_a_wrapped_warning_is_no_entry_once_its_hash_is_removed(tmp_path: Path, monkeypatch) -> None:
    study = tmp_path / "s.toml"
    first = draft_study([pose(tmp_path / "cable_1.0N.csv", 8.0, [0, 1, 2, 3])], study, length=0.12, mass=0.05)
    for words in range(40, 60):  # one of these lines is wrapped before its length
        check = DraftCheck("a " * words + "length = 0.1 m, mass = 0.2 kg", None, ())
        monkeypatch.setattr("pliant.study.draft.check_draft", lambda *_, check=check: check)
        tomllib.loads(re.sub(r"(?m)^# (\w+ = )", r"\1", checked(first, study).text.partition("\nname = ")[0]))


def test_points_in_pixels_are_tried_at_a_scale_that_fits_the_length(tmp_path: Path) -> None:
    time, _, base, tip = bending()
    head = ["scorer," + ",".join(["net"] * 6), "bodyparts,base,base,base,tip,tip,tip",
            "coords,x,y,likelihood,x,y,likelihood"]  # fmt: skip
    rows = [f"{k},{4e3 * b[0] + 500:.2f},{90 - 4e3 * b[2]:.2f},0.99,{4e3 * e[0] + 500:.2f},{90 - 4e3 * e[2]:.2f},0.99"
            for k, (b, e) in enumerate(zip(base, tip, strict=True))]  # fmt: skip
    path = tmp_path / "film_30kPa.csv"
    path.write_text("\n".join([*head, *rows, ""]))
    draft = draft_study([path], tmp_path / "s.toml", length=0.12, mass=0.05)
    assert not any("length_unit" in doubt for doubt in draft.doubts)
    assert draft.inspected is not None
    content, assumed = answered(tomllib.loads(draft.text), draft.inspected)
    assert "camera.pixels_per_mm" in assumed
    assert content["camera"]["pixels_per_mm"] == pytest.approx(4.0, rel=0.1)
    assert len(time) == len(rows)


def test_a_proposed_entry_is_one_once_its_hash_is_removed(tmp_path: Path) -> None:
    time, pressure, base, tip = bending()
    rows = [",".join(f"{v:.6f}" for v in (t, p, *b, *e)) for t, p, b, e in zip(time, pressure, base, tip, strict=True)]
    path = tmp_path / "push.csv"
    path.write_text("\n".join(["t,p_kpa,x_base,y_base,z_base,x_tip,y_tip,z_tip", *rows, ""]))
    drafted(tmp_path / "s.toml", path)
    text = re.sub(r"(?m)^# (\w+ = )", r"\1", (tmp_path / "s.toml").read_text())
    assert {"gravity", "diameter", "tip_mass"} <= set(tomllib.loads(text)["actuator"])
