"""A model for control from recordings of one virtual actuator, as a laboratory would make it.

    python examples/control/identify.py a -o examples/control/model_a.json

Records five scenarios (seed 1), fits bending, torque law, damping and memory through the study in actuator.toml, the
valve to the commanded and the measured pressure of the pulses, and writes both as one model.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import pliant
from pliant.control import ValveFit, ValveRun, identify_valve
from pliant.recording import read
from pliant.study import load_study, run_study
from pliant.testbed import generate_set
from pliant.testbed.scenarios import scenario

STUDY = Path(__file__).with_name("actuator.toml")
SEED = 1


def valve_of(folder: Path, names: list[str]) -> ValveFit:
    """The valve, from the pulses among the recordings."""
    runs = []
    for name in names:
        edges, levels = np.array(scenario(name).command.points).T
        recording = read(folder / f"{name}.nc")
        runs.append(ValveRun(edges, levels, recording["pressure_time"].values, recording["pressure"].values))
    return identify_valve(runs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuator", choices=["a", "b", "c"])
    parser.add_argument("-o", "--output", type=Path, required=True, help="model file to write")
    parser.add_argument("--work", type=Path, default=Path("results/control"), help="folder for recordings and report")
    args = parser.parse_args()
    study, folder = load_study(STUDY), args.work / f"actuator_{args.actuator}"
    folder.mkdir(parents=True, exist_ok=True)
    for path, name in zip(
        generate_set([(name, args.actuator, SEED) for name in study.recordings], folder), study.recordings, strict=True
    ):
        path.replace(folder / f"{name}.nc")
    outcome = run_study(study.model_copy(update={"folder": str(folder)}), folder / "report")
    print("\n".join(outcome.verdict))
    fitted = pliant.load_model(folder / "report" / "model.json")
    found = valve_of(folder, [name for name in study.recordings if name.startswith("pulse")])
    print(f"valve: {found.valve}, {found.rmse:.0f} Pa rms")
    source = {
        **fitted.source,
        "all": f"examples/control/identify.py {args.actuator}: virtual actuator {args.actuator}, seed {SEED}, study "
               f"{STUDY.name}, trained on {', '.join(study.fits['memory'].train)}",
        "valve": f"commanded and measured pressure of the pulses, {found.rmse:.0f} Pa rms",
    }
    made = fitted.with_(valve=found.valve.mean, source=source, name=f"virtual actuator {args.actuator}", stations=())
    pliant.save_model(made, args.output)


if __name__ == "__main__":
    main()
