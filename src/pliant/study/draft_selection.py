"""The table [model_selection] of a generated study file: which recordings train and judge, and what is always free."""

from __future__ import annotations

from collections.abc import Sequence

from pliant.study.toml_text import Lines
from pliant.study.trial import Trial, excitation, held_out

MINUTES = 5


def spatial_study(trials: Sequence[Trial]) -> bool:
    """Return whether the study is in space: some recording is aligned in space or driven by tendons."""
    frames = [trial.aligned.attrs["frame"] for trial in trials if trial.aligned is not None]
    return "spatial" in frames or any(trial.tendon_inputs for trial in trials)


def selection(out: Lines, trials: Sequence[Trial]) -> None:
    """Write the [model_selection] table: training and held-out recordings, time limit, and the parameters that are free
    in every model.
    """
    held = held_out(trials)
    out.table("model_selection")
    out.say("the training recordings choose the terms of the model (creep, friction, softening, ...): a term joins if",
            "parts of the recordings are then predicted better from the other parts")
    out.put("train", [trial.name for trial in trials if trial.name != held])
    if held:
        out.put("held_out", [held], "has no part in the choice; the report judges how the model predicts it")
    else:
        out.say('to test the prediction, make one more recording and name it here: held_out = ["another"]')
    out.put("minutes", MINUTES, "time limit: when it is reached, the best model so far is the result")
    if common := common_parameters(trials):
        out.table("model_selection.common")
        out.say("free in every model, besides stiffness, damping and a torque of each input")
        for name, meaning in common:
            out.put(name, "free", meaning)


def common_parameters(trials: Sequence[Trial]) -> list[tuple[str, str]]:
    """Return (name, comment) of the parameters that are free in every model: properties of the measurement, and the
    torques of a single pressure in space.

    The position of the last station is free for marker stations alone, not for dense shapes, planar recordings or free
    decays.
    """
    kinds, first = {excitation(trial) for trial in trials}, trials[0]
    free = []
    named = any(trial.chambers or trial.tendon_inputs for trial in trials)
    if spatial_study(trials) and kinds != {"release"} and not named:
        free += [("torque_1", "N m/Pa"), ("gain_y", "ratio of the torque about y to the torque about x")]
    if "trace" in kinds and first.angles_only:
        free += [("sensor_lag", "s, time constant of the angle's sensor")]
    if first.dense or first.angles_only or first.recording.attrs["frame"] == "planar" or kinds == {"release"}:
        return free
    tip = (list(first.stations) or [str(s) for s in first.recording["station"].values])[-1]
    free += [(f"{tip}.along", "m, position of the last station on its link"), (f"{tip}.across", "m, across it")]
    return free + ([(f"{tip}.aside", "m, perpendicular to both")] if spatial_study(trials) else [])
