"""The direction of gravity in the axes of links, from inertial sensors in tables and bags."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.recording import make_recording, read, write
from pliant.recording.inclination import InclinationMapping, gravity_rows, turning_angles
from pliant.recording.netcdf import write_netcdf

Array = np.ndarray
DOWN = np.array([0.0, 0.6, 0.8])
LINK = Rotation.from_rotvec(np.outer(np.linspace(0.0, 0.7, 40), [0.6, 0.64, 0.48]))  # of the link in the base frame
SENSOR = Rotation.from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # its axes in those of the link
SEEN = LINK.inv().apply(DOWN)


def options(**more: object) -> InclinationMapping:
    return InclinationMapping(down=(5.0 * DOWN).tolist(), axes=["-y", "x", "z"], **more)


def rows_of(values: Array, **more: object) -> Array:
    return gravity_rows({"tip": values}, options(**more), "a.csv")[0]["further"]["gravity"][:, 0]


def test_accelerations_gravity_and_orientations_show_the_same_direction() -> None:
    up = -9.81 * SENSOR.inv().apply(SEEN)
    fixed = Rotation.align_vectors([[0.0, 0.0, -1.0]], [DOWN])[0]  # from the base frame to axes whose z points up
    turn = (fixed * LINK * SENSOR).as_quat()
    np.testing.assert_allclose(rows_of(up), SEEN, atol=1e-12)
    np.testing.assert_allclose(rows_of(-2.0 * up, measures="gravity"), SEEN, atol=1e-12)
    np.testing.assert_allclose(rows_of(turn), SEEN, atol=1e-12)


def test_lost_rows_are_gaps_and_counted_and_shaken_sensors_are_named() -> None:
    up = -SENSOR.inv().apply(SEEN)
    up[3], up[5] = 0.0, np.nan
    arguments, history = gravity_rows({"tip": up}, options(), "a.csv")
    assert np.flatnonzero(np.isnan(arguments["further"]["gravity"]).any(axis=(1, 2))).tolist() == [3, 5]
    assert any("1 frame(s) of tip are gaps" in line for line in history)
    assert not any("not gravity alone" in line for line in history)
    shaken = gravity_rows({"tip": up * np.linspace(0.5, 1.5, 40)[:, None]}, options(), "a.csv")[1]
    assert any("not gravity alone" in line for line in shaken)


def test_in_the_plane_the_part_across_it_is_left_out_and_named() -> None:
    turn = np.linspace(0.0, 0.8, 30)
    up = -np.column_stack([np.sin(turn), np.cos(turn), 0.05 + 0.0 * turn])
    plane = InclinationMapping(down=[0.0, 1.0])
    arguments, history = gravity_rows({"tip": up}, plane, "a.csv")
    expected = np.column_stack([np.sin(turn), np.cos(turn)])
    np.testing.assert_allclose(arguments["further"]["gravity"][:, 0], expected, atol=1e-12)
    assert arguments["frame"] == "planar"
    assert len(history) == 1
    up[:, 2] = 0.3
    assert any("across the plane" in line for line in gravity_rows({"tip": up}, plane, "a.csv")[1])


@pytest.mark.parametrize(("entries", "message"), [
    ({"down": [0.0, 0.0, 0.0]}, "not zero"), ({"axes": ["x", "x", "z"]}, "axes are the sensor's axes"),
    ({"axes": ["y", "x", "z"]}, "right-handed"), ({"axes": ["x", "y"]}, "inclination.axes which 3 axes of tip"),
    ({"axes": {"mid": ["x", "y", "z"]}}, "state in inclination.axes which 3 axes of tip"),
    ({"angles": None}, "inclination needs"), ({"angles": {"tip": "ax"}, "angle_unit": "deg"}, "inclination needs"),
])  # fmt: skip
def test_a_mapping_that_cannot_be_read_says_what_to_state(tmp_path: Path, entries: dict, message: str) -> None:
    path = table(tmp_path, -SEEN)
    mapping = {"time": "t", "angles": entries.pop("angles", {"tip": ["ax", "ay", "az"]})}
    mapping |= {"angle_unit": entries.pop("angle_unit", None), "inclination": {"down": [0.0, 0.0, 1.0], **entries},
                "pressure": {"columns": ["p"], "unit": "kPa"}}
    with pytest.raises(InputError, match=message):
        read(path, mapping={key: value for key, value in mapping.items() if value is not None})


def table(folder: Path, up: Array) -> Path:
    rows = "\n".join(f"{0.1 * k:.1f}," + ",".join(f"{v:.7f}" for v in row) + f",{k}" for k, row in enumerate(up))
    path = folder / "imu.csv"
    path.write_text(f"t,ax,ay,az,p\n{rows}\n")
    return path


def test_a_table_is_a_recording_that_is_kept(tmp_path: Path) -> None:
    mapping = {"time": "t", "angles": {"tip": ["ax", "ay", "az"]}, "pressure": {"columns": ["p"], "unit": "kPa"},
               "inclination": {"down": DOWN.tolist(), "reference": "base"}}  # fmt: skip
    recording = read(table(tmp_path, -SEEN), mapping=mapping)
    np.testing.assert_allclose(recording["gravity"].values[:, 0], SEEN, atol=1e-6)
    write_netcdf(recording, tmp_path / "a.nc")
    again = read(tmp_path / "a.nc")
    np.testing.assert_allclose(np.linalg.norm(again["gravity"].values, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(again["gravity"].values, recording["gravity"].values, atol=1e-12)
    np.testing.assert_allclose(again["gravity_constants"].values, [DOWN])
    assert again["gravity"].attrs["reference"] == "base"
    with pytest.raises(InputError, match="a wide CSV holds positions, and the recording has none"):
        write(recording, tmp_path / "a.csv")


@pytest.mark.parametrize(("gravity", "further", "message"), [
    (2.0 * SEEN, {"gravity_constants": [DOWN]}, "not of unit length"), (SEEN, {}, "gravity needs|needs its direction"),
    (SEEN, {"gravity_constants": [0.5 * DOWN]}, "not of unit length"),
])
def test_a_direction_is_a_unit_vector_with_its_direction_in_the_base_frame(
    gravity: Array, further: dict, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        make_recording(np.arange(40.0), frame="spatial", further={"gravity": gravity[:, None], **further})


def test_inertial_sensors_of_a_bag(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed: pip install 'pliant[ros]'")
    from journey.habits import bag

    path = bag(tmp_path)[0]
    flat = read(path)
    mapping = {"inclination": {"down": [0.0, 0.0, 1.0], "axes": ["x", "-z", "y"]}}
    recording = read(path, mapping=mapping)
    assert recording.attrs["frame"] == "spatial"
    assert recording["gravity"].attrs["reference"] == "rest"
    x, _, z = -recording["gravity"].values[:, 0].T
    turned = np.unwrap(np.arctan2(x, z))
    change = np.abs(turned - turned[0])
    np.testing.assert_allclose(change, np.abs(flat["angle"].values[:, 0]), atol=0.01)
    assert change.max() > 0.1


def test_the_warning_on_a_body_that_leaves_a_plane_holds_the_entry_that_reads_it():
    bend, side = 0.8 * np.sin(np.linspace(0, 6, 60)), 0.6 * np.cos(np.linspace(0, 6, 60))
    sensors = {"tip/data": 9.81 * np.column_stack([np.sin(bend), np.sin(side), -np.cos(bend) * np.cos(side)])}
    _, lines = turning_angles(sensors, "bag")
    line = next(line for line in lines if line.startswith("WARNING: the body leaves a plane"))
    stated = tomllib.loads("inclination" + line.partition("mapping inclination")[2])["inclination"]
    rows, _ = gravity_rows(sensors, InclinationMapping(**stated), "bag")
    gravity = rows["further"]["gravity"][:, 0]
    assert gravity.shape == (60, 3)
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 1.0)
    assert gravity[:, 2].mean() > 0.5
