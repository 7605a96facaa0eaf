"""The command line as a user meets it: what it prints, what it writes, its exit codes."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from command_line import invoke, program
from small_study import HEADER, body, changed, table, write_recording, write_study

from pliant.cli import app
from pliant.cli.terminal import QUIET
from pliant.errors import InputError
from pliant.model import load_model, save_model
from pliant.recording import make_recording, read, write
from pliant.simulation import Pulse, equilibrium, simulate
from pliant.simulation.forces import PointForce

HEAVY = ("numba", "xarray", "matplotlib", "scipy", "pandas", "numpy", "pydantic")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small study with its recordings."""
    return write_study(tmp_path_factory.mktemp("cli"))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file."""
    return save_model(body(), tmp_path_factory.mktemp("model") / "model.json")


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['pliant', '--help']\n"
        "from pliant.__main__ import main\n"
        "try: main()\n"
        f"finally: print('HEAVY', [m for m in {HEAVY} if m in sys.modules], file=sys.stderr)"
    )
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=30)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = ended.ru_utime - began.ru_utime + ended.ru_stime - began.ru_stime
    assert done.returncode == 0
    assert all(name in " ".join(done.stdout.split()) for name in ("inspect", "run", "simulate", "Exit codes"))
    assert done.stderr.strip().endswith("HEAVY []")
    assert seconds < 0.6  # 0.25 where nothing else runs


def test_a_command_ends_without_a_search_for_garbage() -> None:
    """At the end of a process that has loaded xarray it takes a quarter of `pliant inspect`."""
    code = (
        "import atexit, gc, sys; sys.argv = ['pliant', '--version']\n"
        "atexit.register(lambda: print(gc.get_freeze_count() > 1000))\n"
        "from pliant.__main__ import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "True"


def test_commands_that_need_no_dask_import_none(model: Path, tmp_path: Path) -> None:
    """Where it is installed, xarray would import it with the first array, a cluster's client with the first file."""
    code = (
        f"import sys; sys.argv = ['pliant', 'simulate', {str(model)!r}, '-o', {str(tmp_path / 'run.nc')!r}]\n"
        "from pliant.__main__ import main\n"
        "from pliant.heavy import show_heavy\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print([m for m in sys.modules if m.partition('.')[0] in ('dask', 'distributed') and sys.modules[m]])\n"
        "show_heavy()\n"
        "print('dask' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-2:] == ["[]", "False"]
    assert (tmp_path / "run.nc").is_file()


@pytest.mark.parametrize("command", [c.name for c in app.registered_commands])
def test_every_command_explains_itself(command: str) -> None:
    result = invoke(command, "--help")
    assert result.exit_code == 0
    assert "Usage" in result.output
    assert result.output.splitlines()[-1].startswith(f"Example: pliant {command}")
    assert "--json" in result.output
    assert "--quiet" in result.output


def test_the_shell_completes_commands() -> None:
    asked = {**os.environ, "_PLIANT_COMPLETE": "complete_bash", "COMP_WORDS": "pliant ins", "COMP_CWORD": "1"}
    code = "import sys; sys.argv = ['pliant']; from pliant.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", code], env=asked, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["inspect"]


def test_a_scenario_and_a_shape_are_told_as_json(tmp_path: Path) -> None:
    listed = json.loads(invoke("testbed", "--list", "--json").stdout)
    assert listed["pulse_119"]["duration_s"] > 1
    raw = write(make_recording(np.arange(60) / 50, swinging()), tmp_path / "raw.nc")
    told = json.loads(invoke("shape", raw, "-o", tmp_path / "flat.nc", "--json").stdout)
    assert told["recording"] == str(tmp_path / "flat.nc")
    assert any(line.startswith("aligned") for line in told["history"])
    told = json.loads(invoke("shape", raw, "-o", tmp_path / "deep.nc", "--space", "--plane", "+z", "--json").stdout)
    assert any("along +z, plane +z normal to x" in line for line in told["history"])
    assert dict(read(tmp_path / "deep.nc").sizes) == {"time": 60, "station": 3, "axis": 3}


