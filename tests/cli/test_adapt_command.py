"""`pliant adapt`: another day of a known arm, on the command line; what it finds, writes and refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from command_line import invoke, program
from small_study import AXES, ORIGIN, body, changed, write_recording, write_study

from pliant.errors import InputError, PliantError
from pliant.model import Model
from pliant.simulation import Trace, simulate
from pliant.validation.metrics_file import MetricsFile
from pliant.validation.store import load_outcome

TIMES = np.arange(0.0, 3.2, 0.01)
TILT = 0.06  # rad, of the base on the other day


def day(path: Path, arm: Model, *, tilt: float = 0.0, seed: int = 5, gain: float = 1.0) -> Path:
    """Write a recording of three pulses of an arm whose whole body is turned in its plane, with noise."""
    trace = Trace([0.1, 0.12, 0.7, 0.72, 1.2, 1.22, 1.8, 1.82, 2.3, 2.32],
                  np.array([0.0, 7e4, 7e4, 0.0, 0.0, 11e4, 11e4, 0.0, 0.0, 9e4]))
    tip = simulate(arm, trace, times=TIMES, time_step=5e-4)["station_position"].values[:, 0]
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    seen = np.zeros((TIMES.size, 2, 3))
    seen[:, 1, :2] = tip @ turn.T
    seen = seen @ AXES.T + ORIGIN + 3e-4 * np.random.default_rng(seed).standard_normal(seen.shape)
    return write_recording(path, np.column_stack([TIMES, gain * trace(TIMES) / 1e3, seen.reshape(TIMES.size, -1)]))


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the small study."""
    folder = tmp_path_factory.mktemp("arm")
    done = invoke("run", write_study(folder), "-o", folder / "out", "--quiet")
    assert done.exit_code == 0, done.output
    return folder / "out"


def digest(folder: Path) -> dict[str, str]:
    """Digests of all files in a folder."""
    return {p.name: sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir())}


