"""`report.html`: what a study found, on one page that needs nothing but itself."""

from __future__ import annotations

import base64
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pliant.errors import InputError
from pliant.files import write_text
from pliant.identification import Ladder
from pliant.validation.metrics import DEFINITIONS
from pliant.validation.outcome import FitOutcome, RecordOutcome, Shape, StudyOutcome
from pliant.validation.rows import (
    PAIRS,
    SINGLE,
    first_records,
    fit_table,
    known_unit,
    ladder_rows,
    link_rows,
    metric_label,
    model_facts,
    order_rows,
    parameter_row,
    record_row,
    seen_text,
)
from pliant.validation.wording import ROLE, clip, digits, heading

LARGEST_DRAWING = 400_000  # bytes of one embedded SVG; a larger one is embedded as pixels
BUDGET = 2_700_000  # bytes of all embedded figures; what does not fit is linked


@dataclass(frozen=True)
class Picture:
    """A figure as the page shows it."""

    file: str  # relative, without its ending
    caption: str
    alt: str
    source: str  # data address; empty when the page has no room for it
    width: float  # of the drawing, inches


@dataclass
class Gallery:
    """Saves figures and embeds them while the page has room."""

    folder: Path
    taken: set[str] = field(default_factory=set)
    used: int = 0

    def add(self, figure: Any, name: str, caption: str, alt: str) -> Picture:
        """Save a figure under a file name made from `name`, and give what the page needs to show it."""
        from pliant.validation.figures import save

        file, width = self.file_name(name), float(figure.get_figwidth())
        svg, png = save(figure, self.folder, file)
        drawing = rounded(svg.read_text(encoding="utf-8")).encode()
        kind, content = ("svg+xml", drawing) if len(drawing) <= LARGEST_DRAWING else ("png", png.read_bytes())
        source = f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
        if self.used + len(source) > BUDGET:
            source = ""
        self.used += len(source)
        return Picture(f"{self.folder.name}/{file}", caption, alt, source, width)

    def file_name(self, name: str) -> str:
        """A plain file name that no other figure has."""
        plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:80] or "figure"
        file, count = plain, 1
        while file.lower() in self.taken:
            count += 1
            file = f"{plain}-{count}"
        self.taken.add(file.lower())
        return file


