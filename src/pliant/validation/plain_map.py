"""A plain map from inputs to observed positions or angles: what a prediction without mechanics achieves.

The map is a polynomial of the inputs and of the same inputs behind first-order lags, fitted by least squares with a
ridge. Degree, lags, ridge, and whether the polynomial goes on beyond the training inputs or keeps its value at their
edge, are those with the smallest error on left-out training data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement
from math import comb
from typing import NamedTuple

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.numerics.ridge import Products, fits_without, products, solved, squared_error
from pliant.shapes import Float
from pliant.validation.map_inputs import InputTable, table_of

Array = np.ndarray
DEGREES = (1, 2, 3)
WORDS = ("constant", "linear", "quadratic", "cubic")
RIDGES = tuple(10.0**k for k in range(-8, 1))
TIME_CONSTANTS = 6  # in the grid, from two frames to a sixth of the longest recording
TRIED_LAGS = 3  # pairs of time constants that are tried with higher degrees, the best of the linear maps
MOST_TERMS = 300
MOST_ROWS = 3000  # of all training frames, evenly thinned
MOST_BLOCKS = 10
FEWEST_BLOCKS = 4
FEW = 3  # recordings from which on whole recordings are left out, and not blocks
BLOCK = 10.0  # length of a left-out block in times after which the motion forgets itself
LEAST_ERROR = 1e-12  # m or rad, so that an exact map has a logarithm
SIMPLER = 1.02  # error, relative to the smallest, up to which the map with the fewest terms is chosen
EDGE = 1.02  # of the range of training inputs: beyond, a frame is outside


class MapChoice(NamedTuple):
    """A polynomial of the inputs: its degree, time constants, ridge, number of terms and error on left-out data."""

    degree: int
    time_constants: tuple[float, ...]  # s
    ridge: float
    held: bool  # whether inputs beyond the range of the training inputs count as on its edge
    terms: int
    error: float  # m or rad


class PolynomialTerms(NamedTuple):
    """The terms of a polynomial of C columns, each centred and scaled by its training values."""

    middle: Array  # (C,)
    half: Array  # (C,)
    powers: tuple[tuple[int, ...], ...]  # columns of each term
    mean: Array  # (P - 1,)
    scale: Array  # (P - 1,)
    held: bool = False

    def terms(self, columns: Array) -> Array:
        """Return the P terms (N, P), the constant first, for N rows of C input values (N, C)."""
        z = (columns - self.middle) / self.half
        z = np.clip(z, -1.0, 1.0) if self.held else z
        raw = np.stack([np.ones(len(z)), *(np.prod(z[:, list(p)], axis=1) for p in self.powers)], axis=1)
        raw[:, 1:] = (raw[:, 1:] - self.mean) / self.scale
        return raw


@dataclass(frozen=True, repr=False)
class PlainMap(Shown):
    """A polynomial map from inputs to observed positions or angles, from `plain_map`.

    Attributes
    ----------
    inputs : tuple of str
        Inputs and known loads that the map uses; "" is a single input without a name.
    degree : int
        0 to 3. 0 is the mean of the training frames, where no input moves.
    time_constants : tuple of float
        Of the lags, s; none or two.
    ridge : float
    held : bool
        Whether an input, or one behind a lag, beyond the range of the training data counts as on its edge; else the
        polynomial goes on.
    left_out_error : float
        Distance [m], or difference of angles [rad], of left-out training data from the map fitted to the rest: RMS over
        blocks, or the geometric mean of the RMS of recordings. NaN if there was a single frame.
    training_error : float
        RMS for the training data themselves.
    frames : int
        Number of training frames used, after thinning.
    stations : tuple of str
    coefficients : array (P, M)
        Of the P terms for each coordinate of each station, M in all, m or rad.
    notes : tuple of str
        Sentences on inputs that never move or always move together.
    table : InputTable
        The inputs that move, and the known loads.
    basis : PolynomialTerms
        The terms, scaled by the training data.
    unit : (str, float)
        Unit in which errors are shown, "mm" or "deg", and the factor to it from m or rad.

    Raises
    ------
    InputError
        From `predict`, when the experiment has a station that no training experiment has, or holds angles where these
        held positions.
    """

    inputs: tuple[str, ...]
    degree: int
    time_constants: tuple[float, ...]
    ridge: float
    held: bool
    left_out_error: float
    training_error: float
    frames: int
    stations: tuple[str, ...]
    coefficients: Float[Array, "P M"]
    notes: tuple[str, ...]
    table: InputTable
    basis: PolynomialTerms
    unit: tuple[str, float]  # of display, and the factor to it

    @property
    def title(self) -> str:
        """Return the map in words, such as "quadratic in the inputs and their lags of 0.2 and 3 s"."""
        if self.degree == 0:
            return "mean of the training frames"
        lags = " and ".join(f"{tau:.2g}" for tau in self.time_constants)
        inputs = "inputs" if len(self.inputs) > 1 else "input"
        return f"{WORDS[self.degree]} in the {inputs}" + (f" and {'their' if inputs == 'inputs' else 'its'} lags of "
                                                           f"{lags} s" if lags else "")

    def predict(self, exp: Experiment) -> Float[Array, "T S d"]:
        """Return the positions (T, S, d) [m], or the angles (T, S, 1) [rad], that the map predicts for an experiment.

        Raises
        ------
        InputError
            When the experiment has a station, or a kind of observation, that no training experiment has.
        """
        if missing := [s for s in exp.stations if s not in self.stations]:
            raise InputError(f"experiment {exp.name} has the station {missing[0]!r}, which no training experiment of "
                             f"the plain map has: it has {', '.join(self.stations)}")
        values = self.basis.terms(self.table.values(exp, self.time_constants)) @ self.coefficients
        out = values.reshape(exp.time.size, len(self.stations), -1)
        if out.shape[2] != exp.compared.shape[2] or self.unit != exp.shown_in:
            raise InputError(f"experiment {exp.name} does not hold what the plain map was fitted to: fit it to "
                             "experiments of the same kind")
        return np.asarray(out[:, [self.stations.index(s) for s in exp.stations]])

    def outside(self, exp: Experiment) -> float:
        """Return the fraction of an experiment's frames in which an input, or one behind a lag, is outside the range of
        the training data.
        """
        columns = self.table.values(exp, self.time_constants)
        if not columns.shape[1]:
            return 0.0
        return float(np.mean(np.any(np.abs(columns - self.basis.middle) > EDGE * self.basis.half, axis=1)))

    def card(self) -> Card:
        """Return the map in words with its errors on training data, for display."""
        unit, factor = self.unit
        errors = [f"{factor * e:.3g} {unit}" for e in (self.left_out_error, self.training_error)]
        lines = (f"RMS error {errors[0]} on left-out training data, {errors[1]} on training data",
                 f"{self.coefficients.size} coefficients, ridge {self.ridge:.0e}, {self.frames} training frames")
        return Card(f"Plain map, {self.title}", [*lines, *self.notes])


def plain_map(experiments: Sequence[Experiment], *, degree: int | None = None) -> PlainMap:
    """Fit a polynomial map from inputs to observed positions or angles, to compare a model's predictions with.

    The map is a polynomial of degree 1 to 3 of the inputs and, where this helps, of the same inputs behind two
    first-order lags. Degree, time constants and ridge are those with the smallest error on left-out data: with three or
    more experiments, each is left out in turn; with fewer, blocks of them are. The same data decide whether the
    polynomial goes on beyond the range of the training inputs or keeps its value at the edge.

    Parameters
    ----------
    experiments : sequence of Experiment
        Training experiments, from `pliant.experiment`. Inputs are the measured ones; for pulses and steps of known
        level the level between the edges that the motion shows; known forces; and known tip masses that differ. Settled
        poses give a static map.
    degree : {1, 2, 3}, optional
        Degree of the polynomial. Default: the one with the smallest error on left-out data.

    Returns
    -------
    PlainMap

    Raises
    ------
    InputError
        When there is no experiment, when some hold positions and others angles, or when the degree is not possible.

    Examples
    --------
    >>> from pliant.validation.plain_map import plain_map
    >>> baseline = plain_map(training)  # doctest: +SKIP
    >>> baseline.predict(held_out).shape  # doctest: +SKIP
    (320, 1, 2)
    """
    if not experiments:
        raise InputError("a plain map needs at least one training experiment")
    if len({(e.shown_in, e.compared.shape[2]) for e in experiments}) > 1:
        raise InputError("a plain map cannot mix recordings of positions with those of angles, or of a plane with "
                         "those in space: make one map for each kind")
    if degree is not None and degree not in DEGREES:
        raise InputError(f"the degree of a plain map must be 1, 2 or 3, got {degree}")
    table, notes = table_of(experiments)
    data = training_data(experiments, table)
    maps = list(candidates(data, DEGREES if degree is None else (degree,)))
    if not maps:
        raise InputError(f"{len(data.values)} frames do not determine a plain map of degree {degree}: use a lower one")
    chosen = best_of(maps)
    columns = data.chosen_columns(chosen.time_constants)
    basis = basis_of(columns, chosen.degree)._replace(held=chosen.held)
    terms = basis.terms(columns)
    coefficients = np.empty((terms.shape[1], data.values.shape[1]))
    for rows, outputs in data.parts():
        coefficients[:, outputs] = solved(products(terms[rows], data.values[np.ix_(rows, outputs)]), chosen.ridge)
    missed = (terms @ coefficients - data.values).reshape(len(terms), len(data.stations), -1)
    coefficients[0] += data.mean
    if chosen.degree == 0:
        notes = (*notes, "No input moves in the training recordings: the plain map is the mean of their frames.")
    return PlainMap(
        (*table.names, *table.loads), chosen.degree, chosen.time_constants, chosen.ridge, chosen.held, chosen.error,
        float(np.sqrt(np.nanmean(np.sum(missed**2, axis=2)))), len(terms), data.stations, coefficients, notes, table,
        basis, experiments[0].shown_in,
    )


class TrainingData(NamedTuple):
    """Thinned training frames: inputs with every lag of the grid, observed values, and the group of each frame."""

    table: InputTable
    grid: tuple[float, ...]  # s, time constants
    columns: Array  # (N, C + L + K C)
    values: Array  # (N, S d) observed, less their mean; NaN where nothing was measured
    mean: Array  # (S d,)
    stations: tuple[str, ...]
    group: Array  # (N,) group of frames that is left out together
    whole: bool  # whether each group is whole recordings, and no block of one

    def chosen_columns(self, time_constants: Sequence[float]) -> Array:
        """Return the columns of the inputs, the loads and the inputs behind lags of these time constants."""
        count, width = self.table.size, len(self.table.names)
        lags = [range(count + k * width, count + (k + 1) * width) for k in map(self.grid.index, time_constants)]
        return self.columns[:, [*range(count), *(c for lag in lags for c in lag)]]

    def error(self, square: Array, count: Array) -> Array:
        """Return the error (R,) [m or rad] of R maps on left-out data, from the sums of squares (G, R) of G groups
        and the numbers (G, 1) of values in them: the RMS over blocks, or the geometric mean of that over recordings.

        A recording that no map can predict from the others, such as the only one that drives an input, would else
        decide alone.
        """
        coordinates, counted = self.values.shape[1] // len(self.stations), count[:, 0] > 0
        if not counted.any():
            return np.full(square.shape[1], np.nan)
        if not self.whole:
            return np.asarray(np.sqrt(coordinates * square.sum(axis=0) / count.sum()))
        mean = np.sqrt(coordinates * square[counted] / count[counted])
        return np.asarray(np.exp(np.mean(np.log(np.maximum(mean, LEAST_ERROR)), axis=0)))

    def parts(self) -> Iterator[tuple[Array, Array]]:
        """Yield the indices of frames and of outputs for each set of outputs that were measured in the same frames."""
        outputs: dict[bytes, list[int]] = {}
        for k, measured in enumerate(np.isfinite(self.values).T):
            outputs.setdefault(measured.tobytes(), []).append(k)
        for same in outputs.values():
            yield np.flatnonzero(np.isfinite(self.values[:, same[0]])), np.array(same)


def training_data(experiments: Sequence[Experiment], table: InputTable) -> TrainingData:
    """Return the thinned frames of the training experiments, and their inputs filtered by each lag of `lag_grid`."""
    grid = lag_grid(experiments) if table.names else ()
    stations = tuple(dict.fromkeys(s for e in experiments for s in e.stations))
    every = -(-sum(e.time.size for e in experiments) // MOST_ROWS)
    columns, values, groups = [], [], []
    for exp, group in zip(experiments, groups_of(experiments), strict=True):
        frames = slice(every // 2 if exp.time.size > every else 0, None, every)
        columns.append(table.values(exp, grid)[frames])
        observed = np.full((exp.time.size, len(stations), exp.compared.shape[2]), np.nan)
        observed[:, [stations.index(s) for s in exp.stations]] = exp.compared
        observed[np.isnan(observed).any(axis=2)] = np.nan
        values.append(observed.reshape(exp.time.size, -1)[frames])
        groups.append(group[frames])
    whole = np.concatenate(values)
    mean = np.nanmean(whole, axis=0)
    return TrainingData(table, grid, np.concatenate(columns), whole - mean, mean, stations, np.concatenate(groups),
                        len(experiments) >= FEW)


def lag_grid(experiments: Sequence[Experiment]) -> tuple[float, ...]:
    """Return the time constants [s] of the lags that are tried; none for settled poses and for too short recordings."""
    moving = [e for e in experiments if not e.poses and e.time.size > 2 * MOST_BLOCKS]
    if not moving:
        return ()
    shortest = 2.0 * min(float(np.median(np.diff(e.time))) for e in moving)
    longest = max(float(np.ptp(e.time)) for e in moving) / 6.0
    return tuple(float(f"{tau:.2g}") for tau in np.geomspace(shortest, longest, TIME_CONSTANTS))


def groups_of(experiments: Sequence[Experiment]) -> list[Array]:
    """Return for each experiment the number (T,) of the group in which each of its T frames is left out.

    A group is a whole experiment where there are at least three, else a block of about ten times the time after which
    the motion forgets itself.
    """
    if len(experiments) >= FEW:
        count = min(len(experiments), MOST_BLOCKS)
        return [np.full(e.time.size, k * count // len(experiments)) for k, e in enumerate(experiments)]
    groups, first = [], 0
    for exp in experiments:
        blocks = MOST_BLOCKS if exp.poses else int(np.clip(
            round(float(np.ptp(exp.time)) / (BLOCK * forgetting_time(exp))), FEWEST_BLOCKS, MOST_BLOCKS))
        groups.append(first + np.arange(exp.time.size) * min(blocks, exp.time.size) // exp.time.size)
        first += blocks
    return groups


def forgetting_time(exp: Experiment) -> float:
    """Return the time [s] after which the autocorrelation of the last station's motion falls below 1/e."""
    path = exp.steady
    measured = np.isfinite(path).all(axis=1)
    moved = np.where(measured[:, None], path - path[measured].mean(axis=0), 0.0)
    power = np.abs(np.fft.rfft(moved, 2 * len(moved), axis=0)) ** 2
    correlation = np.fft.irfft(power, axis=0)[: len(moved)].sum(axis=1)
    below = np.flatnonzero(correlation < correlation[0] / np.e)
    frames = int(below[0]) if below.size else len(moved)
    return frames * float(np.median(np.diff(exp.time)))


