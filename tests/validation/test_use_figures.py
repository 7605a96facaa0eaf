"""Figures of the running model draw what they are given, in the units that their axes name."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from pliant.validation import use_figures

TIME = np.linspace(0.0, 1.0, 7)


def drawn(ax):
    """Lines of an axis by their labels; unlabelled ones by their number."""
    return {line.get_label(): np.array(line.get_data()) for line in ax.lines}


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def band(patch):
    """Lowest and highest value of a filled band."""
    values = patch.get_paths()[0].vertices[:, 1]
    return values.min(), values.max()


@pytest.mark.parametrize("lengthens", [False, True])
def test_an_estimate_shows_angles_rates_innovations_and_strains(lengthens):
    rng = np.random.default_rng(1)
    angle, rate, innovation = rng.normal(size=(7, 2)), rng.normal(size=(7, 2)), rng.normal(size=(7, 3))
    values = {
        "joint_angle": (("time", "joint"), angle), "smooth_joint_rate": (("time", "joint"), rate),
        "smooth_joint_rate_sd": (("time", "joint"), np.full((7, 2), 0.25)),
        "innovation": (("time", "row"), innovation),
    }
    if lengthens:
        strain = rng.normal(size=(7, 1))
        values |= {"smooth_axial_strain": (("time", "segment"), strain), "axial_strain": (("time", "segment"), strain),
                   "smooth_axial_strain_sd": (("time", "segment"), np.full((7, 1), 0.01))}  # fmt: skip
    names = {"segment": ["first"]} if lengthens else {}
    figure = use_figures.estimate_overview(xr.Dataset(values, {"time": TIME, "joint": [1, 2], **names}))
    assert len(figure.axes) == 3 + lengthens
    top, middle, low, *strains = figure.axes
    assert legend(top) == ["joint 1", "joint 2"]
    for j in range(2):
        np.testing.assert_allclose(top.lines[j].get_ydata(), np.degrees(angle[:, j]), rtol=1e-6)
        np.testing.assert_allclose(middle.lines[j].get_ydata(), rate[:, j])
        assert band(middle.collections[j]) == pytest.approx((rate[:, j].min() - 0.5, rate[:, j].max() + 0.5))
        assert middle.lines[j].get_color() == top.lines[j].get_color()
    assert [float(line.get_ydata()[0]) for line in low.lines[3:]] == [-2.0, 2.0]
    for ax in strains:
        np.testing.assert_allclose(ax.lines[0].get_ydata(), 100 * strain[:, 0])
        assert band(ax.collections[0]) == pytest.approx((100 * strain.min() - 2, 100 * strain.max() + 2))
        assert legend(ax) == ["first"]
    assert figure.axes[-1].get_xlabel() == "time (s)"


def test_a_contact_shows_statistic_place_and_force():
    rng = np.random.default_rng(2)
    rows = {name: rng.uniform(0.01, 0.1, 7) for name in (
        "statistic", "arc_low", "arc_high", "contact_arc_length", "normal_force", "tangential_force")}
    rows["statistic"][0] = 0.0  # on a logarithmic axis
    found = xr.Dataset({k: ("time", v) for k, v in rows.items()}, {"time": TIME}, {"threshold": 14.5})
    top, middle, low = use_figures.contact_overview(found).axes
    statistic, level = top.lines
    np.testing.assert_allclose(statistic.get_ydata(), np.maximum(rows["statistic"], 1e-2))
    assert (top.get_yscale(), set(level.get_ydata()), legend(top)) == ("log", {14.5}, ["threshold"])
    np.testing.assert_allclose(middle.lines[0].get_ydata(), 1e3 * rows["contact_arc_length"])
    low_mm, high_mm = 1e3 * rows["arc_low"], 1e3 * rows["arc_high"]
    assert band(middle.collections[0]) == pytest.approx((min(*low_mm, *high_mm), max(*low_mm, *high_mm)))
    assert legend(middle) == ["95 %"]
    assert legend(low) == ["normal", "tangential"]
    for name in ("normal", "tangential"):
        np.testing.assert_allclose(drawn(low)[name][1], rows[f"{name}_force"])


@pytest.mark.parametrize("moving", [False, True])
def test_a_sweep_shows_each_number_of_the_samples_that_did_not_fail(moving):
    rng = np.random.default_rng(3)
    failed, numbers = np.arange(40) % 8 == 0, [f"parameter_{k}" for k in ("stiffness", "damping", "mass", "tip_mass")]
    values = {name: ("sample", np.where(failed, np.nan, rng.normal(size=40)), {"units": "1"}) for name in numbers}
    tip = rng.normal(size=(40, 7, 2))
    tip[failed] = np.nan
    if moving:
        values["tip"] = (("sample", "time", "axis"), tip)
    samples = xr.Dataset({**values, "failed": ("sample", failed)}, {"time": TIME, "axis": ["x", "y"]})
    figure = use_figures.sweep_figure(samples)
    spread = [ax for ax in figure.axes if ax.get_ylabel() == "samples"]
    assert [ax.get_xlabel() for ax in spread] == ["stiffness (1)", "damping (1)", "mass (1)", "tip mass (1)"]
    assert all(sum(bar.get_height() for bar in ax.patches) == 35 for ax in spread)
    assert len(figure.axes) == 4 + moving
    if moving:
        wide = figure.axes[-1]
        assert legend(wide) == ["tip x, median and 95 %", "tip y, median and 95 %"]
        for k in range(2):
            low, middle, high = 1e3 * np.quantile(tip[~failed, :, k], (0.025, 0.5, 0.975), axis=0)
            np.testing.assert_allclose(wide.lines[k].get_ydata(), middle)
            assert band(wide.collections[k]) == pytest.approx((low.min(), high.max()))


@pytest.mark.parametrize("several", [False, True])
def test_a_controlled_tip_shows_what_was_wanted_commanded_and_measured(several):
    rng = np.random.default_rng(4)
    wanted, reached, command, pressure = (rng.uniform(size=(7, 2) if several else 7) for _ in range(4))
    names = ("tip_x", "angle_sum") if several else ("",)
    top, low = use_figures.control_figure(TIME, wanted, reached, command, pressure, names).axes
    above, below = drawn(top), drawn(low)
    for k, name in enumerate(names):
        own = f" {k + 1}" if several else ""
        for rows, label, values, factor in (
            (above, f"{name} reached (estimated)".strip(), reached, 1e3),
            (above, f"{name} wanted".strip(), wanted, 1e3),
            (below, f"command{own}", command, 1e-3), (below, f"measured{own}", pressure, 1e-3),
        ):
            np.testing.assert_allclose(rows[label][1], factor * (values[:, k] if several else values))
    assert legend(top) == list(above)
    assert legend(low) == list(below)
    assert top.get_ylabel() == ("change of outputs (mm, mrad)" if several else "tip displacement (mm)")
    with pytest.raises(ValueError, match="zip"):
        use_figures.control_figure(TIME, wanted, reached, command, pressure, (*names, "more"))