def test_a_body_that_never_rests_and_whose_base_no_station_shows(tmp_path):
    time = np.linspace(0.0, 1.0, 101)
    swing = np.stack([30.0 + 20.0 * np.sin(9.0 * time), 0.0 * time, 80.0 + 3.0 * np.cos(9.0 * time)], axis=1)
    places = np.stack([1e-3 * swing, 1.1e-3 * swing], axis=1)
    file = write(make_recording(time, places, station=["a", "b"]), tmp_path / "swing.nc")
    words = ("shape", file, "-o", tmp_path / "clean.nc", "--space", "--tangent", "0,0,1", "--plane", "+y", "--json")
    assert "never at rest" in str(invoke(*words).exception)
    told = json.loads(invoke(*words, "--rest", "0,0.02", "--origin", "0.03,0,-0.01").stdout)
    assert any("rest 0 to 0.02 s" in line for line in told["history"])
    clean = read(tmp_path / "clean.nc")
    heights = clean["position"].sel(station="a", axis="z").to_numpy()
    np.testing.assert_allclose(heights, 1e-3 * swing[:, 2] + 0.01, atol=1e-12)
    assert "--rest must be START,STOP in s, got '3'" in str(invoke(*words, "--rest", "3").exception)
    assert "--origin must be X,Y,Z in m" in str(invoke(*words, "--rest", "0,0.02", "--origin", "0,high,0").exception)


def test_a_table_without_a_rest_is_named_with_the_options_that_state_it(tmp_path):
    rows = [f"{t:.2f},0,0,0,{20 * np.sin(9 * t):.3f},{80 + 3 * np.cos(9 * t):.3f},0" for t in np.arange(101) / 100]
    table = "\n".join(["t,base_x [mm],base_y [mm],base_z [mm],tip_x [mm],tip_y [mm],tip_z [mm]", *rows])
    (tmp_path / "nr.csv").write_text(table, encoding="utf-8")
    done = program("shape", "nr.csv", "-o", "clean.csv", cwd=tmp_path)
    assert done.returncode == 2
    said = " ".join(done.stderr.split())
    assert "nr.csv: the body is never at rest for 0.1 s: state `rest` = [start, end], s" in said
    assert "in [alignment.options] of a study, or --rest of pliant shape" in said
    done = program("shape", "nr.csv", "-o", "clean.csv", "--rest", "5,6", cwd=tmp_path)
    assert "nr.csv: the rest window 5 to 6 s contains no frame" in " ".join(done.stderr.split())
    assert program("shape", "nr.csv", "-o", "clean.csv", "--rest", "0,0.02", cwd=tmp_path).returncode == 0


def swinging() -> np.ndarray:
    """Points (60, 3, 3) of a body that rests for half a second and then bends."""
    kappa = 1e-6 + 4 * np.clip(np.arange(60) / 50 - 0.5, 0, None)[:, None]
    s = np.array([1e-6, 0.1, 0.2])
    points = np.stack([(np.cos(kappa * s) - 1) / kappa, np.sin(kappa * s) / kappa, 0 * kappa * s], axis=2)
    return points + 1e-6 * np.random.default_rng(0).standard_normal(points.shape)


def test_the_version_is_that_of_the_package() -> None:
    import platform

    import numba

    from pliant import __version__

    result = invoke("--version")
    first, machine = result.output.splitlines()
    assert (result.exit_code, first) == (0, f"pliant {__version__}")
    assert f"numba {numba.__version__}," in machine
    assert machine.endswith(platform.machine())


def test_bad_usage_leaves_with_two() -> None:
    for arguments in ((), ("frobnicate",), ("run",), ("simulate", "model.json", "--duration", "long")):
        assert invoke(*arguments).exit_code == 2


