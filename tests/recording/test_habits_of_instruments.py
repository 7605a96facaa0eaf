"""Tables in the habits of further instruments and loggers, with known content."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.recording import read

NAMES = ["base_x [mm]", "base_y [mm]", "base_z [mm]", "tip_x [mm]", "tip_y [mm]", "tip_z [mm]"]


def written(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def places(count: int = 60) -> np.ndarray:
    """Positions (T, 6) [mm] of a base at rest and of a tip that moves along x."""
    move = 20.0 * np.sin(np.arange(count) / 10.0)
    return np.column_stack([*np.zeros((3, count)), move, np.zeros(count), -100.0 - 0.1 * move])


def table(path: Path, clock: str, times: list[str], *more: str) -> Path:
    rows = [f"{t},{','.join(f'{v:.3f}' for v in row)}{''.join(f',{k % 7}' for _ in more)}"
            for k, (t, row) in enumerate(zip(times, places(len(times)), strict=True))]  # fmt: skip
    return written(path, ",".join([clock, *NAMES, *more]), *rows)


@pytest.mark.parametrize("step", [6.0, 30.0])
def test_days_of_a_slow_log(tmp_path: Path, step: float) -> None:
    path = table(tmp_path / "a.csv", "Date", [f"{46354.5 + step * k / 86400:.9f}" for k in range(60)])
    assert np.diff(read(path)["time"].values) == pytest.approx(step, abs=1e-3)


@pytest.mark.parametrize("rate", [1000.0, 1250.0, 2000.0, 10000.0])
def test_seconds_since_midnight_of_a_fast_log_are_no_days(tmp_path: Path, rate: float) -> None:
    path = table(tmp_path / "a.csv", "time", [f"{40000.0 + k / rate:.6f}" for k in range(60)])
    assert np.diff(read(path)["time"].values) == pytest.approx(1 / rate, rel=1e-3)


@pytest.mark.parametrize("name", ["p_atm [kPa]", "pressure_ambient [mbar]", "barometer [hPa]"])
def test_the_atmosphere_alone_is_no_input(tmp_path: Path, name: str) -> None:
    from pliant.study.first_reading import read_or_guess

    path = table(tmp_path / "a.csv", "time [s]", [f"{k / 50:.3f}" for k in range(60)], name)
    recording = read_or_guess(path, None).recording
    assert "pressure" not in recording
    assert name in recording.attrs["history"]


def test_a_pressure_in_atm_varies_and_the_atmosphere_does_not(tmp_path: Path) -> None:
    from pliant.study.first_reading import read_or_guess

    for varies in (True, False):
        air = [0.5 * np.sin(k / 9) ** 2 if varies else 1 + 1e-4 * k for k in range(60)]
        rows = [f"{k / 50:.3f},{','.join(f'{v:.3f}' for v in row)},{air[k]}" for k, row in enumerate(places())]
        for name in ("p_atm", "p [atm]"):
            path = written(tmp_path / "a.csv", ",".join(["time [s]", *NAMES, name]), *rows)
            assert ("pressure" in read_or_guess(path, None).recording) == (varies or name == "p [atm]")


def turning(path: Path, order: str, *, unity: bool = False, named: bool = True) -> Path:
    """A body that hangs in a room with skew axes and bends, with quaternions of its stations in an order."""
    from scipy.spatial.transform import Rotation

    room = Rotation.from_euler("xyz", [0.4, -0.7, 1.1])
    angle = 0.8 * np.sin(np.arange(80) / 20.0) ** 2
    columns, names = [np.arange(80) / 50.0], ["time"]
    for name, part in (("base", 0.0), ("mid", 0.5), ("tip", 1.0)):
        bend = part * angle
        along = 0.12 * part * np.stack([np.sin(bend / 2) * np.sinc(bend / 2 / np.pi), 0 * bend, np.sinc(bend / np.pi)])
        place = room.apply(along.T) + np.array([0.3, 0.2, 0.9])
        turn = (room * Rotation.from_rotvec(np.outer(bend, [0.0, 1.0, 0.0]))).as_quat()
        if unity:  # z reversed: as the rotation is seen in a mirror
            place, turn = place * [1, 1, -1], turn * [-1, -1, 1, 1]
        columns += [*place.T, *(turn[:, "xyzw".index(c)] for c in order)]
        names += [f"{name}_{a}" for a in "xyz"] + [f"{name}_q{c}" for c in order]
    rows = [",".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)]
    return written(path, *([",".join(names)] if named else []), *rows)


ROLES = {name: {"position": [f"{name}_{a}" for a in "xyz"]} for name in ("base", "mid", "tip")}


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_the_positions_show_the_order_of_quaternions_without_names(tmp_path: Path, order: str) -> None:
    from pliant.study.column_guess import guessed_table

    guess = guessed_table(turning(tmp_path / "a.txt", order, named=False))
    assert guess is not None
    first = [4, 5, 6, 7] if order == "xyzw" else [5, 6, 7, 4]
    assert guess.mapping["stations"]["p1"]["quaternion"] == first
    assert any(f"read as {', '.join(order)}" in note for note in guess.notes)


def test_quaternions_in_another_order_are_refused_or_doubted(tmp_path: Path) -> None:
    from pliant.errors import InputError
    from pliant.preprocessing.quality import quality

    path = turning(tmp_path / "a.csv", "wxyz")
    assert not quality(read(path)).doubts  # by their names
    listed = {name: {**entry, "quaternion": [f"{name}_q{c}" for c in "wxyz"]} for name, entry in ROLES.items()}
    with pytest.raises(InputError, match="in the order x, y, z, w"):
        read(path, mapping={"time": "time", "length_unit": "m", "stations": listed})
    by_index = {name: {**entry, "quaternion": [4 + 7 * k, 5 + 7 * k, 6 + 7 * k, 7 + 7 * k]}
                for k, (name, entry) in enumerate(ROLES.items())}  # fmt: skip
    doubts = quality(read(path, mapping={"time": "time", "length_unit": "m", "stations": by_index})).doubts
    assert "read as w, x, y, z" in doubts["order of quaternions"]


def test_quaternions_under_wrong_names_are_listed_by_the_names_or_the_indices(tmp_path: Path) -> None:
    from pliant.errors import InputError
    from pliant.preprocessing.quality import quality

    path = turning(tmp_path / "a.csv", "wxyz")
    names, _, below = path.read_text().partition("\n")
    for name in ROLES:
        names = names.replace(",".join(f"{name}_q{c}" for c in "wxyz"), ",".join(f"{name}_q{c}" for c in "xyzw"))
    path.write_text(f"{names}\n{below}")
    assert "whatever their names say" in quality(read(path)).doubts["order of quaternions"]

    def stations(letters: str) -> dict:
        return {name: {**entry, "quaternion": [f"{name}_q{c}" for c in letters]} for name, entry in ROLES.items()}

    mapping = {"time": "time", "length_unit": "m"}
    assert not quality(read(path, mapping=mapping | {"stations": stations("yzwx")})).doubts
    with pytest.raises(InputError, match="by the indices of the columns"):
        read(path, mapping=mapping | {"stations": stations("zyxw")})


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_a_resting_station_does_not_hide_the_order_of_quaternions(order: str) -> None:
    from scipy.spatial.transform import Rotation

    from pliant.preprocessing.plausibility.shape import shown_order

    phase = np.linspace(0.0, 6.0, 200)
    turned = Rotation.from_rotvec(np.stack([0.4 * np.sin(2 * phase), 0.6 * np.sin(phase), 0 * phase], axis=1))
    sign = np.where(np.arange(200) % 2, 1.0, -1.0)[:, None]  # q and -q are the same rotation
    resting = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1)) * sign
    tip = turned.apply([0.0, 0.0, 0.1])
    position = np.stack([np.zeros_like(tip), tip], axis=1)
    quaternion = np.stack([resting, turned.as_quat()], axis=1)[..., ["xyzw".index(c) for c in order]]
    assert shown_order(position, quaternion) == ", ".join(order)


def test_left_handed_axes_are_stated(tmp_path: Path) -> None:
    right, left = turning(tmp_path / "r.csv", "xyzw"), turning(tmp_path / "l.csv", "xyzw", unity=True)
    mirrored = read(left, mapping={"left_handed": True})
    assert "left-handed" in mirrored.attrs["history"]
    for variable in ("position", "quaternion"):
        assert mirrored[variable].values == pytest.approx(read(right)[variable].values, abs=1e-9)
    assert read(left)["position"].values[0, 0, 2] == pytest.approx(-0.9)  # nothing is mirrored unless it is stated


def lines_of(values: np.ndarray, mark: str) -> list[str]:
    return [mark.join(f"{v:.3f}" for v in row) for row in values]


def same(recording, lost: int = 0) -> None:
    """Whether a recording holds `places` at 100 Hz, with some frames of the tip lost."""
    assert np.diff(recording["time"].values) == pytest.approx(0.01)
    expected = places().reshape(60, 2, 3) / 1e3
    position = recording["position"].values
    assert int(np.isnan(position[:, 1, 0]).sum()) == lost
    known = np.isfinite(position)
    assert position[known] == pytest.approx(expected[known], abs=1e-6)
    assert [str(name) for name in recording["station"].values] == ["base", "tip"]


QUALISYS = ["NO_OF_FRAMES\t60", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t2", "FREQUENCY\t100", "DESCRIPTION\t--",
            "TIME_STAMP\t2026-01-01, 10:00:00.000\t123.4", "DATA_INCLUDED\t3D", "MARKER_NAMES\tbase\ttip"]  # fmt: skip


def test_a_table_of_qualisys(tmp_path: Path) -> None:
    from pliant.errors import InputError

    rows = lines_of(places(), "\t")
    rows[20:24] = ["\t".join([*row.split("\t")[:3], "0.000", "0.000", "0.000"]) for row in rows[20:24]]
    same(read(written(tmp_path / "a.tsv", *QUALISYS, *rows)), lost=4)
    head = "Frame\tTime\t" + "\t".join(f"{name} {axis}" for name in ("base", "tip") for axis in "XYZ")
    timed = [f"{k + 1}\t{k / 100:.5f}\t{row}" for k, row in enumerate(lines_of(places(), "\t"))]
    same(read(written(tmp_path / "b.tsv", *QUALISYS, "TRAJECTORY_TYPES\tMeasured\tMeasured", head, *timed)))
    with pytest.raises(InputError, match=r"60.*50"):
        read(written(tmp_path / "c.tsv", *QUALISYS, *rows[:50]))
    with pytest.raises(InputError, match="FREQUENCY"):
        read(written(tmp_path / "d.tsv", *[line for line in QUALISYS if "FREQ" not in line], *rows))


def test_trajectories_of_vicon_beside_analog_devices(tmp_path: Path) -> None:
    from pliant.errors import InputError

    rows = [f"{k + 41},0,{row}" for k, row in enumerate(lines_of(places(), ","))]
    rows[30] = ",".join([*rows[30].split(",")[:5], "", "", ""])
    block = ["Trajectories", "100", ",,arm:base,,,arm:tip,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm"]
    block += rows
    devices = ["Devices", "1000", ",,Pressure,", "Frame,Sub Frame,Voltage", ",,V",
               *(f"{k // 10 + 41},{k % 10},{k % 5}" for k in range(600))]  # fmt: skip
    for k, text in enumerate((block, [*devices, "", *block], [*block, "", *devices])):
        recording = read(written(tmp_path / f"{k}.csv", *text))
        same(recording, lost=1)
        assert ("Devices" in recording.attrs["history"]) == (k > 0)
    with pytest.raises(InputError, match="without trajectories"):
        read(written(tmp_path / "x.csv", *devices))


def test_tools_of_an_aurora(tmp_path: Path) -> None:
    head = ["Tools"]
    for k in range(2):
        head += [f"Port {k + 1}: 34802", "Frame", "Face", "State", "Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz", "Error"]
    rows = []
    for k, place in enumerate(places()):
        row = ["2"]
        for part in (place[:3], place[3:]):
            row += ["OK", str(900 + 4 * k), "0", "OK", "0.8", "0.0", "0.6", "0.0", *(f"{v:.3f}" for v in part), "0.1"]
        rows.append(row)
    for row in rows[10:13]:
        row[13], row[16], row[17:25] = "MISSING", "MISSING", [""] * 8
    path = written(tmp_path / "a.csv", ",".join(head), *(",".join(row) for row in rows))
    recording = read(path, mapping={"rate_hz": 100.0, "length_unit": "mm"})
    assert recording["station"].values.tolist() == ["tool_1", "tool_2"]
    same(recording.assign_coords(station=["base", "tip"]), lost=3)
    assert recording["quaternion"].values[0, 1] == pytest.approx([0.0, 0.6, 0.0, 0.8])


@pytest.mark.parametrize("mapping", [{"left_handed": True}, {"length_unit": "mm", "left_handed": False}])
def test_the_unit_of_qualisys_holds_with_a_mapping(tmp_path: Path, mapping: dict) -> None:
    path = written(tmp_path / "a.tsv", *QUALISYS, *lines_of(places(), "\t"))
    plain, mapped = read(path), read(path, mapping=mapping)
    reach = [float(np.ptp(r["position"].values[:, -1, 0])) for r in (plain, mapped)]
    assert reach[1] == pytest.approx(reach[0])



@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("end", ["blank cells", "blank cells and a tab", "no cells"])
def test_gaps_of_the_last_marker_of_qualisys(tmp_path: Path, timed: bool, end: str) -> None:
    rows = [f"{k + 1}\t{k / 100:.5f}\t{row}" if timed else row for k, row in enumerate(lines_of(places(), "\t"))]
    for k in range(20, 24):
        shown = rows[k].split("\t")[:-3]
        rows[k] = "\t".join(shown if end == "no cells" else [*shown, "", "", ""])
    rows = [f"{row}\t" for row in rows] if end.endswith("tab") else rows
    head = ["Frame\tTime\t" + "\t".join(f"{name} {axis}" for name in ("base", "tip") for axis in "XYZ")] * timed
    recording = read(written(tmp_path / "a.tsv", *QUALISYS, *head, *rows))
    same(recording, lost=4)
    assert recording["time"].values == pytest.approx(np.arange(60) / 100, abs=1e-6)
    assert ("4 row(s) of a.tsv end before their last marker" in recording.attrs["history"]) == (end == "no cells")


def test_rows_of_qualisys_with_too_many_values_or_of_bodies_are_refused(tmp_path: Path) -> None:
    from pliant.errors import InputError

    rows = lines_of(places(), "\t")
    with pytest.raises(InputError, match=r"row 4 below the header of a\.tsv holds more than 6 values"):
        read(written(tmp_path / "a.tsv", *QUALISYS, *rows[:3], f"{rows[3]}\t5.0", *rows[4:]))
    header = [*QUALISYS[:2], "NO_OF_BODIES\t1", "FREQUENCY\t100", "BODY_NAMES\ttip", "tip X\ttip Y\ttip Z"]
    with pytest.raises(InputError, match=r"poses of rigid bodies \(6DOF\), not of markers"):
        read(written(tmp_path / "b.tsv", *header, *rows))


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_trajectories_of_vicon_with_velocities_and_other_delimiters(tmp_path: Path, delimiter: str) -> None:
    block = ["Trajectories", "100", ',,"arm:base",,,,,,arm:tip,,,,,', "Frame,Sub Frame" + ",X,Y,Z,X',Y',Z'" * 2,
             "," + ",mm,mm,mm,mm/s,mm/s,mm/s" * 2]  # fmt: skip
    for k, place in enumerate(places()):
        cells = [f"{v:.3f}" for v in (*place[:3], 1.0, 2.0, 3.0, *place[3:], 4.0, 5.0, 6.0)]
        block.append(",".join([str(k + 41), "0", *cells]))
    lines = [line.replace(",", delimiter) for line in block]
    same(read(written(tmp_path / "a.csv", *lines)))
    if delimiter == ";":
        same(read(written(tmp_path / "b.csv", *lines[:5], *(line.replace(".", ",") for line in lines[5:]))))


def test_a_title_of_vicon_alone_is_refused_and_a_column_of_that_name_is_read(tmp_path: Path) -> None:
    from pliant.errors import InputError

    for text in (["Trajectories"], ["Trajectories,,", "100,,"]):
        with pytest.raises(InputError, match="fewer than 2 rows of trajectories"):
            read(written(tmp_path / "a.csv", *text))
    rows = [f"1,{k / 100:.2f},{row}" for k, row in enumerate(lines_of(places(), ","))]
    names = [f"{name}_{axis} [mm]" for name in ("base", "tip") for axis in "xyz"]
    for title in ("Joints", "Segments", "Devices"):
        same(read(written(tmp_path / "b.csv", ",".join([title, "t_s", *names]), *rows)))
