"""The paper's shape figure [fig:matchCurve]: measured points, joints of five links, and the spline through them.

Run: python examples/gallery/snapshots.py [picture.png]
"""

import sys
from pathlib import Path

import numpy as np

from pliant.plotting import COLUMN_WIDTH, new_figure, save_figure, snapshots, style
from pliant.reduction import links_of, select_order, spline_shape
from pliant.study import demo_study, load_study
from pliant.study.prepare import aligned_recording

LINKS, FRAMES = 5, 5


def main(path: Path) -> None:
    """Draw the figure into `path`."""
    body = aligned_recording(load_study(demo_study()), "step_240").body
    order = select_order(body, max_order=LINKS)
    nodes = order.node_arc_length[order.orders.index(LINKS)]
    links = links_of(body, node_arc_length=nodes)
    whole = np.isfinite(body["position"].values).all(axis=(1, 2))  # the chain is laid through whole frames alone
    measured = body["position"].values[whole]
    bent = np.linalg.norm(links.tips[:, -1] - links.tips[0, -1], axis=1)
    shown = [int(np.abs(bent - share * bent.max()).argmin()) for share in np.linspace(0, 1, FRAMES)]
    joints = np.concatenate([np.tile(links.base, (FRAMES, 1, 1)), links.tips[shown]], axis=1)
    splines = spline_shape(links.tips[shown] - links.base, nodes, np.linspace(0, nodes[-1], 100)) + links.base
    with style():
        figure, ax = new_figure(width=1.3 * COLUMN_WIDTH, height=3.4)
        snapshots(ax, measured[shown], joints, splines)
        save_figure(figure, path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "snapshots.png"))
