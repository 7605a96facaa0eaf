"""Camera calibration: convert pixels to metres in the plane of bending, for trackers and for video.

As a table of a study or of a mapping::

    [camera]
    rate_hz = 60.0
    pixels_per_mm = 4.2

The scale is one of: ``pixels_per_mm``; ``scale = { points = [[x, y], [x, y]], distance_mm = 100.0 }``, two points and
their distance; ``plane = { pixels = [[...], ...], mm = [[...], ...] }``, four known points for a camera that looks at
the plane obliquely; or a calibration ``board`` in a picture. Pixel coordinates run right and down; the coordinates in
the plane run right and up.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pliant.errors import InputError
from pliant.recording.lost import lost_frames
from pliant.recording.mapping import FileMapping

Array = np.ndarray
Pair = tuple[float, float]
Coefficient = Annotated[float, Field(ge=-1e6, le=1e6)]
Axis = Literal["+x", "-x", "+y", "-y"]


class Scale(FileMapping):
    """Scale of a picture: two points [pixels] and the distance between them [mm]."""

    points: tuple[Pair, Pair]
    distance_mm: float = Field(gt=0)


class Plane(FileMapping):
    """Four or more points of the plane of bending, each given in pixels and in millimetres (y upward), which calibrate
    the camera.
    """

    pixels: list[Pair] = Field(min_length=4)
    mm: list[Pair] = Field(min_length=4)


class Lens(FileMapping):
    """Camera matrix (focal lengths, centre) and distortion coefficients of a lens, in the conventions of OpenCV."""

    focal: Pair  # pixels, x and y
    centre: Pair  # pixels
    coefficients: list[Coefficient] = Field(min_length=4, max_length=14)  # k1, k2, p1, p2, k3, ...


class Board(FileMapping):
    """Calibration board (chessboard or marker) in the plane of bending, in a picture that the same camera took."""

    picture: str
    kind: Literal["chessboard", "aruco", "apriltag"]
    columns: int = Field(2, ge=2)  # inner corners of a chessboard
    rows: int = Field(2, ge=2)
    side_mm: float = Field(gt=0)  # of a square, or of the marker


class Camera(FileMapping):
    """Calibration of a camera that films the plane of bending: frame rate, scale, lens distortion and orientation."""

    rate_hz: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="frames a second, where the file has no times")
    pixels_per_mm: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="the scale; or instead one of the next three entries")
    scale: Scale | None = Field(None, description=(
        "`{ points = [[412, 900], [832, 900]], distance_mm = 100.0 }`: two points of the picture and their distance"))
    plane: Plane | None = Field(None, description=(
        "`{ pixels = [[..], [..], [..], [..]], mm = [[0, 0], [100, 0], [100, 150], [0, 150]] }`: four points or more "
        "of the plane of bending, for a camera that looks at it from the side"))
    board: Board | None = Field(None, description=(
        '`{ picture = "board.png", kind = "chessboard", columns = 7, rows = 5, side_mm = 15.0 }`: a board in that '
        'plane, with its inner corners; or `kind = "aruco"` or `"apriltag"` and the side of the one marker '
        "(extra `camera`)"))
    lens: Lens | None = Field(None, description=(
        "`{ focal = [fx, fy], centre = [cx, cy], coefficients = [k1, k2, p1, p2, k3] }` as OpenCV has them: corrected "
        "first (extra `camera`)"))
    exposure_ms: float | None = Field(None, ge=0, allow_inf_nan=False, description=(
        "time that the shutter is open; this and the next entry give the uncertainty of a film's times"))
    readout_ms: float | None = Field(None, ge=0, allow_inf_nan=False, description=(
        "delay between reading the first and the last row of the picture"))
    axes: tuple[Axis, Axis] = Field(("+x", "+y"), description=(
        "which directions of the picture (x right, y up, whereas pixels count downwards) become x and y: "
        '`["+y", "-x"]` for a camera that was turned'))

    @model_validator(mode="after")
    def _says_one_scale(self) -> Self:
        stated = [n for n in ("pixels_per_mm", "scale", "plane", "board") if getattr(self, n) is not None]
        if len(stated) != 1:
            got = ", ".join(stated) or "none"
            raise ValueError(f"camera needs one of pixels_per_mm, scale, plane or board, got {got}")
        if self.plane is not None and len(self.plane.pixels) != len(self.plane.mm):
            raise ValueError("camera.plane needs as many points in mm as in pixels")
        if {a[1] for a in self.axes} != {"x", "y"}:
            raise ValueError("camera.axes names x and y once each, such as ['+y', '-x']")
        return self

    def metres(self, pixels: Array, folder: Path) -> Array:
        """Convert points (..., 2) [pixels] of a picture to positions (..., 2) [m] in the plane of bending, x right and
        y up.

        Parameters
        ----------
        pixels : array (..., 2)
        folder : Path
            Folder of the picture of a calibration board.
        """
        flat = self.straightened(np.asarray(pixels, dtype=float).reshape(-1, 2))
        homography = self.homography(folder)
        mapped = np.column_stack([flat, np.ones(len(flat))]) @ homography.T
        point = 1e-3 * mapped[:, :2] / mapped[:, 2:]
        turned = np.stack([{"+": 1.0, "-": -1.0}[a[0]] * point[:, "xy".index(a[1])] for a in self.axes], axis=1)
        return turned.reshape(np.shape(pixels))

    def homography(self, folder: Path) -> Array:
        """Return the homography (3, 3) from pixels, without lens distortion, to millimetres in the plane of bending, y
        upward.
        """
        if self.plane is not None:
            return projective(self.straightened(np.array(self.plane.pixels)), np.array(self.plane.mm))
        if self.board is not None:
            corners, board_positions = board_points(self.board, folder)
            return projective(self.straightened(corners), board_positions)
        scale = self.pixels_per_mm
        if self.scale is not None:
            ends = self.straightened(np.array(self.scale.points))
            scale = float(np.linalg.norm(ends[1] - ends[0])) / self.scale.distance_mm
            if scale == 0:
                raise InputError("camera.scale: its two points are identical: give two different points")
        return np.diag([1.0 / float(scale or np.nan), -1.0 / float(scale or np.nan), 1.0])

    def straightened(self, pixels: Array) -> Array:
        """Return N points (N, 2) [pixels] of a picture with the distortion of the lens removed."""
        if self.lens is None:
            return pixels
        cv2 = opencv("lens distortion")
        matrix = np.array([[self.lens.focal[0], 0, self.lens.centre[0]], [0, self.lens.focal[1], self.lens.centre[1]],
                           [0, 0, 1.0]])  # fmt: skip
        finite = np.isfinite(pixels).all(axis=1)
        out = np.full_like(pixels, np.nan)
        if finite.any():
            stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
            out[finite] = cv2.undistortPoints(
                pixels[finite][:, None], matrix, np.array(self.lens.coefficients), R=np.eye(3), P=matrix, criteria=stop
            )[:, 0]
            if not np.isfinite(out[finite]).all():
                raise InputError("camera.lens maps points of the picture to infinity: check focal, centre and "
                                 "coefficients")
        return out

    def description(self, folder: Path) -> str:
        """Return one line for the history of a recording that states the camera's scale or homography."""
        homography = self.homography(folder)
        if self.plane is None and self.board is None:
            return f"pixels to metres by {1.0 / homography[0, 0]:.6g} pixels per mm, y upward"
        return "pixels to metres by a homography from known points of the plane"


