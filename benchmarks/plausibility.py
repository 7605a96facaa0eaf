"""Count false alarms of the plausibility checks, and of the detection of lost stations and glitches of inputs, on all
recordings of the shared data, examples and demonstrations.

    python benchmarks/plausibility.py            # a table: recordings, checks, and every warning of a check

No recording has a mistake that a check names, except recordings of a body that nobody moved.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import xarray as xr
from harness import table
from trunk_learned import MAPPING

from pliant.errors import InputError, PliantError
from pliant.preprocessing.plausibility import CHECKS
from pliant.preprocessing.plausibility.together import beside
from pliant.preprocessing.quality import quality
from pliant.recording import read
from pliant.study import load_study
from pliant.study.prepare import aligned_recording

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
TRUNK: dict[str, Any] = {name: MAPPING[name] for name in ("header", "rate_hz", "length_unit", "stations")}
TENTACLE = {"time": 1, "length_unit": "m", "points": {"count": 5, "first": 2}}
ARM = {
    "time": 0, "length_unit": "m", "pressure": {"columns": [4, 5, 6, 10, 11, 12], "unit": "psi"},
    "stations": {n: {"position": [at, at + 1, at + 2], "quaternion": [at + 3, at + 4, at + 5, at + 6]}
                 for n, at in (("base", 17), ("mid", 24), ("tip", 31))},
}  # fmt: skip
FIBRE = {"delimiter": "space", "rate_hz": 32.0, "length_unit": "mm", "points": {"count": 20}}
ROD = {"delimiter": "space", "skip_lines": 2, "time": 0, "length_unit": "m",
       "stations": {"middle": {"position": [4, 5, 6]}, "tip": {"position": [10, 11, 12]}}}  # fmt: skip
RAW: dict[str, tuple[str, dict[str, Any] | None]] = {
    "arms": ("planar_two_segment_arm/*steps*.txt", ARM),
    "arm at rest": ("planar_two_segment_arm/*no_pressure*.txt", ARM),
    "pulses": ("pneumatic_arm_pulses/*.c3d", None), "beams": ("silicone_cantilever/*.c3d", None),
    "fibre": ("fiber_shape/*.txt", FIBRE), "trunks": ("spatial_tendon_trunk/*.csv", TRUNK),
    "decays": ("trunk_free_decay/*.csv", TRUNK), "tentacles": ("spatial_tentacle/*.csv", TENTACLE),
    "rods": ("spatial_rod_reference/release*.txt", ROD),
}  # fmt: skip
BUNDLED = ROOT / "src" / "pliant" / "testbed" / "bundled"


def cases() -> Iterator[tuple[str, str, dict[str, str]]]:
    """Return group, recording and warnings of every recording."""
    for group, (pattern, mapping) in RAW.items():
        for path in sorted(DATA.glob(pattern)):
            yield group, path.name, doubted(read(path, mapping=mapping))
    for path in sorted(BUNDLED.glob("*.nc")):
        yield "bundled", path.name, doubted(read(path))
    studies = [*sorted((ROOT / "examples").glob("*.toml")), *sorted((ROOT / "src/pliant/study/bundled").glob("*.toml"))]
    for path in studies:
        try:
            study = load_study(path)
        except InputError:  # a mapping
            continue
        bodies = {}
        for name in study.recordings:
            try:
                one = aligned_recording(study, name)
            except PliantError as error:
                yield f"study {path.stem}", name, {"refused": str(error)}
            else:
                bodies[name] = one.body
                yield f"study {path.stem}", name, one.doubts | {
                    line: line for line in one.findings if line.startswith(("lost by the tracker", "left out glitches"))
                }
        for line in beside(bodies):
            yield f"study {path.stem}", "together", {"beside each other": line}


def doubted(recording: xr.Dataset) -> dict[str, str]:
    """Return the warnings about a recording, and what is found of lost stations and of glitches."""
    found = quality(recording)
    return found.doubts | {f"lost {n}": str(v) for n, v in found.lost.items()} | {
        f"glitch {n}": str(v) for n, v in found.input_glitches.items()
    }


def main() -> None:
    """Print every warning, then the table."""
    os.environ.setdefault("PLIANT_DATA", str(DATA))
    counts: dict[str, list[int]] = {}
    for group, name, warned in cases():
        row = counts.setdefault(group, [0, 0])
        row[0], row[1] = row[0] + 1, row[1] + bool(warned)
        for check, sentence in warned.items():
            print(f"{group}, {name}: [{check}] {sentence}")
    counts["all"] = [sum(column) for column in zip(*counts.values(), strict=True)]
    print(f"{len(CHECKS)} checks")
    print(table({group: {"recordings": n, "with a warning": k} for group, (n, k) in counts.items()}))


if __name__ == "__main__":
    main()
