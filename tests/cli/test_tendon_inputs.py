"""Commands on a body in space that tendons pull: inputs in their own units, from a pulse and from recordings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from command_line import invoke

from pliant.errors import InputError
from pliant.estimation import estimate
from pliant.estimation.offline import input_of
from pliant.model import Model, Space, Station, Tendon, Valve, chain_model, save_model
from pliant.recording import make_recording, write
from pliant.simulation import Pulse, Trace, simulate
from pliant.simulation.forces import PointForce
from pliant.validation.use_figures import motion_figure

CLOCK = np.linspace(0.0, 0.4, 41)
DRAWN = np.stack([3e-3 * np.sin(4.0 * CLOCK) ** 2, 0.15 * CLOCK / 0.4], axis=1)  # m, rad
NAMES, KINDS = ["long", "pair"], ["displacement", "angle"]


def arm() -> Model:
    """A tendon drawn in by a displacement, and a pair on one motor."""
    same = {"lever": 8e-3, "line_stiffness": 2e3, "pretension": 2.0}
    tendons = [
        Tendon.at_azimuth(0.3, np.ones(2), name="long", driven_by="displacement", **same),
        Tendon.at_azimuth(2.0, np.ones(2), name="pair", driven_by="angle", pair=True, pulley=0.01, **same),
    ]
    return chain_model(
        length=0.2, mass=0.05, links=2, joint_placement="midsegment", stiffness=0.3, damping=4e-3, space=Space(),
        gravity=[0.0, 0.0, -9.81], chambers=tendons, stations=[Station("tip", 1, 0.1)],
    )


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_model(arm(), tmp_path_factory.mktemp("arm") / "model.json")


def recording(kinds=KINDS, values=DRAWN, **more):
    """The inputs, with the positions of the tip if these are given."""
    return make_recording(**more, actuation=values, input_time=CLOCK, input_names=NAMES, input_kind=kinds)


def said(*words):
    done = invoke(*words)
    assert done.exit_code == 0, done.output + str(done.exception)
    return json.loads(done.stdout)


def test_a_pulse_in_the_units_of_the_tendons(model, tmp_path):
    words = ("simulate", model, "--duration", "0.3", "--start", "0.05", "--width", "1", "--level", "long=3,pair=0.2")
    numbers = said(*words, "--force", "0.1,0,-0.2", "-o", tmp_path / "path.csv", "--json")
    assert numbers["largest_displacement_mm"] == pytest.approx(3.0)
    assert numbers["largest_motor_angle_rad"] == pytest.approx(0.2)
    pull = PointForce(np.array([0.05, 0.05, 1.05, 1.05]), np.outer([0, 1, 1, 0], [0.1, 0.0, -0.2]), "tip")
    run = simulate(arm(), [Pulse(3e-3, 0.05, 1.0), Pulse(0.2, 0.05, 1.0)], duration=0.3, forces=(pull,))
    np.testing.assert_allclose(1e-3 * np.array(numbers["final_tip_mm"]), run.tip_position[-1, -1], atol=1e-9)
    columns = pd.read_csv(tmp_path / "path.csv")
    np.testing.assert_allclose(columns[["actuation_long (m)", "actuation_pair (rad)"]], run.actuation, atol=1e-12)
    assert not [name for name in columns if "pressure" in name]


def test_recorded_inputs_drive_the_body(model, tmp_path):
    file = write(recording(), tmp_path / "drawn.nc")
    numbers = said("simulate", model, "--trace", file, "--json")
    run = simulate(arm(), [Trace(CLOCK, column) for column in DRAWN.T], duration=0.4)
    np.testing.assert_allclose(1e-3 * np.array(numbers["final_tip_mm"]), run.tip_position[-1, -1], atol=1e-9)
    assert np.abs(run.tip_position[-1, -1] - run.tip_position[0, -1]).max() > 0.01
    swapped = str(invoke("simulate", model, "--trace", file, "--drive", "long=pair,pair=long").exception)
    assert "input 'long' of model 'model' is a displacement [m]" in swapped
    assert "but the input that drives it was recorded as an angle [rad]" in swapped


def test_a_dataset_states_the_unit_of_each_input():
    run = simulate(arm(), [Pulse(1e-3), Pulse(0.1)], duration=0.02)
    assert run.actuation.attrs == {"units": "m, rad", "long_name": "input behind its lag"}
    assert run["unit"].to_numpy().tolist() == ["m", "rad"]
    alone = arm().with_(chambers=arm().chambers[:1])
    run = simulate(alone, Pulse(1e-3), duration=0.02)
    assert run.actuation.attrs == {"units": "m", "long_name": "displacement behind its lag"}
    plain = chain_model(length=0.2, mass=0.05, links=2, stiffness=0.3, damping=4e-3, torque=[1e-6])
    pressed = simulate(plain, Pulse(1e4), duration=0.02)
    assert pressed.pressure.attrs == {"units": "Pa", "long_name": "gauge pressure behind the valve"}
    assert "unit" not in pressed.coords


@pytest.mark.slow
def test_the_filter_takes_recorded_tendons(model, tmp_path):
    """As it takes the same inputs given as commands, for ideal motors and without the moving average."""
    motion = simulate(arm(), [Trace(CLOCK, column) for column in DRAWN.T], times=CLOCK)
    seen = recording(
        time=CLOCK, position=motion.station_position.values, station=["tip"], frame="spatial", values=DRAWN,
    )
    found = estimate(seen, arm(), pressure_window=0.0)
    given = estimate(seen, arm(), pressure=[Trace(CLOCK, column) for column in DRAWN.T])
    for name in ("joint_angle_x", "joint_angle_y", "disturbance_x"):
        np.testing.assert_allclose(found[name], given[name], atol=1e-12)
    np.testing.assert_allclose(found.actuation, DRAWN, atol=1e-12)
    assert found["unit"].to_numpy().tolist() == ["m", "rad"]
    file = write(seen, tmp_path / "arm.nc")
    numbers = said("estimate", file, "--model", model, "-o", tmp_path / "states.nc", "--json")
    assert numbers["frames"] == CLOCK.size
    with xr.open_dataset(tmp_path / "states.nc", engine="h5netcdf") as kept:
        assert kept.actuation.attrs["units"] == "m, rad"


def test_recorded_inputs_reach_the_filter(model):
    """The moving average of 8 ms leaves straight lines; a rig's motors are taken as ideal."""
    straight = np.outer(CLOCK, [1e-2, 0.4])
    lagging = arm().with_(chambers=[replace(c, valve=Valve(rise_time=0.03, fall_time=0.03)) for c in arm().chambers])
    sources, ideal = input_of(recording(values=straight), lagging, None, 8e-3)
    for source, column in zip(sources, straight.T, strict=True):
        np.testing.assert_allclose(source(CLOCK), column, atol=1e-12)
    assert [c.valve for c in ideal.chambers] == [Valve(), Valve()]
    holed = straight.copy()
    holed[3, 1] = np.nan
    with pytest.raises(InputError, match="1 samples of the angle are missing"):
        input_of(recording(values=holed), arm(), None)
    with pytest.raises(InputError, match="no measured pressure or other input"):
        input_of(make_recording(time=CLOCK, position=np.zeros((41, 1, 3)), frame="spatial"), arm(), None)


