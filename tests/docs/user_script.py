"""A user's script that touches the whole public page; `mypy --strict` must have nothing to say about it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pliant
from pliant.actuators import chen2018
from pliant.batch import simulate_batch
from pliant.contact import find_contact, map_contacts
from pliant.control import design_lqr
from pliant.errors import FitError, SimulationError
from pliant.identification import (
    Experiment,
    Parameter,
    identifiability,
    predict_held_out,
    prediction_band,
)
from pliant.model import Extension, Memory, Station, Valve
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording
from pliant.reduction import select_order
from pliant.selection import select_model
from pliant.simulation import Chirp, Trace, inputs
from pliant.simulation.inputs import Input
from pliant.sweep import run_sweep
from pliant.validation.plain_map import plain_map


def recordings(path: Path) -> None:
    """Read, judge, align, choose the order, write."""
    raw = pliant.read(path, mapping={"length_unit": "mm"}, format="csv")
    print(quality(raw).summary())
    stations = assemble(raw, {"base": ["Base*"], "tip": ["Tip*"]})
    body = pliant.align(stations, base="base", tangent="+x")
    order = select_order(body, bound=3e-3)
    chosen: int | None = order.chosen
    print(chosen, order.reason, pliant.write(body, "body.nc"))
    made = make_recording(np.arange(3) / 10, np.zeros((3, 2, 3)), station=["base", "tip"])
    print(made.sizes)


def models() -> pliant.Model:
    """Build, save and load a model."""
    model = pliant.chain_model(length=0.17, mass=0.069, links=5, stiffness=1.6, damping=8e-3, torque=[6.67e-7])
    model = model.with_(memory=Memory(creep_share=(0.1,), creep_time=(1.0,)))
    left = pliant.Chamber(np.array([1e-5]), np.full(model.n, 1.0), name="left")
    right = pliant.Chamber(np.array([1e-5]), np.full(model.n, -1.0), name="right")
    model.with_(chambers=(left, right), extensions=(Extension(stiffness=40.0, damping=0.5),))
    model = model.with_(valve=Valve(rise_time=0.02), stations=(Station("tip", 4, 0.034),))
    pliant.save_model(model, "model.json")
    return pliant.load_model("model.json")


def motions(model: pliant.Model) -> float:
    """Every input, every way to move."""
    courses: list[Input] = [
        pliant.Pulse(119e3, 0.12, 2.76), pliant.Step(1e5), inputs.ramp(1e5, 0.1, 1.0), inputs.triangle(1e5, 2.0, 3),
        Chirp(2e4, 1e5, 0.1, 5.0, 10.0),
        Trace(np.array([0.0, 1.0]), np.array([0.0, 1e5])),
    ]
    motion = pliant.simulate(model, courses[0], duration=1.0)
    frequency, damping = pliant.modes(model, pliant.equilibrium(model, 1e5))
    stepper = pliant.Stepper(model, time_step=1e-3)
    angle, rate = stepper.step(1e5)
    many = simulate_batch(model, courses[0], parameters={"stiffness": np.array([1.5, 1.7])}, duration=1.0)
    sweep = {"kind": "monte_carlo", "samples": 8, "parameters": {"stiffness": {"mean": 1.6, "std": 0.1}}}
    swept = run_sweep(sweep, model, "sweep", progress=print)
    print(many["tip_position"].max(), swept.samples["tip"].shape, swept.summary()["message"])
    return float(motion.time[-1]) + float(frequency[0] + damping[0] + angle[-1] + rate[-1])


def fits(paths: list[Path]) -> pliant.Model:
    """Fit, predict, run a study."""
    experiments: list[Experiment] = [pliant.experiment(p.stem, pliant.read(p)) for p in paths]
    start = chen2018.model()
    fitted = pliant.fit(experiments[:-1], start, [Parameter("stiffness", 1.6), "damping", "torque_1"])
    prediction, own = predict_held_out(experiments[-1], fitted)
    same = pliant.predict(fitted.model, experiments[0], fitted.values, 2e-3)
    print(own.status, prediction["position"].shape, same["pressure"].max())
    baseline = plain_map(experiments[:-1], degree=2)
    print(baseline.title, baseline.predict(experiments[-1]).shape, baseline.outside(experiments[-1]))
    told = identifiability(experiments[:-1], start, ["stiffness", "damping", "mass"])
    band = prediction_band(experiments[-1], fitted, noise=1e-4)
    selection = select_model(experiments[:-1], start, minutes=1.0, progress=print)
    print(told.identifiable, band.upper - band.lower, selection.reason, selection.result.values)
    outcome = pliant.run_study(pliant.load_study("study.toml"), "results", progress=print)
    later = pliant.adapt("results", "may.csv", "results_may", seconds=20.0)
    print(later.adaptations["adapted"].sentence)
    return outcome.model


def at_work(model: pliant.Model, free: Path, poked: Path) -> float:
    """State, contact and control."""
    states = pliant.estimate(pliant.read(poked), model, latency=4e-3)
    contact = find_contact(pliant.read(poked), model, free=[pliant.read(free)])
    chart = map_contacts([contact], cell=2e-3)
    linear = pliant.linearise(model, 5e4)
    design = design_lqr(model, 1.2e5, 4e-3)
    print(pliant.export(model, "mjcf", "finger.xml", approximate=True, prefix="left_").files)
    print(states.sizes, contact.attrs["alarm_s"], chart.sizes, linear, design)
    return float(states["joint_rate"].max())


def main() -> None:
    """What a user meets when something is wrong."""
    try:
        motions(models())
        recordings(Path("a.csv"))
        at_work(fits([Path("a.nc"), Path("b.nc")]), Path("a.nc"), Path("c.nc"))
    except pliant.InputError as error:
        print(error)
    except (SimulationError, FitError) as error:
        print(error)
    except pliant.PliantError as error:
        raise SystemExit(error.exit_code) from error


if __name__ == "__main__":
    main()
