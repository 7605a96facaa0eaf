"""Drawing of a study's figures for papers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError, PliantError
from pliant.failures import Failures
from pliant.plotting import curvature_fan, decades, error_by_order, new_figure, order_bars, side_by_side, snapshots
from pliant.reduction import spline_shape
from pliant.selection import ModelSelection
from pliant.validation.curves import instants, laws_of
from pliant.validation.figures import drawing
from pliant.validation.outcome import FitOutcome, Shape, StudyOutcome
from pliant.validation.wording import clip

Draw = Callable[[], Any]  # returns a figure
KINDS = ("svg", "pdf", "png")
NARROWEST, WIDEST = 60.0, 400.0  # mm
INCH = 25.4  # mm
Array = np.ndarray
DARK = "#0b2f6b"
LINE = 0.12  # inch, height of a line of the list of models


def draw_figures(
    outcome: StudyOutcome, folder: str | Path, *, kinds: Sequence[str] = ("pdf",), width_mm: float | None = None,
    records: Sequence[str] = (), all_fits: bool = False, letters: bool = False,
    warn: Callable[[str], None] | None = None,
) -> Iterator[Path]:
    """Draw a study's figures into a folder and yield the path of each file after it is written.

    Parameters
    ----------
    outcome : StudyOutcome
        From `run_study`, or from `pliant.validation.store.load_outcome`.
    folder : str or Path
        Folder for the files, created if it is absent.
    kinds : sequence of str
        File formats: any of "svg", "pdf" and "png".
    width_mm : float, optional
        Width of every figure [mm]. Default: the width of a two-column page. Narrow figures have stacked panels and
        smaller letters.
    records : sequence of str
        Names of the recordings to draw. Default: all.
    all_fits : bool
        Draw every fit, and a comparison of the fits for each recording. Default: only the first fit, which is the
        study's model.
    letters : bool
        Mark the panels (a), (b), ...
    warn : callable, optional
        Called with a line of text for each figure that cannot be drawn; the others are drawn.

    Yields
    ------
    Path
        Path of each file.

    Raises
    ------
    InputError
        When a kind, the width or a record is not possible, or the folder cannot be written.
    PliantError
        When no figure can be drawn.
    """
    from pliant.plotting import PAGE_WIDTH, letter_panels, page
    from pliant.validation.figures import save

    drawn = outcome.fits if all_fits else outcome.fits[:1]
    known = list(dict.fromkeys(r.name for f in drawn for r in f.records))
    missing = {m.record: m.sentence for f in drawn for m in f.missing if m.record not in known}
    if strange := [k for k in kinds if k not in KINDS]:
        raise InputError(f"the format of a figure must be one of {', '.join(KINDS)}, got {strange[0]!r}")
    if none := [r for r in records if r in missing]:
        raise InputError(f"no figure of record {none[0]!r} can be drawn: {missing[none[0]]}")
    if strange := [r for r in records if r not in known]:
        raise InputError(f"these results have no record {strange[0]!r}: choose from {', '.join(known)}")
    if width_mm is not None and not NARROWEST <= width_mm <= WIDEST:
        raise InputError(f"the width of a figure must be {NARROWEST:g} to {WIDEST:g} mm, got {width_mm:g}")
    taken: set[str] = set()
    failures = Failures("", warn)
    with page(PAGE_WIDTH if width_mm is None else width_mm / INCH):
        selected = replace(outcome, fits=drawn)
        for name, draw in figures_of(selected, records or known, only=bool(records)):
            if (figure := failures.attempt(f"figure {name}", "", draw)) is not None:
                if letters:
                    letter_panels(figure)
                yield from save(figure, folder, file_name(name, taken), list(dict.fromkeys(kinds)))
    if failures and not taken:
        raise PliantError(failures[0].sentence)


def figures_of(outcome: StudyOutcome, records: Sequence[str], *, only: bool) -> Iterator[tuple[str, Draw]]:
    """Yield the name of each figure and a function that draws it.

    These are the figures of the recordings named in `records` and, unless `only` is True, those of the whole study.
    """
    from pliant.validation import figures

    for fit in outcome.fits:
        for record in fit.records:
            if record.name in records:
                yield f"{fit.name}-{record.name}-motion", partial(figures.record_figure, record)
                yield f"{fit.name}-{record.name}-residual", partial(figures.residual_figure, record)
                if not outcome.turns:
                    yield f"{fit.name}-{record.name}-path", partial(figures.path_figure, record)
    yield from compared(outcome.fits, records)
    if only:
        return
    if moves_torque(outcome.fits):
        yield "torque", partial(figures.torque_figure, outcome.fits)
    if outcome.model_selection:
        from pliant.validation.draw import selection_figure

        (fit,) = (f for f in outcome.fits if f.name == "model_selection")
        yield "model_selection", partial(selection_figure, outcome.model_selection, map_error(fit))
    if outcome.shape:
        from pliant.validation.draw import order_figure, shape_figure

        yield f"order-{outcome.shape.name}", partial(order_figure, outcome.shape)
        yield f"shape-{outcome.shape.name}", partial(shape_figure, outcome.shape)
    for forecast in outcome.forecasts:
        yield f"forecast-{forecast.name}", partial(figures.forecast_figure, forecast)


def map_error(fit: FitOutcome) -> float | None:
    """Return the error of a fit's plain map on left-out parts of the training recordings, % of their mean peak
    displacement; None if there is no map or nothing was left out.
    """
    plain = fit.baseline
    if plain is None or plain.left_out_error is None or not plain.training_error:
        return None
    names = [r.name for r in fit.records if r.role == "train" and r.name in plain.records]
    errors = [float(plain.records[n]["rmse_percent_of_travel"]) for n in names]
    return sum(errors) / len(errors) * plain.left_out_error / plain.training_error if errors else None


def compared(fits: Sequence[FitOutcome], records: Sequence[str]) -> Iterator[tuple[str, Draw]]:
    """Yield the name of a figure that compares fits, and the function that draws it, for each recording that several
    fits predict.
    """
    from pliant.validation import figures

    counts = Counter(r.name for f in fits for r in f.records)
    for name in records:
        if counts[name] > 1:
            yield f"compare-{name}", partial(figures.comparison_figure, fits, name)


def moves_torque(fits: Sequence[FitOutcome]) -> bool:
    """Return whether a fit has a torque or gain of a chamber among its parameters."""
    changed = [f for f in fits if any(re.match(r"(.+\.)?(torque_\d|gain)$", p.name) for p in f.result.parameters)]
    return any(laws_of(f) for f in changed)


def file_name(name: str, taken: set[str]) -> str:
    """Return a file name of plain characters that is not in `taken`, and add it there."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:80] or "figure"
    file, count = plain, 1
    while file.lower() in taken:
        count += 1
        file = f"{plain}-{count}"
    taken.add(file.lower())
    return file


