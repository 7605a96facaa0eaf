"""A body whose segments differ in length: links, joints, tendons and masses follow the stated segments."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import invoke

from pliant.errors import InputError
from pliant.study.body import study_model
from pliant.study.body_tables import ActuatorEntry
from pliant.study.shorthand import expanded

LENGTHS = [0.06, 0.0625, 0.064]


def model_of(**entries):
    return study_model(ActuatorEntry(mass=0.03, **entries), None)


def test_equal_segments_are_the_body_of_one_length():
    for placement in ("base", "midsegment"):
        one = model_of(length=0.18, links=6, joint_placement=placement)
        three = model_of(segments=[0.06] * 3, segment_links=[2] * 3, joint_placement=placement)
        assert three.link_length == pytest.approx(one.link_length, abs=1e-15)
        assert three.link_mass == pytest.approx(one.link_mass, abs=1e-15)
        assert three.base_length == pytest.approx(one.base_length, abs=1e-15)


def test_joints_lie_in_the_middle_of_the_parts_of_their_segment():
    model = model_of(segments=LENGTHS, segment_links=[1, 2, 1], joint_placement="midsegment", base_length=0.01)
    joints = model.base_length + np.append(0.0, np.cumsum(model.link_length))
    assert joints == pytest.approx([0.04, 0.085625, 0.116875, 0.1645, 0.1965])
    assert model.length == pytest.approx(0.1965)  # with the stiff part of 10 mm
    assert model.link_mass.sum() == pytest.approx(0.03 * (1.0 - 0.03 / 0.1865))  # the part before the first joint rests


def test_a_tendon_that_ends_with_a_segment_passes_its_joints_alone():
    cords = [{"name": f"to_{k}", "driven_by": "tension", "azimuth_deg": 0.0, "lever": 4.5e-3,
              "stop": sum(LENGTHS[: k + 1])} for k in range(3)]  # fmt: skip
    model = model_of(segments=LENGTHS, joint_placement="midsegment", space=True, tendons=cords)
    passed = [np.count_nonzero(np.hypot(c.joint_gain, c.cross_gain)) for c in model.chambers]
    assert passed == [2, 4, 6]


@pytest.mark.parametrize(("entries", "message"), [
    ({"segments": LENGTHS, "length": 0.2}, r"segments add up to 0.1865 m, but length is 0.2 m"),
    ({"segments": [0.06, -0.01]}, "segments needs positive lengths"),
    ({"segments": LENGTHS, "segment_links": [2, 2]}, "one number of links for each of the 3 segments"),
    ({"segments": LENGTHS, "links": 5}, "links = 5 cannot be divided among the 3 segments: remove links"),
    ({"length": 0.1, "segment_links": [2, 2]}, "segment_links needs segments"),
])  # fmt: skip
def test_segments_that_contradict_the_rest_are_refused(entries, message):
    with pytest.raises(ValueError, match=message):
        model_of(**entries)


def test_entries_that_all_tendons_share_are_stated_once():
    cords = [{"name": "a"}, {"name": "b", "lever": 5e-3}]
    whole = expanded({"actuator": {"tendon_defaults": {"lever": 8e-3, "driven_by": "tension"}, "tendons": cords}})
    assert whole["actuator"]["tendons"] == [{"name": "a", "lever": 8e-3, "driven_by": "tension"},
                                            {"name": "b", "lever": 5e-3, "driven_by": "tension"}]  # fmt: skip
    with pytest.raises(InputError, match=r"tendon_defaults.*add the tendons"):
        expanded({"actuator": {"tendon_defaults": {"lever": 8e-3}}})


def test_a_run_says_which_entry_of_the_segments_is_wrong(tmp_path):
    study = tmp_path / "arm.toml"
    study.write_text('name = "arm"\n[actuator]\nmass = 0.03\nlength = 0.2\nsegments = [0.06, 0.0625, 0.064]\n'
                     '[recordings.one]\nfile = "one.csv"\n[model_selection]\ntrain = ["one"]\n')
    done = invoke("run", study, "-o", tmp_path / "out")
    assert done.exit_code
    assert "segments add up to 0.1865 m" in str(done.exception)
