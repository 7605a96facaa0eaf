"""Walk from the files of each laboratory to a verdict with the console script, and beside it the study by hand.

    python tests/journey/walks.py                # all: lines typed, minutes, errors
    python tests/journey/walks.py vrpn poses

Lines are those of a mapping, besides the answers to "?". Minutes are processor time of `inspect`, `new` and `run`.
Errors are those of the held-out recordings, % of their peak displacement (angles: of the largest angle): of the draft,
of the study by hand, and of the plain map of the draft's report.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from types import MappingProxyType
from typing import Any, NamedTuple

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import laboratories
import numpy as np
from arm_in_mujoco import DOWN, LEVER, ORIGIN, ROOM
from command_line import invoke

TANGENT = str(np.round(ROOM.apply([0.0, 0.0, 1.0]), 6).tolist())
PLACE = str(ORIGIN.tolist())
GRAVITY = str(np.round(DOWN, 4).tolist())


class Walk(NamedTuple):
    """What a person types for the files of a laboratory: a mapping, the files that it is for, answers to "?"."""

    mapping: str = ""
    of: str = ""
    answers: Mapping[str, str] = MappingProxyType({})


class Outcome(NamedTuple):
    """Lines of the mapping, questions, minutes of a walk; held-out errors of draft, hand and plain map, %."""

    lines: int
    asked: set[str]
    minutes: float
    draft: float
    hand: float
    plain: float


WALKS = {
    "vrpn": Walk(answers={"origin": PLACE, "tangent": TANGENT}),
    "motive": Walk('pressure = ["ai3"]\npressure_unit = "kPa"\nscale = 0.02\nzero = 400', "daq"),
    "poses": Walk(answers={"lever": str(LEVER), "gravity": GRAVITY}),
    "sessions": Walk(answers={"scale": str(2.0 * np.pi / 3200.0 * 12.0), "lever": str(LEVER), "origin": PLACE,
                              "tangent": TANGENT, "gravity": GRAVITY}),
    "matlab": Walk('struct = "experiments"\nposition = "markers"\norder = "sat"\nlength_unit = "mm"\n'
                   'pressure_unit = "psi"'),
    "bag": Walk(answers={"offset": "-100.9"}),
    "film": Walk(answers={"rate_hz": "40.0", "pixels_per_mm": "3.2"}),
    "coils": Walk(answers={"scale": str(1e3 * 0.015 * 2.0 * np.pi / 4096.0), "lever": str(LEVER),
                           "gravity": GRAVITY}),
    "bars": Walk(),
    "gratings": Walk(answers={"curvature_unit": '"1/m"'}),
}  # fmt: skip


def drafted(name: str, files: list[Path], folder: Path) -> tuple[Path, str]:
    """Inspect the first file and draft a study; return its path and what the program says."""
    walk, options = WALKS[name], []
    if walk.mapping:
        (folder / "mapping.toml").write_text(walk.mapping + "\n")
        options = ["--mapping", f"{walk.of}={folder / 'mapping.toml'}".removeprefix("=")]
    said = invoke("inspect", files[0], *options).output
    study = folder / "study.toml"
    done = invoke("new", study, "--from", *files, *options, "--length", "200mm", "--mass", "60g")
    assert done.exit_code == 0, done.exception or done.output
    return study, said + done.output


def answered(text: str, walk: Walk) -> str:
    """The text of a draft with the answers in place of its open questions."""
    for entry, value in walk.answers.items():
        assert f'{entry} = "?"' in text, f"{entry} is not asked"
        text = text.replace(f'{entry} = "?"', f"{entry} = {value}")
    return text


def held_out(folder: Path) -> tuple[float, float]:
    """Root mean square of the errors of the held-out records of a run, and of the plain map, %."""
    metrics = json.loads((folder / "metrics.json").read_text())
    names = [n for n, record in metrics["records"].items() if record["role"] == "held_out"]
    key = next(k for k in metrics["records"][names[0]] if k.startswith("rmse_percent"))
    model = [metrics["records"][n][key] for n in names]
    maps = next(iter(metrics["baseline"].values()), {"records": {}})["records"]
    plain = [maps.get(n, {}).get(key, np.nan) for n in names]
    return tuple(float(np.sqrt(np.mean(np.square(part)))) for part in (model, plain))


def run(study: Path, out: Path) -> tuple[float, float]:
    """Run a study and return its held-out error and the plain map's, %."""
    done = invoke("run", study, "-o", out, "--json", "--quiet")
    assert done.exit_code == 0, done.exception or done.output
    return held_out(out)


def split_of(content: dict[str, Any], names: list[str]) -> tuple[list[str], list[str]]:
    """Training and held-out recordings of a draft, each trial of a file by its own name."""
    chosen = content["model_selection"]

    def spread(listed: list[str]) -> list[str]:
        return [n for n in names if any(n == one or n.startswith(f"{one}_") for one in listed)]

    kept = spread(chosen["held_out"])
    return [n for n in spread(chosen["train"]) if n not in kept], kept


def processor() -> float:
    return sum(getrusage(who).ru_utime + getrusage(who).ru_stime for who in (RUSAGE_SELF, RUSAGE_CHILDREN))


def walked(name: str, folder: Path) -> Outcome:
    """Walk the way of one laboratory to the end."""
    laboratory = getattr(laboratories, name)(folder)
    began = processor()
    study, _ = drafted(name, laboratory.files, folder)
    text = study.read_text()
    asked = set(re.findall(r'(\w+) = "\?"', text))
    study.write_text(answered(text, WALKS[name]))
    draft, plain = run(study, folder / "out")
    minutes = (processor() - began) / 60.0
    hand = folder / "by_hand"
    hand.mkdir()
    train, kept = split_of(tomllib.loads(study.read_text()), list(laboratory.tables))
    content = laboratories.by_hand(laboratory, hand, train, kept)
    (hand / "study.json").write_text(json.dumps(content))
    by_hand, _ = run(hand / "study.json", hand / "out")
    return Outcome(len(WALKS[name].mapping.splitlines()), asked, minutes, draft, by_hand, plain)


def main() -> None:
    """Print a row for each laboratory."""
    print("| laboratory | lines typed | `?` | minutes | draft, % | by hand, % | plain map, % |")
    print("|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or WALKS:
        with tempfile.TemporaryDirectory() as folder:
            one = walked(name, Path(folder))
        print(f"| {name} | {one.lines} | {len(one.asked)} | {one.minutes:.1f} | {one.draft:.2g} | {one.hand:.2g} | "
              f"{one.plain:.2g} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
