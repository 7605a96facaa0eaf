"""Drawing of a study's figures for papers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pliant.errors import InputError, PliantError
from pliant.failures import Failures
from pliant.validation.curves import laws_of
from pliant.validation.outcome import FitOutcome, StudyOutcome

Draw = Callable[[], Any]  # returns a figure
KINDS = ("svg", "pdf", "png")
NARROWEST, WIDEST = 60.0, 400.0  # mm
INCH = 25.4  # mm


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
        from pliant.validation.selection_figures import selection_figure

        (fit,) = (f for f in outcome.fits if f.name == "model_selection")
        yield "model_selection", partial(selection_figure, outcome.model_selection, map_error(fit))
    if outcome.shape:
        from pliant.validation.selection_figures import order_figure, shape_figure

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
