"""Contact of arms in space: moment arms by virtual work, the planar case, and an arm that MuJoCo moves and pushes."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
import typer
import xarray as xr
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from typer.testing import CliRunner

from pliant.cli.contact import contact as command
from pliant.contact import find_contact, free_motion, locate, map_contacts, static_residual
from pliant.contact.locate import moment_arms, points
from pliant.errors import InputError
from pliant.exporters.mjcf import controls, mjcf
from pliant.exporters.provenance import Provenance
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Space, Station, chain_model, save_model
from pliant.recording import make_recording, write

BODY = {"length": 0.3, "mass": 0.1, "links": 4, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 5e-3}
H, SUB, NOISE = 1 / 75, 10, 1e-4


def test_moment_arms_are_those_of_virtual_work(rng):
    """Rigid links against the Jacobian of points, twist and a strain included."""
    model = chain_model(
        **BODY, torque=(1e-6,), space=Space(twist_ratio=0.7, radius=0.01, rest_turn=rng.normal(0, 0.2, (4, 3))),
        extensions=(Extension(60.0, 0.05, 0.0, None, "all"),),
    )  # fmt: skip
    chain, x = mechanics_of(model), rng.normal(0, 0.3, (2, 13))
    link, along = points(model, 0.02)
    arms = moment_arms(model, x, link, along, rigid=True)
    for t in range(2):
        frames = np.array(chain.posed(x[t]).R)[1 + link]
        for p in range(0, link.size, 3):
            J = chain.position_jacobian(x[t], Station("p", int(link[p]), float(along[p])))
            assert arms[t, p] == pytest.approx(frames[p].T @ J, abs=1e-14)


@pytest.mark.parametrize("rigid", [True, False])
def test_a_push_in_a_plane_is_located_as_the_planar_chain_does(rng, rigid):
    plane, space = (chain_model(**BODY, torque=(1e-6,), **more) for more in ({}, {"space": True}))
    q, force = rng.normal(0.15, 0.1, 4), np.array([0.3, -0.1])
    angle, x = mechanics_of(plane).coordinates(q), np.kron(q, [1.0, 0.0])
    link, along = points(plane, 5e-4)
    p = int(0.8 * link.size)
    torque = force @ moment_arms(plane, angle[None], link[[p]], along[[p]], rigid=rigid)[0, 0]
    flat = locate(plane, angle, torque, 1e-8 * np.eye(4), rigid=rigid)
    whole = locate(space, x, np.kron(torque, [1.0, 0.0]), 1e-8 * np.eye(8), rigid=rigid)
    assert whole.arc_length == pytest.approx(flat.arc_length, abs=2e-3)
    assert whole.force[0] == pytest.approx(0.0, abs=1e-9)
    assert whole.force[1:] == pytest.approx(flat.force, rel=0.02, abs=2e-3)
    assert whole.position[1:] == pytest.approx(flat.position, abs=2e-3)
    assert whole.left[1:] == pytest.approx(np.sign(flat.normal) * flat.left, abs=0.01)


# an arm that MuJoCo moves


@cache
def arm(links=4):
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name)
                for a, name in zip(np.radians([90, 210, 330]), "abc", strict=True)]  # fmt: skip
    l = BODY["length"] / links
    tips = [Station(f"tip_{k + 1}", k, l if k + 1 < links else 0.5 * l) for k in range(links)]
    return chain_model(**BODY | {"links": links}, gravity=(0.0, 0.0, -9.81), chambers=chambers, stations=tips,
                       space=Space(radius=0.012))  # fmt: skip


class Pushed:
    """The arm in MuJoCo, with a force at a point of a link."""

    def __init__(self, model=None):
        self.model = model or arm()
        self.mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
        self.m = self.mujoco.MjModel.from_xml_string(
            mjcf(self.model, Provenance(self.model, "mjcf", "test"), time_step=H / SUB, highest=1e6))
        self.d = self.mujoco.MjData(self.m)

    def step(self, levels, force=(0.0, 0.0, 0.0), link=3, along=0.02):
        for name, c, _ in controls(self.model):
            self.d.ctrl[self.m.actuator(name).id] = levels[c]
        body = self.m.body(f"link_{link + 1}").id
        turn, place = self.d.xmat[body].reshape(3, 3), self.d.xpos[body]
        self.d.qfrc_applied[:] = 0.0
        self.mujoco.mj_applyFT(self.m, self.d, np.array(force), np.zeros(3), place + along * turn[:, 2], body,
                               self.d.qfrc_applied)  # fmt: skip
        self.mujoco.mj_step(self.m, self.d)

    def swings(self):
        """Coordinates of pliant's joints from the frames of the bodies: their axes' swings, twists left out."""
        self.mujoco.mj_kinematics(self.m, self.d)
        x, whole = np.zeros(8), np.eye(3)
        for k in range(4):
            z = whole.T @ self.d.xmat[self.m.body(f"link_{k + 1}").id].reshape(3, 3)[:, 2]
            size = np.arctan2(np.hypot(z[0], z[1]), z[2])
            x[2 * k : 2 * k + 2] = size * np.array([-z[1], z[0]]) / max(np.hypot(z[0], z[1]), 1e-300)
            whole = whole @ Rotation.from_rotvec([*x[2 * k : 2 * k + 2], 0.0]).as_matrix()
        return x

    def tips(self):
        self.mujoco.mj_kinematics(self.m, self.d)
        return np.array([self.d.site_xpos[self.m.site(p.name).id] for p in self.model.points])


def test_a_force_at_rest_is_found_in_an_arm_of_mujoco():
    """What is across the body to 8 %, place and all three components within 3 standard deviations; chi-square of none.

    What hinges one after the other turn other than swings do counts as 0.6 mN m.
    """
    levels, force = np.array([30e3, 10e3, 0.0]), np.array([0.12, -0.15, 0.05])
    covariance = 6e-4**2 * np.eye(8)
    for push, along in ((np.zeros(3), 0.02), (force, 0.02)):
        body = Pushed()
        body.m.dof_damping[:] *= 15.0  # rests do not depend on it
        for _ in range(2500):
            body.step(levels, push, 3, along)
        torque = static_residual(arm(), body.swings()[None], levels[None])[0]
        found = locate(arm(), body.swings(), torque, covariance, rigid=True)
        if not push.any():
            assert found.chi_square_free < chi2.ppf(0.999, 8)
            continue
        assert found.chi_square_free > 10 * chi2.ppf(0.999, 8)
        error, z = found.force - force, mechanics_of(arm()).directions(body.swings())[-1]
        assert np.linalg.norm(error - (error @ z) * z) < 0.08 * np.linalg.norm(force)
        assert error @ np.linalg.solve(found.covariance, error) < 3.0**2
        assert found.arc_interval[0] < 0.2625 + along < found.arc_interval[1]
        assert found.arc_length == pytest.approx(0.2625 + along, abs=0.01)


def filmed(seed, seconds, pushes=()):
    """Frames of an arm of two links from rest under wandering pressures, its tips with noise, as a recording."""
    rng, body = np.random.default_rng(seed), Pushed(arm(2))
    clock = np.arange(round(seconds / H)) * H
    phase, speed = rng.uniform(0, 2 * np.pi, (3, 2)), np.array([0.25, 0.6])
    waves = [[np.sin(2 * np.pi * speed * t + phase[c]).sum() for c in range(3)] for t in clock]
    levels = (1.0 - np.exp(-clock[:, None])) * (3e4 + 1.2e4 * np.array(waves))
    places = []
    for t, level in zip(clock, levels, strict=True):
        places.append(body.tips())
        force = next((push for start, stop, push in pushes if start <= t < stop), np.zeros(3))
        for _ in range(SUB):
            body.step(level, force, 1, 0.0575)
    seen = np.array(places) + NOISE * rng.standard_normal((clock.size, 2, 3))
    return make_recording(clock, seen, station=[p.name for p in body.model.points], frame="spatial",
                          pressure=levels, pressure_time=clock, chamber=list("abc"))  # fmt: skip


def commanded(folder, *recordings):
    """What `pliant contact` reports, and the file it writes, of the last of these recordings."""
    save_model(arm(2), folder / "model.json")
    names = [folder / f"{k}.nc" for k in range(len(recordings))]
    for name, recording in zip(names, recordings, strict=True):
        write(recording, name)
    app = typer.Typer()
    app.command()(command)
    words = [names[-1], "--model", folder / "model.json", "--false-alarms-per-hour", 10, "--json",
             "-o", folder / "contact.nc", "--figure", folder / "contact.png"]  # fmt: skip
    done = CliRunner().invoke(app, list(map(str, [*words, *(w for name in names[:-1] for w in ("--free", name))])))
    assert done.exit_code == 0, done.output
    assert (folder / "contact.png").stat().st_size > 5000
    with xr.open_dataset(folder / "contact.nc", engine="h5netcdf") as found:
        return json.loads(done.stdout), found.load()


@pytest.mark.slow  # compiles the filter, for sizes that tests of the filter have
def test_a_push_is_noticed_located_and_measured_in_an_arm_of_mujoco(tmp_path):
    """Two forces of 0.2 N on the last link are noticed within 0.1 s, their releases not; without them is no alarm.

    The place lies within its interval, what is across the body is right to 15 %, all three components to what is said.
    """
    free = [filmed(1, 12.0), filmed(2, 12.0)]
    learnt = free_motion(free, arm(2), false_alarms_per_hour=10.0)
    assert find_contact(filmed(3, 12.0), arm(2), free=learnt).attrs["alarm_s"] == []
    pushes = [(4.0, 5.0, np.array([0.15, -0.12, 0.0])), (8.0, 9.0, np.array([-0.1, 0.15, 0.08]))]
    report, found = commanded(tmp_path, *free, filmed(4, 12.0, pushes))
    alarms = np.array(found.attrs["alarm_s"])
    assert len(alarms) == len(pushes)  # none while the filter still shows a release, up to half a second after it
    for start, stop, force in pushes:
        assert start < alarms[alarms > start][0] < start + 0.1
        late = found.sel(time=slice(start + 0.6, stop - 0.05))
        error = late.contact_force.median("time").values - force
        z = np.diff(late.tip_position.median("time").values[-2:], axis=0)[0]
        z /= np.linalg.norm(z)
        assert np.linalg.norm(error - (error @ z) * z) < 0.15 * np.linalg.norm(force)
        assert error @ np.linalg.solve(late.force_covariance.median("time").values, error) < chi2.ppf(0.99, 3)
        assert float(late.contact_arc_length.median()) == pytest.approx(0.2825, abs=0.015)
        assert float(late.arc_low.median()) < 0.2825 < float(late.arc_high.median())
    assert report["contacts"] == len(alarms)
    assert report["normal_force_n"] == pytest.approx(0.19, rel=0.15)
    with pytest.raises(InputError, match="a map needs a body in a plane"):
        map_contacts([found])
    assert set(found.external_torque_x.dims) == {"time", "joint"}
    assert found.contact_force.shape[1] == 3


def test_shapes_of_another_size_are_refused():
    with pytest.raises(InputError, match="locate needs"):
        locate(arm(), np.zeros(4), np.zeros(8), np.eye(8))
