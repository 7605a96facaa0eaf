"""The model file: the same numbers out as in, and one sentence for every file that is not one."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.model import Chamber, Extension, Memory, Model, Station, Valve, load_model, save_model
from pliant.model.model import PER_LINK


def full(rng):
    return Model(
        link_length=rng.uniform(0.01, 0.1, 4), link_mass=rng.uniform(0.01, 0.1, 4), stiffness=rng.uniform(0.1, 3, 4),
        damping=rng.uniform(0, 1e-2, 4), torque=rng.normal(size=3), rest_angle=rng.normal(size=4),
        joint_gain=rng.normal(size=4), mass_at="tip", tip_mass=np.float64(1 / 3), base_length=0.1,
        base_angle=np.pi / 7, gravity=rng.normal(size=2),
        valve=Valve(rise_time=0.1 / 3, fall_time=0.2, dead_time=1e-3),
        stations=[Station("Spitze, µ", 3, 0.1 / 7, -0.01), ("base", np.int64(-1), 0)], name='a "model"',
        source={"stiffness": "fit"},
    )


def test_a_model_comes_back_equal(tmp_path, rng):
    for k, model in enumerate((full(rng), chen2018.model(), chen2018.model(valve=Valve(natural_frequency=7.0)))):
        path = save_model(model, tmp_path / f"{k}.json")
        assert load_model(path) == model
        assert load_model(str(path)) == model


def test_the_file_says_what_it_is(tmp_path):
    content = json.loads(save_model(chen2018.model(), tmp_path / "m.json").read_text(encoding="utf-8"))
    assert content["schema_name"] == "pliant-model"
    assert content["schema_version"] == 1
    assert content["units"]["stiffness"] == "N m/rad"
    assert content["stiffness"] == [1.6067] * 5


def broken(tmp_path, **changes):
    content = json.loads(save_model(chen2018.model(), tmp_path / "m.json").read_text(encoding="utf-8"))
    for name, value in changes.items():
        content.pop(name, None)
        if value is not None:
            content[name] = value
    path = tmp_path / "broken.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stifness": [1.0]}, "'stifness' is not a known entry"),
        ({"stiffness": None}, "'stiffness' is missing"),
        ({"stiffness": [-1.0] * 5}, "stiffness must be positive"),
        ({"stiffness": [1.0, 2.0]}, "stiffness must be one number or 5"),
        ({"stiffness": 1.6067}, "'stiffness' should be a valid array"),
        ({"stiffness": ["much"] * 5}, "'stiffness.0' should be a valid number"),
        ({"stiffness": [float("nan")] * 5}, "stiffness must be finite"),
        ({"link_length": [0.0] * 5}, "link_length must be positive"),
        ({"link_length": []}, "link_length must be one number or 5"),
        ({"schema_version": 2}, "'schema_version' should be 1"),
        ({"schema_name": "other"}, "'schema_name' should be 'pliant-model'"),
        ({"units": {"link_length": "mm"}}, "'units' must be those of the schema"),
        ({"units": {"stifness": "N m/rad"}}, "'units' must be those of the schema"),
        ({"mass_at": "middle"}, "'mass_at' should be 'rod' or 'tip'"),
        ({"bend_sign": -1}, "change the sign of the x component of gravity"),
        ({"valve": {"rise_time": -1}}, "rise_time must be finite and not negative"),
        ({"valve": {"lag": 1}}, "'valve.lag' is not a known entry"),
        ({"stations": [{"name": "a", "link": 9, "along": 0.0}]}, "must sit on a link"),
        ({"stations": [{"name": "a", "link": 0}]}, "'stations.0.along' is missing"),
        ({"stations": [{"name": "a", "link": 0.5, "along": 0.0}]}, "'stations.0.link' should be a valid integer"),
    ],
)
def test_a_broken_file_gets_one_sentence(tmp_path, changes, words):
    path = broken(tmp_path, **changes)
    with pytest.raises(InputError, match=words) as caught:
        load_model(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"link_mass": [1e308] * 5}, {"link_mass": [1e30] * 5}, {"link_length": [1e-320] * 5},
        {"stiffness": [1e300] * 5},
        {"valve": {"natural_frequency": 5e-324}}, {"valve": {"rise_time": 1e-320}}, {"memory": {"creep_share": [1e308],
        "creep_time": [1.0]}}, {"memory": {"creep_share": [0.1], "creep_time": [5e-324]}}, {"gravity": [0.0, 1e200]},
        {"stations": [{"name": "a", "link": 0, "along": 1e300}]}, {"torque": [1e200]}, {"torque": [1e-7] * 50},
        {name: [1.0] * 200 for name in PER_LINK},
        {"inflation_limit": 5e-324}, {"rest_angle": [1e300] * 5}, {"tip_mass": 1e300},
    ],
)
def test_what_no_body_can_be_is_refused(tmp_path, changes):
    """Each of these overflowed, divided by zero or never ended in the arithmetic behind."""
    with pytest.raises(InputError, match=r"must have a size of|must have at most") as caught:
        load_model(broken(tmp_path, **changes))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_what_was_written(tmp_path):
    with pytest.raises(InputError, match="its checksum differs"):
        load_model(broken(tmp_path, stiffness=[1.6077] * 5))
    changed = json.loads((tmp_path / "broken.json").read_text(encoding="utf-8"))
    del changed["checksum"]
    (tmp_path / "broken.json").write_text(json.dumps(changed), encoding="utf-8")
    assert load_model(tmp_path / "broken.json").stiffness[0] == 1.6077


@pytest.mark.parametrize("cut", [0, 1, 57, -3])
def test_a_truncated_file(tmp_path, cut):
    path = save_model(chen2018.model(), tmp_path / "m.json")
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError, match="Invalid JSON") as caught:
        load_model(path)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(InputError, match=r"cannot read the model file .*none\.json: No such file"):
        load_model(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot read"):
        load_model(tmp_path)
    (tmp_path / "list.json").write_text("[1, 2]", encoding="utf-8")
    with pytest.raises(InputError, match="the whole"):
        load_model(tmp_path / "list.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00CDF")
    with pytest.raises(InputError, match="Invalid JSON"):
        load_model(tmp_path / "bytes.json")


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for path in (tmp_path / "none" / "m.json", tmp_path / "file" / "m.json", tmp_path):
        with pytest.raises(InputError, match="cannot write") as caught:
            save_model(chen2018.model(), path)
        assert "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert not list(tmp_path.parent.glob(".*.tmp"))


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="this user may write everywhere")
def test_a_folder_that_may_not_be_written(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"):
        save_model(chen2018.model(), tmp_path / "m.json")
    tmp_path.chmod(0o700)


def test_writing_leaves_the_old_file_or_the_new(tmp_path, monkeypatch):
    path = save_model(chen2018.model(), tmp_path / "m.json")

    def full_disk(self, *_, **__):
        self.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(type(path), "write_text", full_disk)
    with pytest.raises(InputError, match="No space left on device"):
        save_model(chen2018.model(stiffness=2.0), path)
    monkeypatch.undo()
    assert load_model(path) == chen2018.model()
    assert [p.name for p in tmp_path.iterdir()] == ["m.json"]
    save_model(chen2018.model(stiffness=2.0), path)
    assert load_model(path) == chen2018.model(stiffness=2.0)


def test_what_a_file_leaves_out_is_as_the_classes_have_it(tmp_path):
    """Each part of a model with as few numbers as make one, once from Python and once from a file written by hand."""
    body = {"link_length": [0.1, 0.1], "link_mass": [0.02, 0.02], "stiffness": [0.5, 0.5], "damping": [0.01, 0.01]}
    parts = (
        ({"torque": [1e-6]}, {"torque": [1e-6]}),
        ({"torque": [1e-6], "valve": {"rise_time": 0.1}}, {"torque": [1e-6], "valve": Valve(rise_time=0.1)}),
        ({"torque": [1e-6], "valve": {"settle_share": 0.1}}, {"torque": [1e-6], "valve": Valve(settle_share=0.1)}),
        ({"torque": [1e-6], "valve": {"natural_frequency": 9.0}},
         {"torque": [1e-6], "valve": Valve(natural_frequency=9.0)}),
        ({"torque": [1e-6], "swell_share": 0.2}, {"torque": [1e-6], "swell_share": 0.2}),
        ({"torque": [1e-6], "inflation_limit": 3e5}, {"torque": [1e-6], "inflation_limit": 3e5}),
        ({"torque": [1e-6], "memory": {"creep_share": [0.1], "creep_time": [0.5]}},
         {"torque": [1e-6], "memory": Memory((0.1,), (0.5,))}),
        ({"torque": [1e-6], "memory": {"boucwen_share": 0.1}},
         {"torque": [1e-6], "memory": Memory(boucwen_share=0.1)}),
        ({"torque": [1e-6], "stations": [{"name": "tip", "link": 1, "along": 0.1}]},
         {"torque": [1e-6], "stations": [Station("tip", 1, 0.1)]}),
        ({"torque": [1e-6], "extensions": [{"name": "all", "stiffness": 200.0}]},
         {"torque": [1e-6], "extensions": (Extension(200.0, name="all"),)}),
        ({"chambers": [{"name": name, "torque": [1e-6], "joint_gain": [1.0, 1.0]} for name in "ab"]},
         {"chambers": tuple(Chamber([1e-6], joint_gain=[1.0, 1.0], name=name) for name in "ab")}),
    )  # fmt: skip
    for written, given in parts:
        path = tmp_path / "m.json"
        path.write_text(json.dumps({"rest_angle": [0.0, 0.0], **body, **written}))
        assert load_model(path) == Model(**body, **given), written


@pytest.mark.parametrize("rows", [((0.1, 0.2), (0.5, 0.0)), ((0.1, 0.2), (0.0, 0.5))])
def test_every_time_of_a_memory_is_positive(rows):
    with pytest.raises(InputError, match="memory creep_time must be positive"):
        Memory(*rows)
    with pytest.raises(InputError, match="memory slip_angle must be positive"):
        Memory(slip_share=rows[0], slip_angle=rows[1])


def test_no_gravity_is_one_zero_and_another_lone_number_is_refused():
    body = {"link_length": 0.1, "link_mass": 0.02, "stiffness": 0.5, "damping": 0.01, "torque": [1e-6]}
    assert Model(**body, gravity=0.0).gravity.tolist() == [0.0, 0.0]
    assert Model(**body, gravity=[0.0, -9.81]).gravity.tolist() == [0.0, -9.81]
    with pytest.raises(InputError, match="gravity must be"):
        Model(**body, gravity=9.81)
