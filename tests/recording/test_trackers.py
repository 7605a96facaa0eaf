"""Points that trackers follow in a video: their files, their likelihoods, and the camera between pixels and metres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hdf5_files
import numpy as np
import pandas as pd
import pytest

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.camera import Camera

CAMERA = {"rate_hz": 60.0, "pixels_per_mm": 4.0}
NAMES = ["base", "mid", "tip"]


def path_of(count: int = 20) -> np.ndarray:
    """Points (T, 3, 2) in pixels, x right and y down."""
    t = np.arange(count) / 60
    bend = 40.0 * np.sin(5 * t)[:, None] * np.array([0.0, 0.4, 1.0])
    return np.stack([960 + bend, np.broadcast_to([900.0, 700.0, 500.0], bend.shape)], axis=-1)


def expected() -> np.ndarray:
    """The same in metres, y up."""
    return path_of() * np.array([1.0, -1.0]) / 4e3


def dlc_frame(points: np.ndarray, animals: list[str] | None = None) -> pd.DataFrame:
    """A table as DeepLabCut writes it, with a point of low likelihood in the first frame."""
    columns, values = [], []
    for k, animal in enumerate(animals or [""]):
        for s, name in enumerate(NAMES):
            for c, what in enumerate(("x", "y", "likelihood")):
                columns.append(("net", animal, name, what) if animals else ("net", name, what))
                good = np.where((np.arange(len(points)) == 0) & (s == 2), 0.2, 0.99)
                values.append(good if what == "likelihood" else points[:, s, c] + 1000 * k)
    levels = ["scorer", *(["individuals"] if animals else []), "bodyparts", "coords"]
    return pd.DataFrame(np.array(values).T, columns=pd.MultiIndex.from_tuples(columns, names=levels))


def test_a_file_that_looks_like_a_trackers_says_so(tmp_path):
    rows = ["scorer,net,net,net", "bodyparts,tip,tip,tip", "coords,x,y,likelihood", *(f"{i},1,2,1" for i in range(12))]
    (tmp_path / "points.txt").write_text("\n".join(rows) + "\n")
    with pytest.raises(InputError, match='looks like a file of deeplabcut: set format = "deeplabcut" in its mapping'):
        read(tmp_path / "points.txt")
    camera = {"camera": {"rate_hz": 30.0, "pixels_per_mm": 2.0}}
    assert read(tmp_path / "points.txt", mapping=camera, format="deeplabcut").sizes["station"] == 1
    assert read(tmp_path / "points.txt", mapping={**camera, "format": "deeplabcut"}).sizes["station"] == 1
    with pytest.raises(InputError, match="unknown format 'deplabcut': use one of deeplabcut"):
        read(tmp_path / "points.txt", mapping={**camera, "format": "deplabcut"})
    with pytest.raises(InputError, match="repeated column names: net"):
        read(tmp_path / "points.txt", mapping={"format": "deeplabcut"}, format="csv")
    (tmp_path / "notes.csv").write_text("\n".join(["of Monday", *rows]) + "\n")
    with pytest.raises(InputError, match=r"repeated column names: net.* looks like a file of deeplabcut"):
        read(tmp_path / "notes.csv")


@pytest.mark.parametrize("ending", ["csv", "h5"])
@pytest.mark.parametrize("animals", [None, ["left", "right"]])
def test_deeplabcut_in_both_formats(tmp_path: Path, ending: str, animals: list[str] | None) -> None:
    table, path = dlc_frame(path_of(), animals), tmp_path / f"points.{ending}"
    if ending == "csv":
        table.to_csv(path)
    else:
        hdf5_files.write_table(path, list(table.columns), table.to_numpy(), levels=table.columns.names)
    mapping: dict[str, Any] = {"camera": CAMERA}
    if animals:
        with pytest.raises(InputError, match="set individual in the mapping to one of left, right"):
            read(path, mapping=mapping)
        mapping["individual"] = "left"
    ds = read(path, mapping=mapping)
    assert ds["station"].to_numpy().tolist() == NAMES
    place = ds["position"].to_numpy()
    assert np.isnan(place[0, 2]).all()
    np.testing.assert_allclose(place[1:, :, :2], expected()[1:], atol=1e-12)
    assert (place[1:, :, 2] == 0).all()
    np.testing.assert_allclose(np.diff(ds["time"]), 1 / 60)
    assert "1 of 60 points have a likelihood below 0.6 and are gaps: tip 1" in ds.attrs["history"]
    assert "4 pixels per mm, y upward" in ds.attrs["history"]
    assert np.isfinite(read(path, mapping={**mapping, "likelihood": 0.1})["position"].to_numpy()).all()


def test_frames_that_deeplabcut_left_out_are_gaps(tmp_path: Path) -> None:
    dlc_frame(path_of()).drop(index=[5, 6]).to_csv(tmp_path / "points.csv")
    ds = read(tmp_path / "points.csv", mapping={"camera": CAMERA, "stations": ["tip", "base"]})
    assert ds["station"].to_numpy().tolist() == ["tip", "base"]
    assert ds.sizes["time"] == 20
    assert np.isnan(ds["position"].to_numpy()[5:7]).all()
    assert "2 frames are missing in points.csv and are gaps" in ds.attrs["history"]


def test_sleap_analysis_files(tmp_path: Path) -> None:
    ds = read(hdf5_files.write_sleap(tmp_path / "one.analysis.h5", path_of()), mapping={"camera": CAMERA})
    assert np.isnan(ds["position"].to_numpy()[0, 2]).all()
    np.testing.assert_allclose(ds["position"].to_numpy()[1:, :, :2], expected()[1:], atol=1e-12)
    two = hdf5_files.write_sleap(tmp_path / "two.h5", path_of(), 2)
    with pytest.raises(InputError, match="several tracks: set individual in its mapping to one of t0, t1"):
        read(two, mapping={"camera": CAMERA})
    moved = read(two, mapping={"camera": CAMERA, "individual": "t1"})["position"].to_numpy()[..., :2]
    np.testing.assert_allclose(moved, expected() + np.array([0.25, -0.25]), atol=1e-12)


def test_a_mapping_reads_the_data_table_of_tracker(tmp_path: Path) -> None:
    """Tracker (physlets.org): the name of the track, then `t x y`; one file for each point, joined as the docs say."""
    place = expected() * 1e2  # cm, as calibrated
    for s, name in enumerate(NAMES):
        rows = [f"{k / 60!r}\t{x!r}\t{y!r}" for k, (x, y) in enumerate(place[:, s].tolist())]
        (tmp_path / f"{name}.txt").write_text("\n".join([name, "t\tx\ty", *rows]) + "\n")
    one = {"delimiter": "\t", "skip_lines": 1, "header": True, "time": "t", "length_unit": "cm"}
    ds = read(tmp_path / "tip.txt", mapping={**one, "stations": {"tip": {"position": ["x", "y"]}}})
    np.testing.assert_allclose(ds["position"].to_numpy()[:, 0, :2], expected()[:, 2], atol=1e-12)
    (tmp_path / "tip.txt").write_text("\n".join((tmp_path / "tip.txt").read_text().splitlines()[:-1]) + "\n")
    tables = {n: pd.read_csv(tmp_path / f"{n}.txt", sep="\t", skiprows=1, index_col="t") for n in NAMES}
    joined = pd.concat([table.add_prefix(f"{n}_") for n, table in tables.items()], axis=1).sort_index()
    joined.to_csv(tmp_path / "points.csv", index_label="t")
    stations = {n: {"position": [f"{n}_x", f"{n}_y"]} for n in NAMES}
    ds = read(tmp_path / "points.csv", mapping={"header": True, "time": "t", "length_unit": "cm", "stations": stations})
    assert ds["station"].to_numpy().tolist() == NAMES
    np.testing.assert_allclose(ds["position"].to_numpy()[:-1, :, :2], expected()[:-1], atol=1e-12)
    assert np.isnan(ds["position"].to_numpy()[-1, 2, :2]).all()
    np.testing.assert_allclose(ds["position"].to_numpy()[-1, :2, :2], expected()[-1, :2], atol=1e-12)


@pytest.mark.parametrize("comma", [False, True])
def test_a_mapping_reads_a_trajectory_of_kinovea(tmp_path: Path, comma: bool) -> None:
    """Kinovea: comments, then `time x y` in ms and pixels. A second trajectory in the file is refused by its line."""
    def trajectory(s: int) -> list[str]:
        points = enumerate(path_of()[:, s].tolist())
        return [f"# {NAMES[s]}", *(f"{1000 * k / 60:.9f} {x!r} {y!r}" for k, (x, y) in points), ""]

    def write(*stations: int) -> Path:
        lines = ["#Kinovea Trajectory data export", "#T X Y", "", *(line for s in stations for line in trajectory(s))]
        text = "\n".join(lines)
        (tmp_path / "k.txt").write_text(text.replace(".", ",") if comma else text)
        return tmp_path / "k.txt"

    mapping = {"delimiter": "space", "time": 0, "time_unit": "ms", "camera": {"pixels_per_mm": 4.0},
               "stations": {"tip": {"position": [1, 2]}}}  # fmt: skip
    ds = read(write(2), mapping=mapping)
    np.testing.assert_allclose(ds["position"].to_numpy()[:, 0, :2], expected()[:, 2], atol=1e-12)
    np.testing.assert_allclose(ds["time"].to_numpy(), np.arange(20) / 60, atol=1e-8)
    with pytest.raises(InputError, match=r"line 26 of k\.txt has 2 cell"):
        read(write(0, 2), mapping=mapping)
    with pytest.raises(InputError, match="give a mapping that names its columns"):
        read(write(2))


def test_a_plain_table_of_pixels(tmp_path: Path) -> None:
    rows = [",".join(map(repr, row)) for row in path_of().reshape(20, -1).tolist()]
    (tmp_path / "p.csv").write_text("\n".join(rows) + "\n")
    stations = {n: {"position": [2 * s, 2 * s + 1]} for s, n in enumerate(NAMES)}
    ds = read(tmp_path / "p.csv", mapping={"camera": CAMERA, "stations": stations})
    np.testing.assert_allclose(ds["position"].to_numpy()[..., :2], expected(), atol=1e-12)


def seen(places_mm: np.ndarray) -> np.ndarray:
    """Pixels of points of a plane that a pinhole camera sees from the side."""
    turn = np.array([[0.9, 0.0, -0.436], [0.1, -0.97, 0.2], [0.42, 0.22, 0.88]])
    camera = np.column_stack([places_mm, np.zeros(len(places_mm))]) @ turn.T + np.array([-20.0, 60.0, 700.0])
    return camera[:, :2] / camera[:, 2:] * 1500.0 + np.array([960.0, 540.0])


def test_a_camera_from_the_side_by_four_points() -> None:
    corners = np.array([[0.0, 0.0], [120.0, 0.0], [120.0, 150.0], [0.0, 150.0]])
    camera = Camera(plane={"pixels": seen(corners).tolist(), "mm": corners.tolist()})
    inside = np.random.default_rng(1).uniform(0, 120, (50, 2))
    np.testing.assert_allclose(camera.metres(seen(inside), Path()), 1e-3 * inside, atol=1e-9)
    with pytest.raises(InputError, match="four of which no three"):
        Camera(plane={"pixels": [[0, 0], [1, 0], [2, 0], [3, 0]], "mm": corners.tolist()}).metres(inside, Path())


def test_two_points_and_a_turned_camera() -> None:
    camera = Camera(scale={"points": [[0, 0], [300, 400]], "distance_mm": 125.0}, axes=("+y", "-x"))
    np.testing.assert_allclose(camera.metres(np.array([[40.0, -80.0]]), Path()), [[0.02, -0.01]])


def test_a_lens_is_straightened() -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install pliant[camera]")
    lens = {"focal": (1500.0, 1510.0), "centre": (950.0, 530.0), "coefficients": [-0.25, 0.08, 1e-3, -5e-4, 0.0]}
    matrix = np.array([[1500.0, 0, 950.0], [0, 1510.0, 530.0], [0, 0, 1.0]])
    straight = np.random.default_rng(2).uniform([100, 100], [1800, 1000], (40, 2))
    rays = np.column_stack([(straight - [950.0, 530.0]) / [1500.0, 1510.0], np.ones(40)])
    bent = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(lens["coefficients"]))[0][:, 0]
    assert np.abs(bent - straight).max() > 10
    camera = Camera(pixels_per_mm=4.0, lens=lens)
    bent[3] = np.nan
    found = camera.metres(bent, Path())
    assert np.isnan(found[3]).all()
    np.testing.assert_allclose(np.delete(found, 3, 0), np.delete(straight * [1, -1] / 4e3, 3, 0), atol=1e-7)


@pytest.mark.parametrize("size", [1e-300, 1e160, 1e290])
def test_points_too_far_out_for_the_arithmetic_are_a_sentence(size: float) -> None:
    corners = np.array([[0.0, 0.0], [120.0, 0.0], [120.0, 150.0], [0.0, 150.0]])
    for pixels, mm in ((size * corners, corners), (corners, size * corners)):
        with pytest.raises(InputError, match=r"the points of camera.plane (do not determine|disagree)"):
            Camera(plane={"pixels": pixels.tolist(), "mm": mm.tolist()}).metres(corners, Path())


@pytest.mark.parametrize("coefficient", [1e290, -1e290, 1e7])
def test_a_lens_that_no_camera_has_is_a_sentence(coefficient: float) -> None:
    pytest.importorskip("cv2", reason="OpenCV is not installed: pip install pliant[camera]")
    corners = [[0.0, 0.0], [120.0, 0.0], [120.0, 150.0], [0.0, 150.0]]
    for k in range(5):
        lens = {"focal": (1500.0, 1510.0), "centre": (950.0, 530.0),
                "coefficients": [coefficient if i == k else 0.0 for i in range(5)]}
        entry = {"lens": lens, "plane": {"pixels": corners, "mm": corners}}
        with pytest.raises(InputError, match=r"coefficients|do not determine|disagree"):
            Camera.load(entry, "a.csv").metres(np.array(corners), Path())


@pytest.mark.parametrize("kind", ["chessboard", "aruco", "apriltag"])
def test_a_board_in_a_picture_gives_the_plane(tmp_path: Path, kind: str) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install pliant[camera]")
    if kind == "chessboard":
        tiles = (np.add.outer(np.arange(6), np.arange(8)) % 2 * 255).astype(np.uint8)
        flat, unit = np.pad(np.kron(tiles, np.ones((60, 60), np.uint8)), 100, constant_values=255), 60
        options, origin = {"columns": 7, "rows": 5, "side_mm": 15.0}, np.array([160.0, 160.0]) - 0.5
    else:
        name = cv2.aruco.DICT_4X4_50 if kind == "aruco" else cv2.aruco.DICT_APRILTAG_36h11
        drawn = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(name), 7, 400)
        flat, unit = np.pad(drawn, 120, constant_values=255), 400
        options, origin = {"side_mm": 50.0}, np.array([120.0, 120.0]) - 0.5
    warp = np.array([[0.9, 0.08, 60.0], [-0.05, 0.85, 90.0], [1e-4, 5e-5, 1.0]])
    cv2.imwrite(str(tmp_path / "board.png"), cv2.warpPerspective(flat, warp, (900, 800), borderValue=200))
    camera = Camera(board={"picture": "board.png", "kind": kind, **options})
    ends = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    where = np.column_stack([origin + unit * ends, np.ones(4)]) @ warp.T
    found = camera.metres(where[:, :2] / where[:, 2:], tmp_path)
    apart = np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(apart, 1e-3 * options["side_mm"], rtol=0.01)
    assert found[0, 1] > found[2, 1]  # y upward
    with pytest.raises(InputError, match="does not exist or is not a picture"):
        Camera(board={"picture": "none.png", "kind": kind, **options}).metres(found, tmp_path)


@pytest.mark.parametrize(("mapping", "said"), [
    (None, r"give \[camera\] with pixels_per_mm"),
    ({"camera": {"pixels_per_mm": 4.0}}, "set rate_hz in"),
    ({"camera": {"rate_hz": 60.0}}, "camera needs one of pixels_per_mm, scale, plane or board, got none"),
    ({"camera": {**CAMERA, "scale": {"points": [[0, 0], [1, 1]], "distance_mm": 1}}}, "got pixels_per_mm, scale"),
    ({"camera": CAMERA, "stations": ["foot"]}, "no point 'foot': choose stations among base, mid, tip"),
    ({"camera": CAMERA, "length_unit": "mm"}, r"has both \[camera\] and length_unit"),
    ({"camera": {**CAMERA, "axes": ["+x", "-x"]}}, "once each"),
])
def test_what_no_file_tells_is_asked_for(tmp_path: Path, mapping: dict[str, Any] | None, said: str) -> None:
    dlc_frame(path_of()).to_csv(tmp_path / "points.csv")
    with pytest.raises(InputError, match=said):
        read(tmp_path / "points.csv", mapping=mapping)