def candidates(data: TrainingData, degrees: Sequence[int] = DEGREES) -> Iterator[MapChoice]:
    """Yield the maps of these degrees to choose from: the linear ones with every pair of lags, and those of higher
    degree with the best of these pairs.
    """
    if not data.table.size:
        yield tried(data, (), 0)
        return
    pairs = list(combinations(data.grid, 2))
    linear = [tried(data, lags, 1) for lags in [(), *pairs]]
    yield from linear if 1 in degrees else ()
    lagging = sorted((one for one in linear if one.time_constants), key=lambda one: one.error)
    for lags in [(), *(one.time_constants for one in lagging[:TRIED_LAGS])]:
        columns = data.table.size + len(lags) * len(data.table.names)
        for degree in (d for d in degrees if d > 1):
            if comb(columns + degree, degree) <= min(MOST_TERMS, len(data.values)):
                yield tried(data, lags, degree)


def tried(data: TrainingData, time_constants: tuple[float, ...], degree: int) -> MapChoice:
    """Return the map of this degree with these lags whose ridge, and way beyond the edge of the inputs, give the
    smallest error on left-out data.
    """
    columns = data.chosen_columns(time_constants)
    basis = basis_of(columns, degree)
    terms, groups = basis.terms(columns), np.unique(data.group)
    inside = {g: held_inside(columns, data.group == g) for g in groups}
    edge = terms.copy()
    for g, moved in inside.items():
        if moved is not None:
            edge[data.group == g] = basis.terms(moved)
    ridges = RIDGES if degree else (0.0,)
    squares, count = np.zeros((2, groups.size, len(ridges))), np.zeros((groups.size, 1))
    for rows, outputs in data.parts():
        there = [rows[data.group[rows] == g] for g in groups]
        filled = [k for k, r in enumerate(there) if r.size]
        if len(filled) > 1:
            values = [data.values[np.ix_(there[k], outputs)] for k in filled]
            sums = [products(terms[there[k]], y) for k, y in zip(filled, values, strict=True)]
            edges = [total if inside[groups[k]] is None else products(edge[there[k]], y)
                     for k, y, total in zip(filled, values, sums, strict=True)]
            squares[:, filled] += left_out(sums, edges, ridges)
            count[filled, 0] += [there[k].size * len(outputs) for k in filled]
    errors = np.stack([data.error(square, count) for square in squares])
    simpler = int(errors[1].min() <= SIMPLER * errors[0].min())
    best = int(np.argmin(errors[simpler]))
    return MapChoice(degree, time_constants, ridges[best], bool(simpler), terms.shape[1], float(errors[simpler, best]))


