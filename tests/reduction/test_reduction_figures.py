import numpy as np
from planar_bodies import wavy

from pliant.plotting import (
    curvature_fan,
    error_by_order,
    new_figure,
    order_bars,
    save_figure,
    snapshots,
    style,
)
from pliant.reduction import links_of, select_order, spline_shape


def test_the_three_figures_of_the_reduction(tmp_path):
    recording, kappa = wavy(frames=30)
    s = recording["arc_length"].values
    result = select_order(recording)
    links = links_of(recording, 5)
    curves = spline_shape(links.tips, links.node_arc_length, s)
    nodes = np.concatenate((np.zeros((30, 1, 2)), links.tips), axis=1)
    with style():
        figure, axes = new_figure(2, 2, height=5)
        curvature_fan(axes[0, 0], s, kappa, kappa[0])
        snapshots(axes[0, 1], recording["position"].values[:3], nodes[:3], curves[:3])
        errors = dict(zip(result.orders, result.max_error, strict=True))
        error_by_order(axes[1, 0], result.time, errors, bound=3e-3)
        order_bars(axes[1, 1], errors, bound=3e-3)
        written = save_figure(figure, tmp_path / "reduction")
    assert [p.suffix for p in written] == [".svg", ".png"]
    assert all(p.stat().st_size > 5000 for p in written)
    fan = {line.get_label(): line for line in axes[0, 0].lines}
    assert fan["rest"].get_linewidth() > 3 * fan["30 of 30 frames"].get_linewidth()
    assert len({str(line.get_linestyle()) for line in axes[1, 0].lines[:4]}) == 4
    assert axes[0, 1].get_aspect() == 1.0