@pytest.mark.slow
def test_a_study_runs_from_file_to_report(study: Path, tmp_path: Path) -> None:
    done = program("run", study, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert printed["records"]["middle"]["role"] == "held_out"
    assert "prepared low" in done.stderr
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000
    drawn = program("figures", tmp_path / "out", "--format", "svg", "--records", "middle", "--json",
                    "--width-mm", "8.8cm", "--letters")
    assert drawn.returncode == 0, drawn.stderr
    files = [Path(f) for f in json.loads(drawn.stdout)]
    assert files
    assert all(f.parent == tmp_path / "out" / "figures" and f.is_file() for f in files)
    assert "Traceback" not in done.stderr


def test_a_model_is_simulated_saved_and_drawn(model: Path, tmp_path: Path) -> None:
    out, figure = tmp_path / "path.nc", tmp_path / "path.svg"
    result = invoke("simulate", model, "--level", "80", "--duration", "0.5", "--start", "0.1", "--width", "0.2",
                    "-o", out, "--figure", figure, "--json")
    assert result.exit_code == 0, result.output
    numbers = json.loads(result.stdout)
    assert numbers["duration_s"] == pytest.approx(0.5)
    assert numbers["largest_pressure_kpa"] == pytest.approx(80)
    with xr.open_dataset(out, engine="h5netcdf") as saved:
        assert saved["tip_position"].shape == (501, 2, 2)
    assert figure.read_text().startswith("<?xml")
    assert {p.name for p in tmp_path.iterdir()} == {"path.nc", "path.svg"}


def test_a_model_follows_a_recorded_pressure(model: Path, study: Path) -> None:
    result = invoke("simulate", model, "--trace", study.parent / "high.csv", "--json")
    assert result.exit_code == 0, result.output
    numbers = json.loads(result.stdout)
    assert numbers["largest_pressure_kpa"] == pytest.approx(120)
    assert numbers["duration_s"] == pytest.approx(1.59)  # all of it
    short = invoke("simulate", model, "--trace", study.parent / "high.csv", "--duration", "0.3", "--json")
    assert json.loads(short.stdout)["duration_s"] == pytest.approx(0.3)


def test_a_pulse_needs_no_option(model: Path) -> None:
    numbers = json.loads(invoke("simulate", model, "--json").stdout)
    own = load_model(model)
    bend = equilibrium(own, 1e3 * numbers["largest_pressure_kpa"]).sum() - equilibrium(own).sum()
    assert abs(bend) == pytest.approx(0.5, rel=0.1)
    assert numbers["duration_s"] == pytest.approx(4.0)


def test_the_folder_of_a_run_names_its_model(model: Path, tmp_path: Path) -> None:
    save_model(load_model(model), tmp_path / "model.json")
    words = ("--level", "20", "--duration", "0.3", "--json")
    by_file, by_folder = (invoke("simulate", path, *words) for path in (model, tmp_path))
    assert by_folder.exit_code == 0, by_folder.output
    assert json.loads(by_folder.stdout) == json.loads(by_file.stdout)
    empty = tmp_path / "empty"
    empty.mkdir()
    assert f"cannot read the model file {empty / 'model.json'}" in str(invoke("simulate", empty).exception)


def test_a_vacuum_is_not_told_as_no_pressure(model: Path) -> None:
    numbers = json.loads(invoke("simulate", model, "--level", "-20", "--duration", "0.5", "--json").stdout)
    assert numbers["largest_pressure_kpa"] == pytest.approx(-20)
    assert numbers["largest_tip_displacement_mm"] > 0.1


@pytest.mark.slow
def test_a_load_a_table_and_a_film(model: Path, tmp_path: Path) -> None:
    plain = invoke("simulate", model, "--level", "80", "--duration", "0.6", "-o", tmp_path / "a.csv", "--json")
    loaded = invoke("simulate", model, "--level", "80", "--duration", "0.6", "--load-g", "30", "--film",
                    tmp_path / "motion.gif", "-o", tmp_path / "b.nc", "--json")
    assert (plain.exit_code, loaded.exit_code) == (0, 0), plain.output + loaded.output
    rows = pd.read_csv(tmp_path / "a.csv")
    own = load_model(model)
    run = simulate(own, Pulse(80e3, 0.12, 2.76), duration=0.6)
    assert rows["time (s)"].to_numpy() == pytest.approx(run.time.to_numpy(), abs=1e-12)
    for column in ("tip_position_link_2_y (m)", "joint_angle_joint_1 (rad)", "pressure (Pa)"):
        assert column in rows.columns
    height = run.tip_position.to_numpy()[:, -1, 1]
    assert rows["tip_position_link_2_y (m)"].to_numpy() == pytest.approx(height, abs=1e-12)
    heavy = simulate(own.with_(tip_mass=own.tip_mass + 0.03), Pulse(80e3, 0.12, 2.76), duration=0.6)
    told = json.loads(loaded.stdout)["final_tip_mm"]
    assert told == pytest.approx(1e3 * heavy.tip_position.to_numpy()[-1, -1], abs=1e-6)
    assert (tmp_path / "motion.gif").read_bytes()[:6] == b"GIF89a"
    pushed = invoke("simulate", model, "--level", "0", "--duration", "0.6", "--force", "0.1,0", "--json")
    force = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.0], [0.0, 0.0]])
    pull = PointForce(np.array([0.12, 0.12, 2.88, 2.88]), force, own.points[-1].name)
    alone = simulate(own, Pulse(0.0), duration=0.6, forces=[pull])
    told = json.loads(pushed.stdout)["final_tip_mm"]
    assert told == pytest.approx(1e3 * alone.tip_position.to_numpy()[-1, -1], abs=1e-6)
    wrong = invoke("simulate", model, "--force", "1,a")
    assert "--force must be FX,FY" in str(wrong.exception)
    wrong = invoke("simulate", model, "--load-g", "-1e6")
    assert "must be a mass in grams" in str(wrong.exception)
    wrong = invoke("simulate", model, "--duration", "0.1", "--film", tmp_path / "a.avi")
    assert "must end in .gif or .mp4" in str(wrong.exception)


