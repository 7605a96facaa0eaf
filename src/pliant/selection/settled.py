"""The first model of a body in space that follows its inputs without delay: settled shapes come first.

Where the inputs of a frame alone explain most of its pose, frames are nearly settled shapes, and a few of them
determine gains, directions and the places of markers in seconds. A fit of the motion from there begins near its
optimum, and takes few evaluations of a long recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from pliant.errors import PliantError
from pliant.identification.experiment import Experiment
from pliant.identification.fit_step import STEPS_A_FRAME, fit_step
from pliant.identification.parameters import shared_name
from pliant.model import Model
from pliant.selection.first_model import Entry
from pliant.selection.fitted import FitSetting, FittedModel, fitted, frame_spacing, tried_step
from pliant.selection.slow import first_parameters, left_by, may_be_slow, moved_and_inputs, settled

EXPLAINED = 0.8  # of the variance of the motion that the inputs of the same frames must explain
STATIC_EVALUATIONS = 30
OF_MOTION = ("damping", "axial_damping")  # parameters that settled shapes do not show


def follows_at_once(train: Sequence[Experiment], model: Model) -> bool:
    """Return whether the inputs of each frame alone explain most of the last station's motion, in recordings of
    positions under measured inputs.
    """
    if not may_be_slow(train):
        return False
    moved, now, _ = moved_and_inputs(train, model.actuation.names, ())
    return left_by([now], moved) < (1.0 - EXPLAINED) * float(((moved - moved.mean(axis=0)) ** 2).sum())


def fit_from_settled_shapes(
    setting: FitSetting, model: Model, common: Sequence[Entry], time_step: float | None,
) -> tuple[FitSetting, FittedModel]:
    """Return the setting of all fits of a search, and the fit of the first model to the motion, begun at the values
    that settled shapes of the recordings show. Damping begins at its first guess.
    """
    train = setting.experiments
    shapes = replace(setting, experiments=tuple(settled(e) for e in train))
    listed = first_parameters(model, train, common)
    static = [p for p in listed if shared_name(p.name) not in OF_MOTION]
    still = fitted(shapes, model, static, evaluations=STATIC_EVALUATIONS)
    begun = [p.with_(value=still.values[p.name]) if p.value is None and p.name in still.values else p for p in listed]
    values = {p.name: p.value for p in begun if p.value is not None}
    setting = replace(setting, time_step=time_step or fit_step(still.model, values, train))
    if time_step is None:
        with suppress(PliantError):
            first = fitted(replace(setting, time_step=frame_spacing(train) / STEPS_A_FRAME), still.model, begun)
            setting = replace(setting, time_step=tried_step(first, setting.time_step))
            begun = first.parameters
    return setting, fitted(setting, still.model, begun)