def order_figure(shape: Shape) -> Any:
    """Draw the largest error of the rebuilt shape in each frame, for each number of segments: in one panel against
    time, in the other as a distribution over the frames.
    """
    order = shape.order
    errors = dict(zip(order.orders, order.max_error, strict=True))
    with drawing():
        figure, (left, right) = side_by_side(2, (2, 1), 2.8)
        error_by_order(left, order.time, errors, bound=order.bound)
        order_bars(right, errors, bound=order.bound)
        figure.align_ylabels()
    return figure


def shape_figure(shape: Shape) -> Any:
    """Draw the curvature along a body at many instants, and at a few instants the chain of links with a spline through
    its joints.
    """
    with drawing():
        figure, (left, right) = side_by_side(2, (1, 1), 3.4)
        curvature_fan(left, shape.arc_length, shape.curvature, shape.rest_curvature)
        snapshots(right, *chain_through(shape))
        if shape.position.shape[2] == 3:
            right.set(xlabel="sideways (mm)", ylabel="z (mm)")
    return figure


def chain_through(shape: Shape) -> tuple[Array, Array, Array]:
    """Return points of the measured body, the joints of the chain, and a spline through these joints, at a few frames.
    Each is an array (frames, points, 2) [m] relative to the base.

    Only complete frames are used, since the chain was fitted to these alone. A body in space is projected onto the
    vertical plane in which it moves most.
    """
    links = shape.links
    whole = shape.position[np.isfinite(shape.position).all(axis=(1, 2))]
    if len(whole) != len(links.tips):
        raise InputError(f"the shape of {shape.name} has {len(whole)} complete frames, but its links were computed "
                         f"from {len(links.tips)}: compute them again from this shape by links_of")
    tips = links.tips - links.base
    frames = instants(tips[:, -1])
    upright = np.eye(tips.shape[2])
    joints = np.concatenate([np.zeros((len(frames), 1, len(upright))), tips[frames]], axis=1)
    splines = joints
    if links.n > 1:
        along = np.linspace(links.node_arc_length[0], links.node_arc_length[-1], 100)
        splines = spline_shape(tips[frames], links.node_arc_length, along, boundary=shape.order.boundary,
                               base=0 * upright[-1], base_tangent=upright[-1])  # fmt: skip
    curves = whole[frames] - links.base, joints, splines
    if len(upright) == 2:
        return curves
    side = np.linalg.eigh(np.cov(tips[:, -1, :2].T))[1][:, -1]
    first, second, third = (np.stack([a[..., :2] @ side, a[..., 2]], axis=-1) for a in curves)
    return first, second, third


