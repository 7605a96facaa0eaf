"""Identification of model parameters from recordings: experiments, fits, uncertainties and held-out predictions."""

from pliant.identification.design import Design, design
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitResult, fit, predict_held_out
from pliant.identification.from_recording import experiment
from pliant.identification.identifiability import Identifiability, identifiability
from pliant.identification.parameters import Parameter
from pliant.identification.prediction import predict
from pliant.identification.prediction_bands import (
    Band,
    TrainingResiduals,
    prediction_band,
    residual_noise,
    residual_reach,
)
from pliant.identification.resampling import bootstrap, bootstrapped
from pliant.identification.sensitivity import sensitivities

__all__ = [
    "Band", "Design", "Experiment", "FitResult", "Identifiability", "Parameter", "TrainingResiduals", "bootstrap",
    "bootstrapped", "design", "experiment", "fit", "identifiability", "predict", "predict_held_out", "prediction_band",
    "residual_noise", "residual_reach", "sensitivities",
]
