"""The middle of the body's silhouette in every frame of a film."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pliant.errors import InputError
from pliant.video.follow import Follower
from pliant.video.reel import Reel
from pliant.video.stillness import Stillness
from pliant.video.surroundings import Surroundings, surroundings

Array = np.ndarray
FIRST = 10  # frames that say where the base is
TRIED = 120  # frames in which it is looked for


def follow_silhouette(
    reel: Reel, base: tuple[float, float] | None = None
) -> Iterator[tuple[float, Array, Array | None]]:
    """Time [s], picture and points (S, 2) [pixels] from base to tip of each frame; None where the body is hidden.

    Parameters
    ----------
    reel : Reel
    base : (x, y), pixels, optional
        Where the body begins. Default: where its colour ends at the end that does not move.

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
    """Return where the body begins, (2,) pixels: the median over some frames, since it stands still."""
    follow, found = Follower(around), []
    for tried, (_, picture) in enumerate(reel.frames(), 1):
        ribbon = follow(picture)
        if ribbon is not None:
            found.append(ribbon.line[0])
        if len(found) == FIRST or tried == TRIED:
            break
    if not found:
        raise InputError(
            f"{reel.path.name}: no body is seen whole in the first {TRIED} frames: nothing there has two clear edges "
            "before its background from one end to the other; say where it begins by --base, or put a sheet behind it"
        )
    return np.asarray(np.median(found, axis=0))


