"""Determine the colour of the body and the picture of the background in a video, from a few scaled-down frames.

The body is what moves. Its colour is therefore the colour that many pixels take at some time and the surroundings do
not have. The background of a pixel is its colour while the body is elsewhere. Where the body never leaves, at its base,
the background is filled in from neighbouring pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.recording.camera import opencv
from pliant.video.reel import Reel

Array = np.ndarray
SAMPLES, SMALL = 32, 480  # number of frames, and width of the small pictures in pixels
BINS = 16  # histogram bins per colour channel
LEAST_MOTION, NOISES = 14.0, 8.0  # least change of a moving pixel: levels, and times the noise
MOST_SHAKE = 1.5  # pixels
LEAST_AREA = 4e-4  # of the picture
LEAST_CONTRAST = 6.0  # between body and background, in standard deviations of the noise
ROUGH_COLOUR = 12.0  # levels: codecs keep a colour's hue more coarsely than its lightness
NEAR = 0.35  # of the contrast of body and background: values of a pixel that close are equal


@dataclass(frozen=True)
class Surroundings:
    """Colour of the body and picture of the background in a video, by which the pixels of the body are recognised.

    Attributes
    ----------
    weight : array (3,)
        Weights that map a colour to a lightness in which body and background differ most. The lightness of the body
        minus that of the background is 1.
    body : float
        Lightness of the body.
    background : array (H, W, 3), uint8
        The background at full size.
    small : array (h, w, 3), float32
        The background, scaled down.
    scale : float
        Pixels of the video per pixel of the small picture.
    always, reach : arrays (h, w) of bool
        Masks of the pixels that the body always covers, and of those that it may cover.
    """

    weight: Array
    body: float
    background: Array
    small: Array
    scale: float
    always: Array
    reach: Array


def surroundings(reel: Reel) -> Surroundings:
    """Determine the colour of the body and the background picture of a video, by which the pixels of the body are
    recognised.

    Raises
    ------
    InputError
        When the camera moves, nothing moves, or body and background look alike.
    """
    cv2 = opencv("tracking a video")
    stack = reel.sampled(SAMPLES, min(SMALL, reel.width))
    refuse_moving_camera(stack, reel)
    middle = np.partition(stack, len(stack) // 2, axis=0)[len(stack) // 2]
    moving, noise = moving_pixels(stack, middle, reel)
    body = commonest(stack, moving)
    weight = discriminant(middle, moving, body, noise, reel)
    behind, always = _background(stack, middle, body, weight, moving)
    scale = reel.width / stack.shape[2]
    reach = cv2.dilate((moving | always).astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    large = _large_background(reel, behind, weight, reach)
    return Surroundings(weight, float(body @ weight), large, behind, scale, always, reach)


def refuse_moving_camera(stack: Array, reel: Reel) -> None:
    """Raise InputError where most corners in the sampled pictures `stack` of a video move, which means that the camera
    moves.
    """
    cv2 = opencv("tracking a video")
    grey = [cv2.cvtColor(p, cv2.COLOR_BGR2GRAY) for p in stack]
    corners = cv2.goodFeaturesToTrack(grey[0], 60, 0.02, 12)
    if corners is None:
        return
    moved = []
    for other in grey[1:]:
        there, tracked, _ = cv2.calcOpticalFlowPyrLK(grey[0], other, corners, None)
        went = np.linalg.norm(there - corners, axis=2)[tracked[:, 0] == 1]
        if went.size:
            moved.append(float(np.quantile(went, 0.25)) * reel.width / stack.shape[2])
    if np.median(moved) > MOST_SHAKE:
        raise InputError(
            f"{reel.path.name}: the camera moves by up to {max(moved):.0f} pixels: fix it to a stand and film again"
        )


def moving_pixels(stack: Array, middle: Array, reel: Reel) -> tuple[Array, float]:
    """Return a mask (h, w) of the pixels whose colour changes in the sampled pictures `stack` of a video, and the noise
    in grey levels.
    """
    cv2 = opencv("tracking a video")
    change = [cv2.absdiff(picture, middle) for picture in stack]
    noise = 1.4826 * float(np.median([c[::4, ::4] for c in change]))
    most = np.max(change, axis=0).max(axis=2)
    moving = cv2.morphologyEx(
        (most > max(LEAST_MOTION, NOISES * noise)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    ).astype(bool)
    if moving.mean() < LEAST_AREA:
        raise InputError(
            f"{reel.path.name}: no motion found above the change of brightness: {100 * moving.mean():.2g} % of the "
            f"picture changes by more than {max(LEAST_MOTION, NOISES * noise):.0f} of 255 levels; lock the camera's "
            "exposure and check the contrast between body and background"
        )
    return moving, max(noise, 0.5)


def commonest(stack: Array, moving: Array) -> Array:
    """Return the colour (3,) of the body in a video. Among the pixels that change, most take this colour at some time;
    it is rare in the pixels around them, which do not change.
    """
    cv2 = opencv("tracking a video")
    crossed = _binned(stack[:, moving])
    ordered = np.sort(crossed, axis=0)
    new = np.diff(ordered, axis=0, prepend=-1) > 0
    weight = np.bincount(ordered[new], minlength=BINS**3).astype(float)  # pixels that take a colour at some time
    counts = np.array([_blurred(np.bincount(c, minlength=BINS**3)) for c in crossed])
    weight *= np.quantile(counts, 0.2, axis=0) > 0.3 * counts.mean(axis=0)  # in nearly every frame: no hand that passes
    around = cv2.dilate(moving.astype(np.uint8), np.ones((25, 25), np.uint8)).astype(bool) & ~moving
    rest = np.bincount(_binned(stack[0][around if around.any() else ~moving]), minlength=BINS**3)
    score = _blurred(weight / crossed.shape[1]) - 1.5 * _blurred(rest / max(1, rest.sum()))
    best = int(score.argmax())
    middle = (np.array([best // BINS**2, best // BINS % BINS, best % BINS]) + 0.5) * (256.0 / BINS)
    colours = stack[:, moving].reshape(-1, 3).astype(np.float32)
    for reach in (40.0, 30.0, 25.0):
        near = np.linalg.norm(colours - middle, axis=1) < reach
        middle = colours[near].mean(axis=0) if near.any() else middle
    return np.asarray(middle, np.float32)


def _binned(colours: Array) -> Array:
    """Return the index of the histogram bin of each colour (..., 3), uint8."""
    bins = colours.astype(np.int32) * BINS // 256
    return np.asarray((bins[..., 0] * BINS + bins[..., 1]) * BINS + bins[..., 2])


def _blurred(histogram: Array) -> Array:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(histogram.astype(float).reshape((BINS,) * 3), 0.8, mode="nearest").ravel())


def discriminant(middle: Array, moving: Array, body: Array, noise: float, reel: Reel) -> Array:
    """Return weights (3,) of blue, green and red for which the weighted sums of body and background colour differ most
    relative to the noise. The sums differ by 1.
    """
    cv2 = opencv("tracking a video")
    around = cv2.dilate(moving.astype(np.uint8), np.ones((15, 15), np.uint8)).astype(bool)
    colours = middle[around].astype(np.float32)  # what passes by, a hand or a mark, is no background
    far = np.linalg.norm(colours - body, axis=1) > 35.0
    if far.sum() < 30:
        far = np.linalg.norm(colours - body, axis=1) > 12.0
    rest = colours[far] if far.sum() > 30 else colours
    scatter = np.cov(rest.T) + 0.02 * np.outer(body, body) + np.eye(3) * max(noise, ROUGH_COLOUR) ** 2
    weight = np.linalg.solve(scatter, body - rest.mean(axis=0))
    contrast = float(weight @ (body - rest.mean(axis=0)))
    grain = noise * float(np.linalg.norm(weight)) / contrast
    if 1.0 / grain < LEAST_CONTRAST:
        raise InputError(
            f"{reel.path.name}: body and background differ by only {1.0 / grain:.1f} times the noise, but "
            f"{LEAST_CONTRAST:g} are needed: put a darker or lighter sheet behind the body, or more light on it"
        )
    return np.asarray(weight / contrast, np.float32)


def _background(stack: Array, middle: Array, body: Array, weight: Array, moving: Array) -> tuple[Array, Array]:
    """Return the small picture (h, w, 3) without the body, and the mask of pixels that the body always covers."""
    cv2 = opencv("tracking a video")
    light = np.array([cv2.transform(p.astype(np.float32), weight[None]) for p in stack])
    free = light < float(body @ weight) - 0.4
    crossed, there, colours = light[:, moving], free[:, moving], stack[:, moving].astype(np.float32)
    ordered = np.sort(np.where(there, crossed, np.inf), axis=0)
    usual = ordered[there.sum(axis=0) // 2, np.arange(ordered.shape[1])]  # the middle one of those without the body
    same = (there & (np.abs(crossed - usual) < NEAR))[..., None]
    mean = (colours * same).sum(axis=0) / np.maximum(same.sum(axis=0), 1)
    behind = middle.astype(np.float32)
    behind[moving] = np.where(same.any(axis=0), mean, behind[moving])
    always = _always(~free, moving)
    hole = cv2.dilate(always.astype(np.uint8), np.ones((5, 5), np.uint8))
    filled = cv2.inpaint(behind.astype(np.uint8), hole, 3.0, cv2.INPAINT_TELEA)
    return np.where(hole[..., None] > 0, filled, behind).astype(np.float32), always


def _always(bodily: Array, moving: Array) -> Array:
    """Return the mask (h, w) of pixels that the body always covers, connected to it in most frames (K, h, w)."""
    from scipy.ndimage import binary_fill_holes

    cv2 = opencv("tracking a video")
    count, label = cv2.connectedComponents(bodily.all(axis=0).astype(np.uint8))
    together = np.zeros(count)
    for frame in bodily:
        parts = cv2.connectedComponents(frame.astype(np.uint8))[1]
        inside = np.bincount(parts[frame & moving])
        if inside.size:
            together[np.unique(label[parts == inside.argmax()])] += 1.0
    boundaries = np.flatnonzero(together[1:] > 0.7 * len(bodily)) + 1
    return np.asarray(binary_fill_holes(np.isin(label, boundaries)))


def _large_background(reel: Reel, small: Array, weight: Array, reach: Array) -> Array:
    """Return the background (H, W, 3), uint8, at full size: the mean of the frames that do not show the body."""
    cv2 = opencv("tracking a video")
    guess = cv2.resize(small, (reel.width, reel.height), interpolation=cv2.INTER_LINEAR)
    x, y, w, h = cv2.boundingRect(reach.astype(np.uint8))
    scale = reel.width / small.shape[1]
    box = np.s_[int(y * scale) : int((y + h) * scale) + 1, int(x * scale) : int((x + w) * scale) + 1]
    part, row = np.ascontiguousarray(guess[box]), weight[None]
    level, total, count = cv2.transform(part, row), np.zeros_like(part), np.zeros(part.shape[:2], np.float32)
    ones = np.ones_like(count)
    for number, picture in enumerate(reel.pictures(SAMPLES)):
        if not number:
            guess[:] = picture
        now = np.ascontiguousarray(picture[box], np.float32)
        near = (cv2.absdiff(cv2.transform(now, row), level) < NEAR).astype(np.uint8)
        cv2.accumulate(now, total, near)
        cv2.accumulate(ones, count, near)
    guess[box] = np.where(count[..., None] > 0, total / np.maximum(count, 1.0)[..., None], part)
    return np.asarray(guess + 0.5, np.uint8)
