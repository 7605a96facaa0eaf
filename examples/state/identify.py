"""A model for estimation and contact from recordings of one virtual actuator, as a laboratory would make it.

    python examples/state/identify.py b -o examples/state/model_b.json

Records ten scenarios (seed 1), runs the study in actuator.toml and writes its model; prints the latency [s] of the
sensor, which an estimator takes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pliant
from pliant.study import load_study, run_study
from pliant.testbed import generate_set

STUDY = Path(__file__).with_name("actuator.toml")
SEED = 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuator", choices=["a", "b", "c"])
    parser.add_argument("-o", "--output", type=Path, required=True, help="model file to write")
    parser.add_argument("--work", type=Path, default=Path("results/state"), help="folder for recordings and report")
    args = parser.parse_args()
    study, folder = load_study(STUDY), args.work / f"actuator_{args.actuator}"
    folder.mkdir(parents=True, exist_ok=True)
    cases = [(name, args.actuator, SEED) for name in study.recordings]
    for path, name in zip(generate_set(cases, folder), study.recordings, strict=True):
        path.replace(folder / f"{name}.nc")
    outcome = run_study(study.model_copy(update={"folder": str(folder)}), folder / "report", progress=print)
    print("\n".join(outcome.verdict))
    fitted = outcome.fits[0].result
    print(f"latency {fitted.values['latency']:.6f} s")
    source = {"all": f"examples/state/identify.py {args.actuator}: study {STUDY.name} of virtual actuator "
                     f"{args.actuator}, seed {SEED}"}  # fmt: skip
    made = fitted.model.with_(stations=(), name=args.actuator, source={**fitted.model.source, **source})
    pliant.save_model(made, args.output)


if __name__ == "__main__":
    main()