def in_plane(position: Array, camera: Camera, folder: Path) -> tuple[Array, str]:
    """Convert points (T, S, 2) [pixels] of S stations over T frames to positions (T, S, 3) [m] in the plane z = 0. Also
    return a line for the history that states the scale.

    Pixels that a tracker writes for a lost point, such as 0, 0, become NaN and are counted in that line.
    """
    lost = lost_frames(position[..., :2])
    placed = with_z(camera.metres(np.where(lost[..., None], np.nan, position[..., :2]), folder))
    note = f"; {int(lost.sum())} point(s) at the pixel that stands for a lost one are gaps" if lost.any() else ""
    return placed, camera.description(folder) + note


def with_z(place: Array) -> Array:
    """Return positions (T, S, 2) with a third coordinate, 0 where the point was seen."""
    return np.concatenate([place, np.where(np.isfinite(place[..., :1]), 0.0, np.nan)], axis=2)


def opencv(what: str) -> Any:
    """Import OpenCV and return its module `cv2`; raise InputError, which names the purpose `what`, where it is not
    installed.
    """
    try:
        import cv2
    except ImportError:
        raise InputError(f"{what} needs OpenCV: pip install 'pliant[camera]'") from None
    return cv2


def marker_finders(cv2: Any, *dictionaries: str) -> list[Any]:
    """Return a detector of OpenCV for each dictionary of markers, such as "4X4_250", with corners to a fraction of a
    pixel.
    """
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    books = [cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}")) for name in dictionaries]
    return [cv2.aruco.ArucoDetector(book, settings) for book in books]