def selection_figure(selection: ModelSelection, plain_map: float | None = None) -> Any:
    """Draw the errors of the training recordings and of their left-out parts against the number of free parameters, for
    each model on the way of a model selection. Numbers beside the points refer to the list of models below the axes. A
    dotted line shows the error of the plain map on left-out parts, in % of the peak displacement, if it is given.
    """
    steps = selection.steps
    with drawing():
        figure, ax = new_figure(1, 1, height=2.9 + LINE * len(steps))
        free = [len(s.free) for s in steps]
        ax.plot(free, [s.train_percent for s in steps], color="0.6", marker="o", markersize=4, label="training")
        ax.plot(free, [s.left_out_percent for s in steps], color=DARK, marker="s", markersize=4, label="parts left out")
        for numbers, place in numbered(free, [max(s.train_percent, s.left_out_percent) for s in steps]):
            ax.annotate(numbers, place, xytext=(5, 4), textcoords="offset points", fontsize=6.5)
        names = [f"{k}  {'+ ' if s.joins else ''}{clip(s.title, 60)}" for k, s in enumerate(steps, 1)]
        figure.supxlabel("\n".join(names), x=0.02, ha="left", fontsize=6.5)
        ax.plot(free[-1], steps[-1].left_out_percent, color=DARK, marker="s", markersize=8, fillstyle="none",
                linestyle="", label="chosen")
        if plain_map is not None:
            ax.axhline(plain_map, color="black", linestyle=":", linewidth=1.0, label="plain map, left out")
        decades(ax)
        ax.xaxis.get_major_locator().set_params(integer=True)
        ax.margins(y=0.12)
        ax.set(xlabel="free parameters", ylabel="error (% of peak displacement)",
               xlim=(min(free) - 0.5, max(free) + 0.5 + 0.06 * (max(free) - min(free))))
        ax.legend()
    return figure


def numbered(free: Sequence[int], error: Sequence[float]) -> list[tuple[str, tuple[int, float]]]:
    """Return the numbers of steps with `free` parameters and an `error` [%], and where they stand: those of places that
    would cover each other, in one text.
    """
    texts: list[tuple[list[int], tuple[int, float]]] = []
    for k, place in enumerate(zip(free, error, strict=True), 1):
        beside = (numbers for numbers, (count, size) in texts
                  if count == place[0] and size / 1.25 < place[1] < size * 1.25)
        if (numbers := next(beside, None)) is None:
            texts.append(([k], place))
        else:
            numbers.append(k)
    return [(", ".join(map(str, numbers)), place) for numbers, place in texts]