def test_a_recording_is_inspected_as_text_and_as_json(study: Path) -> None:
    text = invoke("inspect", study.parent / "low.csv")
    assert text.exit_code == 0
    assert "stations: base, tip" in text.output
    assert "160 frames" in text.output
    content = json.loads(invoke("inspect", study.parent / "low.csv", "--json").stdout)
    assert content["station_names"] == ["base", "tip"]
    assert content["quality"]["frames"] == 160
    assert content["sizes"]["time"] == 160


def test_a_wrong_unit_shows_in_an_inspection(tmp_path: Path) -> None:
    columns = table(60.0).copy()
    columns[:, 1] *= 1e3 / 6894.757
    path = write_recording(tmp_path / "psi.csv", columns, [HEADER[0], "p_pa", *HEADER[2:]])
    result = invoke("inspect", path)
    assert result.exit_code == 0
    assert "was a pressure in kPa, mbar or psi read as Pa?" in result.output


def test_results_go_where_they_are_asked_to_go_and_nowhere_else(study: Path, tmp_path: Path) -> None:
    before = set(study.parent.iterdir())
    assert invoke("inspect", study.parent / "low.csv", "--figure", tmp_path / "look.png").exit_code == 0
    assert set(study.parent.iterdir()) == before
    assert list(tmp_path.iterdir()) == [tmp_path / "look.png"]


def test_a_job_that_fails_leaves_with_one(tmp_path: Path) -> None:
    fixed = {"stiffness": {"value": 1.0, "free": False}}
    study = write_study(tmp_path, changed("fits", "linear", "parameters", value=fixed))
    done = program("run", study, "-o", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith("pliant: fit linear: nothing to fit")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_demo_hands_its_options_on_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: dict[str, object] = {}

    def run(study: Path, output: Path, **options: object) -> None:
        asked.update(options, output=output, study=study.name)

    monkeypatch.setattr(sys.modules["pliant.cli.run"], "run", run)
    assert invoke("demo", "-o", tmp_path, "--json", "--quiet").exit_code == 0
    assert asked == {"json": True, "output": tmp_path, "study": "demo.toml"}
    for option in ("angles", "space"):
        assert invoke("demo", "-o", tmp_path, f"--{option}").exit_code == 0
        assert asked["study"] == f"{option}.toml"
    refused = invoke("demo", "--space", "--camera")
    assert "choose one" in str(refused.exception)
    assert not QUIET.get(), "what one command was asked is not asked of the next"


def test_a_run_without_a_folder_goes_where_the_study_is_called(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path] = []

    def stopped(_study: object, output: Path, **_options: object) -> None:
        asked.append(output)
        raise InputError("asked enough")

    monkeypatch.setattr("pliant.study.run_study", stopped)
    invoke("run", study)
    assert asked == [Path("results") / study.stem]


def test_a_quiet_run_tells_nothing_but_the_result(study: Path, tmp_path: Path) -> None:
    done = invoke("run", study, "-o", tmp_path / "quiet", "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "The model predicts the held-out record middle" in done.stdout


def test_work_in_a_pipe_tells_quarters_once_it_has_lasted_and_nothing_if_quiet(capsys, monkeypatch) -> None:
    from pliant.cli import terminal

    def run(seconds: float) -> str:
        clock = iter(np.arange(100) * seconds)
        monkeypatch.setattr(terminal, "monotonic", lambda: next(clock))
        with terminal.counting("samples") as count:
            for done in (0.1, 0.3, 0.3, 0.8, 1.0):
                count(done)
        return capsys.readouterr().err

    assert run(2.0).splitlines() == ["samples: 25 %", "samples: 75 %", "samples: 100 %"]
    assert run(0.01) == ""
    token = terminal.QUIET.set(True)
    assert run(2.0) == ""
    terminal.QUIET.reset(token)
