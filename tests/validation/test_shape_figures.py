from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.validation.report import write_report
from pliant.validation.rows import link_rows, order_rows
from pliant.validation.shape_figures import chain_through, order_figure, shape_figure


def test_chain_meets_the_measured_shape(shape):
    points, joints, splines = chain_through(shape)
    assert points.shape[0] == joints.shape[0] == splines.shape[0] > 2
    assert joints.shape[1] == shape.links.n + 1
    np.testing.assert_allclose(joints[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(splines[:, -1], points[:, -1], atol=1e-9)
    np.testing.assert_allclose(joints[:, 0], 0.0, atol=1e-12)


def test_a_shape_and_a_chain_of_other_frames_are_refused(shape):
    with pytest.raises(InputError, match="38 whole frames, but a chain through 39"):
        chain_through(replace(shape, position=shape.position[:-1]))


def test_figures_say_what_they_show(shape):
    assert "bending" in order_figure(shape).get_suptitle()
    assert "chain of 3 links" in shape_figure(shape).get_suptitle()


def test_rows_tell_each_order_and_link(shape):
    rows = order_rows(shape)
    assert [r["n"] for r in rows] == [str(n) for n in shape.order.orders]
    assert [r["n"] for r in rows if r["used"]] == ["3"]
    assert [r["n"] for r in rows if r["chosen"]] == [str(shape.order.chosen)]
    lengths = [float(row[1]) for row in link_rows(shape)]
    assert sum(lengths) == pytest.approx(200, rel=0.02)


def test_report_has_the_shape_with_its_reason(outcome, shape, tmp_path):
    one = replace(outcome.fits[1], records=outcome.fits[1].records[:1])
    page = write_report(replace(outcome, fits=(one,), forecasts=(), shape=shape), tmp_path).read_text(encoding="utf-8")
    assert "is the lowest order that keeps the bound of 1 mm" in page
    assert "The tip was found by its cap." in page
    assert (tmp_path / "figures" / "order-bending.svg").is_file()
