"""The paper's curvature figure [fig:curvatureVariation]: profiles along the body under a step of 240 kPa.

Run: python examples/gallery/curvature_fan.py [picture.png]
"""

import sys
from pathlib import Path

from pliant.plotting import COLUMN_WIDTH, curvature_fan, new_figure, save_figure, style
from pliant.preprocessing.curvature import curvature_of
from pliant.study import demo_study, load_study
from pliant.study.prepare import aligned_recording


def main(path: Path) -> None:
    """Draw the figure into `path`."""
    body = aligned_recording(load_study(demo_study()), "step_240").body  # raw fibre points: tip found, cut, aligned
    kappa = curvature_of(body)
    rest = kappa.sel(time=slice(0.0, 0.4)).mean("time")  # the step comes at 0.5 s
    with style():
        figure, ax = new_figure(width=1.5 * COLUMN_WIDTH)
        curvature_fan(ax, kappa["arc_length"].values, kappa.values, rest.values)
        save_figure(figure, path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "curvature_fan.png"))
