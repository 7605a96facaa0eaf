"""Numbers that a tracker writes for a lost station are gaps in every format; a station that rests or passes is not."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.io import savemat

from pliant.errors import InputError
from pliant.recording import make_recording, read, write
from pliant.recording.lost import known_losses, lost_frames, unit_poses
from tests.command_line import invoke

TIME = np.arange(0.0, 4.0, 0.01)
STATIONS = ["base", "middle", "tip"]


def body(seed=1, noise=5e-5):
    """Stations (T, 3, 3) of a body of 0.17 m that bends by 60 mm from 0.4 s to 2.4 s, 1 m from the tracker's origin."""
    bend = np.where(TIME > 0.4, 1 - np.exp(-6 * (TIME - 0.4).clip(0)) * np.cos(12 * (TIME - 0.4)), 0.0)
    bend -= np.where(TIME > 2.4, 1 - np.exp(-6 * (TIME - 2.4).clip(0)) * np.cos(12 * (TIME - 2.4)), 0.0)
    along = np.array([0.0, 0.5, 1.0])
    place = np.stack([0.06 * bend[:, None] * along**2, 0.17 * along - 0.02 * (bend**2)[:, None] * along,
                      0.0 * bend[:, None] * along], axis=-1)  # fmt: skip
    return place + [0.53, 0.80, 0.18] + noise * np.random.default_rng(seed).standard_normal(place.shape)


def losses():
    """Frames in which each station is lost: all in the first two frames, the tip in three frames of the motion."""
    lost = np.zeros((TIME.size, 3), dtype=bool)
    lost[:2] = True
    lost[150:153, 2] = True
    return lost


def lossy(mark):
    return np.where(losses()[..., None], mark, body())


def wide_csv(path, position):
    head = ["t", *(f"{a}_{s}" for s in STATIONS for a in "xyz")]
    rows = [",".join(["" if np.isnan(v) else f"{v:.6f}" for v in [t, *p.ravel()]])
            for t, p in zip(TIME, position, strict=True)]  # fmt: skip
    path.write_text("\n".join([",".join(head), *rows]) + "\n")
    return path


def as_npz(folder, position):
    np.savez(folder / "a.npz", t=TIME, xyz=position)
    return read(folder / "a.npz")


def as_mat(folder, position):
    savemat(folder / "a.mat", {"t": TIME, "xyz": position})
    return read(folder / "a.mat")


def as_csv(folder, position):
    return read(wide_csv(folder / "a.csv", position))


def as_columns(folder, position):
    np.savetxt(folder / "a.txt", np.column_stack([TIME, 1e3 * position.reshape(TIME.size, -1)]), delimiter=",")
    return read(folder / "a.txt", mapping={"time": 0, "length_unit": "mm", "points": {"count": 3, "first": 1}})


def as_netcdf(folder, position):
    return read(write(make_recording(TIME, position, station=STATIONS), folder / "a.nc"))


@pytest.mark.parametrize("stored", [as_csv, as_columns, as_npz, as_mat, as_netcdf])
@pytest.mark.parametrize("mark", [(0.0, 0.0, 0.0), (-1.0, -1.0, -1.0), (0.55, 0.9, 0.2)])
def test_a_fixed_position_is_a_gap_in_every_format(stored, mark, tmp_path):
    ds = stored(tmp_path, lossy(np.array(mark)))
    lost = np.isnan(ds["position"].values).any(axis=2)
    assert lost.tolist() == losses().tolist()
    name = str(ds["station"].values[2])
    assert known_losses(ds)[name] == {f"position exactly {', '.join(f'{v:g}' for v in mark)}": 5}
    assert f"read as gaps: {name} 5," in ds.attrs["history"]


def test_inspect_names_and_counts_the_losses(tmp_path):
    path = wide_csv(tmp_path / "a.csv", lossy(0.0))
    shown = invoke("inspect", path)
    assert "! lost by the tracker, which wrote a position exactly 0, 0, 0; read as gaps: tip 5, base 2, middle 2" in (
        shown.output
    )
    quality = json.loads(invoke("inspect", path, "--json").output)["quality"]
    assert quality["missing"] == {"base": 2, "middle": 2, "tip": 5}
    assert quality["travel_m"]["tip"] < 0.1


@pytest.mark.parametrize("mark", [(-1.0, -1.0, -1.0), (9.0, 0.5, 0.25)])
@pytest.mark.parametrize("frames", [[60, 150, 300], [60, 61, 62, 63, 64], [100, 102, 104, 106, 200]])
def test_another_repeated_position_is_a_loss(mark, frames):
    position = body()
    position[frames, 2] = mark
    assert np.flatnonzero(lost_frames(position)[:, 2]).tolist() == frames
    assert not lost_frames(position)[:, :2].any()


