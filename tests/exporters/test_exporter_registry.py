"""The door: targets, what they refuse, what they leave out, bad input."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from command_line import invoke
from target_models import longer, pulled, tied, twisting

import pliant
from pliant.actuators import chen2018
from pliant.equations.spring_terms import SPRING_TERMS
from pliant.exporters.difference import difference
from pliant.exporters.features import FEATURES, without
from pliant.exporters.provenance import standard_errors
from pliant.exporters.registry import BUILT_IN, exporters
from pliant.mechanics import springs
from pliant.model import Chamber, Extension, Memory, Valve, load_model, save_model
from pliant.model.features import missing, named
from pliant.simulation import equilibrium
from pliant.simulation.state import typical_pressure

EVERYTHING = chen2018.model(
    gravity=[0.0, -9.8], stiffening=-0.1, stiffening_bound=0.7,
    torque=[6e-7, 1e-13], swell_share=0.2, inflation_limit=2e6,
    valve=Valve(rise_time=0.02, fall_time=0.03, dead_time=0.01, rise_rate=1e6, settle_share=0.1, dead_band=500.0,
                opening_time=0.05),
    memory=Memory((0.1, 0.05), (0.5, 5.0), (0.1,), (0.02,), boucwen_share=0.05),
)


IN_SPACE = ("space", "twist", "soft_swing", "space_memory")


def test_every_built_in_target_loads():
    assert {name: e.name for name, e in exporters().items() if name in BUILT_IN} == {n: n for n in BUILT_IN}
    assert all(e.can | set(e.by_nature) <= set(FEATURES) for e in exporters().values())


@pytest.mark.parametrize("key", list(FEATURES))
def test_a_model_without_a_feature_has_none_of_it(key):
    model = EVERYTHING
    if key == "second_order":
        model = model.with_(valve=Valve(natural_frequency=9.0))
    if key == "own_law":
        model = model.with_(law="saturating", torque=[6e-7, 1e5])
    if key == "lengthening":
        model = model.with_(extensions=(Extension(500.0),))
    if key == "curved_segments":
        model = model.with_(extensions=(Extension(500.0, stiffening=-0.2),))
    if key == "tied_segments":
        model = tied()
    if key == "axial_memory":
        branch = {"axial_creep_share": (0.1,), "axial_creep_time": (0.5,)}
        model = model.with_(extensions=(Extension(500.0),), memory=Memory(**branch))
    if key == "space_lengthening":
        model = longer()
    if key in SPRING_TERMS:
        model = model.with_(**{key: 0.1})
    if key == "points":
        model = model.with_(stations=[("middle", 2, 0.01)])
    if key == "chambers":
        model = model.with_(chambers=(model.chamber, Chamber(torque=[-1e-7], name="other")))
        assert FEATURES[key].names(model) == ("chamber other",)
    if key in IN_SPACE:
        model = twisting().with_(stiffening=-0.1)
    if key == "space_memory":
        model = model.with_(memory=Memory((0.1,), (0.5,)))
    if key == "tendons":
        model = pulled()
    if key in ("tendon_friction", "pair_pretension"):
        cords = [replace(c, friction=0.2, pretension=3.0 if c.pair else 0.0) for c in pulled().chambers]
        model = pulled().with_(chambers=cords)
    if key == "tendon_chords":
        model = pulled().with_(chambers=[replace(c, spacing=0.01) for c in pulled().chambers])
    assert FEATURES[key].names(model)
    if key in ("space", "tendons"):
        with pytest.raises(pliant.InputError, match=r"is a model in space|is driven by tendons"):
            without(model, (key,))
    elif key not in ("springs", "drive"):  # no artefact can do without: those that cannot say so by nature
        assert not FEATURES[key].names(without(model, (key,)))


def test_a_refusal_names_each_thing(tmp_path):
    with pytest.raises(pliant.InputError) as caught:
        pliant.export(EVERYTHING, "mjcf", tmp_path / "a.xml")
    for name in ("Bouc-Wen", "inflation", "swelling", "limited rate", "not expressible in mjcf"):
        assert name in str(caught.value)
    assert "creep" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_approximate_lists_and_measures(tmp_path):
    done = pliant.export(EVERYTHING, "mjcf", tmp_path / "a.xml", approximate=True)
    can = exporters()["mjcf"].can
    reduced = without(EVERYTHING, missing(EVERYTHING, can))
    again = difference(EVERYTHING, reduced)
    assert done.difference == again
    assert 0 < again.rms < again.largest < 1.0
    assert done.left_out == named(EVERYTHING, missing(EVERYTHING, can))
    text = (tmp_path / "a.xml").read_text(encoding="utf-8")
    assert "Bouc-Wen" in text
    assert f"{1e3 * again.largest:.3g} mm" in repr(done)
    assert not missing(reduced, can)


def test_nothing_left_out_is_said(tmp_path):
    done = pliant.export(chen2018.model(), "mjcf", tmp_path / "a.xml")
    assert done.left_out == ()
    assert done.difference is None
    assert "nothing was left out" in repr(done)


@pytest.mark.parametrize("target", list(BUILT_IN))
def test_every_artefact_says_what_it_is(target, tmp_path):
    model = chen2018.model()
    path = tmp_path / f"arm{exporters()[target].suffixes[-1]}"
    done = pliant.export(model, target, path, standard_errors={"stiffness": 0.0123})
    text = b"".join(f.read_bytes() for f in done.files if f.suffix != ".fmu").decode(errors="ignore")
    if path.suffix == ".fmu":
        with zipfile.ZipFile(path) as archive:
            text = archive.read("documentation/README.txt").decode()
    if path.suffix == ".npz":
        import numpy as np

        text = str(np.load(path)["pliant"])
    for word in ("chen2018", f"pliant {pliant.__version__}", "along +y", "0.0123", "Secs. II and III", "pliant export"):
        assert word.replace("&quot;", '"') in text, word


def test_bad_input(tmp_path):
    model = chen2018.model()
    with pytest.raises(pliant.InputError, match=f"unknown target 'simulink': use one of {', '.join(BUILT_IN)}"):
        pliant.export(model, "simulink", tmp_path / "a.xml")
    with pytest.raises(pliant.InputError, match=r"the file name for mjcf must end in \.xml or \.mjcf, got 'a\.urdf'"):
        pliant.export(model, "mjcf", tmp_path / "a.urdf")
    with pytest.raises(pliant.InputError, match="does not exist; create it first"):
        pliant.export(model, "mjcf", tmp_path / "none" / "a.xml")
    with pytest.raises(pliant.InputError, match="has no option 'colour': its options are prefix, time_step, radius"):
        pliant.export(model, "mjcf", tmp_path / "a.xml", colour="red")
    with pytest.raises(pliant.InputError, match="time_step must be a float, got 'soon'"):
        pliant.export(model, "mjcf", tmp_path / "a.xml", time_step="soon")
    folder = tmp_path / "folder.xml"
    folder.mkdir()
    with pytest.raises(pliant.InputError, match="cannot write"):
        pliant.export(model, "mjcf", folder)
    assert [p.name for p in tmp_path.iterdir()] == ["folder.xml"]


def test_the_command(tmp_path):
    file = save_model(EVERYTHING, tmp_path / "model.json")
    fit = tmp_path / "metrics.json"
    fit.write_text(json.dumps({"fits": {"first": {"parameters": {"damping": {"std": 2e-4}, "x": {"std": None}}}}}))
    refused = invoke("export", file, "--to", "mjcf", "-o", tmp_path / "a.xml")
    assert isinstance(refused.exception, pliant.InputError)
    assert "Bouc-Wen" in str(refused.exception)
    done = invoke(
        "export", file, "--to", "mjcf", "-o", tmp_path / "a.xml", "--approximate", "--json", "--fit", fit,
        "--set", "prefix=left_",
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert told["difference"]["largest_tip_difference_mm"] > 0
    text = (tmp_path / "a.xml").read_text(encoding="utf-8")
    assert "--approximate --set prefix=left_" in text
    assert "0.0002" in text
    assert standard_errors(fit) == {"damping": 2e-4}
    with pytest.raises(pliant.InputError, match="is not the result of a fit"):
        standard_errors(file)
    wrong = invoke("export", file, "--to", "mjcf", "-o", tmp_path / "a.xml", "--set", "prefix")
    assert "NAME=VALUE" in str(wrong.exception)


def test_typical_pressure():
    paper = chen2018.model()
    level = typical_pressure(paper)
    assert equilibrium(paper, level).sum() == pytest.approx(0.5, rel=0.05)
    weak = paper.with_(stiffening=[-6.0])  # gives way at 1/12 rad a joint
    assert 0 < typical_pressure(weak) < level
    assert equilibrium(weak, typical_pressure(weak)).sum() < 0.5
    assert typical_pressure(paper.with_(torque=[0.0])) == 0.0
    assert difference(paper.with_(torque=[0.0]), paper.with_(torque=[0.0], damping=[0.01])).largest > 0


def test_the_file_is_the_model(tmp_path):
    """A path and the model that lies there give one artefact, but for the name in the command."""
    file = save_model(chen2018.model(), tmp_path / "model.json")
    pliant.export(file, "mjcf", tmp_path / "a.xml")
    pliant.export(load_model(file), "mjcf", tmp_path / "b.xml")
    one, other = ((tmp_path / n).read_text(encoding="utf-8") for n in ("a.xml", "b.xml"))
    assert one.replace(str(file), "MODEL.json").replace("a.xml", "b.xml") == other


def test_the_polynomial_in_the_place_of_a_bounded_spring_is_near_it():
    soft = chen2018.model(stiffening=-1.5, stiffening_bound=0.75)
    near = FEATURES["bounded"].without(soft)
    q = equilibrium(soft, typical_pressure(soft))
    for share in np.linspace(-1.0, 1.0, 9):
        torque = springs.springs_of(soft).torque(share * q)
        off = springs.springs_of(near).torque(share * q) - torque
        assert np.abs(off).max() < 0.01 * np.abs(springs.springs_of(soft).torque(q)).max()
    assert not near.stiffening_bound.any()
