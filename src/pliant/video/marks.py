"""Track marks on the body in every frame of a video: dots of one colour, or ArUco markers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.camera import marker_finders, opencv
from pliant.video.reel import Reel

Array = np.ndarray
Frame = tuple[float, Array, Array | None]
Region = tuple[float, float, float, float]  # pixels: left, top, right, bottom
HALF_COLOUR = 0.4  # fraction of the dots' colour from which a pixel belongs to a dot
LEAST_PIXELS = 9
ROUND = (0.68, 0.88)  # fraction of its bounding box that a disc fills, in pixels
MASS = (0.6, 1.6)  # accepted size relative to a dot's usual size
BLURRED = 0.35  # accepted size of a dot that moves by more than its width per frame
NEARER, FARTHER = 0.75, 1.2  # accepted distance of the next dot relative to its usual distance
MOST_TURN = 1.2  # rad: accepted turn of the direction from dot to dot
FIRST = 30  # number of first frames, one of which must show all marks
APART = 2.5  # times the usual spacing: a mark farther away is not on the same body
COLOURED = 40.0  # least difference of a dot's colour from grey, in levels


def chain(points: Array) -> Array:
    """Return the indices (M,) of M points (M, 2) in their order along the body: from one end, each followed by the
    nearest remaining point.
    """
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    order = [int(apart.max(axis=1).argmax())]
    while len(order) < len(points):
        left = [k for k in range(len(points)) if k not in order]
        order.append(left[int(apart[order[-1], left].argmin())])
    return np.array(order)


class Dots:
    """Detector of coloured dots in a picture, which locates their centres to a fraction of a pixel."""

    def __init__(self, colour: tuple[float, float, float], region: Region | None = None) -> None:
        self.region = region
        self.cv2: Any = opencv("tracking a video")
        away = np.array(colour) - np.mean(colour)
        if np.linalg.norm(away) < COLOURED:
            raise InputError(f"the colour {hexadecimal(colour)} of the dots is nearly grey: use dots of a more "
                             "saturated colour")
        self.weight = (away / (away @ away)).astype(np.float32)[None]

    def all(self, picture: Array, *, round_ones: bool = False) -> tuple[Array, Array]:
        """Return the centres (N, 2) [pixels] and masses (N,) (sums of colour weights) of N regions of the dots' colour
        in a picture; with `round_ones` only of round regions.
        """
        share = self.cv2.transform(picture.astype(np.float32), self.weight)
        count, label, facts, _ = self.cv2.connectedComponentsWithStats((share > HALF_COLOUR).astype(np.uint8))
        frames = []
        for k in range(1, count):
            x, y, w, h, area = facts[k]
            disc = ROUND[0] < area / (w * h) < ROUND[1] and w < 1.6 * h < 2.6 * w
            if area < LEAST_PIXELS or (round_ones and not disc):
                continue
            height, width = label.shape
            part = np.s_[max(0, y - 2) : min(height, y + h + 2), max(0, x - 2) : min(width, x + w + 2)]
            other = (label[part] != k) & (label[part] != 0)
            mass = np.where(other, 0.0, np.clip(share[part] - 0.2, 0.0, None))
            rows, columns = np.mgrid[part]
            frames.append(((mass * columns).sum() / mass.sum(), (mass * rows).sum() / mass.sum(), mass.sum()))
        markers = np.array(frames).reshape(-1, 3)
        if self.region is not None:
            left, top, right, bottom = self.region
            x, y = markers[:, 0], markers[:, 1]
            markers = markers[(x >= left) & (x <= right) & (y >= top) & (y <= bottom)]
        return markers[:, :2], markers[:, 2]


def follow_dots(
    reel: Reel, colour: tuple[float, float, float], count: int | None = None, region: Region | None = None,
) -> tuple[list[str], Iterator[Frame]]:
    """Track M coloured dots on a body: return an iterator that yields time [s], picture and dot centres (M, 2) [pixels]
    of each frame. Also return sentences on marks that were left out.

    The dots are in order along the body, with NaN where one is hidden.

    Parameters
    ----------
    count : int, optional
        Number of dots on the body; marks of that colour elsewhere are then left out.
    region : left, top, right, bottom, pixels, optional
        Part of the picture in which dots are searched.

    Raises
    ------
    InputError
        When fewer than two dots of that colour are found, a number other than `count`, or, without `count`, marks away
        from the others.
    """
    dots = Dots(colour, region)
    start, usual, findings = _first_dots(reel, dots, colour, count)
    return findings, _dots_by_frame(reel, dots, start, usual)


def _dots_by_frame(reel: Reel, dots: Dots, place: Array, usual: Array) -> Iterator[Frame]:
    follow = ChainOfDots(place, usual)
    for time, picture in reel.frames():
        yield time, picture, follow(*dots.all(picture))


class ChainOfDots:
    """Tracker of the M dots (M, 2) [pixels] on a body from frame to frame, which starts each search at the slowest dot
    and proceeds to its neighbours.

    The slowest dot is searched near its expected position, within a reach that grows with its speed and with the frames
    since it was last seen. Each neighbour is then searched from the dot found before, at the known distance and in the
    last known direction. The body may therefore move by several dot spacings from frame to frame.
    """

    def __init__(self, place: Array, mass: Array) -> None:
        self.place, self.mass = place, mass
        self.step = np.zeros_like(place)
        self.gap = np.zeros(len(place))  # frames since each dot was seen
        self.travel = np.zeros(len(place))  # pixels, all steps together
        self.spacing = np.linalg.norm(np.diff(place, axis=0), axis=1)

    def __call__(self, centres: Array, masses: Array) -> Array:
        """Return the dots (M, 2), NaN where one is hidden, among centres (N, 2) of the given masses (N,)."""
        chosen = self._from_slowest(centres, masses) if len(centres) else np.full(len(self.place), -1)
        matched = chosen >= 0
        positions = np.full_like(self.place, np.nan)
        positions[matched] = centres[chosen[matched]]
        steady = matched & (self.gap == 0)  # a step over a gap is no speed
        self.step = np.where(steady[:, None], positions - self.place, 0.0)
        self.travel += np.linalg.norm(self.step, axis=1)
        self.place = np.where(matched[:, None], positions, self.place)
        self.gap = np.where(matched, 0, self.gap + 1)
        return positions

    def _from_slowest(self, centres: Array, masses: Array) -> Array:
        """Return the index of the centre (M,) of each dot, -1 where hidden, starting from the slowest dot."""
        best = np.full(len(self.place), -1)
        for start in np.argsort(self.travel, kind="stable").tolist():
            k = self._nearest(start, centres, masses)
            if k < 0:
                continue
            chosen = np.full(len(self.place), -1)
            chosen[start] = k
            for way in (1, -1):
                self._along(chosen, start, way, centres, masses)
            if (chosen >= 0).sum() > (best >= 0).sum():
                best = chosen
            if (best >= 0).sum() > 0.5 * len(best):
                break
        return best

    def _nearest(self, dot: int, centres: Array, masses: Array) -> int:
        """Return the index of the centre nearest to the expected position of a dot, -1 where none is within reach."""
        apart = np.linalg.norm(centres - self.place[dot] - self.step[dot], axis=1)
        reach = (1.0 + self.gap[dot]) * (0.5 * self.spacing.min() + float(np.linalg.norm(self.step[dot])))
        apart[~self._alike(dot, masses) | (apart >= reach)] = np.inf
        k = int(apart.argmin())
        return k if np.isfinite(apart[k]) else -1

    def _along(self, chosen: Array, start: int, way: int, centres: Array, masses: Array) -> None:
        """Fill `chosen` to one side of dot `start`: each dot takes the centre at the known distance from the last."""
        last, turn = start, 0.0
        dot = start + way
        while 0 <= dot < len(chosen):
            apart = float(self.spacing[min(last, dot) : max(last, dot)].sum())
            before = self.place[dot] - self.place[last]
            offset = centres - centres[chosen[last]]
            far = np.linalg.norm(offset, axis=1)
            turned = np.arctan2(offset[:, 1], offset[:, 0]) - np.arctan2(before[1], before[0]) - turn
            turned = (turned + np.pi) % (2.0 * np.pi) - np.pi
            good = (far > NEARER * apart) & (far < FARTHER * apart) & (np.abs(turned) < MOST_TURN)
            good &= self._alike(dot, masses) & ~np.isin(np.arange(len(centres)), chosen)
            if good.any():
                k = int(np.where(good, np.abs(turned) + np.abs(far / apart - 1.0), np.inf).argmin())
                chosen[dot], last, turn = k, dot, turn + float(turned[k])
            dot += way

    def _alike(self, dot: int, masses: Array) -> Array:
        """Return a mask (N,) of the masses that fit a dot; a fast dot is blurred and may be smaller."""
        wide = 2.0 * np.sqrt(self.mass[dot] / np.pi)
        least = MASS[0] if np.linalg.norm(self.step[dot]) < wide and not self.gap[dot] else BLURRED
        size = masses / self.mass[dot]
        return np.asarray((size > least) & (size < MASS[1]))


def _first_dots(
    reel: Reel, dots: Dots, colour: tuple[float, float, float], count: int | None
) -> tuple[Array, Array, list[str]]:
    """Return centres and masses of the dots in order along the body, and a line about marks left out."""
    best, masses = np.empty((0, 2)), np.empty(0)
    for k, (_, picture) in enumerate(reel.frames()):
        if k == FIRST:
            break
        centres, sizes = dots.all(picture, round_ones=True)
        usual = float(np.median(sizes)) if len(sizes) else 0.0
        alike = (sizes > 0.4 * usual) & (sizes < 2.5 * usual)
        if alike.sum() > len(best):
            best, masses = centres[alike], sizes[alike]
    if len(best) < 2:
        raise InputError(
            f"{reel.path.name}: {len(best)} dots of the colour {hexadecimal(colour)} were found in its first "
            "frames, but two are needed: set colour to the colour of the dots in the picture"
        )
    body = _on_one_body(best, count)
    away = ", ".join(f"({x:.0f}, {y:.0f})" for x, y in best[~body])
    if count is None and away:
        raise InputError(
            f"{reel.path.name}: marks of the dots' colour are away from the others, at the pixels {away}: cover them, "
            "or set in [tracking] either count (number of dots on the body) or region (part of the picture to search)"
        )
    if count is not None and body.sum() != count:
        raise InputError(
            f"{reel.path.name}: {int(body.sum())} dots were found on one body, but count = {count} in [tracking]: "
            "correct colour or count, or set region to the part of the picture in which the body moves"
        )
    best, masses = best[body], masses[body]
    order = chain(best)
    return best[order], masses[order], [f"left out, not on the body: marks at the pixels {away}"] if away else []


def _on_one_body(points: Array, count: int | None) -> Array:
    """Return a mask (M,) of the points on one body: a group of `count` close neighbours, else the largest group."""
    from scipy.sparse.csgraph import connected_components

    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    nearest = np.where(np.eye(len(points), dtype=bool), np.inf, apart).min(axis=1)
    group = connected_components(apart <= APART * np.median(nearest))[1]
    sizes = np.bincount(group)
    chosen = int(np.argmax(sizes == count)) if count is not None and (sizes == count).any() else int(np.argmax(sizes))
    return np.asarray(group == chosen)


def hexadecimal(colour: tuple[float, float, float]) -> str:
    """Return a colour, given as (blue, green, red) from 0 to 255, as text ``#rrggbb``."""
    return "#" + "".join(f"{round(c):02x}" for c in reversed(colour))