def test_one_frame_of_another_position_is_left_to_the_detection_of_spikes():
    position = body()
    position[150, 2] = [-1.0, -1.0, -1.0]
    assert not lost_frames(position).any()


def test_a_slow_tracker_in_a_fast_log_may_lose_its_body(tmp_path):
    position = np.repeat(body()[::2], 2, axis=0)
    position[:4, 2] = 0.0
    position[200:204, 2] = 0.0
    assert np.flatnonzero(lost_frames(position)[:, 2]).tolist() == [*range(4), *range(200, 204)]


def at_origin(position):
    return position - [0.53, 0.80, 0.18]


STILL = {
    "body away from the origin": body(),
    "base exactly at the origin": np.where([[[True], [False], [False]]], 0.0, at_origin(body())),
    "tip at rest near the origin": at_origin(body()) - [0.0, 0.17, 0.0],
    "simulated, at rest exactly, tip at the origin": at_origin(body(noise=0.0)) - [0.0, 0.17, 0.0],
    "coarse numbers": np.round(body(), 3),
    "coarse numbers, tip at the origin": np.round(at_origin(body()) - [0.0, 0.17, 0.0], 3),
    "a tracker slower than its log": np.repeat(body()[::4], 4, axis=0),
    "a still body": np.repeat(body()[:1], TIME.size, axis=0),
    "levels that are held, one at the origin": np.repeat(np.round(at_origin(body()), 3)[::40], 40, axis=0),
    "gaps already": lossy(np.nan),
}


@pytest.mark.parametrize("name", list(STILL))
def test_positions_that_recur_by_rest_are_kept(name):
    assert not lost_frames(STILL[name]).any()


def test_a_refused_quaternion_takes_its_position_along(tmp_path):
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (TIME.size, 3, 1))
    quaternion[[0, 1, 70], 2] = 0.0
    quaternion[80, 1] = [0.0, 0.0, 0.0, 3.0]
    ds = make_recording(TIME, body(), station=STATIONS, quaternion=quaternion)
    assert np.argwhere(np.isnan(ds["position"].values).all(axis=2)).tolist() == [[0, 2], [1, 2], [70, 2], [80, 1]]
    assert np.isnan(ds["quaternion"].values).any(axis=2).sum() == 4
    assert known_losses(ds) == {"tip": {"quaternion that is incomplete or not of unit length": 3},
                                "middle": {"quaternion that is incomplete or not of unit length": 1}}  # fmt: skip


def test_a_lost_position_takes_its_orientation_along(tmp_path):
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (TIME.size, 3, 1))
    ds = read(write(make_recording(TIME, lossy(0.0), station=STATIONS, quaternion=quaternion), tmp_path / "a.nc"))
    assert np.isnan(ds["quaternion"].values).all(axis=2).tolist() == losses().tolist()


def test_points_without_orientation_keep_their_positions():
    """Messages of points often carry quaternions of zeros throughout."""
    ds = make_recording(TIME, body(), station=STATIONS, quaternion=np.zeros((TIME.size, 3, 4)))
    assert "quaternion" not in ds
    assert np.isfinite(ds["position"].values).all()


def test_quaternions_that_are_never_of_unit_length_are_refused():
    with pytest.raises(InputError, match="not of unit length"):
        make_recording(TIME, body(), quaternion=np.ones((TIME.size, 3, 4)))


def test_unit_quaternions_keep_their_bits():
    random = np.random.default_rng(4).standard_normal((50, 2, 4))
    unit = random / np.linalg.norm(random, axis=-1, keepdims=True)
    result, _, refused, _ = unit_poses(unit, None)
    assert result.tobytes() == unit.tobytes()
    assert not refused.any()
    rough, *_ = unit_poses(np.round(unit, 4), None)
    np.testing.assert_allclose(np.linalg.norm(rough, axis=-1), 1.0, atol=1e-12)


def test_a_fixed_pixel_is_a_gap(tmp_path):
    pixels = np.round(1000 * body()[:, 2, :2], 3)
    pixels[[0, 1, 150, 200], :] = 0.0
    np.savetxt(tmp_path / "a.txt", np.column_stack([TIME, pixels]), delimiter=",")
    mapping = {"time": 0, "camera": {"pixels_per_mm": 2.0}, "stations": {"tip": {"position": [1, 2]}}}
    ds = read(tmp_path / "a.txt", mapping=mapping)
    assert np.flatnonzero(np.isnan(ds["position"].values).any(axis=(1, 2))).tolist() == [0, 1, 150, 200]
    assert "4 point(s) at the pixel that stands for a lost one are gaps" in ds.attrs["history"]
