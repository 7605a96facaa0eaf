"""Terms that give parts of a body values of their own, on data that no model of pliant made: two rods by SciPy, a joint
and a straight body that tendons pull in closed form.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pliant.identification import Experiment, Parameter
from pliant.identification.fit import fit
from pliant.model import Extension, Space, Station, Tendon, chain_model
from pliant.selection import select_model, terms_for
from pliant.simulation import Trace

pytestmark = pytest.mark.slow  # kernels of their own are compiled first
TIMES = np.arange(0.0, 2.0, 0.01)
NOISE = 1e-6  # m; the rods swing by less than 2 mm
ROD, MASS, STIFFNESS, TORQUE = 0.06, 0.015, 0.5, 6e-7  # m, kg, N m/rad, N m/Pa
TRACE = Trace([0.1, 0.13, 1.0, 1.03], [0.0, 1e4, 1e4, 0.0])
PARTS = ("joint_damping", "markers")


def two_rods(damping=(3e-3, 3e-3), marker=(0.03, 0.0)) -> Experiment:
    """Small swings of two uniform rods on springs, from their linear equations of motion."""
    absolute = MASS * ROD**2 * np.array([[4.0 / 3.0, 0.5], [0.5, 1.0 / 3.0]])
    to_absolute = np.array([[1.0, 0.0], [1.0, 1.0]])
    inverse = np.linalg.inv(to_absolute.T @ absolute @ to_absolute)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        force = TORQUE * TRACE(np.array([t])) - STIFFNESS * y[:2] - np.array(damping) * y[2:]
        return np.concatenate([y[2:], inverse @ force])

    turns = solve_ivp(rate, (0.0, 2.0), np.zeros(4), t_eval=TIMES, max_step=2e-3, rtol=1e-8, atol=1e-10).y[:2]
    first, second = np.cumsum(turns, axis=0)
    along, left = (np.stack([s * np.sin(a), c * np.cos(a)], axis=1) for a, s, c in ((first, -1, 1), (second, -1, 1)))
    across = np.stack([-np.cos(first), -np.sin(first)], axis=1)
    middle, tip = marker[0] * along + marker[1] * across, ROD * (along + left)
    path = np.stack([middle, tip], axis=1)
    path = path + NOISE * np.random.default_rng(5).normal(size=path.shape)
    return Experiment("rods", TIMES, path, ("middle", "tip"), "trace", TRACE)


def rods():
    return chain_model(length=2 * ROD, mass=2 * MASS, links=2, stiffness=0.4, damping=2e-3, torque=[0.0],
                       stations=(Station("middle", 0, 0.03), Station("tip", 1, ROD)))  # fmt: skip


@pytest.mark.parametrize(("change", "chosen"), [
    ({}, ()), ({"damping": (6e-3, 1e-3)}, ("joint_damping",)), ({"marker": (0.027, 0.001)}, ("markers",)),
])  # fmt: skip
def test_a_part_has_a_value_of_its_own_where_the_rods_have_one(change, chosen):
    train, model = [two_rods(**change)], rods()
    result = select_model(train, model, terms=terms_for(model, train, only=PARTS))
    assert result.terms == chosen
    values = result.result.values
    assert values["stiffness"] == pytest.approx(STIFFNESS, rel=0.01)
    known = {"joint_damping": {"damping_1": 6e-3, "damping_2": 1e-3},
             "markers": {"middle.along": 0.027, "middle.across": 0.001}}
    for name in chosen:
        for parameter, value in known[name].items():
            assert values[parameter] == pytest.approx(value, rel=0.1, abs=3e-5), parameter


K, LINE, LEVER = 0.02, 800.0, 5e-3  # N m/rad, N/m, m


def pulled_joint(pretension: float, origin: tuple[float, ...]) -> Experiment:
    """Poses of one joint between two opposite tendons, each slack where its length asks for it, in a moved frame."""
    drawn = 1e-3 * np.linspace(-5.0, 5.0, 61)

    def turn(u: float) -> float:
        def torque(q: float) -> float:
            pull = LINE * (u - LEVER * q)
            return LEVER * (max(0.0, pretension + pull) - max(0.0, pretension - pull)) - K * q

        return brentq(torque, -2.0, 2.0, xtol=1e-12)

    q = np.array([turn(u) for u in drawn])
    path = np.stack([0.05 * np.sin(q), 0.0 * q, 0.05 + 0.05 * np.cos(q)], axis=1)[:, None]
    path = path + np.array(origin) + 1e-5 * np.random.default_rng(2).normal(size=path.shape)
    time = np.arange(drawn.size, dtype=float)
    return Experiment("poses", time, path, ("tip",), "trace", drives={"pull": Trace(time, drawn)}, poses=True)


@pytest.mark.parametrize(("pretension", "origin", "chosen"), [
    (0.0, (0.0, 0.0, 0.0), ()), (0.8, (0.0, 0.0, 0.0), ("pretension",)), (0.0, (1e-3, 2e-3, -1e-3), ("origin",)),
])  # fmt: skip
def test_slack_tendons_show_a_pretension_and_positions_an_offset_of_the_base(pretension, origin, chosen):
    cord = Tendon.at_azimuth(0.0, [1], driven_by="displacement", name="pull", lever=LEVER, line_stiffness=LINE,
                             pair=True)  # fmt: skip
    model = chain_model(length=0.1, mass=0.01, links=1, joint_placement="midsegment", stiffness=K, damping=1e-3,
                        chambers=[cord], space=Space(), gravity=(0.0, 0.0, 0.0),
                        stations=[Station("tip", 0, 0.05)])  # fmt: skip
    train = [pulled_joint(pretension, origin)]
    result = select_model(train, model, terms=terms_for(model, train, only=["pretension", "imbalance", "origin"]),
                          common=[Parameter("stiffness", K, free=False), Parameter("damping", 1e-3, free=False)])
    assert result.terms[: len(chosen)] == chosen
    assert bool(result.terms) == bool(chosen)
    assert result.result.rmse["poses"] == pytest.approx(1e-5 * np.sqrt(3.0), rel=0.1)
    known = {"pretension": {"pull.pretension": pretension},
             "origin": dict(zip(("base_x", "base_y", "base_z"), origin, strict=True))}  # fmt: skip
    for name in chosen:
        for parameter, value in known[name].items():
            assert result.result.values[parameter] == pytest.approx(value, rel=0.05), parameter


def test_segments_between_the_ends_of_tendons_shorten_as_bars_do():
    """Three tendons run to the tip and three to the middle, each three pulled alike: the strains are -F / EA."""
    azimuths, axial, length = 2 * np.pi * np.arange(3) / 3, np.array([900.0, 300.0]), 0.2
    far = [Tendon.at_azimuth(a, [1, 1, 1, 1], lever=0.01, name=f"far_{k}") for k, a in enumerate(azimuths)]
    half = [Tendon.at_azimuth(a, [1, 1, 0, 0], lever=0.01, name=f"half_{k}") for k, a in enumerate(azimuths)]
    model = chain_model(length=length, mass=0.02, links=4, stiffness=0.4, damping=1e-3, chambers=[*far, *half],
                        space=Space(), gravity=(0.0, 0.0, 0.0),
                        stations=[Station("middle", 1, 0.05), Station("tip", 3, 0.05)])  # fmt: skip
    time, rng = np.arange(8.0), np.random.default_rng(3)
    tip_pull, half_pull = rng.uniform(0.0, 8.0, (2, 8))  # N in each of three tendons
    shorter = 3.0 * np.stack([tip_pull + half_pull, tip_pull], axis=1) / axial * 0.5 * length
    path = np.zeros((8, 2, 3))
    path[:, 0, 2], path[:, 1, 2] = 0.1 - shorter[:, 0], length - shorter.sum(axis=1)
    drives = {c.name: Trace(time, pull) for cs, pull in ((far, tip_pull), (half, half_pull)) for c in cs}
    poses = Experiment("poses", time, path, ("middle", "tip"), "trace", drives=drives, poses=True)
    (term,) = terms_for(model, [poses], only=["segments"])
    assert [(e.start, e.end(length)) for e in term.segments] == [(0.0, 0.1), (0.1, 0.2)]
    result = fit([poses], term.model(model), term.begun(term.grid[1], {}), time_step=1e-3, starts=1)
    stiff = [result.values[f"segment_{k}.axial_stiffness"] for k in (1, 2)]
    assert stiff == pytest.approx(axial.tolist(), rel=1e-3)


def test_walls_that_stiffen_need_a_body_that_lengthens():
    model = rods()
    train = [two_rods()]
    assert "wall_stiffening" not in {t.name for t in terms_for(model, train)}
    lengthened = terms_for(model.with_(extensions=(Extension(900.0, 2.0),)), train, only=["wall_stiffening"])
    assert [t.needs for t in lengthened] == [""]
    assert all(e.curved and not e.stiffens_bending for t in lengthened for e in t.segments)
