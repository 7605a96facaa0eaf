"""Small SVG drawings of an actuator's shape, for notebooks.

The axes are equal; measured lines are thick and grey, modelled lines thin and dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

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
