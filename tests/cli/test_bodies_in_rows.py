"""Tables whose rows each hold one of several bodies are refused: read as frames, they show a body that jumps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from unit_tables import bending

BODIES = ("base", "tip")


def written(
    path: Path, *, label: str | None, texts: bool = False, blocks: bool = False, own_times: bool = False,
) -> Path:
    time, pressure, base, tip = bending()
    rows = []
    for k, t in enumerate(time):
        for s, place in enumerate((base[k], tip[k])):
            name = BODIES[s] if texts else str(s + 1)
            numbers = ",".join(f"{v:.3f}" for v in 1e3 * place)
            rows.append((s, f"{name},{t + 0.004 * s * own_times:.3f},{numbers},{pressure[k]:.2f}"))
    if blocks:
        rows.sort(key=lambda row: row[0])
    head = [] if label is None else [f"{label},time,x [mm],y [mm],z [mm],pressure [kPa]"]
    path.write_text("\n".join([*head, *(row for _, row in rows)]) + "\n")
    return path


@pytest.mark.parametrize("command", ["inspect", "new"])
@pytest.mark.parametrize(("label", "changed"), [
    ("sensor", {}), ("sensor", {"texts": True}), ("sensor_id", {}), ("Track", {"blocks": True}), (None, {}),
    ("marker", {"own_times": True}),
])  # fmt: skip
def test_rows_of_several_bodies_are_no_frames(tmp_path: Path, command: str, label, changed) -> None:
    path = written(tmp_path / "a.csv", label=label, **changed)
    arguments = [path] if command == "inspect" else [tmp_path / "s.toml", "--from", path]
    done = invoke(command, *arguments)
    assert done.exit_code != 0
    assert "each row of a.csv holds one of several bodies" in str(done.exception)
    assert not (tmp_path / "s.toml").exists()


def test_one_of_the_bodies_can_be_chosen(tmp_path: Path) -> None:
    mapping = tmp_path / "m.toml"
    for texts, value in ((False, "2"), (True, '"tip"')):
        path = written(tmp_path / "a.csv", label="sensor", texts=texts)
        mapping.write_text(f'time = "time"\nselect = {{ column = "sensor", value = {value} }}\n')
        done = invoke("inspect", path, "--mapping", mapping)
        assert done.exit_code == 0, done.output
        assert "200 frames of 1 station(s)" in done.output


@pytest.mark.parametrize("name", ["sensor", "target", "number", "id"])
def test_a_reading_that_changes_beside_one_body_names_no_bodies(tmp_path: Path, name: str) -> None:
    time, pressure, _, tip = bending()
    reading = np.rint(20 * np.sin(3 * time) + 30)
    rows = [",".join([f"{t:.3f}", *(f"{1e3 * v:.3f}" for v in place), f"{p:.2f}", f"{r:.0f}"])
            for t, place, p, r in zip(time, tip, pressure, reading, strict=True)]  # fmt: skip
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"time,x [mm],y [mm],z [mm],pressure [kPa],{name}", *rows]) + "\n")
    assert invoke("inspect", path).exit_code == 0


def one_body(path: Path, name: str, labels: list[str], *, staircase: bool = False) -> Path:
    """A table of one body whose rows are frames, beside a column `name`; without a header if `name` is empty."""
    time, pressure, _, tip = bending()
    steps = np.repeat(np.arange(len(time) // 10), 10) if staircase else pressure
    rows = [",".join([f"{t:.3f}", label, *(f"{1e3 * v:.3f}" for v in place), f"{p:.2f}"])
            for t, label, place, p in zip(time, labels, tip, steps, strict=True)]  # fmt: skip
    path.write_text("\n".join([*([f"time,{name},x [mm],y [mm],z [mm],pressure [kPa]"] if name else []), *rows]) + "\n")
    return path


@pytest.mark.parametrize("name", ["track", "body", "marker", "tool", "port", "no"])
@pytest.mark.parametrize("kind", ["blocks", "in turn", "count"])
def test_numbers_beside_one_body_whose_times_rise_name_no_bodies(tmp_path: Path, name: str, kind: str) -> None:
    count = len(bending()[0])
    numbers = {"blocks": [1 + (k > count // 3) for k in range(count)], "in turn": [1 + k % 2 for k in range(count)],
               "count": [k % 10 for k in range(count)]}[kind]  # fmt: skip
    done = invoke("inspect", one_body(tmp_path / "a.csv", name, [str(n) for n in numbers]))
    assert done.exit_code == 0, done.exception
    assert f"{count} frames of 1 station(s)" in done.output


@pytest.mark.parametrize("labels", ["one", "several"])
def test_texts_beside_one_body_on_a_staircase_name_no_bodies(tmp_path: Path, labels: str) -> None:
    count = len(bending()[0])
    texts = ["hold" if labels == "one" or k % 7 < 4 else "move" for k in range(count)]
    path = one_body(tmp_path / "a.csv", "label", texts, staircase=True)
    assert invoke("inspect", path).exit_code == 0


def test_a_number_in_turn_beside_one_body_without_names_names_no_bodies(tmp_path: Path) -> None:
    path = one_body(tmp_path / "a.csv", "", [str(k % 2) for k in range(len(bending()[0]))])
    assert "several bodies" not in str(invoke("inspect", path).exception)


def test_the_remedy_names_a_text_of_the_column(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", label="marker", texts=True, blocks=True)
    path.write_text(path.read_text().replace("tip,", "end's,"))
    refused = invoke("inspect", path)
    assert 'select = { column = "marker", value = "end\'s" }' in str(refused.exception)


def test_texts_that_share_times_in_any_order_name_bodies(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", label="marker", texts=True)
    head, *rows = path.read_text().splitlines()
    pairs = [rows[k : k + 2][:: 1 if k % 4 else -1] for k in range(0, len(rows), 2)]
    path.write_text("\n".join([head, *(row for pair in pairs for row in pair)]) + "\n")
    assert "holds one of several bodies" in str(invoke("inspect", path).exception)
