"""Names of columns in other languages, with units behind slashes, in tables of other programs; known content."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.column_names import is_command, standard_names, words_of

TIME = np.arange(60) / 20.0
TIP = np.column_stack([20.0 * np.sin(TIME), 0.0 * TIME, -100.0 + TIME])  # mm
PRESSURE = 10.0 * np.sin(TIME) ** 2  # kPa
NAMES = {
    "utf-8": "t_s,base_x_mm,base_y_mm,base_z_mm,x_tip [mm],y_tip [mm],z_tip [mm],p_kpa",
    "cp1252": "Zeit / s,Basis x / mm,Basis y / mm,Basis z / mm,Spitze x / mm,Spitze y / mm,Spitze z / mm,p / kPa",
    "gb18030": "时间(s),基座X(mm),基座Y(mm),基座Z(mm),末端X（mm）,末端Y（mm）,末端Z（mm）,压力(kPa)",
    "cp932": "時刻[s],根元x[mm],根元y[mm],根元z[mm],先端x[mm],先端y[mm],先端z[mm],圧力[kPa]",
    "utf-16": "temps (s),base X (mm),base Y (mm),base Z (mm),extrémité X (mm),extrémité Y (mm),extrémité Z (mm),"
              "pression (kPa)",
}  # fmt: skip

STATIONS = {"cp1252": ("Basis", "Spitze"), "gb18030": ("基座", "末端"), "cp932": ("根元", "先端"),
            "utf-16": ("base", "extrémité")}  # fmt: skip


def cells(decimal: str = ".") -> list[list[str]]:
    values = np.column_stack([TIME, 0.0 * TIP, TIP, PRESSURE])
    return [[f"{v:.4f}".replace(".", decimal) for v in row] for row in values]


def check(path: Path, stations: tuple[str, str] = ("base", "tip"), noise: float = 1e-7) -> None:
    recording = read(path)
    assert tuple(recording["station"].values.tolist()) == stations
    np.testing.assert_allclose(recording["time"].values, TIME, atol=1e-6)
    np.testing.assert_allclose(recording["position"].values[:, 1], 1e-3 * TIP, atol=noise)
    if "pressure" in recording:
        np.testing.assert_allclose(recording["pressure"].values.ravel(), 1e3 * PRESSURE, atol=0.1)


@pytest.mark.parametrize("encoding", NAMES)
def test_a_table_in_another_language_and_its_encoding(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "arm.csv"
    path.write_bytes("\n".join([NAMES[encoding], *map(",".join, cells()), ""]).encode(encoding))
    assert "pressure" in read(path)
    check(path, STATIONS.get(encoding, ("base", "tip")))


def table(path: Path, names: list[str]) -> Path:
    rows = [[f"{t:.2f}", *(f"{0.01 * t + k:.4f}" for k in range(len(names) - 1))] for t in TIME]
    path.write_text("\n".join(map(",".join, [names, *rows, ""])), encoding="utf-8")
    return path


@pytest.mark.parametrize("stations", [("Fuß", "Spitze"), ("pièce", "tête"), ("datum", "tip"), ("base", "bout"),
                                      ("Spitze", "Ende"), ("基座", "末端")])  # fmt: skip
def test_stations_keep_their_names_and_their_quaternions(tmp_path: Path, stations: tuple[str, str]) -> None:
    turns = [f"q{a}_{s}" for s in stations for a in "xyzw"]
    names = ["t", *(f"{a}_{s}" for s in stations for a in "xyz"), *turns]
    path = table(tmp_path / "arm.csv", names)
    path.write_text("\n".join([path.read_text().splitlines()[0], *(
        ",".join([f"{t:.2f}", "0", "0", "0", "0", "0", f"{t:.2f}", *(["0", "0", "0", "1"] * 2)]) for t in TIME), ""]))
    recording = read(path)
    assert recording["station"].values.tolist() == list(stations)
    assert recording["quaternion"].shape == (60, 2, 4)


@pytest.mark.parametrize(("first", "second", "chambers"), [
    ("Druck A [kPa]", "Druck B [kPa]", ["Druck A", "Druck B"]),
    ("Druck [kPa]", "Luftdruck [kPa]", ["Druck", "Luftdruck"]),
    ("Druck [kPa]", "Vorgabe [kPa]", None),
])  # fmt: skip
def test_chambers_keep_their_names(tmp_path: Path, first: str, second: str, chambers: list[str] | None) -> None:
    recording = read(table(tmp_path / "arm.csv", ["t", "x_tip", "y_tip", first, second]))
    assert (recording["chamber"].values.tolist() if "chamber" in recording.coords else None) == chambers


def test_of_two_times_the_one_in_a_known_word_is_read(tmp_path: Path) -> None:
    assert standard_names(["Temps", "horodatage", "p_kpa"], "a.csv").names == ["t", "horodatage", "p_kpa"]
    assert standard_names(["horodatage", "p_kpa"], "a.csv").names == ["t", "p_kpa"]
    two = read(table(tmp_path / "arm.csv", ["t", "p_kpa", "Winkel"]))  # an angle without a unit
    assert "pressure" in two


@pytest.mark.parametrize(("name", "chamber"), [
    ("Sollwert [kPa]", None), ("p_soll_kpa", ["soll"]), ("p_kpa_set", ["set"]),
])  # fmt: skip
@pytest.mark.parametrize("other", ["raw_count", "measurement", "flow"])
def test_a_lone_set_point_is_read_as_before(tmp_path: Path, name: str, chamber: list[str] | None, other: str) -> None:
    recording = read(table(tmp_path / "arm.csv", ["t", "x_tip", "y_tip", name, other]))
    assert recording["pressure"].size == len(TIME)
    assert (recording["chamber"].values.tolist() if "chamber" in recording.coords else None) == chamber
    measured = read(table(tmp_path / "both.csv", ["t", "x_tip", "y_tip", "p_soll_kpa", "pressure_raw"]))
    assert "pressure" not in measured


@pytest.mark.parametrize("other", ["stage_x_mm", "load_x_mm", "tip_y_mm", "end_x", "ee_x", "mount_x",
                                   "load_x_mm,load_y_mm,load_z_mm"])  # fmt: skip
def test_an_extra_column_beside_stations_is_no_station(tmp_path: Path, other: str) -> None:
    names = ["t", *(f"{a}_{s}" for s in ("base", "tip") for a in "xyz"), *other.split(",")]
    assert read(table(tmp_path / "arm.csv", names))["station"].values.tolist() == ["base", "tip"]


def test_a_table_between_bars_with_a_rule_below_its_names(tmp_path: Path) -> None:
    names = NAMES["utf-8"].split(",")
    path = tmp_path / "arm.csv"
    rows = ["| " + " | ".join(row) + " |" for row in [names, *cells()]]
    path.write_text("\n".join([rows[0], "|" + ":---:|" * len(names), *rows[1:], ""]))
    check(path)
    assert "1 line(s) of arm.csv are rules between rows" in read(path).history
    assert "the bars at both ends of 61 line(s)" in read(path).history


def test_a_trc_file(tmp_path: Path) -> None:
    rows = ["\t".join([str(k + 1), *row[:7]]) for k, row in enumerate(cells())]
    head = ["PathFileType\t4\t(X/Y/Z)\tarm.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
            f"20\t20\t{len(rows)}\t2\tmm", "Frame#\tTime\tbase\t\t\ttip\t\t", "\t\tX1\tY1\tZ1\tX2\tY2\tZ2", ""]
    path = tmp_path / "arm.trc"
    path.write_text("\n".join([*head, *rows, ""]))
    check(path)
    for markers in (("A", "F"), ("base", "target"), ("M_V", "Spitze")):
        path.write_text("\n".join([*head, *rows, ""]).replace("\tbase\t\t\ttip", f"\t{markers[0]}\t\t\t{markers[1]}"))
        assert read(path)["station"].values.tolist() == list(markers)
    path.write_text("\n".join([*head, *rows[:-5], ""]))
    with pytest.raises(InputError, match="60"):
        read(path)
    path.write_text("\n".join([head[0], head[1].replace("Units", "Unit"), *head[2:], *rows, ""]))
    with pytest.raises(InputError, match="without Units"):
        read(path)


@pytest.mark.parametrize(("ending", "content", "remedy"), [
    (".csv", b"PK\x03\x04\x14\x00\x06\x00xl/workbook.xml", "a .xlsx file by its first bytes: save its sheet as CSV"),
    (".csv", b"PK\x03\x04\x14\x00\x06\x00word/document.xml", "a .zip file by its first bytes: unpack it first"),
    (".bin", b"HIERARCHY\nROOT a\n{\n}\n", "export the positions of its joints"),
])  # fmt: skip
def test_a_file_of_another_program(tmp_path: Path, ending: str, content: bytes, remedy: str) -> None:
    path = tmp_path / f"arm{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=remedy):
        read(path)


def test_stations_in_both_spellings_are_kept() -> None:
    names = ["t", *(f"{a}_base_mm" for a in "xyz"), *(f"tip_{a}_mm" for a in "xyz"), "foo_x", "foo_y"]
    assert standard_names(names, "a.csv").names[1:7] == [f"{a}_{s}" for s in ("base", "tip") for a in "xyz"]
    assert standard_names(names, "a.csv").names[7:] == ["foo_x", "foo_y"]
    with pytest.raises(InputError, match="several units of length"):
        standard_names(["t", "x_base", "y_base", "tip_x_mm", "tip_y_mm"], "a.csv")


def test_units_behind_a_slash_but_no_rates_or_topics() -> None:
    assert standard_names(["Zeit/s", "x/mm", "y/mm"], "a.csv").names == ["t", "x_body", "y_body"]
    names = ["t", "v/m/s", "/arm/pressure/mbar"]
    assert standard_names(names, "a.csv").names[1] == "v/m/s"
    assert words_of("传感器1X") == ["传感器", "1", "x"]  # letters without a translation tell names apart


@pytest.mark.parametrize(("name", "commanded"), [
    ("soll [kPa]", True), ("Sollwert [bar]", True), ("pTarget", True), ("P_set [kPa]", True), ("desired_p", True),
    ("目标压力(kPa)", True), ("consigne (bar)", True), ("Istwert [bar]", False), ("pression des tubes [kPa]", False),
    ("p_meas [kPa]", False), ("offset_kPa", False), ("settle [N]", False), ("refill [N]", False),
])  # fmt: skip
def test_a_set_point_by_its_name(name: str, commanded: bool) -> None:
    assert is_command(name) == commanded


def test_a_sign_of_windows_before_a_word_is_no_chinese_name(tmp_path: Path) -> None:
    path = tmp_path / "arm.csv"
    rows = "\n".join(",".join(row[:7]) for row in cells())
    path.write_bytes(f"# \u2022r\u00e9gulation\n{NAMES['utf-8'].rsplit(',', 1)[0]}\n{rows}\n".encode("cp1252"))
    assert "gb18030" not in read(path).history
    check(path)


def test_lines_that_only_begin_with_a_bar_keep_a_blank_last_cell(tmp_path: Path) -> None:
    path = tmp_path / "arm.csv"
    rows = cells()
    rows[20][-1] = ""
    path.write_text("\n".join("|" + "|".join(row) for row in [NAMES["utf-8"].split(","), *rows]) + "\n")
    assert np.isnan(read(path)["pressure"].values).sum() == 1
