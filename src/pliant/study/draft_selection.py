"""The table [model_selection] of a generated study file: which recordings train and judge, and what is always free."""

from __future__ import annotations

from typing import Any

from pliant.study.draft_inputs import can_be_slack, input_names
from pliant.study.inspected import LATER, Inspected
from pliant.study.toml_text import Lines

MINUTES = 5
WAYS = {"along": "position of this station on its link", "across": "across it", "aside": "perpendicular to both"}


def selection(out: Lines, inspected: Inspected) -> None:
    """Write the [model_selection] table: training and held-out recordings, time limit, and the parameters that are free
    in every model.
    """
    held_out, train = inspected.held_out(), inspected.training()
    out.table("model_selection")
    out.say("the training recordings choose the terms of the model (creep, friction, softening, ...): a term joins if",
            "parts of the recordings are then predicted better from the other parts")
    out.put("train", train)
    for name, other in inspected.copied.items():
        out.say(f"{name} is left out: {other} holds its frames, so that it cannot judge a model that {other} trains")
    if inspected.divided:
        out.put("held_out", [f"{name}{LATER}" for name in train], "the later poses of the file; the report judges how "
                "the model predicts them")
    elif held_out:
        out.put("held_out", held_out, "no part in the choice; the report judges how the model predicts this")
    else:
        out.say('to test the prediction, make one more recording and name it here: held_out = ["another"]')
    out.put("minutes", MINUTES, "time limit: when it is reached, the best model so far is the result")
    if common := common_parameters(inspected):
        out.table("model_selection.common")
        out.say("part of every model, besides stiffness, damping and a torque of each input")
        for name, value, meaning in common:
            out.put(name, value, meaning)


def common_parameters(inspected: Inspected) -> list[tuple[str, Any, str]]:
    """Return (name, entry, comment) of the parameters that are part of every model: properties of the measurement, and
    the torques of a single pressure in space. Nothing moves between settled poses, so that their damping is held.

    The position of the last station is free for marker stations alone, not for dense shapes, planar recordings or free
    decays; of settled poses that of every station, since they do not show where it is on a straight body.
    """
    first = inspected.first
    released = all(kind.excitation == "release" for kind in inspected.kinds.values())
    common: list[tuple[str, Any, str]] = []
    if inspected.poses:
        common += [("damping", {"value": 1e-3, "free": False}, "N m s/rad, without effect on settled poses")]
    common += [(f"{name}.pretension", "free", "N, where it begins to pull; below 0 it hangs slack at displacement 0")
               for name in can_be_slack(inspected)]  # fmt: skip
    if inspected.space and not released and not input_names(inspected):
        common += [("torque_1", "free", "N m/Pa"),
                   ("gain_y", "free", "ratio of the torque about y to the torque about x")]
    if first.angles_only and inspected.excited_by("trace"):
        common += [("sensor_lag", "free", "s, time constant of the angle's sensor")]
    if first.dense or first.angles_only or first.recording.attrs["frame"] == "planar" or released:
        return common
    names = list(first.stations) or [str(s) for s in first.recording["station"].values]
    for name in names[:-1] if inspected.poses else []:
        if name != first.base or not first.options:
            common += [(f"{name}.{way}", "free", f"m, {meaning}: no pose shows the body at rest")
                       for way, meaning in WAYS.items()]  # fmt: skip
    tip = names[-1]
    common += [(f"{tip}.along", "free", "m, position of the last station on its link"),
               (f"{tip}.across", "free", "m, across it")]
    return common + ([(f"{tip}.aside", "free", "m, perpendicular to both")] if inspected.space else [])
