"""Tables that hold several runs below each other are never read as one recording."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from unit_tables import bending

import pliant
from pliant.errors import InputError

NAMES = "time [s],base_x [mm],base_y [mm],base_z [mm],tip_x [mm],tip_y [mm],tip_z [mm],pressure [kPa]"


def rows(level: float, *, timed: bool = True, start: float = 0.0) -> list[str]:
    """Rows of an arm whose tip follows a pulse of pressure, with an angle of 0.01 rad for each kPa."""
    time, pressure, base, tip = bending(level)
    text = [",".join(f"{v:.4f}" for v in row) for row in np.column_stack([1e3 * base, 1e3 * tip, pressure])]
    return [f"{t + start:.3f},{row}" for t, row in zip(time, text, strict=True)] if timed else text


def bend(recording) -> float:
    """The largest deflection of the tip [mm]: 12 at 20 kPa, 24 at 40 kPa, 35 at 60 kPa."""
    return 1e3 * float(recording["position"].sel(station="tip", axis="x").max())


def written(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def restarted(path: Path) -> Path:
    return written(path, NAMES, *rows(20), *rows(40), "", *rows(60))


def repeated(path: Path) -> Path:
    names = NAMES.partition(",")[2]
    return written(path, names, *rows(20, timed=False), names, *rows(40, timed=False), names, *rows(60, timed=False))


@pytest.mark.parametrize("table", [restarted, repeated])
def test_each_run_of_a_table_is_a_recording_of_the_draft(tmp_path: Path, table) -> None:
    path, study = table(tmp_path / "day.csv"), tmp_path / "s.toml"
    drafted = invoke("new", study, "--from", path, "--length", "120mm", "--mass", "50g")
    assert drafted.exit_code == 0, drafted.output
    content = tomllib.loads(study.read_text())
    assert content["recordings"]["day"]["select"] == {"column": "run", "values": [1, 2, 3]}
    assert content["model_selection"]["held_out"] == ["day_2"]
    assert "this study can be run" in " ".join(drafted.output.split())
    shown = " ".join(invoke("inspect", path).output.split())
    assert "holds 3 runs" in shown


def test_a_stated_mapping_keeps_its_columns_for_each_run(tmp_path: Path) -> None:
    path, study, mapping = restarted(tmp_path / "day.csv"), tmp_path / "s.toml", tmp_path / "m.toml"
    mapping.write_text('time = 0\nlength_unit = "mm"\npressure = { columns = [7], unit = "kPa" }\n'
                       "stations = { base = { position = [1, 2, 3] }, tip = { position = [4, 5, 6] } }\n")  # fmt: skip
    drafted = invoke("new", study, "--from", path, "--mapping", mapping, "--length", "120mm", "--mass", "50g")
    assert drafted.exit_code == 0, drafted.output
    assert list(tomllib.loads(study.read_text())["recordings"]) == ["day_1", "day_2", "day_3"]


@pytest.mark.parametrize("table", [restarted, repeated])
def test_runs_are_not_read_as_one_recording(tmp_path: Path, table) -> None:
    path = table(tmp_path / "day.csv")
    clock = {"time": "time [s]"} if table is restarted else {"rate_hz": 50.0}
    with pytest.raises(InputError, match="holds 3 runs below each other"):
        pliant.read(path, mapping=clock)
    one = pliant.read(path, mapping=clock | {"select": {"column": "run", "value": 2}})
    assert one.sizes["time"] == 200
    assert bend(one) == pytest.approx(24, abs=1)
    part = pliant.read(path, mapping=clock | {"rows": [400, 600]})
    assert bend(part) == pytest.approx(35, abs=1)


def test_a_clock_that_goes_back_otherwise_numbers_no_runs(tmp_path: Path) -> None:
    once = rows(20)
    path = written(tmp_path / "a.csv", NAMES, *once[:100], *once[60:])
    with pytest.raises(InputError, match="goes back"):
        pliant.read(path)
    path = written(tmp_path / "b.csv", NAMES, *rows(20), *rows(40, start=20.0))
    assert pliant.read(path).sizes["time"] == 400
    ticks = [f"{(65000 + 20 * k) % 65536},{row.partition(',')[2]}" for k, row in enumerate(once)]
    path = written(tmp_path / "c.csv", NAMES.replace("time [s]", "time [ms]"), *ticks)
    assert float(np.diff(pliant.read(path)["time"]).max()) == pytest.approx(0.02)


def test_a_delimiter_behind_each_row_stays_no_column(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", f"{NAMES},", *(f"{row}," for row in [*rows(20), *rows(40)]))
    one = pliant.read(path, mapping={"select": {"column": "run", "value": 2}})
    assert bend(one) == pytest.approx(24, abs=1)


def test_a_cut_last_row_of_the_last_run_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([NAMES, *rows(20), *rows(40)])[:-3])
    one = pliant.read(path, mapping={"select": {"column": "run", "value": 2}})
    assert one.sizes["time"] == 199
    assert "was left out" in one.attrs["history"]


@pytest.mark.parametrize("wrong", [
    {100: "0.000"}, {100: "0.020"}, {60: "0.000", 130: "0.000"}, dict.fromkeys(range(100, 120), "0.000"),
    {100 + k: f"{0.02 * k:.3f}" for k in range(20)},
])
def test_wrong_time_stamps_begin_no_run(tmp_path: Path, wrong: dict[int, str]) -> None:
    lines = [f"{wrong.get(k, row.partition(',')[0])},{row.partition(',')[2]}" for k, row in enumerate(rows(20))]
    path = written(tmp_path / "day.csv", NAMES, *lines)
    for command in (("inspect", path), ("new", tmp_path / "s.toml", "--from", path)):
        answer = invoke(*command)
        assert answer.exit_code != 0
        assert "goes back" in str(answer.exception)
    assert not (tmp_path / "s.toml").exists()


@pytest.mark.parametrize("jitter", [0, 3000])
def test_a_counter_that_begins_anew_each_second_begins_no_run(tmp_path: Path, jitter: int) -> None:
    late = np.random.default_rng(3).integers(0, jitter + 1, 200)
    ticks = [f"{(20000 * k + late[k]) % 1000000},{row.partition(',')[2]}" for k, row in enumerate(rows(20))]
    path = written(tmp_path / "day.csv", NAMES.replace("time [s]", "time [us]"), *ticks)
    with pytest.raises(InputError, match="its counter may begin anew after each 1000000 us"):
        pliant.read(path)


def test_runs_whose_last_time_is_round_stay_runs(tmp_path: Path) -> None:
    time = np.linspace(0.0, 60.0, 101)
    once = [f"{t:.3f},{row.partition(',')[2]}" for t, row in zip(time, rows(20), strict=False)]
    path = written(tmp_path / "day.csv", NAMES, *once, *once)
    with pytest.raises(InputError, match="holds 2 runs"):
        pliant.read(path)


@pytest.mark.parametrize(("cut", "last"), [(0, 200), (2, 199), (30, 199)])
def test_a_last_run_without_a_line_end_is_a_recording_of_the_draft(tmp_path: Path, cut: int, last: int) -> None:
    path, study = restarted(tmp_path / "day.csv"), tmp_path / "s.toml"
    path.write_text(path.read_text()[: -1 - cut])
    drafted = invoke("new", study, "--from", path, "--length", "120mm", "--mass", "50g")
    assert drafted.exit_code == 0, drafted.output
    assert tomllib.loads(study.read_text())["recordings"]["day"]["select"] == {"column": "run", "values": [1, 2, 3]}
    one = pliant.read(path, mapping={"select": {"column": "run", "value": 3}})
    assert one.sizes["time"] == last
    assert ("was left out" in one.attrs["history"]) == bool(cut)


def angles(path: Path) -> Path:
    once = [f"{0.02 * k:.2f},{0.1 * k:.2f},{0.3 * k:.2f}" for k in range(100)]
    return written(path, "t_s,theta_deg,p_kpa", *once, *once)


def many(path: Path) -> Path:
    once = rows(20)[:20]
    return written(path, NAMES, *once * 70)


@pytest.mark.parametrize(("table", "size", "listed"), [
    (angles, 100, "rows = [0, 100] or [100, 200]"),
    (many, 20, "rows = [0, 20], [20, 40] ... or [1380, 1400]"),
])
def test_the_rows_of_a_run_are_named_where_no_draft_can_list_the_runs(tmp_path: Path, table, size, listed) -> None:
    path, mapping = table(tmp_path / "day.csv"), tmp_path / "m.toml"
    for command in (("inspect", path), ("new", tmp_path / "s.toml", "--from", path)):
        answer = invoke(*command)
        assert answer.exit_code != 0
        assert listed in str(answer.exception)
        assert "pliant new" not in str(answer.exception)
    mapping.write_text(f"rows = [{size}, {2 * size}]\n")
    shown = invoke("inspect", path, "--mapping", mapping)
    assert shown.exit_code == 0, shown.output
    assert f"{size} frames" in shown.output


def test_units_below_the_names_of_each_run_are_no_rows(tmp_path: Path) -> None:
    names = NAMES.replace("time [s]", "t").replace(" [mm]", "").replace(" [kPa]", "")
    units = "s,mm,mm,mm,mm,mm,mm,kPa"
    for titles in ([names, units], []):
        path = written(tmp_path / "day.csv", names, units, *rows(20), *titles, *rows(40))
        one = pliant.read(path, mapping={"select": {"column": "run", "value": 2}})
        assert one.sizes["time"] == 200
        assert bend(one) == pytest.approx(24, abs=1)
        part = pliant.read(path, mapping={"rows": [200, 400]})
        assert float(part["pressure"].max()) == pytest.approx(40e3)


UNTIMED = NAMES.partition(",")[2]
STATIONS = {s: {"position": [f"{s}_{axis} [mm]" for axis in "xyz"]} for s in ("base", "tip")}


@pytest.mark.parametrize(("lines", "more", "frames"), [
    ([UNTIMED, UNTIMED, *rows(20, timed=False)], {}, 200),
    ([UNTIMED, *rows(20, timed=False), UNTIMED], {}, 200),
    ([f"{UNTIMED},trial", *(f"{row},1" for row in rows(20, timed=False)), f"{UNTIMED},trial",
      *(f"{row},2" for row in rows(40, timed=False))], {"select": {"column": "trial", "value": 2}}, 200),
], ids=["twice above", "again below", "with a column of trials"])  # fmt: skip
def test_names_that_stand_again_begin_no_run_by_themselves(tmp_path: Path, lines, more, frames: int) -> None:
    mapping = {"rate_hz": 50.0, "length_unit": "mm", "stations": STATIONS, **more}
    recording = pliant.read(written(tmp_path / "day.csv", *lines), mapping=mapping)
    assert recording.sizes["time"] == frames
    assert "repeat the names of its columns" in recording.attrs["history"]


def test_a_table_of_blanks_whose_names_stand_again_is_read(tmp_path: Path) -> None:
    lines = [row.replace(" [mm]", "").replace(" [kPa]", "").replace(",", " ")
             for row in (UNTIMED, *rows(20, timed=False), UNTIMED, *rows(40, timed=False))]  # fmt: skip
    stations = {s: {"position": [f"{s}_{axis}" for axis in "xyz"]} for s in STATIONS}
    mapping = {"rate_hz": 50.0, "length_unit": "mm", "stations": stations}
    assert pliant.read(written(tmp_path / "day.csv", *lines), mapping=mapping).sizes["time"] == 400


def test_runs_are_numbered_without_a_hole_where_a_logger_began_twice(tmp_path: Path) -> None:
    """Names that follow each other without rows between them begin one run."""
    path, study, mapping = tmp_path / "day.csv", tmp_path / "s.toml", tmp_path / "m.toml"
    written(path, UNTIMED, *rows(20, timed=False), UNTIMED, UNTIMED, *rows(40, timed=False))
    mapping.write_text('rate_hz = 50\nlength_unit = "mm"\npressure = { columns = [6], unit = "kPa" }\n'
                       "stations = { base = { position = [0, 1, 2] }, tip = { position = [3, 4, 5] } }\n")
    drafted = invoke("new", study, "--from", path, "--mapping", mapping, "--length", "120mm", "--mass", "50g")
    assert drafted.exit_code == 0, drafted.output
    assert list(tomllib.loads(study.read_text())["recordings"]) == ["day_1", "day_2"]
