"""Tables of curvature become shapes: circles, and a helix whose closed form is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pliant.errors import InputError
from pliant.preprocessing.align import align
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


def test_names_state_the_unit_of_the_direction(tmp_path):
    """A mapping of the other columns leaves the radians of the names as they are."""
    path, turn = tmp_path / "fbg.csv", 1.2
    arcs = [f"{s:g} mm" for s in S]
    head = ["t", *(f"K {s}" for s in arcs), *(f"Dir {s} (rad)" for s in arcs)]
    rows = [",".join(map(str, [t, *[4.0] * len(S), *[turn] * len(S)])) for t in T]
    path.write_text("\n".join([",".join(head), *rows, ""]))
    mapping = {**UNIT, "curvature": "K ", "direction": "Dir "}
    places = [read(path, mapping={**mapping, **unit}, format="curvature")["position"].values[0, -1]
              for unit in ({}, {"direction_unit": "rad"}, {"direction_unit": "deg"})]  # fmt: skip
    np.testing.assert_array_equal(places[0], places[1])
    assert np.arctan2(*places[2][[2, 0]]) != pytest.approx(np.arctan2(*places[0][[2, 0]]), abs=0.5)


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


def test_two_components_are_a_curvature_and_its_direction(tmp_path):
    k, w = 8.0 + 40 * 1e-3 * S, 15.0 * 1e-3 * S
    direction = np.degrees(w)
    one = read(write(tmp_path / "a.csv", np.tile(k, (len(T), 1)), direction), mapping=UNIT, format="curvature")
    rows = [",".join(["t", *(f"kx {s:g}" for s in S), *(f"ky {s:g}" for s in S)])]
    rows += [",".join(f"{c:.9f}" for c in [t, *(k * np.cos(w)), *(k * np.sin(w))]) for t in T]
    (tmp_path / "b.csv").write_text("\n".join([*rows, ""]))
    mapping = {**UNIT, "components": ["kx ", "ky "]}
    two = read(tmp_path / "b.csv", mapping=mapping, format="curvature")
    np.testing.assert_allclose(two["position"], one["position"], atol=1e-9)
    body = align(two, base="s000", tangent="+y", plane="-x", rest=[0, 1], space=True)
    # the frame's own equations by another integrator: t' = k1 d1 + k2 d2
    found = solve_ivp(lambda s, y: frame_rate(s, y, np.interp(s, 1e-3 * S, k * np.cos(w)),
                                              np.interp(s, 1e-3 * S, k * np.sin(w))),
                      (0, 0.16), [0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1, 0], rtol=1e-9, atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(body["position"].values[0, -1], found.y[:3, -1], atol=3e-6)
    with pytest.raises(InputError, match="columns kz<arc length> at the same arc lengths"):
        read(tmp_path / "b.csv", mapping=mapping | {"components": ["kx ", "kz"]}, format="curvature")


def frame_rate(s, y, k1, k2):
    """Derivative (12,) of place, tangent and both directions of bending: a frame that does not turn about the curve."""
    tangent, d1, d2 = y[3:6], y[6:9], y[9:]
    return np.concatenate([tangent, k1 * d1 + k2 * d2, -k1 * tangent, -k2 * tangent])


@pytest.mark.parametrize(("options", "said"), [
    ({}, "curvature_unit"), ({**UNIT, "curvature": "c"}, "has 0 columns of curvature, named c<arc length>"),
    ({**UNIT, "skip_lines": 50}, "no row of column names after its first 50"),
])
def test_what_is_no_table_of_curvature_is_refused(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        read(write(tmp_path / "fbg.csv", np.ones((len(T), len(S)))), mapping=options, format="curvature")


def test_the_header_is_recognised(tmp_path):
    ds = read(write(tmp_path / "fbg.csv", np.ones((len(T), len(S))), name="time (ms)"), mapping=UNIT)
    assert ds.attrs["source_format"] == "curvature"


def test_units_behind_the_arc_length_and_pressures_of_the_table_are_read(tmp_path):
    rows = "".join(f"{0.01 * k:.2f},{0.1 * k},{0.2 * k},{k},{2 * k},7\n" for k in range(12))
    names = "t,bend 0 cm (1/m),bend 2 cm (1/m),left [kPa],right [kPa],room"
    (tmp_path / "fbg.csv").write_text(f"{names}\n{rows}")
    mapping = {"format": "curvature", "curvature": "bend ", "curvature_unit": "1/m"}
    ds = read(tmp_path / "fbg.csv", mapping=mapping)
    np.testing.assert_allclose(ds["arc_length"], [0.0, 0.02])
    assert ds["chamber"].values.tolist() == ["left", "right"]
    np.testing.assert_allclose(ds["pressure"].values[:, 1], 2e3 * np.arange(12))
    assert "1 column(s) of fbg.csv were left out: room" in ds.attrs["history"]