def write_report(outcome: StudyOutcome, folder: str | Path) -> Path:
    """Write ``report.html`` and, into ``figures``, each figure as SVG and PNG.

    Parameters
    ----------
    outcome : StudyOutcome
    folder : str or Path
        Made when absent. The page embeds its figures and asks for nothing from any network.

    Returns
    -------
    Path
        Of the page. The same outcome gives the same bytes.

    Raises
    ------
    InputError
        When the folder cannot be made or written.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folder = Path(folder)
    try:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write into the output folder {folder}: {error.strerror or error}") from None
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )
    environment.globals.update(definition=DEFINITIONS, label=metric_label, digits=digits, role=ROLE)
    page = environment.get_template("report.html.j2").render(content(outcome, Gallery(folder / "figures")))
    return write_text(folder / "report.html", page)


def content(outcome: StudyOutcome, gallery: Gallery) -> dict[str, Any]:
    """Everything that the template shows."""
    main = sorted(first_records(outcome.fits), key=lambda pair: pair[1].role != "held_out")
    return {
        "outcome": outcome,
        "records": {
            "held_out": [record_row(f, r) for f in outcome.fits for r in f.records if r.role == "held_out"],
            "train": [record_row(f, r) for f, r in main if r.role == "train"],
        },
        "seen": {r.name: seen_text(r) for _, r in main},
        "several": len(outcome.fits) > 1,
        "pictures": [(f.title, r, record_pictures(gallery, f, r)) for f, r in main],
        "fits": fit_table(outcome.fits, list(outcome.findings)),
        "fit_pictures": fit_pictures(gallery, outcome.fits),
        "ladder": ladder_block(gallery, outcome.ladder) if outcome.ladder else None,
        "parameters": [(f, [parameter_row(p) for p in f.result.parameters]) for f in outcome.fits],
        "shape": shape_block(gallery, outcome.shape) if outcome.shape else None,
        "forecasts": [forecast_block(gallery, f) for f in outcome.forecasts],
        "definitions": {k: (*metric_label(k), v) for k, v in DEFINITIONS.items()},
        "pairs": PAIRS, "single": SINGLE, "facts": model_facts(outcome),
    }


def record_pictures(gallery: Gallery, fit: FitOutcome, record: RecordOutcome) -> list[Picture]:
    """Motion, residual and path of one record."""
    from pliant.validation import figures

    base, name = f"{fit.name}-{record.name}", clip(record.name)
    what = f"{heading(record)} (fit: {clip(fit.title)})"
    below = "" if record.experiment.excitation == "release" else ", and the pressure behind the valve"
    largest = digits(record.metrics.get("max_mm"))
    band = band_sentence(fit, record)
    return [
        gallery.add(
            figures.record_figure(record), f"{base}-motion", f"Motion of {what}.{band}",
            "Line plots against time: measured and modelled x and y in millimetres of "
            f"{clip(', '.join(record.experiment.stations))}, below them their difference{below}. "
            f"{what}; the largest distance is {largest} mm.",
        ),
        gallery.add(
            figures.residual_figure(record), f"{base}-residual",
            f"Residual of {name} in time and its autocorrelation. Correlation outside the band is motion that the "
            "model does not explain.",
            f"Residual x and y of the last station of {name} against time, and their autocorrelation against lag with "
            "the 95 % band of white noise.",
        ),
        gallery.add(
            figures.path_figure(record), f"{base}-path", f"Path of the last station of {name}.",
            f"Measured and modelled path of the last station of {name} in the plane of bending.",
        ),
    ]


def band_sentence(fit: FitOutcome, record: RecordOutcome) -> str:
    """What the band of a prediction rests on, and how much of the record it holds; empty where there is none."""
    spread = fit.result.covariance
    if record.band is None or spread is None:
        return ""
    held = digits(record.metrics.get("within_band_percent"), 3, zeros=False)
    return (f" The {100 * record.band.level:g} % band, of the parameters' uncertainty ({spread.source}) and of "
            f"residuals as large as in training, holds {held} % of the coordinates.")


def fit_pictures(gallery: Gallery, fits: Sequence[FitOutcome]) -> list[Picture]:
    """Records that some fit had to predict, under every fit; and the torque laws."""
    from pliant.validation import figures

    counts = Counter(r.name for f in fits for r in f.records)
    held = dict.fromkeys(r.name for f in fits for r in f.records if r.role == "held_out")
    pictures = [
        gallery.add(
            figures.comparison_figure(fits, name), f"compare-{name}", f"{clip(name)} under each fit.",
            f"Measured and modelled x and y of the last station of {clip(name)}, and their distance, one column for "
            "each fit, on shared scales.",
        )
        for name in held if counts[name] > 1
    ]
    if any(re.match(r"(.+\.)?(torque_\d|gain)$", p.name) for f in fits for p in f.result.parameters):
        pictures.append(gallery.add(
            figures.torque_figure(fits), "torque", "Torque law of each fit.",
            f"Torque on each joint against gauge pressure for {len(fits)} fit(s); filled marks are training levels, "
            "open marks held-out ones."))
    return pictures


def ladder_block(gallery: Gallery, ladder: Ladder) -> dict[str, Any]:
    """Every rung of the ladder: what it frees, what it buys, what it costs."""
    from pliant.validation.ladder_figure import ladder_figure

    picture = gallery.add(
        ladder_figure(ladder), "ladder", "Error of each rung on training and held-out records, and its cost.",
        f"Left: mean error in % of travel of each rung, training and held out. Right: time to fit each rung. "
        f"{ladder.reason}",
    )
    return {"reason": ladder.reason, "rows": ladder_rows(ladder), "picture": picture}


def shape_block(gallery: Gallery, shape: Shape) -> dict[str, Any]:
    """The dense shape that decided the chain: how its tip was found, the errors of each order, the links."""
    from pliant.validation.shape_figures import order_figure, shape_figure

    name = clip(shape.name)
    pictures = [
        gallery.add(
            order_figure(shape), f"order-{shape.name}",
            f"Error of the shape of {name} rebuilt from its joints, for each number of segments n.",
            f"Largest distance between the measured shape of {name} and its reconstruction: left against time, right "
            f"its median, middle 90 % and maximum against the number of segments. {shape.order.reason}",
        ),
        gallery.add(
            shape_figure(shape), f"shape-{shape.name}",
            f"Curvature of {name} along the body, and the chain of {shape.links.n} links laid through its shape.",
            f"Left: curvature of {name} against arc length for many frames and at rest. Right: measured points, joints "
            "and the spline through them at a few instants.",
        ),
    ]
    notes = dict.fromkeys([shape.tip_status, *shape.order.notes, *shape.links.notes])
    return {
        "name": shape.name, "summary": shape.order.summary(), "notes": [n for n in notes if n], "pictures": pictures,
        "orders": order_rows(shape), "links": link_rows(shape),
    }


def forecast_block(gallery: Gallery, forecast: Any) -> dict[str, Any]:
    """A forecast: what was changed, what is predicted, its figure."""
    from pliant.validation.figures import forecast_figure

    stated = [(k, digits(v, 5, zeros=False), known_unit(k)) for k, v in forecast.stated.items()]
    half = {k: f" ± {digits(v, 2)}" for k, v in forecast.interval.items()}
    numbers = [(k, *metric_label(k), f"{digits(v, 4)}{half.get(k, '')}") for k, v in forecast.numbers.items()]
    said = ", ".join(f"{label} {value} {unit}".strip() for _, label, unit, value in numbers)
    picture = gallery.add(
        forecast_figure(forecast), f"forecast-{forecast.name}", f"Predicted motion: {clip(forecast.title)}.",
        f"Predicted x and y of the last station against time, {clip(forecast.title)}: {said or 'no numbers'}.",
    )
    return {"title": forecast.title, "stated": stated, "numbers": numbers, "picture": picture}


def rounded(svg: str) -> str:
    """The drawing with its coordinates to a hundredth of a point: a third of the size, no visible change."""
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), svg)
