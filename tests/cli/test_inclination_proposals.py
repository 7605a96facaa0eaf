"""`pliant new` on tables of inertial sensors that nobody described, on a body that leaves a plane."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from command_line import invoke
from test_inclination_journey import leaning


def drafted(path: Path) -> tuple[dict, str]:
    study = path.with_name("s.toml")
    done = invoke("new", study, "--from", path, "--length", "0.21", "--mass", "0.05")
    assert done.exit_code == 0, done.output
    return tomllib.loads(study.read_text()), " ".join(done.output.split())


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize(("swap", "axes"), [("x y z", ["x", "y", "z"]), ("z x y", ["z", "x", "y"]),
                                            ("y z x", ["y", "z", "x"])])  # fmt: skip
def test_the_mounting_of_sensors_is_proposed_as_if_the_body_hung(tmp_path: Path, swap: str, axes: list[str]) -> None:
    path = leaning(tmp_path / "a.csv")
    names = path.read_text().partition("\n")
    for name in ("mid", "tip"):
        head = names[0].replace(f"ax_{name}_g,ay_{name}_g,az_{name}_g", ",".join(
            f"a{swap.split()[k]}_{name}_g" for k in range(3)))  # fmt: skip
        names = (head, *names[1:])
    path.write_text("".join(names))
    study, said = drafted(path)
    assert study["mapping"]["inclination"] == {"down": [0.0, 0.0, 1.0], "axes": {"mid": axes, "tip": axes}}
    assert study["actuator"]["space"] is True
    assert study["actuator"]["gravity"] == [0.0, 0.0, 9.81]
    assert "? inclination: down is gravity in the base frame" in said
    assert [one["name"] for one in study["actuator"]["chambers"]] == ["left_kPa", "right_kPa"]
    turned = study["actuator"]["chambers"][1]["azimuth_deg"] - study["actuator"]["chambers"][0]["azimuth_deg"]
    assert turned % 360 in (89, 90, 91)  # axes stay right-handed


@pytest.mark.slow  # the derivatives of a body in space
def test_the_proposal_can_be_run(tmp_path: Path) -> None:
    said = drafted(leaning(tmp_path / "a.csv"))[1]
    assert "this study can be run" in said
