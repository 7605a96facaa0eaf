"""Display of results as text in a terminal and as HTML in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

from pliant.text import escaped

if TYPE_CHECKING:
    import numpy as np

MOST_ROWS = 12


class Card(NamedTuple):
    """The content of a printed result: a title, sentences, a table and an SVG drawing for notebooks.

    The first column of the table holds names.
    """

    title: str
    lines: Sequence[str] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    drawing: str = ""


class Shown:
    """Base class of results that are printed as a `Card`: text in a terminal, HTML in a notebook.

    It is meant for dataclasses with ``repr=False``.
    """

    def card(self) -> Card:
        """Return the title, sentences and table to print for this result. Subclasses must override this method."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return as_text(self.card())

    def _repr_html_(self) -> str:
        return as_html(self.card())


def as_text(card: Card) -> str:
    """Return the content of a card as lines of text, with its table in aligned columns.

    Numbers are aligned to the right.
    """
    table = [[escaped(cell, "line") for cell in row] for row in (card.head, *shortened(card)) if row]
    width = [max(len(row[k]) for row in table) for k in range(len(table[0]))] if table else []
    rows = []
    for row in table:
        cells = [cell.rjust(w) for cell, w in zip(row[1:], width[1:], strict=True)]
        rows.append("  " + "  ".join([row[0].ljust(width[0]), *cells]))
    lines = (escaped(card.title, "line"), *rows, *(escaped(line, "line") for line in card.lines))
    return "\n".join(line.rstrip() for line in lines)


def as_html(card: Card) -> str:
    """Return the content of a card as an HTML fragment, for notebooks.

    The fragment needs no style sheet.
    """
    parts = [f"<p><strong>{escape(card.title)}</strong></p>", card.drawing]
    if card.rows:
        head = "".join(f'<th scope="col">{escape(h)}</th>' for h in card.head)
        parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>")
        for first, *rest in shortened(card):
            cells = "".join(f"<td>{escape(cell)}</td>" for cell in rest)
            parts.append(f'<tr><th scope="row">{escape(first)}</th>{cells}</tr>')
        parts.append("</tbody></table>")
    if card.lines:
        parts.append(f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in card.lines)}</ul>")
    return f"<div>{''.join(parts)}</div>"


def shortened(card: Card) -> list[Sequence[str]]:
    """Return the rows of a card's table. If there are more than 12, one row such as "... 8 more" replaces those in the
    middle.

    The first 6 rows and the last 6 are kept.
    """
    rows = list(card.rows)
    if len(rows) <= MOST_ROWS:
        return rows
    half = MOST_ROWS // 2
    left_out = [f"... {len(rows) - 2 * half} more", *[""] * (len(rows[0]) - 1)]
    return [*rows[:half], left_out, *rows[-half:]]


SIZE, MARGIN = 220.0, 14.0  # pixels of the longer side, and around the body
STYLES = {
    "measured": 'stroke="#999" stroke-width="6" stroke-linecap="round" stroke-linejoin="round"',
    "faint": 'stroke="#0b2f6b" stroke-width="1.2" stroke-opacity="0.35"',
    "modelled": 'stroke="#0b2f6b" stroke-width="2"',
    "path": 'stroke="#c1440e" stroke-width="1" stroke-dasharray="3 2"',
}


def body_svg(lines: Sequence[tuple[str, np.ndarray]], title: str) -> str:
    """Return an SVG drawing of planar shapes, with a base at the origin; '' if no shape has two finite points.

    Parameters
    ----------
    lines : sequence of (style, points)
        A style of `STYLES`, and points (N, 2) [m]; rows with NaN are left out.
    title : str
        Description of the drawing for screen readers.
    """
    import numpy as np

    from pliant.text import escaped

    drawn = [(style, points[np.isfinite(points).all(axis=1)]) for style, points in lines]
    drawn = [(style, points) for style, points in drawn if len(points) > 1]
    if not drawn:
        return ""
    every = np.concatenate([np.zeros((1, 2)), *(points for _, points in drawn)])
    low, high = every.min(axis=0), every.max(axis=0)
    scale = SIZE / max(float((high - low).max()), 1e-9)
    width, height = ((high - low) * scale + 2 * MARGIN).tolist()

    def at(points: np.ndarray) -> np.ndarray:
        return np.stack([(points[:, 0] - low[0]) * scale + MARGIN, (high[1] - points[:, 1]) * scale + MARGIN], axis=1)

    (x, y), = at(np.zeros((1, 2))).tolist()
    parts = [f'<rect x="{x - 10:.1f}" y="{y:.1f}" width="20" height="5" fill="#555"/>']
    for style, points in drawn:
        text = " ".join(f"{a:.1f},{b:.1f}" for a, b in at(points).tolist())
        parts.append(f'<polyline fill="none" {STYLES[style]} points="{text}"/>')
        if style == "modelled":
            parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="white" stroke="#0b2f6b" stroke-width="1.4"/>'
                      for a, b in at(points).tolist()]  # fmt: skip
    name = "".join({"&": "&amp;", "<": "&lt;", '"': "&quot;"}.get(c, c) for c in escaped(title, "line"))
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" role="img" '
            f'aria-label="{name}">{"".join(parts)}</svg>')  # fmt: skip