def adapted(arm: Path, recording: Path, out: Path, *options: str, code: int = 0) -> dict[str, Any]:
    """Metrics of an adaptation to the first 1.6 s of a recording."""
    done = invoke("adapt", arm, "--recording", recording, "--seconds", "1.6", "-o", out, "--json", "--quiet", *options)
    assert done.exit_code == code, (done.output, done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    metrics: dict[str, Any] = json.loads(done.stdout)
    MetricsFile.model_validate(metrics)
    return metrics


def test_a_tilted_base_is_found_and_the_body_stays(arm, tmp_path):
    before = digest(arm)
    found = adapted(arm, day(tmp_path / "may.csv", body(), tilt=TILT), tmp_path / "new")
    day_found = found["adaptations"]["adapted"]
    assert day_found["verdict"] == "re-mounted", day_found["sentence"]
    assert day_found["changed"] == []
    parameters = found["fits"]["adapted"]["parameters"]
    moves = day_found["moves"]
    assert abs(parameters["base_angle"]["value"] - TILT) < 3 * moves["base_angle"]["std"]
    errors = day_found["errors"]
    assert {n: e["role"] for n, e in errors.items()} == {"may": "fitted", "may_rest": "judged"}
    assert errors["may_rest"]["after_mm"] < 0.6 < 2.0 < errors["may_rest"]["before_mm"]
    assert digest(arm) == before
    restored = load_outcome(tmp_path / "new")
    assert restored.adaptations["adapted"].to_dict() == day_found
    assert str(arm) in found["provenance"]["adapted from 1"]
    assert any("may.csv" in text for text in found["provenance"].values())


@pytest.mark.slow
def test_the_same_arm_in_the_same_mounting(arm, tmp_path):
    found = adapted(arm, day(tmp_path / "may.csv", body()), tmp_path / "new")["adaptations"]["adapted"]
    assert found["verdict"] == "same arm", found["sentence"]


@pytest.mark.slow
def test_a_softer_body_is_named(arm, tmp_path):
    softer = body().with_(stiffness=0.35)
    found = adapted(arm, day(tmp_path / "may.csv", softer), tmp_path / "new")
    day_found = found["adaptations"]["adapted"]
    assert day_found["verdict"] == "changed body", day_found["sentence"]
    assert "stiffness" in day_found["changed"]
    assert found["fits"]["adapted"]["parameters"]["stiffness"]["value"] == pytest.approx(0.35, rel=0.15)


@pytest.mark.slow
def test_another_sensor_is_a_common_gain_and_no_other_body(arm, tmp_path):
    found = adapted(arm, day(tmp_path / "may.csv", body(), gain=1.08), tmp_path / "new")["adaptations"]["adapted"]
    assert found["moves"]["common_gain"]["after"] == pytest.approx(1 / 1.08, rel=0.02)
    assert "may be the inverse factor on all stiffnesses" in found["sentence"]
    assert "torque_1" not in found["changed"]


@pytest.mark.slow
def test_days_follow_each_other(arm, tmp_path):
    source = arm
    for k in range(2):
        new = tmp_path / f"new_{k}"
        adapted(source, day(tmp_path / f"day_{k}.csv", body(), tilt=0.02 * k, seed=k), new)
        source = new
    assert len(json.loads((source / "study.json").read_text())["adapt"]) == 2


@pytest.mark.slow
def test_a_study_adapts_its_fit_to_another_day(tmp_path):
    day(tmp_path / "may.csv", body(), tilt=TILT)
    content = changed("adapt", value={"recordings": ["may"], "seconds": 1.6})
    content["recordings"]["may"] = {"file": "may.csv"}
    done = invoke("run", write_study(tmp_path, content), "-o", tmp_path / "out", "--json", "--quiet")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert list(found["fits"]) == ["linear", "adapted", "adapted_before"]
    assert found["adaptations"]["adapted"]["verdict"] == "re-mounted"
    assert "mounted anew" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def unrelated(path: Path) -> Path:
    """Write a recording whose tip moves, but not with the pressure."""
    angle = np.where(TIMES < 0.3, 0.0, np.sin(9 * (TIMES - 0.3)))
    tip = 0.12 * np.column_stack([np.sin(angle), np.cos(angle)])
    seen = np.zeros((TIMES.size, 2, 3))
    seen[:, 1, :2] = tip
    seen = seen @ AXES.T + ORIGIN
    pressure = 50 * (1 + np.sin(4 * TIMES))
    return write_recording(path, np.column_stack([TIMES, pressure, seen.reshape(TIMES.size, -1)]))


@pytest.mark.slow
def test_another_arm_gets_start_values_and_exit_code_1(arm, tmp_path):
    found = adapted(arm, unrelated(tmp_path / "other.csv"), tmp_path / "new", code=1)
    assert found["adaptations"]["adapted"]["verdict"] == "another arm"
    assert "Identify it anew" in found["adaptations"]["adapted"]["sentence"]


def test_another_robot_of_the_kind_moves_within_the_spread(arm, tmp_path):
    other = body().with_(stiffness=0.58)
    found = adapted(arm, day(tmp_path / "b.csv", other), tmp_path / "new", "--of-a-kind")
    assert found["adaptations"]["adapted"]["verdict"] == "another of the kind"
    assert found["fits"]["adapted"]["parameters"]["stiffness"]["value"] == pytest.approx(0.58, rel=0.03)


def test_a_stated_spread_is_the_width_of_the_prior(arm, tmp_path):
    recording = day(tmp_path / "b.csv", body().with_(stiffness=0.52))
    std = [adapted(arm, recording, tmp_path / f"new_{s[0]}", "--of-a-kind", "--spread", s)["adaptations"]["adapted"]
           ["moves"]["stiffness"]["prior_std"] for s in ("5", "30%")]  # fmt: skip
    assert std == pytest.approx([0.05 * 0.5, 0.3 * 0.5], rel=0.15)  # and the doubt of the first robot


@pytest.mark.slow
def test_a_warm_up_is_simulated_but_not_compared(arm, tmp_path):
    recording = day(tmp_path / "may.csv", body(), tilt=TILT)
    rows = recording.read_text().splitlines()
    table = [[float(c) for c in row.split(",")] for row in rows[1:]]
    for row in table:
        if 0.05 < row[0] < 0.4:  # somebody holds the arm
            row[5:8] = table[5][5:8]
    recording.write_text("\n".join([rows[0], *(",".join(map(str, row)) for row in table)]) + "\n")
    found = adapted(arm, recording, tmp_path / "new", "--warm-up", "0.6")
    assert abs(found["fits"]["adapted"]["parameters"]["base_angle"]["value"] - TILT) < 0.01
    assert found["adaptations"]["adapted"]["verdict"] == "re-mounted"
    assert found["adaptations"]["adapted"]["seconds"] == pytest.approx(1.0, abs=0.02)
    assert json.loads((tmp_path / "new" / "study.json").read_text())["recordings"]["may"]["warm_up"] == 0.6


def still(path: Path) -> Path:
    seen = np.zeros((TIMES.size, 2, 3))
    seen[:, 1, 1] = 0.12
    seen = seen @ AXES.T + ORIGIN + 2e-5 * np.random.default_rng(1).standard_normal(seen.shape)
    return write_recording(path, np.column_stack([TIMES, 60.0 * (TIMES > 1), seen.reshape(TIMES.size, -1)]))


def without_pressure(path: Path) -> Path:
    day(path, body())
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("\n".join(",".join([r[0], *r[2:]]) for r in rows) + "\n")
    return path


def idle(path: Path) -> Path:
    """The recording of an arm whose pressure log shows another input, which never rises."""
    day(path, body())
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("\n".join(",".join([r[0], r[1] if k == 0 else "0.0", *r[2:]]) for k, r in enumerate(rows)) + "\n")
    return path


@pytest.mark.parametrize(("recording", "options", "said"), [
    (still, (), "no station moves"),
    (without_pressure, (), "pressure"),
    (idle, (), "stays at 0 throughout"),
    (lambda path: path, (), "there is no recording"),
    (lambda path: day(path, body()), ("--like", "nothing"), "--like names recording 'nothing'"),
    (lambda path: day(path, body()), ("--fit", "nothing"), "has no fit 'nothing'"),
    (lambda path: day(path, body()), ("--seconds", "0.02"), "state more seconds"),
    (lambda path: day(path, body()), ("--warm-up", "1.6"), "after the warm-up of 1.6 s"),
    (lambda path: day(path, body()), ("--spread", "10"), "state --of-a-kind too"),
    (lambda path: day(path, body()), ("--of-a-kind", "--spread", "0"), "a number of % above 0"),
])  # fmt: skip
def test_bad_input_is_one_sentence_and_nothing_is_written(arm, tmp_path, recording, options, said):
    before = digest(arm)
    file = recording(tmp_path / "bad.csv")
    done = invoke("adapt", arm, "--recording", file, "--seconds", "1.6", "-o", tmp_path / "new", *options)
    assert isinstance(done.exception, PliantError | SystemExit), done.exception
    assert said in str(done.exception or done.output), done.output
    assert not (tmp_path / "new").exists()
    assert digest(arm) == before


def changed_results(arm: Path, folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Copy results, and change their fit in metrics.json."""
    copytree(arm, folder)
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    change(metrics["fits"]["linear"])
    (folder / "metrics.json").write_text(json.dumps(metrics), encoding="utf-8")
    return folder


@pytest.mark.parametrize(("change", "said"), [
    (lambda fit: fit.update(covariance=None), "no covariance of its parameters"),
    (lambda fit: fit.pop("covariance"), "fit linear of metrics.json cannot be read"),
    (lambda fit: fit["covariance"]["matrix"].pop(), "the covariance lacks numbers of its"),
    (lambda fit: fit["covariance"]["form"][0].__setitem__(0, None), "the covariance lacks numbers of its"),
    (lambda fit: fit["covariance"]["names"].__setitem__(0, "mass"), "does not contain its free parameter"),
    (lambda fit: fit["parameters"].clear(), "no free parameter of the body"),
])  # fmt: skip
def test_results_that_say_nothing_of_the_body_are_refused(arm, tmp_path, change, said):
    folder = changed_results(arm, tmp_path / "old", change)
    before = digest(folder)
    done = invoke("adapt", folder, "--recording", day(tmp_path / "may.csv", body()), "-o", tmp_path / "new")
    assert isinstance(done.exception, InputError), done.exception
    assert said in str(done.exception)
    assert not (tmp_path / "new").exists()
    assert digest(folder) == before


@pytest.mark.parametrize("file", ["metrics.json", "study.json"])
def test_results_cut_in_the_middle_are_refused(arm, tmp_path, file):
    folder = tmp_path / "old"
    copytree(arm, folder)
    content = (folder / file).read_bytes()
    (folder / file).write_bytes(content[: len(content) // 2])
    done = invoke("adapt", folder, "--recording", day(tmp_path / "may.csv", body()), "-o", tmp_path / "new")
    assert isinstance(done.exception, InputError), done.exception
    assert f"{file} is not valid JSON" in str(done.exception)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("where", ["itself", "other"])
def test_results_are_never_replaced(arm, tmp_path, where):
    target = arm
    if where == "other":
        target = tmp_path / "old"
        target.mkdir()
        (target / "metrics.json").write_text("{}")
    before = digest(target)
    done = invoke("adapt", arm, "--recording", day(tmp_path / "may.csv", body()), "-o", target)
    assert done.exit_code != 0
    assert "never replaces" in str(done.exception)
    assert digest(target) == before


def test_several_results_need_one_kind(arm, tmp_path):
    done = program("adapt", str(arm), str(arm), "--recording", str(day(tmp_path / "may.csv", body())),
                   "-o", str(tmp_path / "new"))  # fmt: skip
    assert done.returncode == 2
    assert "--of-a-kind" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_command_weighs_as_the_study_of_the_results(tmp_path):
    recording = day(tmp_path / "may.csv", body(), tilt=TILT)
    content = changed("fits", "linear", weighting="noise")
    content["recordings"]["may"] = {"file": "may.csv"}
    content["adapt"] = [{"recordings": ["may"], "seconds": 1.6}]
    done = invoke("run", write_study(tmp_path, content), "-o", tmp_path / "out", "--json", "--quiet")
    assert done.exit_code == 0, done.output
    by_study = json.loads(done.stdout)["fits"]["adapted"]["parameters"]
    by_command = adapted(tmp_path / "out", recording, tmp_path / "new", "--fit", "linear")["fits"]["adapted"]
    for name, p in by_study.items():
        assert by_command["parameters"][name]["value"] == pytest.approx(p["value"], rel=1e-6, abs=1e-9), name
