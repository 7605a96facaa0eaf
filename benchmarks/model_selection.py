"""Print the model selections of "Judging a fit" as tables.

Usage: python benchmarks/model_selection.py [demo|short|arm|regulator|four ...]. The recordings for `arm` (the silicone
arm), `regulator` (its pressure regulator) and `four` (the arm with four chambers) come by `pliant data fetch`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from pliant.identification import ModelSelection
from pliant.study import demo_study, load_study
from pliant.study.run import prepare_all, run_model_selection
from pliant.study.schema import SelectionEntry

EXAMPLES = Path(__file__).parents[1] / "examples"
ARM, FOUR = EXAMPLES / "pneumatic_arm_pulses.toml", EXAMPLES / "planar_two_segment_arm_chambers.toml"
PULSES = {"train": ["pulse_60", "pulse_180"], "held_out": ["pulse_119", "step_240"], "common": {"start": "free"}}
PLACES = dict.fromkeys(("base_angle", "tip.along", "tip.across"), "free")
FILLING = ("stiffness", "damping", "torque_1", "valve_rise_time", "valve_fall_time", "valve_fall_rate",
           "inflation_limit", "inflation_time")
LATE = ["given", "settle", "creep", "soften"]  # what comes late, beyond a wall and a limited fall
SELECTIONS = {  # study, entries of its [model_selection]
    "demo": (demo_study(), PULSES),
    "lead": (demo_study(), {**PULSES, "common": {}, "choose_by": "training"}),  # the terms of the demo's first fit
    "short": (demo_study(), {**PULSES, "stages": ["given", "elastic", "torque", "soften", "joints"]}),
    "arm": (ARM, {"train": ["p100", "p300"], "held_out": ["p200"], "common": PLACES}),
    "regulator": (ARM, {"train": ["p100", "p200", "p300"], "held_out": ["p400"], "stages": LATE,
                        "common": {**PLACES, **dict.fromkeys(FILLING, "free")}}),
    "four": (FOUR, {"train": ["first", "opposite"], "held_out": ["second", "third"],
                    "common": {**PLACES, "mid.along": "free", "mid.across": "free"},
                    "stages": ["given", "elastic", "torque", "lag"]}),
}  # fmt: skip


def selected(name: str) -> ModelSelection:
    """Return a model selection by its name."""
    path, entries = SELECTIONS[name]
    study = load_study(path).model_copy(update={"model_selection": SelectionEntry.model_validate(entries)})
    ready = prepare_all(study, lambda _line: None)
    made = run_model_selection(study, ready.experiments, ready.model, lambda line: print(line, file=sys.stderr))
    assert made is not None
    return made


def table(name: str, made: ModelSelection) -> str:
    """Return a model selection as a table."""
    lines = [f"{name}: {made.reason}", "", "| stage | free | training | held out | BIC | why not |", "|---" * 6 + "|"]
    for s in made.stages:
        train, held_out = (f"{np.mean(list(e.values())):.3g}" if e else "" for e in (s.train, s.held_out))
        chosen = ", chosen" * (s.stage.name == made.chosen)
        bic = "" if s.bic is None else f"{s.bic:.0f}"
        lines.append(f"| {s.stage.title}{chosen} | {len(s.freed)} | {train} | {held_out} | {bic} | {s.reason} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for selection_name in sys.argv[1:] or SELECTIONS:
        print(table(selection_name, selected(selection_name)), flush=True)
