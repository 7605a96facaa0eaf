"""Every field of the parts of a model is written by a target, refused, or reported as left out: by introspection."""

from __future__ import annotations

import dataclasses
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hostile_models import code_of, fields_of
from target_models import pulled

import pliant
from pliant.exporters.c99 import defaults, public_step
from pliant.exporters.c_space import text_of
from pliant.exporters.features import without
from pliant.exporters.registry import BUILT_IN, exporters
from pliant.model import Chamber, Extension, Memory, Model, Space, Station, Tendon, Valve, features
from pliant.model.features import FEATURES, KNOWN, missing

PARTS = (Model, Chamber, Valve, Memory, Extension, Station, Space, Tendon)
ENDS = {name: e.suffixes[0] for name, e in exporters().items()} | {"state-space": ".npz"}
OPTIONS: dict[str, dict[str, Any]] = {"state-space": {"pressure": [2e4, 3e4]}, "mjcf": {"highest": 2e5}}
# At 0.2 mm, the second tendon of a pair would not be slack: it counts
IN_SPACE = {**OPTIONS, "state-space": {"pressure": [2e-4, 0.3, 1.0]}, "mjcf": {"highest": [4e-3, 0.5, 3.0]}}


@pytest.fixture(scope="module", autouse=True)
def no_compiler():
    """FMUs without binaries: what is written counts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pliant.exporters.fmu.compiled", lambda *_: (None, "not compiled"))
        yield


def rich(kind: str = "limits") -> Model:
    """A model that has all there is: one valve with first order and limits, or one of second order; or one in space."""
    if kind == "space":
        body = pulled(2)
        first, pair, *more = body.chambers
        rubbing = dataclasses.replace(first, friction=0.1, entry_friction=0.2, spacing=0.04)
        cords = [rubbing, dataclasses.replace(pair, pretension=9.0), *more]
        return body.with_(chambers=cords, space=dataclasses.replace(body.space, twist_ratio=0.7), stiffening=-0.1,
                          cubic_stiffening=0.2, stiffening_bound=0.7)
    lagging = Valve(rise_time=0.02, fall_time=0.03, dead_time=0.004, rise_rate=1e6, fall_rate=2e6, settle_share=0.1,
                    dead_band=500.0, opening_time=0.05)  # fmt: skip
    ringing = Valve(natural_frequency=9.0, damping_ratio=0.6, dead_time=0.004, settle_share=0.1)
    chambers = tuple(
        Chamber([6e-7, 1e-13], [1.0, 0.5], valve, swell_share=0.2, inflation_limit=2e6, inflation_jm=9.0,
                axial_gain=20.0, name=name)
        for name, valve in (("near", ringing if kind == "second order" else lagging), ("far", lagging))
    )
    return Model(
        link_length=[0.05, 0.04], link_mass=0.01, stiffness=1.0, damping=5e-3, chambers=chambers, tip_mass=0.003,
        tip_inertia=2e-6,
        memory=Memory((0.1,), (0.5,), (0.1,), (0.02,), 0.05, axial_creep_share=(0.2,), axial_creep_time=(3.0,),
                      axial_slip_share=(0.1,), axial_slip_strain=(0.01,)), stiffening=-0.1, cubic_stiffening=0.2,
        stiffening_bound=0.7,
        stations=[("middle", 0, 0.03, 0.001), ("tip", 1, 0.04, 0.0)], gravity=[0.5, -9.0], rest_angle=0.1,
        base_length=0.02, base_angle=0.1, extensions=(Extension(300.0, 1.0, 0.01, 0.1, "whole", -0.3, 0.7, 0.6),),
    )


def owners(model: Model) -> list[tuple[tuple[Any, ...], Any]]:
    """The parts of a model, the first of each kind, and the path to each."""
    rows = [((), model), (("chambers", 0), model.chambers[0])]
    rows += [(("chambers", k, "valve"), model.chambers[k].valve) for k in (1 if model.space else 0,)]
    rows += [(("space",), model.space), (("chambers", 1), model.chambers[1])] if model.space else []
    rows += [(("memory",), model.memory)]
    return rows + [((kind, 0), getattr(model, kind)[0]) for kind in ("stations", "extensions") if getattr(model, kind)]


def other(name: str, value: Any) -> Any:
    """Another value of a field that a body can have as well; None for what holds parts or texts."""
    if name == "mass_at":
        return "tip" if value == "rod" else "rod"
    if name == "link":
        return value + 1
    if isinstance(value, bool):
        return not value
    if isinstance(value, np.ndarray):
        return value * 1.07 + (0.01 if np.abs(value).max(initial=0.0) < 1e-9 else 0.0)
    if isinstance(value, float):
        return value * 1.07 or (1e6 if name.endswith(("rate", "limit")) else 0.01)
    if isinstance(value, tuple) and value and isinstance(value[0], float):
        return tuple(1.07 * v for v in value)
    return None


def changed(part: Any, name: str, value: Any) -> Any:
    """A part of a model with another value of a field."""
    if isinstance(part, Model):
        return part.with_(**{name: value})
    return part._replace(**{name: value}) if isinstance(part, Station) else dataclasses.replace(part, **{name: value})


def with_part(model: Model, path: tuple[Any, ...], part: Any) -> Model:
    """The model with one of its parts changed."""
    if not path:
        return part
    if path in (("memory",), ("space",)):
        return model.with_(**{path[0]: part})
    if path[-1] == "valve":
        return with_part(model, path[:-1], dataclasses.replace(model.chambers[path[1]], valve=part))
    rows = list(getattr(model, path[0]))
    rows[path[1]] = part
    return model.with_(**{path[0]: tuple(rows)})


def has_features_of(model: Model, field: str) -> bool:
    """Whether a field counts in this model: it is not a number of a feature that the model does not have."""
    owning = [feature for feature in FEATURES.values() if field in feature.fields]
    return not owning or any(feature.names(model) for feature in owning)


def content(model: Model, target: str, folder: Path) -> str:
    """What an export holds beside its comments and descriptions."""
    if model.space and target in ("c99", "fmu"):  # a whole text takes seconds: what of it does not come from kernels
        if missing(model, exporters()[target].can):
            raise pliant.InputError("not expressible")
        text = text_of(model, "arm", single=False)
        return defaults(text) + text.stations() + public_step(text, 1e-3)[0]
    options = (IN_SPACE if model.space else OPTIONS).get(target, {})
    done = pliant.export(model, target, folder / f"arm{ENDS[target]}", **options)
    text = ""
    for path in done.files:
        if path.suffix == ".npz":
            arrays = np.load(path)
            text += "".join(f"{k} {arrays[k].tolist()}" for k in arrays if k != "pliant")
        elif path.suffix in (".xml", ".urdf"):
            text += "".join(str(sorted(e.items())) for e in ET.fromstring(path.read_bytes()).iter() if e.tag != "text")
        elif path.suffix == ".fmu":
            with zipfile.ZipFile(path) as archive:
                text += code_of(archive.read("sources/all.c").decode()).partition("strcmp")[0]
        elif path.suffix == ".py":
            text += "\n".join(row for row in path.read_text().splitlines() if not row.startswith("#"))
        else:
            text += code_of(path.read_text())
    return text


@pytest.mark.parametrize(("target", "kind"), [
    pytest.param(target, kind, marks=pytest.mark.slow if target in ("c99", "fmu") and kind != "space" else ())
    for target in BUILT_IN for kind in ("limits", "second order", "space")
])
def test_every_field_is_written_refused_or_told(target, kind, tmp_path):
    exporter = exporters()[target]
    everything = rich(kind)
    if target == "mjcf" or (kind != "space" and target != "urdf"):
        with pytest.raises(pliant.InputError, match="not expressible"):
            pliant.export(everything, target, tmp_path / f"arm{ENDS[target]}", **OPTIONS.get(target, {}))
    lost = tuple(k for k in missing(everything, exporter.can) if k not in exporter.by_nature)
    model = without(everything, lost)
    calm, untouched = content(model, target, tmp_path), []
    for path, part in owners(model):
        for name in fields_of(type(part)):
            value = other(name, getattr(part, name))
            if value is None:
                continue
            field = features.title_of(part, name)
            try:  # the model refuses what no body has, the target what it cannot express
                near = with_part(model, path, changed(part, name, value))
                if near == model:  # of a tendon, what follows from its other fields
                    continue
                if content(near, target, tmp_path) == calm and has_features_of(near, field):
                    untouched.append(field)
            except pliant.InputError:
                continue
    reported = {f for key in (*lost, *exporter.by_nature) for f in FEATURES[key].fields}
    assert not [f for f in untouched if f not in reported]


def test_features_know_fields_that_exist_and_all_of_them():
    rows = [(part, name) for part in PARTS for name in fields_of(part)]
    present = {f"{part.__name__}.{name}" for part, name in rows if part is not Tendon or name not in fields_of(Chamber)}
    assert present == KNOWN


def test_a_field_that_no_feature_knows_is_refused(monkeypatch, tmp_path):
    """As when a term is added to the model and forgotten in the exporters: every target refuses it where it is used."""
    model = rich()
    for feature in ("Memory.slip_angle", "Valve.rise_rate", "Model.stiffening", "Station.across", "Extension.start"):
        monkeypatch.setattr(features, "KNOWN", KNOWN - {feature})
        for target in BUILT_IN:
            for approximate in (False, True):
                with pytest.raises(pliant.InputError, match=f"^{feature}.*: unknown to the consumers of models"):
                    pliant.export(model, target, tmp_path / f"a{ENDS[target]}", approximate=approximate)
    monkeypatch.setattr(features, "KNOWN", KNOWN - {"Model.cubic_stiffening", "Valve.settle_share"})
    from pliant.actuators import chen2018

    pliant.export(chen2018.model(), "mjcf", tmp_path / "a.xml")  # at their defaults they are nothing to lose


def test_a_new_field_of_a_new_kind_of_spring_is_refused():
    """A subclass stands for the model to come, with one more term."""

    @dataclasses.dataclass(frozen=True)
    class Longer(Extension):
        quintic_stiffening: float = 0.0

    Longer.__name__ = "Extension"
    calm = rich()
    for value, refused in ((0.1, True), (0.0, False)):
        model = calm.with_(extensions=(Longer(300.0, 1.0, 0.01, 0.1, "whole", quintic_stiffening=value),))
        if refused:
            with pytest.raises(pliant.InputError, match=r"^Extension\.quintic_stiffening: unknown"):
                missing(model, frozenset(FEATURES))
        else:
            assert missing(model, frozenset(FEATURES)) == ()
