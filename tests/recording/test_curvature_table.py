"""Tables of curvature become shapes: circles, and a helix whose closed form is known."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording import read

S = np.linspace(0.0, 160.0, 17)  # mm
T = np.arange(20) / 25
UNIT = {"curvature_unit": "1/m"}


def write(path, curvature, direction=None, *, name="t_ms", start="k_"):
    """One row for each time; curvature (T, S) as given, direction (S,) in degrees."""
    turning = [] if direction is None else [f"a_{s:g}" for s in S]
    rows = [",".join([name, *(f"{start}{s:g}" for s in S), *turning, "temperature"])]
    for t, k in zip(T, curvature, strict=True):
        cells = [1e3 * t, *k, *(direction if direction is not None else []), 21.0]
        rows.append(",".join(f"{c:.9f}" for c in cells))
    path.write_text("\n".join([*rows, ""]))
    return path


def test_constant_curvature_is_a_circle(tmp_path):
    kappa = np.linspace(0.5, 12.0, len(T))
    ds = read(write(tmp_path / "fbg.csv", np.repeat(kappa[:, None], len(S), 1)), mapping=UNIT, format="curvature")
    np.testing.assert_allclose(ds["time"], T, atol=1e-9)
    s, k = 1e-3 * S, kappa[:, None]
    circle = np.stack([(np.cos(k * s) - 1) / k, np.sin(k * s) / k], 2)
    np.testing.assert_allclose(ds["position"][..., :2], circle, atol=1e-9)
    np.testing.assert_allclose(ds["arc_length"], s)
    assert "left out: temperature" in ds.attrs["history"]


def test_a_turning_direction_is_a_helix(tmp_path):
    """Curvature k and torsion w: radius k / (k^2 + w^2) and pitch 2 pi w / (k^2 + w^2)."""
    k, w = 8.0, 15.0
    path = write(tmp_path / "fbg.txt", np.full((len(T), len(S)), k / 1e3), np.degrees(w * 1e-3 * S), start="kappa ")
    ds = read(path, mapping={"curvature_unit": "1/mm", "curvature": "kappa "}, format="curvature")
    place, omega = ds["position"].values[0], np.hypot(k, w)
    apart = np.linalg.norm(place[-1] - place[0])
    s = 0.16
    exact = np.hypot(2 * k / omega**2 * np.sin(omega * s / 2), w / omega * s)
    assert apart == pytest.approx(exact, rel=5e-4)  # curvature is linear from station to station


@pytest.mark.parametrize(("options", "said"), [
    ({}, "curvature_unit"), ({**UNIT, "curvature": "c"}, "has 0 columns of curvature, named c<arc length>"),
    ({**UNIT, "skip_lines": 50}, "no row of names after its first 50"),
])
def test_what_is_no_table_of_curvature_is_refused(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        read(write(tmp_path / "fbg.csv", np.ones((len(T), len(S)))), mapping=options, format="curvature")


def test_the_header_is_recognised(tmp_path):
    ds = read(write(tmp_path / "fbg.csv", np.ones((len(T), len(S))), name="time (ms)"), mapping=UNIT)
    assert ds.attrs["source_format"] == "curvature"
