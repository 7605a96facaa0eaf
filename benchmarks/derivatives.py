"""Compare every column of the Jacobian of a fit with finite differences, for all parameters, options and models.

    python benchmarks/derivatives.py [--models plain lengthens]

The tests check a sample of each option and of each model; this program checks the full product (half an hour on one
core). It prints, for each kind of parameter, the number of compared columns and the largest relative difference. The
exit code is 1 if a difference is above the limit of the tests.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "identification"))

from derivative_cases import CHOICES, CLOSE, MODELS, case, column_errors, excitations_of, experiment_of


def compare_all(models: list[str]) -> dict[str, list[tuple[float, str]]]:
    """Return (relative distance, case) of every column, by kind of parameter."""
    by_kind: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for model, excitation in ((m, e) for m in models for e in excitations_of(m)):
        cases = {"no option": experiment_of(MODELS[model], excitation)}
        cases |= {f"{f}: {w}": exp for f, w in CHOICES if (exp := case(model, excitation, f, w)) is not None}
        for name, exp in cases.items():
            owned = ("shared", "part", "record") if name == "no option" else ("shared", "part")
            for parameter, error in column_errors(model, exp, owned).items():
                by_kind[parameter.rpartition(".")[2]].append((error, f"{model}, {excitation}, {name}: {parameter}"))
        print(f"{model}, {excitation}: {len(cases)} cases", file=sys.stderr, flush=True)
    return by_kind


def main() -> int:
    parser = argparse.ArgumentParser(description="Jacobians of fits against differences, the full product")
    parser.add_argument("--models", nargs="+", default=list(MODELS), choices=list(MODELS))
    by_kind = compare_all(parser.parse_args().models)
    for kind, errors in sorted(by_kind.items()):
        print(f"{kind:28s}{len(errors):6d}  {max(errors)[0]:.1e}")
    wrong = sorted((e for errors in by_kind.values() for e in errors if not e[0] < CLOSE), reverse=True)
    print(f"{sum(map(len, by_kind.values()))} columns, {len(wrong)} off by more than {CLOSE:g}")
    for error, where in wrong:
        print(f"  {error:.1e}  {where}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
