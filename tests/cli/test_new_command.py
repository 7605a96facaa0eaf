"""`pliant new`: what it drafts runs, what it cannot know is marked, what is there stays."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from pliant.cli.new import new
from pliant.errors import InputError
from pliant.recording import make_recording, write
from pliant.study.draft import draft_study
from pliant.study.plates import clusters
from pliant.study.schema import Study
from pliant.study.shorthand import open_entries, refuse_open
from pliant.study.toml_text import relative, toml
from pliant.study.trial import inspect_trial
from pliant.testbed.bundle import FOLDER

pytestmark = pytest.mark.usefixtures("untried")

app = typer.Typer()
app.command()(new)


def invoke(*arguments):
    return CliRunner().invoke(app, [*(str(a) for a in arguments)])


def arc(kappa, s):
    """Points (T, S, 3) of circular arcs in x-y, tangent +y at the origin."""
    k = np.where(np.abs(kappa) < 1e-6, 1e-6, kappa)[:, None]
    flat = np.stack([(np.cos(k * s) - 1) / k, np.sin(k * s) / k], axis=2)
    return np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2)


def swing(*, back=True):
    """Time (s) and curvature (1/m) of a body that is pushed and, unless told otherwise, let back."""
    t = np.arange(0, 4, 0.01)
    pushed = np.clip((t - 0.5) / 0.1, 0, 1) * 8
    return t, np.where(t > 2.5, np.maximum(0, 1 - (t - 2.5) / 0.1) * 8, pushed) if back else pushed


@pytest.fixture
def markers(tmp_path):
    """A pulse seen by markers on a base plate and on a tip plate; no pressure."""
    t, kappa = swing()
    p = arc(kappa, np.array([0.0, 0.15]))
    angle = np.stack([0 * kappa, 0.15 * kappa], axis=1)
    e = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    n = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=-1)
    z = np.array([0.0, 0.0, 1.0])
    shifts = [0.02 * e, 0.01 * n, 0.015 * z + 0 * e]
    place = np.stack([p + shift for shift in shifts], axis=2).reshape(len(t), 6, 3)
    place = place + 1e-5 * np.random.default_rng(1).standard_normal(place.shape)
    names = [f"{part} - {i}" for part in ("Base", "Tip") for i in (1, 2, 3)]
    return write(make_recording(t, place, station=names), tmp_path / "push_30kPa.csv")


def test_markers_become_stations_and_the_level_comes_from_the_name(markers, tmp_path):
    result = invoke(tmp_path / "arm.toml", "--from", markers, "--mass", 0.1)
    assert result.exit_code == 0, result.output
    content = tomllib.loads((tmp_path / "arm.toml").read_text(encoding="utf-8"))
    assert content["alignment"]["stations"]["base"] == ["Base - 1", "Base - 2", "Base - 3"]
    assert content["alignment"]["options"]["base"] == "base"
    entry = content["recordings"]["push_30kPa"]
    assert (entry["nominal_pressure"], entry["pressure_unit"]) == (30.0, "kPa")
    assert entry["file"] == "push_30kPa.csv"
    assert not list(open_entries(content))
    assert "next: pliant run" in result.output
    Study.model_validate(content)


def test_open_questions_are_named_everywhere(markers, tmp_path):
    other = markers.rename(tmp_path / "push.csv")
    result = invoke(tmp_path / "arm.toml", "--from", other, "--json")
    asked = json.loads(result.output)["open"]
    assert [q.partition(":")[0] for q in asked] == ["mass", "nominal_pressure"]
    content = tomllib.loads((tmp_path / "arm.toml").read_text(encoding="utf-8"))
    assert list(open_entries(content)) == ["actuator.mass", "recordings.push.nominal_pressure"]
    with pytest.raises(InputError, match=r"2 open questions.*actuator\.mass, recordings\.push\.nominal_pressure"):
        refuse_open(content, tmp_path / "arm.toml")


def test_an_existing_file_is_left_alone(markers, tmp_path):
    (tmp_path / "arm.toml").write_text("mine")
    result = invoke(tmp_path / "arm.toml", "--from", markers)
    assert isinstance(result.exception, InputError)
    assert (tmp_path / "arm.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "told"),
    [(["--gravity", "down"], "three numbers"), (["--mapping", "none.toml"], "cannot read the mapping")],
)
def test_bad_options(markers, tmp_path, options, told):
    result = invoke(tmp_path / "arm.toml", "--from", markers, *options)
    assert told in str(result.exception)
    assert not (tmp_path / "arm.toml").exists()


def test_several_files_follow_one_option(markers, tmp_path):
    other = markers.with_name("push_60kPa.csv")
    other.write_bytes(markers.read_bytes())
    result = invoke(tmp_path / "arm.toml", "--from", markers, other, "--mass", 0.1)
    assert result.exit_code == 0, result.output
    assert set(tomllib.loads((tmp_path / "arm.toml").read_text())["recordings"]) == {"push_30kPa", "push_60kPa"}
    assert "! push_30kPa and push_60kPa hold the same numbers in 400 frames" in result.output


def test_a_released_body_asks_for_its_weight(tmp_path):
    t, kappa = swing(back=False)
    p = arc(kappa, np.array([0.0, 0.1, 0.2])) + 1e-5 * np.random.default_rng(2).standard_normal((len(t), 3, 3))
    file = write(make_recording(t, p, station=["clamp", "middle", "tip"]), tmp_path / "drop.csv")
    draft = draft_study([file], tmp_path / "s.toml", mass=0.1)
    content = tomllib.loads(draft.text)
    assert content["recordings"]["drop"]["excitation"] == "release"
    assert content["alignment"]["options"]["base"] == "clamp"  # it stands still
    assert list(open_entries(content)) == ["actuator.gravity"]
    assert "common" not in content["model_selection"]
    answered = tomllib.loads(draft_study([file], tmp_path / "s.toml", mass=0.1, gravity=[-9.81, 0, 0]).text)
    Study.model_validate(answered)


def test_a_fibre_with_a_cap_and_three_levels_runs(tmp_path):
    files = [FOLDER / f"pulse_{level}.nc" for level in (60, 180, 119)]
    draft = draft_study(files, tmp_path / "s.toml", length=0.17, mass=0.069)
    content = tomllib.loads(draft.text)
    assert not draft.questions
    chosen = {"train": ["pulse_60", "pulse_180"], "held_out": ["pulse_119"], "minutes": 5}  # the level between
    assert content["model_selection"] == chosen
    assert "fits" not in content
    assert content["reduction"]["recording"] == "pulse_180"
    assert content["fibre"]["cap_curvature"] == 50.0
    Study.model_validate(content)


def test_one_chamber_of_several_is_kept(tmp_path):
    t, kappa = swing()
    p = arc(kappa, np.array([0.0, 0.2]))
    rows = np.column_stack([t, p.reshape(len(t), -1), 0 * kappa, kappa])
    file = tmp_path / "log.txt"
    np.savetxt(file, rows, delimiter=",")
    stations = {"base": {"position": [1, 2, 3]}, "tip": {"position": [4, 5, 6]}}
    mapping = {"time": 0, "length_unit": "m", "stations": stations,
               "pressure": {"columns": [7, 8], "unit": "kPa", "chamber": ["left", "right"]}}  # fmt: skip
    content = tomllib.loads(draft_study([file], tmp_path / "s.toml", mapping=mapping, mass=0.1).text)
    assert content["actuator"]["chambers"] == [{"name": "right"}]
    assert content["recordings"]["log"]["drive"] == {"right": "right"}
    Study.model_validate(content)


def test_chambers_of_a_body_in_a_plane_are_drafted_where_they_bend_it(tmp_path):
    """The lower half bends under near, the upper under far, to the other side under back, which bends all of it."""
    t = np.arange(0.0, 2.0, 0.02)
    s = np.linspace(0.0, 0.2, 6)  # m
    files, levels = [], {"a": (4e4, 0, 0), "b": (0, 5e4, 0), "c": (0, 0, 6e4), "d": (3e4, 4e4, 0), "e": (2e4, 0, 5e4)}
    for name, level in levels.items():
        pressure = np.where((t > 0.5)[:, None], level, 0.0)
        fine = np.linspace(0.0, 0.2, 201)
        kappa = 4e-5 * (pressure[:, :1] * (fine < 0.1) + pressure[:, 1:2] * (fine >= 0.1) - 0.6 * pressure[:, 2:])
        turn = np.cumsum(kappa, axis=1) * (fine[1] - fine[0])
        path = np.stack([-np.sin(turn), 0 * turn, np.cos(turn)], axis=-1).cumsum(axis=1) * (fine[1] - fine[0])
        places = path[:, np.searchsorted(fine, s - 1e-9)] - path[:, :1]
        places = places + 3e-5 * np.random.default_rng(len(files)).standard_normal(places.shape)
        ds = make_recording(t, places, station=["base", "p1", "p2", "p3", "p4", "tip"], pressure=pressure,
                            chamber=["near", "far", "back"])  # fmt: skip
        files.append(write(ds, tmp_path / f"{name}.csv"))
    content = tomllib.loads(draft_study(files, tmp_path / "s.toml", mass=0.1).text)
    Study.model_validate(content)
    chambers = {c.pop("name"): c for c in content["actuator"]["chambers"]}
    assert chambers == {"near": {"joints": [1, 2, 3]}, "far": {"joints": [4, 5]}, "back": {"joint_gain": -1.0}}
    assert content["model_selection"]["held_out"] == ["d"]  # what each does alone is learnt
    assert content["recordings"]["d"]["drive"] == {"near": "near", "far": "far", "back": "back"}


def test_points_of_a_soft_body_are_no_rigid_cluster(tmp_path):
    t, kappa = swing()
    s = np.array([0.0, 0.05, 0.1, 0.15, 0.2])
    p = arc(kappa, s) + 1e-5 * np.random.default_rng(3).standard_normal((len(t), 5, 3))
    names = ["base", "link1", "link2", "link3", "tip"]
    trial = inspect_trial(write(make_recording(t, p, station=names, nominal_pressure=2e4), tmp_path / "b.csv"))
    assert trial.stations == {}  # every marker stays a station
    assert trial.aligned is not None
    assert trial.options["base"] == "base"


def test_a_plate_of_markers_at_the_base_is_one_station_of_however_many_markers(tmp_path):
    """Three markers on the base and five along the body: eight stations would be a dense shape."""
    t = np.arange(0.0, 2.0, 0.01)
    bend = np.where(t > 0.5, 4.0, 1e-6)[:, None] * np.linspace(0.02, 0.1, 5)  # curvature times arc length
    k = bend / np.linspace(0.02, 0.1, 5)
    body = np.stack([(np.cos(bend) - 1) / k, 0 * bend, -np.sin(bend) / k], axis=-1)
    plate = np.array([[0.03, 0.02, 0.01], [-0.03, 0.02, 0.01], [0.0, -0.03, 0.01]])
    places = np.concatenate([np.broadcast_to(plate, (t.size, 3, 3)), body], axis=1)
    places = places + 3e-5 * np.random.default_rng(1).standard_normal(places.shape)
    names = [*(f"base_{i}" for i in (1, 2, 3)), *(f"body_{i}" for i in range(1, 6))]
    recording = make_recording(t, places, station=names, pressure=np.where(t > 0.5, 5e4, 0.0))
    draft = draft_study([write(recording, tmp_path / "arm.nc")], tmp_path / "arm.toml", mass=0.05)
    content = tomllib.loads(draft.text)
    assert content["alignment"]["stations"]["base"] == ["base_1", "base_2", "base_3"]
    assert content["alignment"]["options"] == {"base": "base", "tangent": "chord"}
    assert content["actuator"]["length"] == pytest.approx(0.11, abs=0.002)  # from the plate, 10 mm above the body
    assert "reduction" not in content


def test_what_has_no_shape_is_refused(tmp_path):
    t = np.arange(10) / 10
    file = write(make_recording(pressure=t * 1e4, pressure_time=t), tmp_path / "p.nc")
    with pytest.raises(InputError, match="the shape too"):
        inspect_trial(file)
    with pytest.raises(InputError, match="different file names"):
        draft_study([], tmp_path / "s.toml")


def test_a_planar_recording_needs_no_alignment(tmp_path):
    t, kappa = swing()
    s = np.linspace(0, 0.17, 30)
    body = make_recording(t, arc(kappa, s)[..., :2], arc_length=s, frame="planar", nominal_pressure=2e4)
    content = tomllib.loads(draft_study([write(body, tmp_path / "b.nc")], tmp_path / "s.toml", mass=0.1).text)
    assert "alignment" not in content
    assert content["actuator"]["length"] == pytest.approx(0.17)
    assert "reduction" in content


def test_small_parts(tmp_path):
    assert clusters(["Tip - 1", "Tip - 2", "Tip - 3", "Base1", "Base2"]) == {
        "base": ["Base1", "Base2"], "tip": ["Tip - 1", "Tip - 2", "Tip - 3"],
    }
    assert clusters(["a", "b", "c"]) == {}
    assert relative(tmp_path / "a" / "f.c3d", tmp_path / "b") == "../a/f.c3d"
    value = {"a b": [1, 2.5, True], "c": {"d": 'quote " and \\'}}
    assert tomllib.loads(f"x = {toml(value)}")["x"] == value


def test_markers_that_stand_beside_the_base_are_left_out_of_the_fit(tmp_path):
    """A camera sees the stand as well as the body: the draft must name what moves, or its run is refused."""
    from pliant.study.prepare import aligned_recording, study_experiment
    from pliant.study.schema import load_study

    t, kappa = swing()
    rng = np.random.default_rng(2)
    for name, gain in {"weak": 0.5, "strong": 1.5, "between": 1.0}.items():
        body = arc(gain * kappa, np.array([0.0, 0.08, 0.15]))
        place = np.concatenate([body[:, :1], body[:, :1] + np.array([0.03, 0.0, 0.0]), body[:, 1:]], axis=1)
        place = place + 1e-5 * rng.standard_normal(place.shape)
        write(make_recording(t, place, station=["base", "stand", "half", "end"]), tmp_path / f"{name}.csv")
    files = [tmp_path / f"{name}.csv" for name in ("weak", "between", "strong")]
    draft = draft_study(files, tmp_path / "s.toml", mass=0.1, length=0.15, level=3e4)
    content = tomllib.loads(draft.text)
    assert content["recordings"]["weak"]["stations"] == ["half", "end"]
    assert content["model_selection"]["held_out"] == ["between"]  # levels are not known: the middle travel
    (tmp_path / "s.toml").write_text(draft.text)
    study = load_study(tmp_path / "s.toml")
    for name in study.recordings:
        assert study_experiment(study, name, aligned_recording(study, name).body).stations == ("half", "end")


def test_a_mapping_that_is_run_as_a_study_says_what_it_is(tmp_path):
    from pliant.study.schema import load_study

    path = tmp_path / "fiber.toml"
    path.write_text('delimiter = "space"\nrate_hz = 32.0\nlength_unit = "mm"\npoints = { count = 20 }\n')
    with pytest.raises(InputError, match=r"is a mapping, .* not a study: pass it with --mapping"):
        load_study(path)


@pytest.fixture
def pixels(tmp_path):
    """A pulse followed in a film by DeepLabCut, in pixels."""
    kappa = swing()[1]
    place = arc(kappa, np.array([0.0, 0.08, 0.15]))[..., :2] * [4e3, -4e3] + [900.0, 1000.0]
    place = place + 0.2 * np.random.default_rng(3).standard_normal(place.shape)
    names = ["base", "half", "end"]
    head = [["scorer", *["net"] * 9], ["bodyparts", *np.repeat(names, 3)], ["coords", *["x", "y", "likelihood"] * 3]]
    rows = [[k, *np.column_stack([p, [0.9] * 3]).ravel()] for k, p in enumerate(place)]
    file = tmp_path / "push_30kPa.csv"
    file.write_text("\n".join(",".join(map(str, row)) for row in [*head, *rows]) + "\n")
    return file


def test_points_in_pixels_ask_for_the_camera(pixels, tmp_path):
    draft = draft_study([pixels], tmp_path / "s.toml", mass=0.1)
    content = tomllib.loads(draft.text)
    assert set(open_entries(content)) == {"camera.rate_hz", "camera.pixels_per_mm", "actuator.length"}
    answered = draft.text
    for name, value in {"rate_hz": 100.0, "pixels_per_mm": 4.0, "length": 0.15}.items():
        answered = answered.replace(f'{name} = "?"', f"{name} = {value}")
    (tmp_path / "s.toml").write_text(answered)
    from pliant.study.prepare import aligned_recording
    from pliant.study.schema import load_study

    found = aligned_recording(load_study(tmp_path / "s.toml"), "push_30kPa").body
    assert float(np.linalg.norm(found["position"].values[0, -1])) == pytest.approx(0.15, rel=0.01)
    camera = {"rate_hz": 60.0, "pixels_per_mm": 4.0}
    told = draft_study([pixels], tmp_path / "s.toml", mass=0.1, mapping={"camera": camera})
    assert "camera" in tomllib.loads(told.text)["recordings"]["push_30kPa"]["mapping"]
    assert not told.questions


def test_a_mapping_names_the_format_of_a_file_that_does_not_show_it(pixels, tmp_path):
    file = pixels.rename(tmp_path / "push_30kPa.txt")
    refused = invoke(tmp_path / "s.toml", "--from", file)
    assert 'looks like a file of deeplabcut: set format = "deeplabcut"' in str(refused.exception)
    (tmp_path / "dlc.toml").write_text('format = "deeplabcut"\n')
    result = invoke(tmp_path / "s.toml", "--from", file, "--mapping", tmp_path / "dlc.toml", "--mass", 0.1)
    assert result.exit_code == 0, result.output
    content = tomllib.loads((tmp_path / "s.toml").read_text(encoding="utf-8"))
    assert set(open_entries(content)) == {"camera.rate_hz", "camera.pixels_per_mm", "actuator.length"}
    assert content["recordings"]["push_30kPa"]["mapping"] == {"format": "deeplabcut"}