def projective(pixels: Array, places: Array) -> Array:
    """Fit a homography (3, 3) that maps N points [pixels] to their positions `places` (N, 2) [mm] in a plane, by least
    squares.

    Raises
    ------
    InputError
        When the points do not determine the homography (such as three of four on a line) or disagree.
    """
    with np.errstate(all="ignore"):
        try:
            return fitted_homography(pixels, places)
        except np.linalg.LinAlgError:  # numbers so large or small that their squares are none
            raise InputError("the points of camera.plane do not determine the plane: their numbers are too large "
                             "or too small; give pixels and millimetres") from None


def fitted_homography(pixels: Array, places: Array) -> Array:
    """Return the homography (3, 3) that maps N points [pixels] to positions (N, 2) [mm], by least squares. Raise
    LinAlgError where the arithmetic overflows.
    """
    def normal(points: Array) -> Array:
        middle, size = points.mean(axis=0), float(np.std(points)) or 1.0
        return np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1.0]])

    before, after = normal(pixels), normal(places)
    p, q = ((np.column_stack([x, np.ones(len(x))]) @ t.T)[:, :2] for x, t in ((pixels, before), (places, after)))
    ones, zero = np.ones(len(p)), np.zeros(len(p))
    rows = np.concatenate([
        np.column_stack([p, ones, zero, zero, zero, -q[:, :1] * p, -q[:, 0]]),
        np.column_stack([zero, zero, zero, p, ones, -q[:, 1:] * p, -q[:, 1]]),
    ])
    size, vectors = np.linalg.svd(rows)[1:]
    if size[7] < 1e-6 * size[0]:
        raise InputError("the points of camera.plane do not determine the plane: choose four of which no three lie "
                         "on a line")
    matrix = np.linalg.inv(after) @ vectors[-1].reshape(3, 3) @ before
    mapped = np.column_stack([pixels, ones]) @ matrix.T
    error = float(np.abs(mapped[:, :2] / mapped[:, 2:] - places).max())
    if not np.isfinite(error):
        raise np.linalg.LinAlgError
    if error > 0.02 * float(np.ptp(places, axis=0).max()):
        raise InputError(f"the points of camera.plane disagree by up to {error:.3g} mm: check pixels against mm")
    return np.asarray(matrix / matrix[2, 2])


def board_points(board: Board, folder: Path) -> tuple[Array, Array]:
    """Find the N corners (N, 2) [pixels] of a calibration board in its picture, and return them with their positions
    (N, 2) [mm] in the plane, y upward.
    """
    cv2 = opencv("a calibration board")
    path = Path(board.picture) if Path(board.picture).is_absolute() else folder / board.picture
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise InputError(f"the picture of the board, {path}, does not exist or is not a picture: correct picture in "
                         "camera.board")
    if board.kind == "chessboard":
        complete, corners = cv2.findChessboardCornersSB(picture, (board.columns, board.rows))
        if not complete:
            raise InputError(f"{path.name} shows no chessboard of {board.columns} x {board.rows} inner corners: "
                             "check camera.board")
        row, column = np.divmod(np.arange(board.columns * board.rows), board.columns)
        corners = corners.reshape(-1, 2).astype(float)
        if corners[0].sum() > corners[-1].sum():  # a board looks alike turned by half a turn: begin at the upper left
            corners = corners[::-1]
        return corners, board.side_mm * np.column_stack([column, -row]).astype(float)
    names = ("4X4_250", "5X5_250", "6X6_250", "ARUCO_ORIGINAL") if board.kind == "aruco" else ("APRILTAG_36h11",)
    for finder in marker_finders(cv2, *names):
        markers = finder.detectMarkers(picture)[0]
        if len(markers) == 1:
            corners = np.asarray(markers[0], dtype=float).reshape(4, 2)
            return corners, board.side_mm * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, -1.0], [0.0, -1.0]])
    raise InputError(f"{path.name} must show exactly one {board.kind} marker: check camera.board")
