"""Transformation of results from the base frame back to the axes of their recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pliant.identification import Band
from pliant.validation.outcome import Forecast, RecordOutcome, Shape, StudyOutcome


def in_recorded_axes(outcome: StudyOutcome, like: Mapping[str, str], signs: Mapping[str, int]) -> StudyOutcome:
    """Return the outcome with all positions in the axes of the recordings, for tables, figures and files.

    Models and their parameters stay in the base frame, where positive angles bend the body towards -x.

    Parameters
    ----------
    outcome : StudyOutcome
        Results with all positions in the base frame.
    like : dict
        Name of the template recording of each forecast.
    signs : dict
        Direction (1 or -1) of each recording's x axis in the base frame, see `pliant.preprocessing.side`.
    """
    if all(sign > 0 for sign in signs.values()):
        return outcome
    fits = tuple(
        replace(f, records=tuple(turned_record(r) if signs[r.name] < 0 else r for r in f.records)) for f in outcome.fits
    )
    forecasts = tuple(turned_forecast(f) if signs[like[f.name]] < 0 else f for f in outcome.forecasts)
    shape = outcome.shape
    if shape is not None and signs[shape.name] < 0:
        shape = turned_shape(shape)
    return replace(outcome, fits=fits, forecasts=forecasts, shape=shape)


def mirrored(position: np.ndarray) -> np.ndarray:
    """Return positions (..., 2) with the sign of x changed."""
    return position * np.array([-1.0, 1.0])


def turned_record(record: RecordOutcome) -> RecordOutcome:
    """Return the outcome of a recording turned by pi about the base tangent."""
    return replace(
        record, experiment=record.experiment.turned(), modelled=mirrored(record.modelled),
        band=None if record.band is None else turned_band(record.band),
        body=None if record.body is None else mirrored(record.body),
    )


def turned_band(band: Band) -> Band:
    """Return a band turned by pi about the base tangent, so that the limits of x change places."""
    edges = np.stack([mirrored(band.lower), mirrored(band.upper)])
    return replace(band, position=mirrored(band.position), lower=edges.min(axis=0), upper=edges.max(axis=0))


def turned_forecast(forecast: Forecast) -> Forecast:
    """Return a forecast turned by pi about the base tangent."""
    return replace(forecast, tip=mirrored(forecast.tip))


def turned_shape(shape: Shape) -> Shape:
    """Return a dense shape, with the chain of links placed on it, turned by pi about the base tangent."""
    links = replace(
        shape.links, base=mirrored(shape.links.base), tips=mirrored(shape.links.tips),
        rest_angle=-shape.links.rest_angle, joint_angle=-shape.links.joint_angle,
    )
    return replace(
        shape, position=mirrored(shape.position), curvature=-shape.curvature, rest_curvature=-shape.rest_curvature,
        links=links,
    )
