"""Track the centreline of the body's silhouette in every frame of a video, and check that the camera stands still."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pliant.errors import InputError
from pliant.recording.camera import opencv
from pliant.video.follow import Follower
from pliant.video.reel import Reel
from pliant.video.surroundings import Surroundings, surroundings

Array = np.ndarray
FIRST = 10  # number of frames that determine the base
TRIED = 120  # most frames that are searched for the base
PATCHES, HALF = 12, 12  # number of patches, and pixels from the centre of each to its border
MOST_SHIFT = 1.5  # pixels; smaller shifts are noise or vibration
MOST_SHIFTED = 0.02  # fraction of frames that may show larger shifts, as when a hand covers the patches


def follow_silhouette(
    reel: Reel, base: tuple[float, float] | None = None
) -> Iterator[tuple[float, Array, Array | None]]:
    """Track the silhouette of a body: yield the time [s], the picture and S points (S, 2) [pixels] of the centreline,
    base to tip, for each frame. The points are None where the body is hidden.

    Parameters
    ----------
    reel : Reel
    base : (x, y), pixels, optional
        Position of the base. Default: the end of the body that does not move.

    Raises
    ------
    InputError
        When no body is found, or the camera moves.
    """
    around = surroundings(reel)
    first = np.array(base, float) if base is not None else base_of(reel, around)
    follow, still = Follower(around, first), Stillness(around, reel)
    for time, picture in reel.frames():
        still(picture)
        body = follow(picture)
        yield time, picture, None if body is None else body.line
    still.refuse()


def base_of(reel: Reel, around: Surroundings) -> Array:
    """Return the position (2,) [pixels] of the body's base in the picture: the median over the first frames."""
    follow, candidates = Follower(around), []
    for tried, (_, picture) in enumerate(reel.frames(), 1):
        ribbon = follow(picture)
        if ribbon is not None:
            candidates.append(ribbon.line[0])
        if len(candidates) == FIRST or tried == TRIED:
            break
    if not candidates:
        raise InputError(
            f"{reel.path.name}: no whole body was found in the first {TRIED} frames, as no object has two clear edges "
            "against the background from one end to the other: give the position of the body's base by --base, or put "
            "a plain sheet behind the body"
        )
    return np.asarray(np.median(candidates, axis=0))


class Stillness:
    """Test for a moving camera. It measures the shift [pixels] of each frame of a video against the background."""

    def __init__(self, around: Surroundings, reel: Reel) -> None:
        self.cv2 = opencv("tracking a video")
        self.reel, self.shifts = reel, list[float]()
        grey = self.cv2.cvtColor(around.background, self.cv2.COLOR_BGR2GRAY)
        free = self.cv2.resize((~around.reach).astype(np.uint8), grey.shape[::-1], interpolation=self.cv2.INTER_NEAREST)
        free[: 2 * HALF], free[-2 * HALF :], free[:, : 2 * HALF], free[:, -2 * HALF :] = 0, 0, 0, 0
        corners = self.cv2.goodFeaturesToTrack(grey, PATCHES, 0.02, 4 * HALF, mask=free, blockSize=7)
        self.patches = [] if corners is None else [self._patch(grey, c) for c in corners[:, 0].astype(int)]

    def _patch(self, grey: Array, middle: Array) -> tuple[tuple[slice, slice], Array, Array]:
        x, y = middle
        where = np.s_[y - HALF : y + HALF + 1, x - HALF : x + HALF + 1]
        patch = self.cv2.GaussianBlur(grey[where].astype(np.float32), (0, 0), 1.5)
        slope = np.stack([g.ravel() for g in np.gradient(patch)[::-1]])
        return where, patch, np.linalg.pinv(slope @ slope.T, rcond=0.02) @ slope

    def __call__(self, picture: Array) -> None:
        """Measure the shift of the next frame."""
        shapes = []
        for where, patch, solve in self.patches:
            grey = self.cv2.cvtColor(picture[where], self.cv2.COLOR_BGR2GRAY).astype(np.float32)
            shapes.append(solve @ (patch - self.cv2.GaussianBlur(grey, (0, 0), 1.5)).ravel())
        if shapes:
            self.shifts.append(float(np.hypot(*np.median(shapes, axis=0))))

    def refuse(self) -> None:
        """Raise InputError where the camera moved in more than 2 % of the frames of the video."""
        shifts = np.array(self.shifts)
        if len(shifts) and (shifts > MOST_SHIFT).mean() > MOST_SHIFTED:
            raise InputError(
                f"{self.reel.path.name}: the camera moves by {np.quantile(shifts, 0.98):.1f} pixels or more in "
                f"{int((shifts > MOST_SHIFT).sum())} of {len(shifts)} frames: fix it to a stand and film again"
            )
