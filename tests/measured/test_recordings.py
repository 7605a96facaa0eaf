"""Recordings that nobody here made: read, checked, aligned. What their README tells is found from the data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.preprocessing.align import align, alignment_of
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.detectors import repeated_frames
from pliant.preprocessing.quality import quality
from pliant.preprocessing.rest import rest_window
from pliant.preprocessing.sync import sync
from pliant.recording import read, write
from pliant.study import load_study
from pliant.study.run import prepare_all

EXAMPLES = Path(__file__).parents[2] / "examples"
CLUSTERS = {"base": ["Base*"], "tip": ["Tip*"]}
FIBRE = {"delimiter": "space", "rate_hz": 32.0, "length_unit": "mm", "points": {"count": 20}}
ARM = {
    "time": 0, "length_unit": "m",
    "pressure": {"columns": [4, 5, 6, 10, 11, 12], "unit": "psi",
                 "chamber": ["1.1", "1.2", "1.3", "2.1", "2.2", "2.3"]},
    "stations": {name: {"position": [at, at + 1, at + 2], "quaternion": [at + 3, at + 4, at + 5, at + 6]}
                 for name, at in (("base", 17), ("mid", 24), ("tip", 31))},
}  # fmt: skip


def trunk(trial):
    return {"header": True, "rate_hz": 100.0, "length_unit": "m", "select": {"column": "ID", "value": trial},
            "stations": {f"disk{k}": {"position": [f"x{k}", f"y{k}", f"z{k}"]} for k in (1, 2, 3)}}  # fmt: skip


@pytest.mark.parametrize(("level", "static_mm"), [(100, 3.1), (200, 7.8), (300, 15.3), (400, 34.0)])
def test_a_pulsed_arm_bends_in_its_plane_as_far_as_told(shared_data, level, static_mm):
    raw = read(shared_data / "pneumatic_arm_pulses" / f"{level}mbar_V3.c3d")
    assert raw.sizes == {"time": 600, "station": 7, "axis": 3}
    assert not quality(raw).missing
    ds = align(assemble(raw, CLUSTERS), tangent="+x")
    report = alignment_of(ds)
    assert report.bending == 1
    assert report.out_of_plane_share < 0.02
    assert abs(report.normal[2]) > 0.99  # it bends mainly in the tracker's y
    assert report.rest_s[1] < 1.6
    sideways = -(ds["position"].values[:, 1, 0] - ds["position"].values[:20, 1, 0].mean()) * 1e3
    loaded = np.flatnonzero(sideways > 0.5 * sideways.max())
    plateau = np.median(sideways[loaded[-1] - 40 : loaded[-1] - 10])
    assert plateau == pytest.approx(static_mm, rel=0.04)
    assert ds["angle"].values[loaded[-20], 1] > 0


@pytest.mark.parametrize(("name", "travel_mm"), [("gravity", 6.7), ("load52", 17.4)])
def test_a_released_beam_falls_along_gravity(shared_data, name, travel_mm):
    raw = read(shared_data / "silicone_cantilever" / f"beam_{name}_V2_a.c3d")
    assert max(quality(raw).travel_m.values()) * 1e3 == pytest.approx(travel_mm, rel=0.02)
    ds = align(assemble(raw, CLUSTERS), tangent="+z")
    rotation = np.array(alignment_of(ds).rotation)
    assert rotation[0] @ [-1, 0, 0] < -0.99  # gravity pulls toward -x of the planar frame
    assert ds["position"].values[-1, 1, 0] < ds["position"].values[0, 1, 0] - 0.005


def test_a_fibre_of_twenty_points_is_read_by_a_mapping(shared_data, tmp_path):
    ds = read(shared_data / "fiber_shape" / "label.txt", mapping=FIBRE)
    assert ds.sizes == {"time": 5812, "station": 20, "axis": 3}
    spacing = np.linalg.norm(np.diff(ds["position"].values, axis=1), axis=-1).mean(0)
    assert 1e3 * spacing.sum() == pytest.approx(302.5, abs=2.0)
    assert 1e3 * spacing.min() == pytest.approx(13.5, abs=0.2)
    assert 1e3 * spacing.max() == pytest.approx(18.9, abs=0.2)
    q = quality(ds)
    assert q.out_of_plane_share > 0.3  # later rows are three-dimensional
    assert len(q.frame_jumps_s) == 5
    assert q.stretched
    xr.testing.assert_equal(read(write(ds, tmp_path / "fibre.csv")), ds)


def test_a_logged_arm_shows_its_traps(shared_data):
    folder = shared_data / "planar_two_segment_arm"
    ds = read(folder / "apr4_steps_chamber1_1.txt", mapping=ARM)
    q = quality(ds)
    assert q.repeated_frames == 1038
    assert q.standing == ("base",)
    assert q.irregular_steps > 1000
    assert q.gaps
    assert q.sign_flips
    assert q.orientation_jumps["tip"] > 100
    assert q.pressure_kpa["1.1"][1] == pytest.approx(111.4, abs=0.1)
    with pytest.raises(InputError, match=r"orientation jumps .* tip"):
        align(ds, base="base")
    fresh = ds.isel(time=~repeated_frames(ds["position"].values, ds["quaternion"].values))
    planar = align(fresh, base="base", tangent="-z", undo_jumps=True, origin_offset=0.05)
    report = alignment_of(planar)
    assert report.out_of_plane_share < 0.02
    assert abs(report.normal[1]) > 0.99  # motion stays in x-z
    assert report.base_travel_m < 3e-4
    angle = np.degrees(planar["angle"].values)
    assert np.abs(np.diff(angle, axis=0)).max() < 15
    assert angle[:, 2].max() == pytest.approx(70, abs=3)


@pytest.mark.slow
def test_the_arm_without_pressure_does_not_move(shared_data):
    ds = read(shared_data / "planar_two_segment_arm" / "jan10-1_no_pressure_1.txt", mapping=ARM)
    assert "no station moves beyond its noise" in quality(ds).findings
    with pytest.raises(InputError, match="no offset between the clocks"):
        sync(ds)


@pytest.mark.slow
def test_the_lag_of_an_over_damped_arm_is_not_taken_for_an_offset(shared_data):
    ds = read(shared_data / "planar_two_segment_arm" / "jan10-4_steps_chamber1_2.txt", mapping=ARM)
    found = sync(ds)
    assert abs(found.delay_s) < 0.1  # one logger wrote both: what lags is the arm
    assert found.explained > 0.9


def test_trials_of_one_table_are_selected_and_judged(shared_data):
    path = shared_data / "trunk_free_decay" / "observations_manual_decay_200g.csv"
    frames = 0
    for trial in range(13):
        ds = read(path, mapping=trunk(trial))
        frames += ds.sizes["time"]
        assert max(quality(ds).travel_m.values()) > 0.1  # in this table every trial moves
    assert frames == 5689
    with pytest.raises(InputError, match="the column holds 0, 1, 2"):
        read(path, mapping=trunk(99))


def test_a_trial_that_hardly_moved_is_found(shared_data):
    """The end of a decayed trial stands for a trial that nobody pulled aside."""
    path = shared_data / "trunk_free_decay" / "observations_manual_decay_200g.csv"
    ds = read(path, mapping=trunk(11) | {"rows": [350, 418]})
    assert any("hardly moves" in sentence for sentence in quality(ds).findings)


def test_a_wrong_unit_of_pressure_is_found(shared_data):
    wrong = ARM | {"pressure": ARM["pressure"] | {"unit": "Pa"}}
    ds = read(shared_data / "planar_two_segment_arm" / "jan10-3_steps_chamber2_1.txt", mapping=wrong)
    assert any("read as Pa" in sentence for sentence in quality(ds).findings)


TEXT = "jan10-3_steps_chamber2_1.txt"


def test_cut_copies_of_real_files_are_refused(shared_data, tmp_path):
    whole = (shared_data / "pneumatic_arm_pulses" / "100mbar_V3.c3d").read_bytes()
    for size in (100, 700, 4000, 40_000, 69_000):
        (tmp_path / "cut.c3d").write_bytes(whole[:size])
        with pytest.raises(InputError):
            read(tmp_path / "cut.c3d")
    text = (shared_data / "planar_two_segment_arm" / TEXT).read_bytes()
    (tmp_path / "cut.txt").write_bytes(text[:100_003])
    kept, full = (read(p, mapping=ARM) for p in (tmp_path / "cut.txt", shared_data / "planar_two_segment_arm" / TEXT))
    assert "has no line end" in kept.attrs["history"], "the row that was cut is left out, and told"
    rows = kept.sizes["time"]
    assert rows == text[:100_003].count(b"\n")
    np.testing.assert_array_equal(kept["position"].values, full["position"].values[:rows])


def test_rest_is_found_before_the_pulse(shared_data):
    for level, end in ((100, 0.6), (200, 0.8), (300, 1.6), (400, 0.55)):
        ds = assemble(read(shared_data / "pneumatic_arm_pulses" / f"{level}mbar_V3.c3d"), CLUSTERS)
        assert rest_window(ds)[1] < end


def test_eight_levels_in_one_array_are_read_each_with_its_level_and_moved_to_one_rest(shared_data, monkeypatch):
    """The tip rests 0.8 mm further at the last level than at the first; moved, only the motion differs."""
    monkeypatch.setenv("PLIANT_DATA", str(shared_data))
    study = load_study(EXAMPLES / "pneumatic_arm_levels.toml")
    ready = prepare_all(study, lambda _line: None)
    assert [e.level for e in ready.experiments.values()] == [5e3 * k for k in range(1, 9)]
    rest = np.array([e.position[:5, 0].mean(axis=0) for e in ready.experiments.values()])
    assert np.abs(rest - rest[0]).max() < 2e-5
    assert "shifted by up to 0.769 mm" in ready.findings["p400"][-1]
    assert [1e3 * e.travel for e in ready.experiments.values()] == pytest.approx(
        [1.55, 3.70, 5.19, 7.48, 10.6, 15.1, 21.9, 33.1], rel=5e-3
    )
