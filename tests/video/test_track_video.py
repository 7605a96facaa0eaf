"""A body is found in a film: its middle, its tip and its times against what the virtual camera filmed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from filming import LENGTH, VIEW, bent, filmed, true_stations

from pliant.errors import InputError
from pliant.recording import read
from pliant.testbed.camera import Look, Scene, Shutter, film_motion
from pliant.testbed.camera.scene import coverage
from pliant.video import Tracking, track_video
from pliant.video.marks import _on_one_body
from pliant.video.overlay import movie
from pliant.video.track import doubled_and_leaps, lost_in_times

SIDE = replace(VIEW, aside=0.3, tilt=0.12, coefficients=(-0.2, 0.06, 1e-3, -5e-4, 0.0))
CASES = {
    "side_and_lens": (SIDE, Look(), Shutter(), 0.25, 0.5),
    "blur": (VIEW, Look(), Shutter(exposure=8e-3, defocus=1.2), 0.3, 0.9),
    "poor": (VIEW, Look(clutter=60, light=0.4, gloss=15), Shutter(noise=8, quality=30), 0.5, 1.5),
}


def camera_of(view=VIEW, exposure=1e-3):
    return {**view.table(), "exposure_ms": 1e3 * exposure, "readout_ms": 0.0}


@pytest.mark.parametrize("case", ["side_and_lens", "blur", pytest.param("poor", marks=pytest.mark.slow)])
def test_silhouette_against_the_truth(tmp_path: Path, case: str) -> None:
    view, look, shutter, most_px, most_tip_px = CASES[case]
    at = filmed(tmp_path / "f.mp4", look, shutter, view, 0.5)
    ds = track_video(tmp_path / "f.mp4", camera_of(view, shutter.exposure))
    np.testing.assert_allclose(ds["time"], at, atol=1e-9)
    place = ds["position"].to_numpy()[..., :2]
    assert np.isfinite(place).all()
    assert ds["arc_length"].to_numpy()[-1] == pytest.approx(LENGTH, rel=4e-3)
    error = np.linalg.norm(place - true_stations(at, np.linspace(0, 1, 25)), axis=2) * 1e3 * view.pixels_per_mm
    assert np.sqrt(np.mean(error[:, 1:-1] ** 2)) < most_px
    assert np.sqrt(np.mean(error[:, -1] ** 2)) < most_tip_px


def test_tracking_that_is_stopped_leaves_nothing_behind(tmp_path: Path) -> None:
    filmed(tmp_path / "f.mp4")
    done = []

    def stop(share: float) -> None:
        done.append(share)
        if share > 0.6:
            raise KeyboardInterrupt

    overlays = (tmp_path / "over.mp4", tmp_path / "over.png")
    with pytest.raises(KeyboardInterrupt):
        track_video(tmp_path / "f.mp4", camera_of(), Tracking(overlays=overlays), progress=stop)
    assert len(done) > 1
    assert [path.name for path in tmp_path.iterdir()] == ["f.mp4"]


@pytest.mark.slow
def test_hand_and_lost_and_doubled_frames_are_gaps_and_told(tmp_path: Path) -> None:
    shutter = Shutter(dropped=(10, 11, 30), doubled=(17,), noise=2)
    at = filmed(tmp_path / "f.mp4", Look(hand=(0.45, 0.6)), shutter)
    ds = track_video(tmp_path / "f.mp4", {**VIEW.table(), "exposure_ms": 1.0})
    np.testing.assert_allclose(ds["time"], at, atol=1e-9)
    place = ds["position"].to_numpy()[..., :2]
    seen = np.isfinite(place).all(axis=(1, 2))
    hidden = (at > 0.485) & (at < 0.565)  # the hand lies over the body
    assert not seen[hidden].any()
    assert not seen[np.searchsorted(at, 17 / 60)]
    assert seen[(at < 0.44) | (at > 0.61)].sum() == ((at < 0.44) | (at > 0.61)).sum() - 1
    error = np.linalg.norm(place - true_stations(at, np.linspace(0, 1, 25)), axis=2)[seen]
    assert error.max() * 1e3 * VIEW.pixels_per_mm < 1.5  # never a wrong shape
    told = ds.attrs["history"]
    assert "3 frames are missing in 2 gap(s) of the file's times" in told
    assert "1 frames repeat the previous frame and are gaps" in told
    assert f"{int((~seen).sum()) - 1} of 45 frames are gaps: the body was hidden or not found" in told
    assert ds.attrs["time_uncertainty_s"] == pytest.approx(0.5 / 60)
    assert "shutter open for 1 ms, rows read within an unknown time" in told


@pytest.mark.parametrize(("marks", "options"), [("dots", {"colour": "#c8283c"}), ("aruco", {})])
def test_marks_on_the_body(tmp_path: Path, marks: str, options: dict) -> None:
    places = (0.08, 0.36, 0.64, 0.92)
    look = Look(marks=marks, mark_places=places, half_width=(0.009, 0.009))
    at = filmed(tmp_path / "f.mp4", look, view=VIEW.scaled(1120), duration=0.25)
    ds = track_video(tmp_path / "f.mp4", camera_of(VIEW.scaled(1120)), Tracking(marks, **options))
    place = ds["position"].to_numpy()[..., :2]
    assert place.shape[1] == len(places)
    assert np.isfinite(place).all(axis=(1, 2)).mean() > 0.9
    error = np.linalg.norm(place - true_stations(at, np.array(places)), axis=2) * 1e3 * VIEW.scaled(1120).pixels_per_mm
    assert np.sqrt(np.nanmean(error**2)) < 0.5
    if marks == "aruco":
        assert ds["station"].to_numpy().tolist() == [f"marker_{k}" for k in range(4)]


def still(at: np.ndarray) -> np.ndarray:
    return bent(np.zeros_like(at))


@pytest.mark.slow
def test_what_cannot_be_followed_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "f.mp4"
    film_motion(still, 0.3, path, Scene(VIEW.scaled(320), Look(), Shutter(), np.random.default_rng(1)))
    with pytest.raises(InputError, match="no motion found"):
        track_video(path, camera_of())
    rng = np.random.default_rng(2)
    board = np.kron(rng.integers(0, 255, (30, 40, 1)), np.ones((8, 8, 3))).astype(np.uint8)
    with movie(path, 60.0, (320, 240)) as write:
        for k in range(20):
            write(np.roll(board, (k, 3 * k), axis=(0, 1)))
    with pytest.raises(InputError, match="the camera moves by up to"):
        track_video(path, camera_of())
    (tmp_path / "no.mp4").write_text("no film")
    with pytest.raises(InputError, match="OpenCV cannot read"):
        track_video(tmp_path / "no.mp4", camera_of())
    with pytest.raises(InputError, match="0 dots of the colour #00ff00 were found"):
        track_video(path, camera_of(), Tracking("dots", colour="#00ff00"))
    with pytest.raises(InputError, match="0 ArUco or AprilTag markers"):
        track_video(path, camera_of(), Tracking("aruco"))
    for wrong, said in (({"method": "flow"}, "method must be one of"), ({"colour": "#123456"}, "takes no colour"),
                        ({"method": "dots"}, "needs the colour of the dots"),
                        ({"stations": 2}, "stations must be between")):  # fmt: skip
        with pytest.raises(InputError, match=said):
            Tracking(**wrong)
    with pytest.raises(InputError, match="colour must be written as"):
        track_video(path, camera_of(), Tracking("dots", colour="red"))
    with pytest.raises(InputError, match="an overlay must be a picture of frames"):
        track_video(path, camera_of(), Tracking("dots", colour="#ff0000", overlays=(tmp_path / "s.jpg",)))


def test_body_and_background_alike_are_refused(tmp_path: Path) -> None:
    look = Look(body=(75.0, 68.0, 62.0))
    filmed(tmp_path / "f.mp4", look, Shutter(noise=6), VIEW.scaled(320), 0.4)
    with pytest.raises(InputError, match=r"no motion found|differ by"):
        track_video(tmp_path / "f.mp4", camera_of())


def test_command_writes_recording_sheet_and_film(tmp_path: Path) -> None:
    import cv2

    filmed(tmp_path / "f.mp4", view=VIEW.scaled(480), duration=0.3)
    lines = [f"{key} = {json.dumps(value)}" for key, value in VIEW.scaled(480).table()["plane"].items()]
    (tmp_path / "camera.toml").write_text("[camera.plane]\n" + "\n".join(lines) + "\n")
    arguments = ("track", tmp_path / "f.mp4", "-o", tmp_path / "f.csv", "--camera", tmp_path / "camera.toml")
    done = invoke(*arguments, "--overlay", tmp_path / "s.png", "--overlay", tmp_path / "o.mp4", "--json")
    assert done.exit_code == 0, done.output
    assert len(json.loads(done.stdout)["written"]) == 3
    ds = read(tmp_path / "f.csv")
    assert ds.sizes["station"] == 25
    assert cv2.imread(str(tmp_path / "s.png")).shape[1] > 1000
    film = cv2.VideoCapture(str(tmp_path / "o.mp4"))
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == ds.sizes["time"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["camera.toml", "f.csv", "f.mp4", "o.mp4", "s.png"]


def test_pace_of_a_film() -> None:
    time = np.delete(np.arange(40) / 30.0, [7, 8, 20])
    assert lost_in_times(time) == (3, 2)
    rows = np.arange(40) * 3.0
    rows[25:] += 3.0  # a frame lost in silence
    rows[12] = rows[11]  # a frame repeated in the place of one
    points = np.stack([rows[:, None] + np.arange(5), np.zeros((40, 5))], axis=2)
    change = np.where(np.arange(40) == 12, 0.1, 2.0)
    doubled, leaps = doubled_and_leaps(points, change, np.arange(40) / 30.0)
    assert np.flatnonzero(doubled).tolist() == [12]
    assert np.flatnonzero(leaps).tolist() == [25]


def test_the_virtual_camera_draws_areas_exactly() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    box = (np.array([[-10.0, -30], [10, -30], [10, 30], [-10, 30]]) @ turn.T) + [60.3, 50.8]
    drawn = coverage([box], (0, 0, 120, 110)).astype(float)
    y, x = np.mgrid[:110, :120]
    assert drawn.sum() == pytest.approx(1200.0, rel=1e-5)
    assert (drawn * x).sum() / drawn.sum() == pytest.approx(60.3, abs=1e-4)
    assert (drawn * y).sum() / drawn.sum() == pytest.approx(50.8, abs=1e-4)
    assert drawn.max() == pytest.approx(1.0, abs=1e-6)


RED = (60.0, 40.0, 200.0)  # blue, green, red


def dotted(path: Path, frames: int = 12, clutter: tuple[tuple[int, int], ...] = (), shift: int = 0) -> np.ndarray:
    """Write a film of five red dots on a swinging line, with red clutter; true places (T, 5, 2) of the dots, pixels."""
    cv2 = pytest.importorskip("cv2")
    places = []
    with movie(path, 30.0, (320, 240)) as write:
        for k in range(frames):
            picture = np.full((240, 320, 3), 200, np.uint8)
            s = np.arange(5) * 30.0
            lean = 0.2 * np.sin(0.5 * k)
            dots = np.stack([shift + 60 + s * np.cos(lean), 60 + s * np.sin(lean)], axis=1)
            for x, y in [*dots, *clutter]:
                centre = (round(16 * x), round(16 * y))
                cv2.circle(picture, centre, 16 * 7, RED, -1, cv2.LINE_AA, 4)
            places.append(dots)
            write(picture)
    return np.array(places)


def followed(path: Path, **options: object) -> tuple[np.ndarray, str]:
    """Places (T, S, 2) in pixels, x right and y down, and the history."""
    ds = track_video(path, {"rate_hz": 30.0, "pixels_per_mm": 1.0}, Tracking("dots", colour="#c8283c", **options))
    return np.abs(1e3 * ds["position"].values[..., :2]), str(ds.attrs["history"])


def test_clutter_of_the_dots_colour_is_refused_and_left_out_on_request(tmp_path: Path) -> None:
    path = tmp_path / "clutter.mp4"
    true = dotted(path, clutter=((300, 200),))
    with pytest.raises(InputError, match=r"away from the others, at the pixels \(300, 200\).*count.*region"):
        followed(path)
    for options in ({"count": 5}, {"region": (0, 0, 250, 240)}):
        places, told = followed(path, **options)
        assert places.shape[1] == 5
        assert np.nanmax(np.abs(places - true)) < 1.0
    assert "left out" not in told
    assert "left out, not on the body: marks at the pixels (300, 200)" in followed(path, count=5)[1]
    with pytest.raises(InputError, match=r"5 dots were found on one body, but count = 8"):
        followed(path, count=8)


def test_colour_that_touches_the_pictures_border_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "border.mp4"
    true = dotted(path, clutter=((319, 239), (0, 0), (319, 2)), shift=40)
    places, _ = followed(path, count=5)
    assert np.nanmax(np.abs(places - true)) < 1.0


@pytest.mark.parametrize(("options", "said"), [
    ({"method": "aruco", "count": 4}, "apply to dots only"),
    ({"method": "dots", "colour": "#ff0000", "count": 1}, "2 or more"),
    ({"method": "dots", "colour": "#ff0000", "region": (5, 5, 1, 9)}, "left, top, right, bottom"),
])  # fmt: skip
def test_options_of_dots_that_cannot_be(options: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Tracking(**options)


@pytest.mark.parametrize(("count", "chosen"), [(None, "right"), (3, "left"), (4, "right"), (5, "right")])
def test_the_group_of_the_stated_number_is_the_body(count: int | None, chosen: str) -> None:
    left = np.array([[10.0 * k, 0.0] for k in range(3)])
    right = np.array([[300.0 + 10.0 * k, 0.0] for k in range(5)])
    body = _on_one_body(np.concatenate([left, right]), count)
    assert body.tolist() == [chosen == "left"] * 3 + [chosen == "right"] * 5


def test_a_frame_after_a_repeated_one_is_no_leap() -> None:
    """It covers two steps because the frame before showed none; a leap without a repeat is a frame that is missing."""
    time, even = 0.01 * np.arange(12), np.full(12, 10.0)
    for way, repeated, leapt in (
        ([0, 5, 10, 15, 20, 20, 30, 35, 40, 45, 50, 55], [5], []),
        ([0, 5, 10, 15, 20, 25, 36, 41, 46, 51, 56, 61], [], [6]),
    ):
        change = even.copy()
        change[repeated] = 0.1
        points = np.stack([np.array(way, dtype=float), np.zeros(12)], axis=1)[:, None]
        doubled, leaps = doubled_and_leaps(points, change, time)
        assert (np.flatnonzero(doubled).tolist(), np.flatnonzero(leaps).tolist()) == (repeated, leapt)
