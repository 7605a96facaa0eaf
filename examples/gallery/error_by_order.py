"""The paper's order figure [fig:fitting]: largest error of the shape for 2 to 5 segments against time.

Run: python examples/gallery/error_by_order.py [picture.png]
"""

import sys
from pathlib import Path

from pliant.plotting import error_by_order, new_figure, order_bars, save_figure, style
from pliant.reduction import select_order
from pliant.study import demo_study, load_study
from pliant.study.prepare import aligned_recording


def main(path: Path) -> None:
    """Draw the figure into `path`."""
    body = aligned_recording(load_study(demo_study()), "step_240").body
    result = select_order(body, max_order=5, bound=3e-3)
    errors = dict(zip(result.orders, result.max_error, strict=True))
    with style():
        figure, (left, right) = new_figure(1, 2, width_ratios=(2, 1))
        error_by_order(left, result.time, errors, bound=result.bound)
        order_bars(right, errors, bound=result.bound)
        save_figure(figure, path)
    print(result.summary())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "error_by_order.png"))
