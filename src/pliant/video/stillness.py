"""Check that the camera does not move, by small patches of the background beside the body."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.recording.camera import opencv
from pliant.video.reel import Reel
from pliant.video.surroundings import Surroundings

Array = np.ndarray
PATCHES, HALF = 12, 12  # number of patches, and pixels from the centre of each to its border
MOST = 1.5  # pixels; smaller shifts are noise or vibration
SHARE = 0.02  # fraction of frames that may show larger shifts, as when a hand covers the patches


class Stillness:
    """Shift of the picture in each frame, by least squares on the grey levels of patches; see `refuse`."""

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
        found = []
        for where, patch, solve in self.patches:
            grey = self.cv2.cvtColor(picture[where], self.cv2.COLOR_BGR2GRAY).astype(np.float32)
            found.append(solve @ (patch - self.cv2.GaussianBlur(grey, (0, 0), 1.5)).ravel())
        if found:
            self.shifts.append(float(np.hypot(*np.median(found, axis=0))))

    def refuse(self) -> None:
        """Raise InputError where the camera moved in more than 2 % of the frames."""
        shifts = np.array(self.shifts)
        if len(shifts) and (shifts > MOST).mean() > SHARE:
            raise InputError(
                f"{self.reel.path.name}: the camera moves by {np.quantile(shifts, 0.98):.1f} pixels or more in "
                f"{int((shifts > MOST).sum())} of {len(shifts)} frames: fix it to a stand and film again"
            )
