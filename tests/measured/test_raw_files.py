"""The raw files of other laboratories as their owners hold them: what `inspect` and `new` need to be told, in lines."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import invoke

TRIALS = 'rate_hz = 100\nselect = { column = "ID" }\n'
SERVOS = ", ".join(f'"servo_{k}_mm"' for k in range(1, 10))
ROBOT = f'length_unit = "mm"\ninputs = {{ columns = [{SERVOS}], kind = "displacement", unit = "mm" }}\n'
ROD = """time = 0
length_unit = "m"
skip_lines = 2
stations.mid = { position = [4, 5, 6], euler = { columns = [1, 2, 3], order = "ZYX", unit = "rad" } }
stations.tip = { position = [10, 11, 12] }
"""
ARM = """time = 0
length_unit = "m"
pressure = { columns = [4, 5, 6, 10, 11, 12], unit = "psi" }
stations.base = { position = [17, 18, 19] }
stations.mid = { position = [24, 25, 26] }
stations.tip = { position = [31, 32, 33] }
"""


def mapped(folder: Path, mapping: str) -> list[str]:
    assert len(mapping.splitlines()) <= 6
    (folder / "mapping.toml").write_text(mapping)
    return ["--mapping", str(folder / "mapping.toml")]


@pytest.mark.parametrize(("file", "mapping", "shows"), [
    pytest.param("spatial_pneumatic_arm/experiment_1.csv", 'pressure_unit = "psi"\n',
                 ["stations: mocap_rigid_body", "pressure Segment_3: ", "pressure Segment_1_pouch_5: ", "drop-outs"],
                 marks=pytest.mark.slow),
    ("spatial_tendon_robot/v4_tendon_pull.csv", ROBOT,
     ["134 frames of 1 station(s)", "input servo_9_mm: -9.99 to 2.67 mm"]),
    ("spatial_rod_reference/release_TPU_1.txt", ROD, ["stations: mid, tip", "Euler angles ZYX"]),
    ("planar_two_segment_arm/jan10-4_steps_chamber1_1.txt", ARM, ["stations: base, mid, tip", "pressure 12: "]),
    pytest.param("fiber_shape/label.txt", 'rate_hz = 32\nlength_unit = "mm"\npoints = { count = 20 }\n',
                 ["of 20 station(s)"], marks=pytest.mark.slow),
])  # fmt: skip
def test_a_raw_file_is_shown_with_few_lines(tmp_path, shared_data, file, mapping, shows):
    done = invoke("inspect", shared_data / file, *mapped(tmp_path, mapping), "--quiet")
    assert done.exit_code == 0, done.output
    assert all(text in done.output for text in shows)


@pytest.mark.parametrize("file", ["spatial_tentacle/m1_u01.csv", "fiber_shape/label.txt",
                                  "planar_two_segment_arm/jan10-4_steps_chamber1_1.txt"])  # fmt: skip
def test_the_columns_of_a_raw_table_without_names_are_proposed(shared_data, file):
    done = invoke("inspect", shared_data / file, "--quiet")
    assert done.exit_code == 0, done.output
    assert "pliant new writes them into [mapping]" in done.output
    assert "stations: p1, p2, p3" in done.output


@pytest.mark.slow  # eight recordings
def test_levels_of_one_file_are_drafted_with_one_line(tmp_path, shared_data):
    names = ", ".join(f'"{name}{k}"' for name, count in (("base", 4), ("tip", 3)) for k in range(1, count + 1))
    done = invoke("new", tmp_path / "study.toml", "--from", shared_data / "pneumatic_arm_levels" / "levels.npz",
                  *mapped(tmp_path, f"station = [{names}]\n"), "--length", "0.12", "--mass", "0.1")  # fmt: skip
    assert done.exit_code == 0, done.output
    text = (tmp_path / "study.toml").read_text()
    assert '= "?"' not in text
    assert [f"nominal_pressure = {kpa}.0" in text for kpa in range(5, 45, 5)] == [True] * 8


@pytest.mark.slow  # twenty recordings
def test_trials_of_one_table_are_drafted_with_two_lines(tmp_path, shared_data):
    file = next((shared_data / "trunk_free_decay").glob("*.csv"))
    done = invoke("new", tmp_path / "study.toml", "--from", file, *mapped(tmp_path, TRIALS), "--mass", "0.2")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "study.toml").read_text().count("[recordings.") > 8
