"""Public recordings, as their laboratories wrote them: the kind of experiment that a draft recognises in each."""

from __future__ import annotations

import pytest

from pliant.study.inspected import inspect_all

RELEASE_MAPPING = {
    "skip_lines": 2, "delimiter": "\t", "time": 0, "length_unit": "m",
    "stations": {"mid": {"position": [4, 5, 6]}, "tip": {"position": [10, 11, 12]}},
}  # fmt: skip
CASES = {  # files -> kind, whether in space, recordings held out
    "spatial_tentacle/*.csv": ("PoseOfFile", True, 1),
    "spatial_tendon_robot/*.csv": ("PoseOfRow", True, []),  # all rows of v4_tendon_pull are in v4_train
    "spatial_rod_reference/release_TPU_*.txt": ("FreeDecay", True, 1),
    "fiber_shape/label.txt": ("WithoutCause", True, []),
    "spatial_pneumatic_arm/*.csv": ("MeasuredInputs", True, 1),
    "spatial_tendon_trunk/observations_controlled_[13].csv": ("MeasuredInputs", True, 1),
    "planar_two_segment_arm/*steps*.txt": ("MeasuredInputs", False, 1),
    "pneumatic_arm_pulses/*.c3d": ("PressurePulse", False, 1),
    "silicone_cantilever/*.c3d": ("FreeDecay", False, 1),
    "trunk_free_decay/*.csv": ("FreeDecay", True, 1),
}


@pytest.mark.slow
@pytest.mark.parametrize("files", list(CASES))
def test_kinds(shared_data, files):
    kind, space, held_out = CASES[files]
    mapping = RELEASE_MAPPING if "release" in files else None
    inspected = inspect_all(sorted(shared_data.glob(files)), mapping, None)
    assert {type(k).__name__ for k in inspected.kinds.values()} == {kind}
    assert inspected.space is space
    assert inspected.held_out() == held_out if isinstance(held_out, list) else len(inspected.held_out()) == held_out


@pytest.mark.slow
def test_the_markers_of_the_tentacle_get_one_order(shared_data):
    inspected = inspect_all(sorted((shared_data / "spatial_tentacle").glob("*.csv")), None, None)
    stations = {t.path.stem: t.guess.mapping["stations"] for t in inspected.trials}
    assert stations["m1_u01"]["base"] == {"position": [14, 15, 16]}
    assert stations["m2_u025"]["base"] == {"position": [8, 9, 10]}
    assert stations["m2_u025"]["tip"] == {"position": [14, 15, 16]}
    assert list(stations["m1_u02"]) == ["base", "p1", "p2", "p3", "tip"]


@pytest.mark.slow
def test_sister_pouches_are_one_chamber(shared_data):
    inspected = inspect_all(sorted((shared_data / "spatial_pneumatic_arm").glob("*.csv")), None, None)
    assert list(inspected.channels) == ["Segment_1", "Segment_2", "Segment_4", "Segment_3"]