def follow_aruco(reel: Reel) -> tuple[list[int], Iterator[Frame]]:
    """Track M ArUco markers on a body: return their numbers in order along the body, and an iterator that yields time
    [s], picture and marker centres (M, 2) [pixels] of each frame.

    Centres of hidden markers are NaN.

    Raises
    ------
    InputError
        When fewer than two markers are seen at once in the first frames.
    """
    finders = marker_finders(opencv("tracking a video"), "4X4_250", "5X5_250", "6X6_250", "APRILTAG_36h11")
    best: dict[int, Array] = {}
    finder = finders[0]
    for k, (_, picture) in enumerate(reel.frames()):
        if k == FIRST:
            break
        for detector in finders if not best else [finder]:
            markers = _markers(detector, picture)
            if len(markers) > len(best):
                best, finder = markers, detector
    if len(best) < 2:
        raise InputError(
            f"{reel.path.name}: {len(best)} ArUco or AprilTag markers were found in its first frames, but two are "
            "needed: a marker must be at least 20 pixels wide, with a white border"
        )
    ids = np.array(list(best))
    numbers = ids[chain(np.array(list(best.values())))].tolist()

    def frames() -> Iterator[Frame]:
        for time, picture in reel.frames():
            markers = _markers(finder, picture)
            yield time, picture, np.array([markers.get(n, np.full(2, np.nan)) for n in numbers])

    return numbers, frames()


def _markers(finder: Any, picture: Array) -> dict[int, Array]:
    """Return the centre (2,) of each marker by number: the crossing of its diagonals."""
    corners, ids, _ = finder.detectMarkers(picture)
    markers: dict[int, Array] = {}
    for quad, number in zip(corners, [] if ids is None else ids.ravel().tolist(), strict=True):
        a, b, c, d = np.asarray(quad, float).reshape(4, 2)
        along, across, between = c - a, d - b, b - a
        share = (between[0] * across[1] - between[1] * across[0]) / (along[0] * across[1] - along[1] * across[0])
        markers[number] = a + share * along
    return markers
