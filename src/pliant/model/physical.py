"""Checks that the parameters of a model are physically possible."""

from __future__ import annotations

from collections.abc import Collection
from math import inf, isfinite

from pliant.errors import InputError
from pliant.model.checks import check_names, check_numbers
from pliant.model.extensible import check_extensions
from pliant.model.parameters import ModelParameters
from pliant.model.quantity import MOST_STATIONS, quantities
from pliant.model.space import check_space
from pliant.model.station import Station

LINK_MASS = quantities(ModelParameters)["link_mass"]


def check_physical(model: ModelParameters, given: Collection[str]) -> None:
    """Raise InputError if one of the `given` parameters of a model is not finite or not physical."""
    check_numbers(model, "model", [name for name in quantities(ModelParameters) if name in given])
    if "link_mass" in given:
        for mass in set(model.link_mass.tolist()):
            LINK_MASS.check_limit("model", "link_mass", mass)
    if "stations" in given:
        check_stations(model)
    choices = (  # messages are formatted only where a check fails
        (model.mass_at in ("rod", "tip"), "mass_at must be 'rod' or 'tip', got {0.mass_at!r}"),
        (isinstance(model.moving_base, bool), "moving_base must be true or false, got {0.moving_base!r}"),
        (model.stiffening_bound.max(initial=0.0) < 1, "stiffening_bound must be below 1, got {0.stiffening_bound}"),
        (model.link_mass[:-1].min(initial=inf) > 0 and model.link_mass[-1] + model.tip_mass >= LINK_MASS.least,
         "link_mass must be positive for every link, got {0.link_mass}"),
    )
    for good, sentence in choices:
        if not good:
            raise InputError(f"model {sentence.format(model)}")
    check_space(model)
    check_extensions(model)


def check_stations(model: ModelParameters) -> None:
    """Raise InputError if an observed point of a model is not on one of its links, or two have the same name."""
    names = [s.name for s in model.stations]
    if len(names) > MOST_STATIONS:
        raise InputError(f"model must have at most {MOST_STATIONS} stations, got {len(names)}")
    check_names("model stations", names)
    for station in model.stations:
        if not (-1 <= station.link < model.n and all(map(isfinite, station[2:]))):
            raise InputError(
                f"model station {station.name!r} must sit on a link 0..{model.n - 1} or the base (-1), got {station}"
            )
        for name, quantity in quantities(Station).items():
            quantity.check_limit("model", f"station {name}", getattr(station, name))
        if station.aside and model.space is None:
            raise InputError(
                f"model station {station.name!r} lies out of the bending plane (aside = {station.aside:g} m): set "
                "aside to 0, or make the model spatial with space = Space()"
            )
