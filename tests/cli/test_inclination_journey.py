"""From the table of two inertial sensors on an arm in space to a model and an estimate; MuJoCo moves the arm."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke

MAPPING = """
time = "t_s"
pressure = { columns = ["left_kPa", "right_kPa"], unit = "kPa", chamber = ["left", "right"] }
angles = { mid = ["ax_mid_g", "ay_mid_g", "az_mid_g"], tip = ["ax_tip_g", "ay_tip_g", "az_tip_g"] }
arc_length = [0.11, 0.19]
inclination = { down = [0.6, 0.0, 0.8], axes = ["y", "-x", "z"], reference = "base" }
"""
FITS = """[fits.plain]
train = ["a"]
held_out = ["b"]

[fits.plain.parameters]
stiffness = "free"
damping = "free"
"left.gain_x" = "free"
"left.gain_y" = "free"
"right.gain_x" = "free"
"right.gain_y" = "free"

"""


def leaning(path: Path) -> Path:
    """A table of an arm that leans towards x, then towards y, as both pressures rise in turn."""
    time = np.arange(0.0, 6.0, 0.05)
    left, right = np.clip(time - 0.5, 0, 2) * 10.0, np.clip(time - 3.0, 0, 2) * 10.0
    lines = ["t_s,ax_mid_g,ay_mid_g,az_mid_g,ax_tip_g,ay_tip_g,az_tip_g,left_kPa,right_kPa"]
    for t, p, q in zip(time, left, right, strict=True):
        row = []
        for gain in (0.01, 0.02):
            x, y = np.sin(gain * p), np.sin(gain * q)
            link = np.array([-x, -y, np.sqrt(1.0 - x * x - y * y)])  # gravity in its axes; it hangs at rest
            row += [link[1], -link[0], -link[2]]  # the sensor's x is -y of the link, its y is x
        lines.append(",".join(f"{v:.5f}" for v in (t, *row, p, q)))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_table_of_accelerations_is_inspected_and_drafted(tmp_path: Path) -> None:
    path, mapping, study = leaning(tmp_path / "a.csv"), tmp_path / "map.toml", tmp_path / "s.toml"
    proposed = invoke("inspect", path)
    assert proposed.exit_code == 0
    assert "? inclination: down is gravity in the base frame" in " ".join(proposed.output.split())
    mapping.write_text(MAPPING.replace("[0.6, 0.0, 0.8]", "[0, 0, 2]"))
    seen = json.loads(invoke("inspect", path, "--mapping", mapping, "--figure", tmp_path / "f.png", "--json").stdout)
    assert seen["station_names"] == ["mid", "tip"]
    assert seen["quality"]["travel_deg"]["tip"] == pytest.approx(20.0, abs=4.0)
    assert (tmp_path / "f.png").stat().st_size > 1000
    drafted = invoke("new", study, "--from", path, "--mapping", mapping, "--length", "0.21", "--mass", "0.05")
    assert drafted.exit_code == 0, drafted.output
    content = tomllib.loads(study.read_text())
    assert content["actuator"]["space"]
    assert content["actuator"]["gravity"] == [0.0, 0.0, 9.81]
    azimuths = {one["name"]: one["azimuth_deg"] for one in content["actuator"]["chambers"]}
    assert azimuths["left"] == pytest.approx(180, abs=2)
    assert azimuths["right"] == pytest.approx(270, abs=2)
    refused = invoke("shape", path, "--mapping", mapping, "-o", tmp_path / "x.nc")
    assert "holds gravity alone" in str(refused.exception)


@pytest.mark.slow  # a run, and MuJoCo's steps in Python
def test_a_study_of_inclinations_ends_in_a_model_that_a_filter_uses(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    from oracles import inertial

    times, up, tip = inertial.measured()
    files = [inertial.table(tmp_path / "a.csv", times, up)]
    files.append(inertial.table(tmp_path / "b.csv", *inertial.measured(2.0, seed=2)[:2]))
    mapping, study = tmp_path / "map.toml", tmp_path / "s.toml"
    mapping.write_text(MAPPING)
    drafted = invoke("new", study, "--from", *files, "--mapping", mapping, "--length", "0.21", "--mass", "0.05")
    assert drafted.exit_code == 0, drafted.output
    text = study.read_text()
    head, rest = text.split("[model_selection]")
    study.write_text(head.replace("# links = 2", "links = 3 #") + FITS + "[targets]" + rest.split("[targets]")[1])
    ran = invoke("run", study, "-o", tmp_path / "results")
    assert ran.exit_code == 0, ran.output
    fitted = json.loads((tmp_path / "results" / "metrics.json").read_text())["fits"]["plain"]
    assert fitted["parameters"]["stiffness"]["value"] == pytest.approx(0.08, rel=0.02)
    assert fitted["records"]["b"]["rmse_deg"] < 0.3
    report = (tmp_path / "results" / "report.html").read_text()
    assert "gravity_z" in report
    assert invoke("figures", tmp_path / "results", "-o", tmp_path / "figures").exit_code == 0
    found = invoke("estimate", files[0], "--model", tmp_path / "results" / "model.json", "--mapping", mapping, "-o",
                   tmp_path / "states.nc")  # fmt: skip
    assert found.exit_code == 0, found.output
    import xarray as xr

    with xr.open_dataset(tmp_path / "states.nc") as states:
        off = np.linalg.norm(states.tip_position.values[10:, -1] - tip[10:], axis=1)
    assert off.max() < 1.5e-3 < 0.05 * np.ptp(tip[:, 1])


def sensed(path: Path, angles: dict[str, np.ndarray]) -> Path:
    """A table of accelerometers that turn by these angles (T,) [rad] in one plane, with noise of 0.02 m/s^2."""
    time, noise = np.arange(0.0, 6.0, 0.02), np.random.default_rng(3)
    columns = {"t_s": time, "p_kpa": 20.0 - 20.0 * np.cos(3.0 * time)}
    for name, angle in angles.items():
        parts = np.column_stack([np.sin(angle), 0.0 * angle, np.cos(angle)])
        acceleration = 9.81 * parts + noise.normal(0.0, 0.02, parts.shape)
        columns |= {f"{name}_a{axis}": acceleration[:, k] for k, axis in enumerate("xyz")}
    rows = [",".join(f"{v:.5f}" for v in row) for row in np.column_stack([*columns.values()])]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path


def test_a_sensor_at_rest_on_the_base_leaves_the_body_in_its_plane(tmp_path: Path) -> None:
    turned = 0.6 * np.sin(3.0 * np.arange(0.0, 6.0, 0.02))
    path = sensed(tmp_path / "a.csv", {"base": 0.0 * turned, "mid": turned / 2, "tip": turned})
    done = invoke("inspect", path)
    assert done.exit_code == 0, done.output
    assert "become angles in one plane" in " ".join(done.output.split())
    assert "leaves" not in done.output


def test_a_sensor_without_values_is_named(tmp_path: Path) -> None:
    turned = 0.6 * np.sin(3.0 * np.arange(0.0, 6.0, 0.02))
    done = invoke("inspect", sensed(tmp_path / "a.csv", {"mid": np.nan * turned, "tip": turned}))
    assert done.exit_code != 0
    assert "mid has no acceleration or orientation in any frame: leave it out" in str(done.exception)
