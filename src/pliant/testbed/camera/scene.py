"""The filmed scene: the body, its base block, the background board, the light and a hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np

from pliant.recording.camera import opencv

Array = np.ndarray
Colour = tuple[float, float, float]  # blue, green, red; 0 to 255
Layer = tuple[list[Array], Colour]  # outlines (N, 2) that do not overlap, and their fill colour
SKIN: Colour = (140.0, 165.0, 215.0)
CELLS = 6  # per side of a 4 x 4 marker with its frame
PIECES = 4  # pieces of an outline per pixel


CORNERS_MM = ((-120.0, -20.0), (60.0, -20.0), (60.0, 180.0), (-120.0, 180.0))  # corners of a sheet behind the body


@dataclass(frozen=True)
class View:
    """Position and optics of a camera that looks at the plane of bending.

    Attributes
    ----------
    size : (width, height), pixels
    pixels_per_mm : float
        Scale in the middle of the picture.
    centre : (float, float), m
        Point of the plane (base at the origin, tangent +y) in the middle of the picture.
    distance : float, m
        Distance from the camera to `centre`; it sets the strength of the perspective.
    aside, tilt : float, rad
        Angles by which the camera stands beside and above the normal of the plane.
    coefficients : tuple of float
        Distortion coefficients of the lens in OpenCV's order; empty: no distortion.
    """

    size: tuple[int, int] = (1920, 1080)
    pixels_per_mm: float = 4.8
    centre: tuple[float, float] = (-0.035, 0.082)
    distance: float = 0.9
    aside: float = 0.0
    tilt: float = 0.0
    coefficients: tuple[float, ...] = ()

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return 1e3 * self.pixels_per_mm * self.distance

    def scaled(self, width: int) -> Self:
        """Return the same view with a picture `width` pixels wide."""
        share = width / self.size[0]
        size = (width, round(share * self.size[1] / 2) * 2)
        return replace(self, size=size, pixels_per_mm=share * self.pixels_per_mm)

    def pixels(self, plane: Array) -> Array:
        """Return the pixel coordinates (x to the right, y down) of points `plane` (..., 2) [m] in the plane of
        bending.
        """
        x, y = plane[..., 0] - self.centre[0], self.centre[1] - plane[..., 1]
        across, depth = x * np.cos(self.aside), x * np.sin(self.aside)
        down, behind = y * np.cos(self.tilt) - depth * np.sin(self.tilt), y * np.sin(self.tilt)
        away = self.distance + depth * np.cos(self.tilt) + behind
        distorted = np.stack(_bent(across / away, down / away, self.coefficients), axis=-1)
        return np.asarray(self.focal * distorted + 0.5 * (np.array(self.size) - 1.0))

    def table(self) -> dict[str, Any]:
        """Return this camera's ``[camera]`` table for a mapping that describes how to read a film: four points of the
        plane in pixels and mm, and the lens if it distorts.
        """
        corners = self.pixels(1e-3 * np.array(CORNERS_MM))
        table: dict[str, Any] = {"plane": {"pixels": corners.tolist(), "mm": [list(c) for c in CORNERS_MM]}}
        if self.coefficients:
            middle = [0.5 * (n - 1.0) for n in self.size]
            table["lens"] = {"focal": [self.focal, self.focal], "centre": middle, "coefficients": [*self.coefficients]}
        return table


def _bent(x: Array, y: Array, coefficients: tuple[float, ...]) -> tuple[Array, Array]:
    """Return normalised image coordinates distorted by OpenCV's lens model (k1, k2, p1, p2, k3)."""
    k1, k2, p1, p2, k3 = (*coefficients, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x**2 + y**2
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y


@dataclass(frozen=True)
class Look:
    """Appearance of the filmed scene (SI units; colours as blue, green, red).

    Attributes
    ----------
    half_width : (float, float), m
        Half width of the body at base and tip.
    marks : {"none", "dots", "aruco"}
        Marks on the body, at `mark_places` (fractions of the length).
    clutter : int
        Number of objects on the board behind the body.
    light : float
        Fraction by which the light falls off from one side of the picture to the other.
    gloss : float
        Brightness of a stripe along the body beside its middle, in levels of 255.
    hand : (float, float), s
        Start and end of a hand's passage over the body; equal values: no hand.
    """

    body: Colour = (190.0, 205.0, 215.0)
    board: Colour = (70.0, 62.0, 55.0)
    block: Colour = (40.0, 40.0, 44.0)
    half_width: tuple[float, float] = (0.0085, 0.0060)
    marks: Literal["none", "dots", "aruco"] = "none"
    mark_places: tuple[float, ...] = (0.06, 0.25, 0.44, 0.63, 0.82, 0.95)
    mark_colour: Colour = (60.0, 40.0, 200.0)
    clutter: int = 0
    light: float = 0.0
    gloss: float = 0.0
    hand: tuple[float, float] = (0.0, 0.0)


def board(view: View, look: Look, rng: np.random.Generator) -> Array:
    """Return the background picture (H, W, 3) of H x W pixels, float32, before light and blur: board, clutter and base
    block.
    """
    cv2 = opencv("a virtual camera")
    width, height = view.size
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = look.board
    for _ in range(look.clutter):
        middle, reach = rng.uniform((0, 0), view.size), rng.uniform(0.01, 0.09) * width
        corners = middle + rng.uniform(-reach, reach, (int(rng.integers(3, 6)), 2))
        colour = rng.uniform(15, 150) + rng.uniform(-40, 40, 3)
        if rng.random() < 0.4:
            thick = int(rng.integers(1, max(2, width // 200)))
            cv2.polylines(picture, [np.round(corners).astype(np.int32)], isClosed=False, color=colour.tolist(),
                          thickness=thick, lineType=cv2.LINE_AA)  # fmt: skip
        else:
            hull = cv2.convexHull(corners.astype(np.float32)).astype(np.int32)
            cv2.fillConvexPoly(picture, hull, np.clip(colour, 5, 170).tolist(), lineType=cv2.LINE_AA)
    wide = 2.6 * look.half_width[0]
    block = np.array([[-wide, 0.0], [wide, 0.0], [wide, -0.05], [-wide, -0.05]])
    return over(picture, [([view.pixels(block)], look.block)])


def lighting(view: View, look: Look) -> Array:
    """Return the relative brightness (H, W, 1) of each pixel in a picture of H x W pixels: a linear slope with a bright
    spot.
    """
    y, x = np.mgrid[: view.size[1], : view.size[0]].astype(np.float32) / np.float32(view.size[0])
    spot = np.exp(-((x - 0.35) ** 2 + (y - 0.3) ** 2) / 0.05)
    return np.asarray(1.0 - look.light * (x - 0.35 * spot), np.float32)[..., None]


def layers(view: View, look: Look, shape: Array) -> list[Layer]:
    """Return the filled outlines [pixels] of a body in the order in which they are drawn. `shape` (N, 2) [m] holds N
    points of its centreline, base first.
    """
    from scipy.interpolate import CubicSpline

    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1)))
    line = CubicSpline(along, shape)
    s = np.linspace(0.0, along[-1], 240)

    def ribbon(left: float, right: float) -> Array:
        half = np.interp(s, [0.0, along[-1]], look.half_width)[:, None]
        point, normal = line(s), _normal(line, s)
        return view.pixels(np.concatenate([point + left * half * normal, (point + right * half * normal)[::-1]]))

    drawn = [([ribbon(1.0, -1.0)], look.body)]
    if look.gloss:
        bright = [min(255.0, c + look.gloss) for c in look.body]
        drawn.append(([ribbon(0.55, 0.15)], (bright[0], bright[1], bright[2])))
    for k, fraction in enumerate(look.mark_places if look.marks != "none" else ()):
        drawn += _mark(view, look, line, fraction * along[-1], k)
    return drawn


def _normal(line: Any, s: Array) -> Array:
    tangent = line(s, 1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)


def _mark(view: View, look: Look, line: Any, s: float, number: int) -> list[Layer]:
    """Return the outline of a round dot, or of a marker's cells, on the centreline at `s` [m]."""
    half = float(np.interp(s / line.x[-1], [0.0, 1.0], look.half_width))
    normal = _normal(line, np.array(s))
    frame = np.stack([normal, np.array([normal[1], -normal[0]])])  # across to the left, along to the tip
    if look.marks == "dots":
        turn = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
        dot = view.pixels(line(s) + 0.45 * half * np.stack([np.cos(turn), np.sin(turn)], 1) @ frame)
        return [([dot], look.mark_colour)]
    cv2 = opencv("a virtual camera")
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cells = cv2.aruco.generateImageMarker(book, number, CELLS, borderBits=1)
    side, unit = 1.35 * half, np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

    def square(corner: Array, cells: int) -> Array:
        """Return the outline [pixels] of a square in a marker's grid. Its sides are `cells` grid cells long, and its
        first corner lies at the grid position `corner`.
        """
        corners = (unit * cells + corner) / CELLS - 0.5
        return view.pixels(line(s) + side * (corners * [-1.0, 1.0]) @ frame)

    white = [square(np.array([column, CELLS - 1 - row]), 1) for row, column in zip(*np.nonzero(cells), strict=True)]
    return [([square(np.zeros(2), CELLS)], (20.0, 20.0, 20.0)), (white, (235.0, 235.0, 235.0))]


def hand(view: View, look: Look, time: float) -> list[Layer]:
    """Return the filled outlines [pixels] of a hand that enters from the left, or [] at times when it is not in the
    picture.
    """
    begin, end = look.hand
    if not begin <= time < end:
        return []
    width, height = view.size
    share = (time - begin) / (end - begin)
    tip = np.array([width * (0.12 + 0.62 * np.sin(np.pi * share)), height * 0.42])  # of the longest finger
    reach = 0.055 * width
    drawn: list[Layer] = []
    for k, back in enumerate((0.35, 0.0, 0.1, 0.5)):
        y = tip[1] + (k - 1) * 0.9 * reach * 0.55
        end_x = tip[0] - back * reach
        round_end = [[end_x - 0.2 * reach * (1 - np.cos(a)), y + 0.22 * reach * np.sin(a)]
                     for a in np.linspace(-np.pi / 2, np.pi / 2, 12)]  # fmt: skip
        back_x = tip[0] - 2.4 * reach
        drawn.append(([np.array([[back_x, y - 0.22 * reach], *round_end, [back_x, y + 0.22 * reach]])], SKIN))
    palm = [[-reach * 3, -reach], [tip[0] - 2.2 * reach, -reach], [tip[0] - 1.8 * reach, reach * 0.8],
            [tip[0] - 2.4 * reach, reach * 1.8], [-reach * 3, reach * 1.6]]  # fmt: skip
    return [*drawn, ([np.add(palm, [0.0, tip[1]])], SKIN)]


def over(picture: Array, shapes: list[Layer]) -> Array:
    """Draw filled outlines with antialiased borders onto the picture (height, width, 3), in place, and return it."""
    x0, y0, x1, y1 = bounds(shapes, (picture.shape[1], picture.shape[0]), 0)
    colour, cover = painted(shapes, (x0, y0, x1, y1))
    part = picture[y0:y1, x0:x1]
    part += colour - cover[..., None] * part
    return picture


def bounds(shapes: list[Layer], size: tuple[int, int], margin: int) -> tuple[int, int, int, int]:
    """Return the box of pixels (x0, y0, x1, y1), ends exclusive, that encloses the outlines with a `margin` [pixels].
    It is limited to a picture of the given `size`.
    """
    points = np.concatenate([outline for outlines, _ in shapes for outline in outlines])
    low = np.clip(np.floor(points.min(axis=0)).astype(int) - 1 - margin, 0, np.array(size) - 1)
    high = np.clip(np.ceil(points.max(axis=0)).astype(int) + 2 + margin, low + 1, size)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def painted(shapes: list[Layer], box: tuple[int, int, int, int]) -> tuple[Array, Array]:
    """Return colour (h, w, 3) and coverage (h, w), float32, of filled outlines in a box of h x w pixels. Coverage is
    the covered fraction of a pixel; colour is multiplied by it.
    """
    x0, y0, x1, y1 = box
    colour, cover = np.zeros((y1 - y0, x1 - x0, 3), np.float32), np.zeros((y1 - y0, x1 - x0), np.float32)
    for layer in shapes:
        u0, v0, u1, v1 = bounds([layer], (x1, y1), 0)
        u0, v0 = max(u0, x0), max(v0, y0)
        if u1 <= u0 or v1 <= v0:
            continue
        a = coverage(layer[0], (u0, v0, u1, v1))
        part = np.s_[v0 - y0 : v1 - y0, u0 - x0 : u1 - x0]
        colour[part] += a[..., None] * (np.array(layer[1], np.float32) - colour[part])
        cover[part] += a * (1.0 - cover[part])
    return colour, cover


def coverage(outlines: list[Array], box: tuple[int, int, int, int]) -> Array:
    """Return the fraction (h, w), float32, of each pixel that lies inside the outlines, in a box of h x w pixels. The
    outlines must not overlap.

    It is computed by Green's theorem, summed along the rows over pieces of a quarter of a pixel.
    """
    x0, y0, x1, y1 = box
    h, w = y1 - y0, x1 - x0
    total = np.zeros(h * (w + 2))
    for outline in outlines:
        corners = outline + 0.5 - [x0, y0]  # pixel k reaches from k to k + 1
        ahead = np.roll(corners, -1, axis=0)
        count = 1 + np.ceil(np.linalg.norm(ahead - corners, axis=1) * PIECES).astype(int)
        edge = np.repeat(np.arange(len(corners)), count)
        step = (np.arange(edge.size) - np.repeat(np.cumsum(count) - count, count))[:, None]
        each = ((ahead - corners) / count[:, None])[edge]
        begin = corners[edge] + step * each
        x, y, end = begin[:, 0] + 0.5 * each[:, 0], begin[:, 1], begin[:, 1] + each[:, 1]
        border = np.maximum(np.floor(y), np.floor(end))  # between two rows, where a piece lies in both
        first = np.where(np.floor(y) == np.floor(end), end, border)
        for row, rise in ((np.floor(y), first - y), (np.floor(end), end - first)):
            inside = (row >= 0) & (row < h) & (rise != 0)
            column = np.clip(x[inside], 0.0, w)
            cell = (row[inside] * (w + 2) + np.floor(column)).astype(int)
            left = rise[inside] * (1.0 - column % 1.0)
            total += np.bincount(cell, left, total.size) + np.bincount(cell + 1, rise[inside] - left, total.size)
    return np.abs(np.cumsum(total.reshape(h, w + 2), axis=1)[:, :w]).astype(np.float32)
