"""Figures of a study for papers, drawn when they are asked for."""

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

Draw = Callable[[], Any]  # makes a figure
KINDS = ("svg", "pdf", "png")
NARROWEST, WIDEST = 60.0, 400.0  # mm
INCH = 25.4  # mm


def draw_figures(
    outcome: StudyOutcome, folder: str | Path, *, kinds: Sequence[str] = ("pdf",), width_mm: float | None = None,
    records: Sequence[str] = (), all_fits: bool = False, letters: bool = False,
    warn: Callable[[str], None] | None = None,
) -> Iterator[Path]:
    """Draw a study's figures into a folder, one after another.

    Parameters
    ----------
    outcome : StudyOutcome
        Of `run_study`, or of `pliant.validation.stored.load_outcome`.
    folder : str or Path
        Made when absent.
    kinds : sequence of str
        Of svg, pdf and png.
    width_mm : float, optional
        Of every figure, mm; by default that of a page of two columns. Narrow ones stack their panels, letters are
        smaller.
    records : sequence of str
        Only these; by default all.
    all_fits : bool
        Draw every fit, and each record under all of them; by default only the first fit, which is the study's model.
    letters : bool
        Mark the panels (a), (b), ...
    warn : callable, optional
        Called with a line for each figure that cannot be drawn; the others are drawn.

    Yields
    ------
    Path
        Each file, once it is written.

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
        raise InputError(f"a figure is {', '.join(KINDS)}, not {strange[0]!r}")
    if none := [r for r in records if r in missing]:
        raise InputError(f"no figure of record {none[0]!r} can be drawn: {missing[none[0]]}")
    if strange := [r for r in records if r not in known]:
        raise InputError(f"no record {strange[0]!r} in these results; they have {', '.join(known)}")
    if width_mm is not None and not NARROWEST <= width_mm <= WIDEST:
        raise InputError(f"a figure is {NARROWEST:g} to {WIDEST:g} mm wide, not {width_mm:g}")
    taken: set[str] = set()
    failures = Failures("", warn)
    with page(PAGE_WIDTH if width_mm is None else width_mm / INCH):
        shown = replace(outcome, fits=drawn)
        for name, draw in figures_of(shown, records or known, only=bool(records)):
            if (figure := failures.attempt(f"figure {name}", "", draw)) is not None:
                if letters:
                    letter_panels(figure)
                yield from save(figure, folder, file_name(name, taken), list(dict.fromkeys(kinds)))
    if failures and not taken:
        raise PliantError(failures[0].sentence)


def figures_of(outcome: StudyOutcome, records: Sequence[str], *, only: bool) -> Iterator[tuple[str, Draw]]:
    """Names of figures and what draws them: of the wanted records and, unless `only` those, of the whole study."""
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
        from pliant.validation.selection_figure import selection_figure

        yield "model_selection", partial(selection_figure, outcome.model_selection)
    if outcome.shape:
        from pliant.validation.shape_figures import order_figure, shape_figure

        yield f"order-{outcome.shape.name}", partial(order_figure, outcome.shape)
        yield f"shape-{outcome.shape.name}", partial(shape_figure, outcome.shape)
    for forecast in outcome.forecasts:
        yield f"forecast-{forecast.name}", partial(figures.forecast_figure, forecast)


def compared(fits: Sequence[FitOutcome], records: Sequence[str]) -> Iterator[tuple[str, Draw]]:
    """Records that several fits have, under each of them."""
    from pliant.validation import figures

    counts = Counter(r.name for f in fits for r in f.records)
    for name in records:
        if counts[name] > 1:
            yield f"compare-{name}", partial(figures.comparison_figure, fits, name)


def moves_torque(fits: Sequence[FitOutcome]) -> bool:
    """Return whether a fit moved the torque law of a chamber."""
    changed = [f for f in fits if any(re.match(r"(.+\.)?(torque_\d|gain)$", p.name) for p in f.result.parameters)]
    return any(laws_of(f) for f in changed)


def file_name(name: str, taken: set[str]) -> str:
    """A plain file name that no other figure has."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:80] or "figure"
    file, count = plain, 1
    while file.lower() in taken:
        count += 1
        file = f"{plain}-{count}"
    taken.add(file.lower())
    return file
