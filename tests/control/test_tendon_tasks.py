"""Tasks of arms that tendons pull: limits, log, report and messages in the unit of the input; a study's arm by MPC."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.cli.control import control, meanings, reached
from pliant.control import Limits, Mpc, design_outputs, read_task
from pliant.control.model_plant import ModelPlant
from pliant.control.rehearsal import range_of
from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.fit import fit
from pliant.loop import Bounds, VirtualActuator, VirtualClock, Watchdog, log_columns, read_log, receiver_of
from pliant.loop.run import streams
from pliant.loop.sample import sample
from pliant.loop.task import check_units
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Space, chain_model, save_model
from pliant.simulation import Trace, equilibrium, simulate
from pliant.study.body import study_model
from pliant.study.body_tables import ActuatorEntry
from pliant.validation.use_figures import control_figure

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

AZIMUTHS = {"red": 90.0, "green": 210.0, "blue": 330.0}  # deg
LENGTH, STIFFNESS, DAMPING = 0.3, 0.09, 2.2e-3  # m, N m^2, N m^2 s


def arm(links, driven_by="tension", **more):
    """The arm that the actuator table of a study describes, between three tendons, joints in the middle of links."""
    stiff = {"line_stiffness": 2e3, "pretension": 1.0} if driven_by != "tension" else {}
    same = {"driven_by": driven_by, "lever": 8e-3, **stiff}
    tables = [{"name": name, "azimuth_deg": azimuth, **same} for name, azimuth in AZIMUTHS.items()]
    table = {"length": LENGTH, "mass": 0.1, "links": links, "joint_placement": "midsegment", "space": True,
             "gravity": [0.0, 0.0, 9.81], "tendons": tables}  # fmt: skip
    model = study_model(ActuatorEntry.model_validate(table), None)
    each = LENGTH / links
    return model.with_(**{"stiffness": STIFFNESS / each, "damping": DAMPING / each, "name": "arm", **more})


def task_file(folder, text="highest_n = 10.0\nslew_n_per_s = 100.0\n", feedback="mpc"):
    path = folder / "task.toml"
    path.write_text(f'period_ms = 4.0\n{text}duration_s = 1.2\nfeedback = "{feedback}"\n[[setpoint]]\ntime_s = 0.1\n'
                    "tip_x_mm = -12.0\ntip_y_mm = 25.0\n")  # fmt: skip
    return path


@pytest.mark.parametrize(("text", "unit", "highest", "slew"), [
    ("highest_n = [10.0, 12, 8]\nslew_n_per_s = 100.0\n", "N", [10.0, 12.0, 8.0], 100.0),
    ("highest_mm = 4\nslew_mm_per_s = 50\n", "m", [4e-3] * 3, 0.05),
    ("highest_rad = 1.5\n", "rad", [1.5] * 3, np.inf), ("highest_kpa = 90\n", "Pa", [9e4] * 3, np.inf),
])  # fmt: skip
def test_limits_stand_in_the_unit_of_the_input(text, unit, highest, slew, tmp_path):
    wanted = read_task(task_file(tmp_path, text))
    assert wanted.unit == unit
    assert wanted.limits.each(3) == pytest.approx(highest)
    assert wanted.limits.slew == pytest.approx(slew)


@pytest.mark.parametrize("text", [
    "highest_n = 10\nhighest_kpa = 90\n", "highest_n = 10\nslew_kpa_per_s = 90\n", "slew_n_per_s = 9\n",
    "highest_mm = 3\nhighest_rad = 1\n",
])  # fmt: skip
def test_limits_of_two_units_are_refused(text, tmp_path):
    with pytest.raises(InputError, match=r"limits all inputs in one unit, in highest_\.\.\. and slew_"):
        read_task(task_file(tmp_path, text))


def test_limits_that_are_not_the_models_are_refused(tmp_path):
    wanted = read_task(task_file(tmp_path))
    check_units(arm(2), wanted)
    words = "'red' of 'arm' takes a displacement .m.: give highest_mm in place of highest_n"
    with pytest.raises(InputError, match=words):
        check_units(arm(2, "displacement"), wanted)
    air = chain_model(length=0.3, mass=0.1, links=2, stiffness=1.0, damping=0.01, torque=(1e-6,), space=Space())
    with pytest.raises(InputError, match="give highest_kpa in place of highest_n"):
        check_units(air, wanted)
    mixed = arm(2).with_(chambers=(*arm(2).chambers[:2], Chamber((1e-6,), name="air")))
    with pytest.raises(InputError, match="make a controller by design_outputs and Lqr or Mpc"):
        check_units(mixed, wanted)
    path = task_file(tmp_path)
    path.write_text(path.read_text() + "[receiver]\nprivate_link = true\n")
    with pytest.raises(InputError, match="a receiver limits pressures, but the task gives highest_n"):
        receiver_of(path, print)


def test_what_the_loop_says_has_the_unit_of_the_input():
    assert range_of(Limits(10.0, 100.0), "N") == "0 ... 10 N and 100 N/s"
    assert range_of(Limits(4e-3), "m") == "0 ... 4 mm"
    assert range_of(Limits(190e3, 1e6), "Pa") == "0 ... 190 kPa and 1000 kPa/s"
    assert log_columns(1, 2, ("tip_x",), "N")[2:6] == ["tension_1_n", "tension_2_n", "command_1_n", "command_2_n"]
    assert log_columns(1, 1, (), "rad")[2:4] == ["angle_rad", "command_rad"]
    dog = Watchdog(Bounds(12.0, lowest_pressure=-1.0, unit="N"))
    dog.pressure(0, np.array([11.0, -2.0]))
    assert dog.fault == "the tension of -2.0 N is outside -1.0 ... 12.0 N"
    dog.reset()
    dog.command(0, np.array([13.0]))
    assert dog.fault == "the command of 13.0 N is outside 0 ... 12.0 N"
    motor = Watchdog(Bounds(0.44, lowest_pressure=-0.02, unit="rad"))
    motor.pressure(0, np.array([0.46]))
    assert motor.fault == "the angle of 0.460 rad is outside -0.020 ... 0.440 rad"
    motor.reset()
    motor.command(0, np.array([0.46]))
    assert motor.fault == "the command of 0.460 rad is outside 0 ... 0.440 rad"
    assert meanings("m")["command_sd_rest_mm"] == meanings("Pa")["command_sd_rest_kpa"]
    assert set(meanings("m")) & set(meanings("Pa")) == set(meanings("N")) & set(meanings("rad"))
    dog.reset()
    dog.frozen(0, 0, 251)
    assert dog.fault.startswith("frozen tension: 251 consecutive readings")
    with pytest.raises(InputError, match="unit must be one of Pa, N, m, rad"):
        Bounds(1.0, unit="kg")
    _, tensions = streams(0, 0, 3, "N")
    assert tensions.accept(sample("pressure", [2.0], 1, "N"), 1) == pytest.approx([2.0])
    assert tensions.accept(sample("pressure", [2.0], 2, "kPa"), 2) is None


def test_a_virtual_arm_reads_in_its_unit_with_a_noise_of_its_size():
    clock = VirtualClock()
    plant = ModelPlant(arm(2))
    source = VirtualActuator(plant, clock, "N")
    clock.sleep_until(clock.now() + 4_000_000)
    first = source.read()
    assert first.unit == "N"
    assert 1e-3 < np.abs(first.array).max() < 1.0
    with pytest.raises(InputError, match=r"finite and >= 0 \(N\)"):
        plant.advance([-1.0, 0.0, 0.0])


def test_figure_and_numbers_have_the_unit_of_the_input():
    import pandas as pd

    time = np.linspace(0.0, 1.0, 5)
    figure = control_figure(time, time, time, 2.0 * time, 2.0 * time, unit="N")
    assert figure.axes[1].get_ylabel() == "tension (N)"
    assert figure.axes[1].lines[0].get_ydata()[-1] == 2.0
    log = pd.DataFrame({"time_s": time, "error_tip_x_m": time, "command_1_m": 2e-3 * time, "command_2_m": time})
    done = SimpleNamespace(log=log, unit="m", summary={"fault": ""})
    assert reached(done)["highest_command_1_mm"] == pytest.approx(2.0)


@pytest.mark.slow  # compiles the prediction
@pytest.mark.parametrize("driven_by", ["tension", "displacement"])
def test_the_program_of_tendons_is_scaled_as_that_of_pressures(driven_by):
    """Commands in parts of their highest: every program is solved, within the limits."""
    model, highest = arm(2, driven_by), 10.0 if driven_by == "tension" else 4e-3
    limits = Limits(highest, 20.0 * highest)
    design = design_outputs(model, ("tip_x", "tip_y"), np.array([[-2e-3, 4e-3]]), limits, 4e-3)
    law = Mpc(design, limits)
    rest = equilibrium(model, np.zeros(3))
    from test_space_control import still

    commands = [law.step(4e-3 * k, still(rest, 4e-3 * k), np.zeros(3)) for k in range(3)]
    assert (law.solved, law.failed, law.fault) == (3, 0, "")
    assert np.min(commands) >= -1e-9 * highest
    assert np.abs(np.diff(commands, axis=0)).max() <= 20.0 * highest * 4e-3 * (1 + 1e-4)
    assert commands[-1].max() > 0.01 * highest


@pytest.mark.slow
def test_a_studys_arm_reaches_its_place_by_predictive_control(tmp_path, capsys):
    """Fitted to a motion of a body of four links, two links bring that body's tip within 1 mm of where it is sent."""
    body = arm(4, stiffness=0.93 * 4 * STIFFNESS / LENGTH)
    time = np.arange(0.0, 1.5, 5e-3)
    each = zip(AZIMUTHS, (3.0, 4.3, 5.1), strict=True)
    waves = {name: Trace(time, 3.0 * (1.0 - np.cos(rate * time)) ** 2) for name, rate in each}
    seen = simulate(body, tuple(waves.values()), times=time, time_step=1e-3, check=False)
    rng = np.random.default_rng(1)
    places = seen.tip_position.to_numpy()[:, [0, 2, 3]]  # 112.5, 262.5 and 300 mm along the body
    record = Experiment("waves", time, places + 2e-4 * rng.standard_normal(places.shape), ("first", "middle", "tip"),
                        excitation="trace", drives=waves)  # fmt: skip
    stations = [("first", 0, 0.0375), ("middle", 1, 0.0375), ("tip", 1, 0.075)]
    found = fit([record], arm(2).with_(stations=stations), ["stiffness", "damping"], time_step=5e-3)
    model = found.model.with_(stations=())
    assert model.stiffness[0] * LENGTH / 2 == pytest.approx(0.93 * STIFFNESS, rel=0.1)
    save_model(model, tmp_path / "model.json")
    save_model(body, tmp_path / "body.json")
    control(model=tmp_path / "model.json", task=task_file(tmp_path), plant=f"model:{tmp_path / 'body.json'}",
            estimator="filter", output=tmp_path / "out", real_time=False)  # fmt: skip
    said = capsys.readouterr().out
    assert "fault: none" in said
    assert "0 ... 10 N and 100 N/s" in said
    assert "highest command 1" in said
    assert "kPa" not in said
    log = read_log(tmp_path / "out" / "log.csv")
    commands = log[[f"command_{k}_n" for k in (1, 2, 3)]].to_numpy()
    assert commands.min() >= 0.0
    assert commands.max() <= 10.0
    assert np.abs(np.diff(commands[:-1], axis=0)).max() <= 100.0 * 4e-3 * (1 + 1e-6)
    chain, late = mechanics_of(body), log["time_s"].to_numpy() > 0.9
    still, held = (chain.tips(equilibrium(body, p))[-1] for p in (np.zeros(3), commands[late][:-1].mean(axis=0)))
    assert np.abs((held - still)[:2] - [-0.012, 0.025]).max() < 1e-3  # the rest of the body itself under these tensions
    assert log.loc[late, ["error_tip_x_m", "error_tip_y_m"]].abs().to_numpy().max() < 1e-3