def held_inside(columns: Array, left: Array) -> Array | None:
    """Return the inputs (n, C) of the n rows marked by `left` (N,), set to the edge of the other rows' inputs where
    they are beyond it; None if none is.
    """
    rest, block = columns[~left], columns[left]
    if not len(rest):
        return None
    inside = np.clip(block, rest.min(axis=0), rest.max(axis=0))
    return None if np.array_equal(inside, block) else inside


def left_out(sums: Sequence[Products], edges: Sequence[Products], ridges: Sequence[float]) -> Array:
    """Return the sums of squared errors (2, K, R) on K left-out groups of rows with R ridges: of the polynomial, and of
    its value at the edge of the other groups' inputs, from the sums of products of each group with both.
    """
    fitted = [fits_without(sums, ridge) for ridge in ridges]
    return np.array([[[squared_error(p, fits[k]) for fits in fitted] for k, p in enumerate(tested)]
                     for tested in (sums, edges)])  # fmt: skip


def best_of(maps: Sequence[MapChoice]) -> MapChoice:
    """Return the map with the fewest terms among those whose error is within 2 % of the smallest."""
    least = min((one.error for one in maps if np.isfinite(one.error)), default=np.nan)
    good = [one for one in maps if one.error <= SIMPLER * least]
    return min(good or maps[:1], key=lambda one: (one.terms, one.error))


def basis_of(columns: Array, degree: int) -> PolynomialTerms:
    """Return the terms up to a degree of the columns (N, C), with the ranges, means and deviations of N rows."""
    low, high = columns.min(axis=0), columns.max(axis=0)
    half = np.where(high > low, 0.5 * (high - low), 1.0)
    powers = tuple(p for k in range(1, degree + 1) for p in combinations_with_replacement(range(columns.shape[1]), k))
    plain = PolynomialTerms(0.5 * (low + high), half, powers, np.zeros(len(powers)), np.ones(len(powers)))
    raw = plain.terms(columns)[:, 1:]
    spread = np.std(raw, axis=0)
    return plain._replace(mean=raw.mean(axis=0), scale=np.where(spread > 0, spread, 1.0))