def test_a_film_shows_a_body_in_space_from_two_sides(model, tmp_path, monkeypatch):
    from matplotlib import animation

    kept = {}
    monkeypatch.setattr(animation.FuncAnimation, "save", lambda film, path, **_: (kept.update(film=film),
                                                                               Path(path).touch()))  # fmt: skip
    done = invoke("simulate", model, "--duration", "0.2", "--start", "0", "--film", tmp_path / "arm.gif")
    assert done.exit_code == 0, done.output
    film = kept["film"]
    film._draw_was_started = True
    first, second, side = film._fig.axes
    assert [ax.get_xlabel() for ax in (first, second)] == ["x (mm)", "y (mm)"]
    assert [ax.get_ylabel() for ax in (first, second)] == ["z (mm)", "z (mm)"]
    assert side.get_ylabel() == "input (mm, rad)"
    run = simulate(arm(), [Pulse(*pulse) for pulse in levels_of(side)], duration=0.2)
    film._func(150)
    for ax, across in ((first, 0), (second, 1)):
        ends = 1e3 * run.tip_position.to_numpy()[150][:, [across, 2]]
        np.testing.assert_allclose(ax.lines[1].get_xydata()[2:], ends, atol=1e-6)
        np.testing.assert_allclose(ax.lines[1].get_xydata()[:2], [[0, 0], [0, 50]], atol=1e-9)


def test_a_figure_of_a_motion_names_the_unit_of_each_input():
    run = simulate(arm(), [Pulse(3e-3), Pulse(0.2)], duration=0.02)
    below = motion_figure(run).axes[-1]
    assert below.get_ylabel() == "input (mm, rad)"
    assert [line.get_label() for line in below.lines] == ["displacement, long (mm)", "motor angle, pair (rad)"]
    alone = arm().with_(chambers=arm().chambers[:1])
    below = motion_figure(simulate(alone, Pulse(3e-3), duration=0.02)).axes[-1]
    assert below.get_ylabel() == "displacement (mm)"


def test_messages_about_inputs_state_their_units():
    for values in ([1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(InputError, match=r"expected 2 value\(s\), one for each input \(long \[m\], pair \[rad\]\)"):
            arm().actuation.pressures(values)
    with pytest.raises(InputError, match=r"needs 2 inputs, one for each \(long, pair\) in this order, got 1"):
        simulate(arm(), Pulse(1e-3), duration=0.02)


def levels_of(side):
    """The pulses that the panel of the inputs shows, SI."""
    return [(factor * line.get_ydata()[-1], 0.0, 2.76)
            for line, factor in zip(side.lines[:2], (1e-3, 1.0), strict=True)]
