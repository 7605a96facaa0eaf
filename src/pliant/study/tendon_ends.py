"""Where tendons end along a body, from how far each draws the stations to its side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

Array = np.ndarray
LOWEST = 0.05  # of the highest station: below it a station does not show where a tendon ends
APART = 0.02  # of the highest station: stations closer than this show one end
MOST_FITS = 100  # of a round: more pairs take minutes
POOR = 0.02  # squared error, over that of no bend, above which a fit is poor
BETTER = 0.97  # squared error with another end over that before, at most
EVALUATIONS, MOST_EVALUATIONS = 30, 600
STIFF, MOST_STIFF = 7.0, 15.0  # logarithm of stiffnesses, tendons' over body's: at the start and at most


def even_bend(height: Array, begin: float | Array, end: float | Array) -> Array:
    """Return the small sideways displacements [m] of points at the heights (S,) [m] along the base tangent, for a body
    with a curvature of 1/m between the heights `begin` and `end` [m], or arrays (E, 1) of them, that is straight
    elsewhere.
    """
    bent = np.clip(height, begin, end) - begin
    return np.asarray(bent * (height - begin - 0.5 * bent))


def end_of_bend(gain: Array, height: Array) -> tuple[float, float]:
    """Return the azimuth [degrees] of a tendon, and the height [m] at which it ends.

    A tendon is assumed to bend the body towards itself, evenly from the base to one of the stations, and to leave it
    straight beyond. The end is the station with which this best explains the displacements of all stations.

    Parameters
    ----------
    gain : array (S, 2)
        Displacement of each station across the base tangent, per unit of the input [m per unit].
    height : array (S,)
        Height of each station along the base tangent at rest [m].
    """
    ends = np.sort(height[height > LOWEST * np.nanmax(height)])
    shapes = even_bend(height, 0.0, ends[:, None])  # (E, S)
    measured = np.isfinite(gain).all(axis=1) & np.isfinite(height)
    curvature = shapes[:, measured] @ gain[measured] / (shapes[:, measured] ** 2).sum(axis=1)[:, None]  # (E, 2)
    squared_error = ((gain[measured] - shapes[:, measured, None] * curvature[:, None]) ** 2).sum(axis=(1, 2))
    best = int(np.argmin(squared_error))
    towards = curvature[best]
    return float(np.degrees(np.arctan2(towards[1], towards[0])) % 360.0), float(ends[best])


@dataclass(frozen=True)
class HeldTendons:
    """Displacements that tendons of given length cause, each while all others are held.

    The body is a chain of parts, from the base and from each possible end to the next, of which each bends evenly, with
    a stiffness. A tendon runs from the base to its end, and its tension is proportional to what its input takes in less
    what the bend of the parts gives. Held tendons that run farther thus keep the body straight beyond the end of the
    one that is pulled, or bend it back.

    Attributes
    ----------
    gains : array (C, S, 2)
        Measured displacement of S stations across the base tangent, per unit of C inputs [m per unit].
    heights : array (S,)
        Heights of the stations along the base tangent at rest, m.
    edges : array (E + 1,)
        Height of the base, 0, and of E possible ends, m.
    """

    gains: Array
    heights: Array
    edges: Array

    def displacements(self, x: Array, ends: Sequence[int]) -> Array:
        """Return the modelled gains (C, S, 2) for the values `x`: azimuths (C,) [rad], bends (C,) [1/m per unit] with
        which a body without other tendons would follow each input, and the logarithm of the tendons' stiffness over the
        body's. `ends` holds the number of parts along which each tendon runs.
        """
        count, parts = len(self.gains), np.diff(self.edges)
        runs = np.arange(parts.size) < np.array(ends)[:, None]
        towards = np.stack([np.cos(x[:count]), np.sin(x[:count])], axis=-1)
        taken = ((runs * parts)[..., None] * towards[:, None]).reshape(count, -1)  # in, by the bend of each part
        stiffness, ratio = np.repeat(parts, 2), np.exp(np.clip(x[-1], -MOST_STIFF, MOST_STIFF)) / self.edges[-1]
        pulled = taken.T * (x[count:-1] * (1.0 + ratio * self.edges[list(ends)]))
        bends = np.linalg.solve(np.diag(stiffness) + ratio * taken.T @ taken, pulled).T.reshape(count, -1, 2)
        begins, stops = self.edges[:-1, None], self.edges[1:, None]
        return np.einsum("es,ced->csd", even_bend(self.heights, begins, stops), bends)

    def fit(self, x: Array, ends: Sequence[int], evaluations: int = EVALUATIONS) -> tuple[float, Array]:
        """Return the least squared error, over that of no bend, and the values of `displacements` there."""
        from scipy.optimize import least_squares

        measured, size = np.isfinite(self.gains), np.sqrt(np.nansum(self.gains**2))
        best = least_squares(lambda x: ((self.displacements(x, ends) - self.gains) / size)[measured], x,
                             max_nfev=evaluations)  # fmt: skip
        return 2.0 * float(best.cost), best.x

    def ends(self, known: Sequence[float | None]) -> tuple[Array, Array]:
        """Return the azimuths (C,) [rad] and heights (C,) [m] at which the tendons end. `known` holds the stated
        heights.

        Of two descents, one begins with stiff tendons that all run to the last end, one with soft tendons that end
        where `end_of_bend` finds it. In each, the end is moved that improves the fit most or, where none does by 3 %
        and the fit is poor, the ends of two tendons are.
        """
        heights = np.where(np.isfinite(self.gains).all(axis=2), self.heights, -np.inf)
        far = self.gains[np.arange(len(self.gains)), np.argmax(heights, axis=1)]
        bend = 2.0 * np.linalg.norm(far, axis=1) / self.edges[-1] ** 2
        alone = [end_of_bend(gain, self.heights) for gain in self.gains]
        stiff = np.array([*np.arctan2(far[:, 1], far[:, 0]), *bend, STIFF])
        soft = np.array([*np.radians([azimuth for azimuth, _ in alone]), *bend, -STIFF])
        farthest, apart = [self.edges[-1]] * len(far), [end for _, end in alone]
        descents = (self.descent(stiff, self.parts_up_to(farthest, known), known),
                    self.descent(soft, self.parts_up_to(apart, known), known))  # fmt: skip
        _, x, ends = min(descents, key=lambda one: one[0])
        return x[: len(ends)], self.edges[ends]

    def parts_up_to(self, guesses: Sequence[float], known: Sequence[float | None]) -> list[int]:
        """Return the number of parts along which each tendon runs: up to its known end [m] or, without one, to that of
        `guesses` [m].
        """
        stops = [guess if stated is None else stated for guess, stated in zip(guesses, known, strict=True)]
        return [1 + int(np.argmin(np.abs(self.edges[1:] - stop))) for stop in stops]

    def descent(
        self, start: Array, ends: list[int], known: Sequence[float | None],
    ) -> tuple[float, Array, list[int]]:
        """Return the error, the values of `displacements` and the ends to which single moves of ends, or pairs of them,
        lead from `ends`.
        """
        error, moves = self.fit(start, ends)[0], 1
        while moves == 1 or (moves == 2 and error > POOR):
            tried = self.moved(ends, known, moves)
            if len(tried) > MOST_FITS:
                break
            fits = [(self.fit(start, other)[0], other) for other in tried]
            least = min(fits, default=(error, ends))
            if least[0] < BETTER * error:
                (error, ends), moves = least, 1
            else:
                moves += 1
        return (*self.fit(start, ends, MOST_EVALUATIONS), ends)

    def moved(self, ends: Sequence[int], known: Sequence[float | None], moves: int) -> list[list[int]]:
        """Return the ends with those of `moves` tendons that are not known moved to others."""
        parts = range(1, self.edges.size)
        free = [k for k, at in enumerate(known) if at is None]
        changes = [dict(zip(few, others, strict=True)) for few in combinations(free, moves)
                   for others in product(*([e for e in parts if e != ends[k]] for k in few))]  # fmt: skip
        return [[change.get(k, end) for k, end in enumerate(ends)] for change in changes]


def ends_of_held_tendons(gains: Array, heights: Array, known: Sequence[float | None]) -> list[tuple[float, float]]:
    """Return azimuth [degrees] and end [m] of C tendons that inputs pull to given lengths, as `HeldTendons` finds them.

    Parameters
    ----------
    gains : array (C, S, 2)
        Displacement of each station across the base tangent, per unit of each input [m per unit].
    heights : array (S,)
        Height of each station along the base tangent at rest [m].
    known : sequence of float or None
        Stated end of each tendon, m.

    Returns
    -------
    list of (float, float)
        For an input that never moves: 0 degrees and the highest end.
    """
    ends = [0.0]
    for height in np.sort(heights[np.isfinite(heights)]):
        if height > max(LOWEST * np.nanmax(heights), ends[-1] + APART * np.nanmax(heights)):
            ends.append(float(height))
    moving = np.nansum(gains**2, axis=(1, 2)) > 0.0  # an input that never moves shows nothing
    rows = np.column_stack([np.zeros(len(gains)), np.full(len(gains), ends[-1])])
    if moving.any():
        stated = [end for end, moves in zip(known, moving, strict=True) if moves]
        azimuths, stops = HeldTendons(gains[moving], heights, np.array(ends)).ends(stated)
        rows[moving] = np.column_stack([np.degrees(azimuths) % 360.0, stops])
    return [(float(azimuth), float(end)) for azimuth, end in rows]
