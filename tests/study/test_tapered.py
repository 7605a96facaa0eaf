"""Bodies whose radius changes, tendons that converge or whose azimuth the recordings show, parts of a file."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.identification.parameters import apply
from pliant.recording import make_recording
from pliant.simulation import Trace
from pliant.study.body import study_model, tendon_of, tip_moves
from pliant.study.body_tables import ActuatorEntry, TendonTable
from pliant.study.prepare import part_of

WIDE, THIN, LENGTH, E, DENSITY = 0.02, 0.01, 0.4, 3e5, 1200.0
TAPER = {"at": [0.0, LENGTH], "radius": [WIDE, THIN], "modulus": E, "density": DENSITY}


def cone(**more):
    return study_model(ActuatorEntry(length=LENGTH, links=4, joint_placement="midsegment", space=True, taper=TAPER,
                                     extensions=[{"name": "all"}], gravity=[0.0, 0.0, 9.81], **more), None)  # fmt: skip


def test_springs_masses_and_strain_of_a_cone():
    """Integrals of 1 / r^4, r^2 and 1 / r^2 along a radius that falls by `slope`."""
    made, slope = cone(), (WIDE - THIN) / LENGTH
    ends = WIDE - slope * LENGTH * np.linspace(0.0, 1.0, 5)
    assert made.stiffness == pytest.approx(E * np.pi / 4 * 3 * slope / (ends[1:] ** -3 - ends[:-1] ** -3), rel=1e-4)
    ends = WIDE - slope * np.array([0.05, 0.15, 0.25, 0.35, 0.4])
    assert made.link_mass == pytest.approx(DENSITY * np.pi / 3 / slope * (ends[:-1] ** 3 - ends[1:] ** 3), rel=1e-4)
    assert made.extensions[0].stiffness == pytest.approx(E * np.pi * WIDE * THIN, rel=1e-4)


@pytest.mark.parametrize("change", [{"mass": 0.1}, {"stiffness": 1.0}, {"taper": TAPER | {"at": [0.0, 0.3]}},
                                    {"taper": TAPER | {"at": [0.1, LENGTH]}}, {"links": None}])  # fmt: skip
def test_a_taper_that_does_not_say_what_the_body_is_like_is_refused(change):
    entries = {"length": LENGTH, "links": 4, "space": True, "taper": TAPER} | change
    with pytest.raises(InputError, match=r"\[actuator.taper\]"):
        study_model(ActuatorEntry(**entries), None)


def test_a_tendon_that_converges_and_ends():
    entry = TendonTable(name="t", driven_by="tension", azimuth_deg=90.0, lever=0.01, taper=0.02, stop=0.25)
    made = tendon_of(entry, 4, LENGTH)
    assert made.joint_gain == pytest.approx([-1.0, -1.0, -0.5, 0.0])
    assert made.distance()[:3] == pytest.approx(0.01 - 0.02 * np.array([0.05, 0.15, 0.225]))


def test_a_tendon_that_would_reach_the_axis_is_refused():
    entry = TendonTable(name="t", driven_by="tension", azimuth_deg=90.0, lever=0.01, taper=0.05, stop=0.25)
    with pytest.raises(InputError, match=r"tendon t: .* reaches the axis at 0.2 m.*correct lever, taper or stop"):
        tendon_of(entry, 4, LENGTH)
    assert tendon_of(entry.model_copy(update={"stop": 0.19}), 4, LENGTH).distance()[1] > 0.0


def test_levers_of_a_converging_tendon_are_the_slopes_of_its_length_through_sites():
    """The body bends in arcs in a plane; the length of the path is summed over sites on its cross-sections."""
    entry = TendonTable(name="t", driven_by="tension", azimuth_deg=0.0, lever=0.011, taper=0.03, stop=0.31)
    levers = cone(tendons=[entry]).actuation.levers[0, 1:8:2]  # about y

    def length(angles):
        s, thin = np.linspace(0.0, LENGTH, 40001, retstep=True)
        turn = np.interp(s, np.linspace(0.0, LENGTH, 5), np.append(0.0, np.cumsum(angles)))
        middle = 0.5 * (turn[1:] + turn[:-1])
        axis = np.cumsum(np.pad(thin * np.stack([np.sin(middle), np.cos(middle)], axis=1), ((1, 0), (0, 0))), axis=0)
        sites = axis + (0.011 - 0.03 * s)[:, None] * np.stack([np.cos(turn), -np.sin(turn)], axis=1)
        return np.linalg.norm(np.diff(sites[s <= 0.31], axis=0), axis=1).sum()

    bent, step = np.array([0.5, -0.3, 0.4, 0.2]), 1e-4
    slopes = [(length(bent + step * one) - length(bent - step * one)) / (2.0 * step) for one in np.eye(4)]
    assert -np.array(slopes) == pytest.approx(levers, rel=1e-3, abs=1e-7)  # to second order in the convergence


def test_stations_lie_on_the_link_that_holds_their_place():
    made = cone(stations=[{"name": "low", "at": 0.02}, {"name": "mid", "at": 0.17, "across": 0.01, "along": 2e-3},
                          {"name": "tip", "at": 0.4, "aside": -0.02}])  # fmt: skip
    rows = [(s.name, s.link, s.along, s.across, s.aside) for s in made.stations]
    assert rows[0] == ("low", -1, pytest.approx(0.02), 0.0, 0.0)
    assert rows[1] == ("mid", 1, pytest.approx(0.022), 0.01, 0.0)
    assert rows[2] == ("tip", 3, pytest.approx(0.05), 0.0, -0.02)
    with pytest.raises(InputError, match="station far: at must be between 0"):
        cone(stations=[{"name": "far", "at": 0.5}])


def test_one_modulus_scales_all_springs_and_changes_nothing_twice():
    made = cone()
    first = float(made.stiffness[0])
    stiff = apply(made, {"body_stiffness": 3.0 * first})
    assert stiff.stiffness == pytest.approx(3.0 * made.stiffness)
    assert stiff.extensions[0].stiffness == pytest.approx(3.0 * made.extensions[0].stiffness)
    again = apply(stiff, {"body_stiffness": 3.0 * first, "all.axial_stiffness": 7.0})
    assert again.stiffness == pytest.approx(stiff.stiffness)
    assert again.extensions[0].stiffness == 7.0


def experiment(drawn, moves):
    time = np.arange(float(len(drawn)))
    drives = {name: Trace(time, column) for name, column in zip("ab", drawn.T, strict=True)}
    place = np.append(drawn @ moves, np.zeros((len(drawn), 1)), axis=1)[:, None]
    return Experiment("e", time, place + 0.1, ("tip",), "trace", drives=drives, poses=True)


def test_the_motion_of_the_tip_shows_where_each_tendon_pulls():
    rng = np.random.default_rng(0)
    moves = np.array([[3.0, 4.0], [-2.0, 1.0]])
    both = [experiment(rng.normal(size=(6, 2)), moves), experiment(rng.normal(size=(4, 2)), moves)]
    assert tip_moves(both, ["a", "b"]) == pytest.approx(moves)
    alike = rng.normal(size=(6, 1)) * [1.0, 1.0]
    with pytest.raises(InputError, match="the azimuths of the tendons a, b cannot be estimated"):
        tip_moves([experiment(alike, moves)], ["a", "b"])


def test_a_tendon_without_azimuth_needs_recordings():
    with pytest.raises(InputError, match="state azimuth_deg"):
        tendon_of(TendonTable(name="t", driven_by="tension", lever=0.01), 4, LENGTH)


def test_a_part_of_a_recording_holds_those_rows_and_no_other():
    time = 0.1 * np.arange(40.0)
    whole = make_recording(time=time, position=np.arange(40.0)[:, None, None] * np.ones((1, 1, 3)), station=["tip"],
                           frame="spatial")  # fmt: skip
    parts = [part_of("r", whole, *ends)["position"].values[:, 0, 0] for ends in ((0.0, 0.5), (0.5, 1.0))]
    assert np.concatenate(parts) == pytest.approx(np.arange(40.0))
    with pytest.raises(InputError, match="part must be"):
        part_of("r", whole, 0.5, 1.2)
