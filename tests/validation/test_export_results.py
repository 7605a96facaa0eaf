"""Recordings beside their model in files of other tools, read back by libraries that share no code with the writer."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import invoke

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.model import chain_model
from pliant.recording import read
from pliant.simulation import Trace
from pliant.validation.export_results import export_results
from pliant.validation.outcome import FitOutcome, RecordOutcome, Role, StudyOutcome
from pliant.validation.sides import Side, Sides, side_of, sides_of

RATE = 50
T = 0.3 + np.arange(120) / RATE
STATIONS = ("middle", "tip")


def seen(phase: float) -> np.ndarray:
    """Two points on arcs (T, 2, 2), m."""
    swing = 0.4 * np.sin(3.0 * T + phase)
    return np.stack([np.stack([-r * np.sin(swing), r * np.cos(swing)], axis=1) for r in (0.05, 0.1)], axis=1)


def record(name: str, role: Role, phase: float, gaps: slice) -> RecordOutcome:
    position = seen(phase)
    position[gaps, 1] = np.nan
    log = Trace(T - 0.01, 1e4 * (2.0 + np.sin(T + phase)))
    body = np.concatenate([np.zeros((T.size, 1, 2)), 1.01 * seen(phase)], axis=1)
    exp = Experiment(name, T, position, STATIONS, "trace", log)
    return RecordOutcome(name, role, exp, 1.01 * seen(phase), np.zeros((T.size, 1)), {}, None, body)


@pytest.fixture
def outcome() -> StudyOutcome:
    """A study of one fit whose held-out recording comes first; gaps within one, at the ends of the other."""
    model = chain_model(length=0.1, mass=0.05, links=1, stiffness=0.5, damping=1e-3, torque=[1e-6])
    records = (record("later", "held_out", 0.7, slice(0, 4)), record("first", "train", 0.0, slice(40, 47)))
    result = type("Result", (), {"model": model})()
    fit = FitOutcome("linear", "Linear", result, records, 0.0)  # type: ignore[arg-type]
    return StudyOutcome("arm", "A soft arm", "", model, (fit,), (), None, (), {}, {}, {})


@pytest.fixture
def frames(outcome, tmp_path):
    pa = pytest.importorskip("pyarrow.parquet")
    export_results(outcome, "lerobot", tmp_path / "set")
    return pa.read_table(tmp_path / "set/data/chunk-000/file-000.parquet"), tmp_path / "set"


def matrix(table, name):
    return np.array(table[name].to_pylist(), dtype=float)


def test_a_lerobot_data_set_holds_the_measured_the_modelled_and_the_input(frames, outcome):
    table, _ = frames
    training = np.array(table["episode_index"]) == 0
    assert training.sum() == T.size
    there = np.r_[0:40, 47 : T.size]
    moved = seen(0.0).reshape(T.size, 4)
    assert matrix(table, "observation.state")[training][there] == pytest.approx(moved[there], rel=1e-6)
    assert matrix(table, "model.state")[training] == pytest.approx(1.01 * moved, rel=1e-6)
    log = np.interp(T, T - 0.01, 1e4 * (2.0 + np.sin(T)))
    assert matrix(table, "action")[training] == pytest.approx(log, rel=1e-6)


def test_gaps_of_a_lerobot_data_set_are_straight_lines_and_reported(outcome, tmp_path):
    pa = pytest.importorskip("pyarrow.parquet")
    done = export_results(outcome, "lerobot", tmp_path / "set")
    assert "first: 7 frame(s) in which a station was not measured were interpolated in time" in done.notes
    assert "later: 4 frame(s) at its ends were cut, since a station was not measured" in done.notes
    state = matrix(pa.read_table(tmp_path / "set/data/chunk-000/file-000.parquet"), "observation.state")
    x = state[40:47, 2]
    ends = seen(0.0)[[39, 47], 1, 0]
    assert x == pytest.approx(ends[0] + (ends[1] - ends[0]) * np.arange(1, 8) / 8, abs=1e-8)
    assert state[T.size, 2] == pytest.approx(seen(0.7)[4, 1, 0], rel=1e-6)  # the first frame that shows the tip


def test_metadata_of_a_lerobot_data_set_follow_version_3(frames):
    pa = pytest.importorskip("pyarrow.parquet")
    table, folder = frames
    info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"], info["fps"]) == (2, 236, 2, RATE)
    assert info["splits"] == {"train": "0:1", "test": "1:2"}
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    assert info["video_path"] is None
    assert list(info["features"]) == table.column_names
    for name, feature in info["features"].items():
        column = table.schema.field(name).type
        (width,) = feature["shape"]
        inner = column if width == 1 else column.value_type  # one number is a plain column, more a list of fixed length
        assert width == 1 or column.list_size == width
        assert str(inner).replace("float", "float32") == feature["dtype"]
        assert feature["names"] is None or len(feature["names"]) == width
        assert "/" not in name
    episodes = pa.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(e["episode_index"], e["tasks"]) for e in episodes] == [(0, ["first"]), (1, ["later"])]
    assert [e["length"] for e in episodes] == [120, 116]
    for e in episodes:
        rows = table.slice(e["dataset_from_index"], e["dataset_to_index"] - e["dataset_from_index"])
        assert set(rows["episode_index"].to_pylist()) == {e["episode_index"]}
        assert rows["frame_index"].to_pylist() == list(range(e["length"]))
        assert matrix(rows, "timestamp") == pytest.approx(np.arange(e["length"]) / RATE, abs=1e-6)
        place = {"chunk_index": e["data/chunk_index"], "file_index": e["data/file_index"]}
        assert (folder / info["data_path"].format(**place)).is_file()
        assert e["stats/action/mean"] == pytest.approx([matrix(rows, "action").mean()])
    assert table["index"].to_pylist() == list(range(236))
    tasks = pa.read_table(folder / "meta/tasks.parquet").to_pandas()
    assert tasks["task_index"].to_dict() == {"first": 0, "later": 1}
    stats = json.loads((folder / "meta/stats.json").read_text(encoding="utf-8"))
    state = matrix(table, "observation.state")
    for key, value in (("min", state.min(0)), ("max", state.max(0)), ("mean", state.mean(0)), ("std", state.std(0)),
                       ("q50", np.median(state, axis=0)), ("count", [236])):
        assert stats["observation.state"][key] == pytest.approx(value, rel=1e-5, abs=1e-9)


def test_a_lerobot_data_set_takes_another_rate_and_no_folder_that_exists(outcome, tmp_path):
    pa = pytest.importorskip("pyarrow.parquet")
    export_results(outcome, "lerobot", tmp_path / "set", fps=25, records=["first"])
    table = pa.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    assert matrix(table, "model.state") == pytest.approx(1.01 * seen(0.0).reshape(T.size, 4)[::2], rel=1e-6)
    with pytest.raises(InputError, match="exists already"):
        export_results(outcome, "lerobot", tmp_path / "set")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["set"]


def test_frames_of_large_data_sets_go_into_several_files(outcome, tmp_path, monkeypatch):
    pa = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr("pliant.validation.lerobot.LARGEST_FILE_MB", 0.01)
    export_results(outcome, "lerobot", tmp_path / "set")
    episodes = pa.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [e["data/file_index"] for e in episodes] == [0, 1]
    second = pa.read_table(tmp_path / "set/data/chunk-000/file-001.parquet")
    assert second["index"].to_pylist() == list(range(120, 236))


def points(cloud) -> np.ndarray:
    """The points of a decoded PointCloud2."""
    names = [f.name for f in cloud.fields]
    assert (names, {f.datatype for f in cloud.fields}, cloud.point_step) == (["x", "y", "z"], {7}, 12)
    return np.frombuffer(bytes(cloud.data), "<f4").reshape(cloud.width, 3)


def test_an_mcap_file_holds_recording_and_model_side_by_side(outcome, tmp_path):
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    pytest.importorskip("rosbags")
    done = export_results(outcome, "mcap", tmp_path / "arm.mcap", records=["first"])
    assert done.notes == ("first begins at 1.000 s",)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["arm.mcap"]
    topics: dict[str, list] = {}
    with (tmp_path / "arm.mcap").open("rb") as file:
        for _, channel, message, content in reader.make_reader(
            file, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, content))
    assert set(topics) == {"/tf_static", "/about", "/record", "/measured/points", "/model/points", "/model/joints",
                           "/model/body", "/input/chamber_pa"}
    stamps = np.array([t for t, _ in topics["/measured/points"]])
    assert stamps == pytest.approx(1e9 * (1.0 + T - T[0]), abs=1.0)
    measured = np.array([points(c) for _, c in topics["/measured/points"]])
    expected = np.concatenate([outcome.fits[0].records[1].experiment.position, np.zeros((T.size, 2, 1))], axis=2)
    np.testing.assert_array_equal(measured, expected.astype("f4"))  # NaN where NaN is
    modelled = np.array([points(c) for _, c in topics["/model/points"]])
    np.testing.assert_array_equal(modelled[..., :2], (1.01 * seen(0.0)).astype("f4"))
    line = [[p.x, p.y] for p in topics["/model/body"][17][1].points]
    assert line == pytest.approx(np.vstack([[0.0, 0.0], 1.01 * seen(0.0)[17]]), rel=1e-12)
    pressure = [m.data for _, m in topics["/input/chamber_pa"]]
    assert pressure == pytest.approx(np.interp(T, T - 0.01, 1e4 * (2.0 + np.sin(T))), rel=1e-12)
    about = json.loads(topics["/about"][0][1].data)
    assert (about["stations"], about["inputs"]) == (list(STATIONS), {"chamber": "Pa"})
    assert topics["/record"][0][1].data == "first (train)"


def test_pliant_reads_the_clouds_of_its_own_mcap_file(outcome, tmp_path):
    pytest.importorskip("rosbags")
    export_results(outcome, "mcap", tmp_path / "arm.mcap", records=["first"])
    topics = {"topics": {"arm": "/measured/points"}, "pressure": {"c": "/input/chamber_pa"}, "pressure_unit": "Pa"}
    again = read(tmp_path / "arm.mcap", mapping=topics)
    assert again["station"].values.tolist() == ["arm_000", "arm_001"]
    measured = outcome.fits[0].records[1].experiment.position
    np.testing.assert_array_equal(again["position"].values[..., :2], measured.astype("f4").astype(float))
    assert "quaternion" not in again


def test_recordings_follow_one_another_in_an_mcap_file(outcome, tmp_path):
    pytest.importorskip("rosbags")
    done = export_results(outcome, "mcap", tmp_path / "arm.mcap")
    assert done.notes == ("first begins at 1.000 s", f"later begins at {2.0 + T[-1] - T[0]:.3f} s")
    assert done.to_dict()["records"] == ["first", "later"]


def test_inputs_of_several_chambers_are_those_that_drove_each(outcome):
    first = outcome.fits[0].records[1]
    log = Trace(T, 1e4 * T)
    exp = replace(first.experiment, drives={"right": log}, pressure=log)
    side = side_of(replace(first, experiment=exp, pressure=np.zeros((T.size, 2))), ("left", "right"))
    assert side.inputs == pytest.approx(np.column_stack([np.zeros(T.size), 1e4 * T]))


@pytest.mark.parametrize(("change", "words"), [
    ({"target": "bag"}, "mcap or lerobot"),
    ({"fit": "cubic"}, "these results have no fit 'cubic': choose from linear"),
    ({"records": ["x"]}, "no recording 'x': choose from later, first"),
    ({"path": "nowhere/arm.mcap"}, "does not exist; create it first"),
    ({"path": "arm.bag"}, "must end in .mcap"),
    ({"fps": 30}, "fps is an option of lerobot"),
])  # fmt: skip
def test_what_cannot_be_exported_is_refused(outcome, tmp_path, change, words):
    pytest.importorskip("rosbags")
    asked = {"target": "mcap", "path": "arm.mcap", **change}
    with pytest.raises(InputError, match=words):
        export_results(outcome, asked.pop("target"), tmp_path / asked.pop("path"), **asked)
    assert not list(tmp_path.iterdir())


def test_recordings_of_other_stations_are_refused(outcome):
    first, second = outcome.fits[0].records
    other = replace(second, experiment=replace(second.experiment, stations=("middle", "end")))
    fits = (replace(outcome.fits[0], records=(first, other)),)
    with pytest.raises(InputError, match="export recordings of the same stations"):
        sides_of(replace(outcome, fits=fits))


def test_angles_go_to_lerobot_and_not_to_a_viewer_of_bodies(tmp_path):
    pa = pytest.importorskip("pyarrow.parquet")
    from pliant.validation.lerobot import write_lerobot
    from pliant.validation.mcap_file import write_mcap

    angle = 0.3 * np.sin(T)[:, None, None]
    side = Side("swing", "train", T, angle, angle, np.zeros((T.size, 2)), None)
    sides = Sides("hinge", "A hinge", "linear", ("tip",), ("angle",), ("a", "b"), ("N", "N"), (side,))
    with pytest.raises(InputError, match="angles and no positions"):
        write_mcap(sides, tmp_path / "a.mcap")
    write_lerobot(sides, tmp_path / "set")
    info = json.loads((tmp_path / "set/meta/info.json").read_text(encoding="utf-8"))
    assert info["features"]["observation.state"] == {"dtype": "float32", "shape": [1], "names": ["tip.angle [rad]"]}
    assert info["features"]["action"]["names"] == ["a [N]", "b [N]"]
    table = pa.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    assert matrix(table, "observation.state") == pytest.approx(angle[:, 0, 0], rel=1e-6)


def test_the_command_exports_a_run_with_its_options(outcome, tmp_path, monkeypatch):
    pytest.importorskip("pyarrow")
    monkeypatch.setattr("pliant.validation.store.load_outcome", lambda _: outcome)
    export = ("export", tmp_path, "--to", "lerobot", "-o", tmp_path / "set")
    done = invoke(*export, "--set", "records=first", "--set", "fps=25", "--json")
    assert (done.exit_code, json.loads(done.stdout)["records"]) == (0, ["first"])
    assert json.loads((tmp_path / "set/meta/info.json").read_text(encoding="utf-8"))["total_frames"] == 60
    for wrong, words in ((("--set", "speed=2"), "its options are fit, records, fps"),
                         (("--set", "fps=fast"), "fps must be a whole number"),
                         (("--approximate",), "--approximate and --fit are for models")):  # fmt: skip
        assert words in str(invoke(*export, *wrong).exception)
