"""Track the centreline of the body's silhouette in every frame of a video."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pliant.errors import InputError
from pliant.video.follow import Follower
from pliant.video.reel import Reel
from pliant.video.stillness import Stillness
from pliant.video.surroundings import Surroundings, surroundings

Array = np.ndarray
FIRST = 10  # number of frames that determine the base
TRIED = 120  # most frames that are searched for the base


def follow_silhouette(
    reel: Reel, base: tuple[float, float] | None = None
) -> Iterator[tuple[float, Array, Array | None]]:
    """Yield time [s], picture and centreline (S, 2) [pixels], base to tip, of each frame; None where hidden.

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
        found = follow(picture)
        yield time, picture, None if found is None else found.line
    still.refuse()


def base_of(reel: Reel, around: Surroundings) -> Array:
    """Return the position of the base (2,) [pixels], the median over the first frames, as the base does not move."""
    follow, found = Follower(around), []
    for tried, (_, picture) in enumerate(reel.frames(), 1):
        ribbon = follow(picture)
        if ribbon is not None:
            found.append(ribbon.line[0])
        if len(found) == FIRST or tried == TRIED:
            break
    if not found:
        raise InputError(
            f"{reel.path.name}: no whole body was found in the first {TRIED} frames: no object has two clear edges "
            "against the background from one end to the other; give the position of its base by --base, or put a "
            "plain sheet behind it"
        )
    return np.asarray(np.median(found, axis=0))


