"""FMUs, validated and simulated by fmpy: equal to `Stepper`, their state saved and restored, parameters tuned."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from target_models import EVERY_BRANCH, flat_longer, longer, pulled

import pliant
from pliant.actuators import chen2018
from pliant.exporters import fmu
from pliant.exporters.fmu import base_units, variables
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Valve
from pliant.simulation import Stepper

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed: pip install 'pliant[export]'")
if shutil.which("cc") is None:
    pytest.skip("no C compiler (cc) is on the path: an FMU has no binary to run", allow_module_level=True)
VERSIONS = ["2.0", "3.0"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The FMU of a model, built once for all tests: they read it."""
    files = {}

    def make(model, version):
        key = (model.name, *(c.valve for c in model.chambers), version)
        if key not in files:
            done = pliant.export(model, "fmu", tmp_path_factory.mktemp("fmu") / "arm.fmu", fmi=version)
            assert all(" is named " in note for note in done.notes)
            files[key] = str(done.files[0])
        return files[key]

    return make


def without_dead_time(model):
    return model.with_(valve=Valve(rise_time=model.valve.rise_time, fall_time=model.valve.fall_time))


@pytest.mark.parametrize("version", VERSIONS)
def test_valid(model, version, made):
    from fmpy.validation import validate_fmu

    assert validate_fmu(made(model, version)) == []


@pytest.mark.parametrize("version", VERSIONS)
def test_the_motion_of_the_stepper(model, version, made):
    model = without_dead_time(model)
    file = made(model, version)
    n, h = model.n, 1e-3
    levels = np.repeat([0.0, 8e4, 2e4, 1e5], 100)
    table = np.array(
        [(k * h, p) for k, p in enumerate(levels)], dtype=[("time", float), ("pressure", float)],
    )
    names = [v.name for v in fmu.variables(model, 0.0) if v.causality == "output"]
    run = fmpy.simulate_fmu(
        file, stop_time=0.4, output_interval=h, step_size=h, fmi_type="CoSimulation", output=names,
        input=table, use_event_mode=False,
    )
    stepper = Stepper(model, h)
    last = model.points[-1].name
    worst = 0.0
    for k in range(400):
        places, angles = mechanics_of(model).stations(stepper.angle)
        row = run[k]
        worst = max(worst, abs(row[f"{last}.x"] - places[-1, 0]), abs(row[f"{last}.y"] - places[-1, 1]))
        worst = max(worst, abs(row[f"{last}.angle"] - angles[-1]))
        q = mechanics_of(model).joint_angles(stepper.angle)
        worst = max(worst, *(abs(row[f"q_{i + 1}"] - q[i]) for i in range(n)))
        if k < 399:
            stepper.step(levels[k])
    assert worst < 1e-9
    assert np.ptp(run[f"{last}.x"]) > 0.01


class Session:
    """An FMU that is stepped by hand."""

    def __init__(self, file, version, folder):
        description = fmpy.read_model_description(file)
        self.refs = {v.name: v.valueReference for v in description.modelVariables}
        unzipped = fmpy.extract(file, str(folder / "unzipped"))
        kind = fmpy.fmi2.FMU2Slave if version == "2.0" else fmpy.fmi3.FMU3Slave
        token = description.guid if version == "2.0" else description.instantiationToken
        self.fmu = kind(
            guid=token, unzipDirectory=unzipped, modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.fmu.instantiate()
        self.two = version == "2.0"
        if self.two:
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.time = 0.0

    def set(self, name, value):
        put = self.fmu.setReal if self.two else self.fmu.setFloat64
        put([self.refs[name]], [value])

    def get(self, name):
        ask = self.fmu.getReal if self.two else self.fmu.getFloat64
        return ask([self.refs[name]])[0]

    def go(self, steps, h=1e-3):
        for _ in range(steps):
            self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=h)
            self.time += h

    def save(self):
        return self.fmu.getFMUState() if not self.two else self.fmu.getFMUstate()

    def restore(self, saved):
        (self.fmu.setFMUstate if self.two else self.fmu.setFMUState)(saved)

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


@pytest.mark.slow
def test_a_body_in_space_under_tendons(made, tmp_path):
    """Units of its inputs and parameters; a parameter tuned changes what `update` derives from it."""
    model = pulled(2)
    file = made(model, "2.0")
    known = {v.name: v for v in variables(model, 0.0)}
    names = ["displacement_long", "angle_pair", "tension_short"]
    assert [known[name].unit for name in names] == ["m", "rad", "N"]
    assert [known[f"torque[{c},1]"].unit for c in (1, 2, 3)] == ["N/m", "N/rad", ""]
    assert [known[f"valve[{c},3]"].unit for c in (1, 2, 3)] == ["m/s", "rad/s", "N/s"]
    assert known["joint_gain[1,1]"].unit == "m"
    run, stiff = Session(file, "2.0", tmp_path), model.with_(space=replace(model.space, stiffness_ratio=2.0))
    for body in (model, stiff):
        stepper = Stepper(model, 1e-3, np.zeros(3))
        if body is stiff:
            run.fmu.reset()
            run.time = 0.0
            run.set("stiffness_ratio", 2.0)
            stepper = Stepper(body, 1e-3, np.zeros(3))
            stepper.reset(0.0, joint_angle=pliant.equilibrium(model, np.zeros(3)))
        for name, level in zip(names, (2e-3, 0.3, 1.0), strict=True):
            run.set(name, level)
        for _ in range(50):
            run.go(1)
            stepper.step([2e-3, 0.3, 1.0])
        found = [run.get(f"tip.{axis}") for axis in "xyz"] + [run.get("bend_x_1"), run.get("bend_y_2")]
        assert found == pytest.approx([*stepper.stations()[0][-1], stepper.angle[0], stepper.angle[3]], abs=1e-12)
        assert run.get("angle_pair_behind_valve") == pytest.approx(stepper.pressure[1], rel=1e-12)
    run.close()


@pytest.mark.slow
def test_a_body_in_space_that_lengthens(made, tmp_path):
    model, levels = longer(2), [40e3, 10e3, 4e-3]
    known = {v.name: v.unit for v in variables(model, 0.0)}
    assert [known[n] for n in ("strain_near", "bend_x_1", "axial_stiffness[2]", "share[1,1]")] == ["", "rad", "N", ""]
    run, stiffer = Session(made(model, "2.0"), "2.0", tmp_path), [replace(e, stiffness=120.0) for e in model.extensions]
    run.set("axial_stiffness[1]", 120.0)
    run.set("axial_stiffness[2]", 120.0)
    stepper = Stepper(model.with_(extensions=stiffer), 1e-3, np.zeros(3))
    stepper.reset(0.0, joint_angle=pliant.equilibrium(model, np.zeros(3)))
    for name, level in zip(model.actuation.labels("{kind}"), levels, strict=True):
        run.set(name, level)
    for _ in range(100):
        run.go(1)
        stepper.step(levels)
    found = [run.get(f"tip.{axis}") for axis in "xyz"] + [run.get("strain_near"), run.get("strain_far")]
    assert found == pytest.approx([*stepper.stations()[0][-1], *stepper.position[-2:]], abs=1e-12)
    run.close()


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_a_body_in_a_plane_that_lengthens(version, tmp_path):
    """Tuned parameters: springs and masses act by what `update` derives from them."""
    from fmpy.validation import validate_fmu

    model = flat_longer(2).with_(memory=EVERY_BRANCH)
    file = str(pliant.export(model, "fmu", tmp_path / "arm.fmu", fmi=version, time_step=1e-3).files[0])
    assert validate_fmu(file) == []
    units = {v.name: v.unit or "" for v in fmpy.read_model_description(file).modelVariables}
    names = ("strain_lower", "axial_stiffness[2]", "axial_damping[1]", "axial_stiffening[1]", "axial_creep_time[2]")
    assert [units[n] for n in names] == ["", "N", "N.s", "", "s"]
    run = Session(file, version, tmp_path)
    segments = [replace(e, stiffness=1.3 * e.stiffness, damping=2.0 * e.damping, stiffening=-0.1)
                for e in model.extensions]  # fmt: skip
    tuned = model.with_(extensions=segments, link_mass=[0.03, 0.04])
    for s, e in enumerate(segments, 1):
        run.set(f"axial_stiffness[{s}]", e.stiffness)
        run.set(f"axial_damping[{s}]", e.damping)
        run.set(f"axial_stiffening[{s}]", -0.1)
    run.set("link_mass[1]", 0.03)
    run.set("link_mass[2]", 0.04)
    stepper = Stepper(tuned, 1e-3, np.zeros(2))
    stepper.reset(0.0, joint_angle=pliant.equilibrium(model, np.zeros(2)))
    stepper.memory[:] = Stepper(model, 1e-3, np.zeros(2)).memory
    for name, level in zip(("a", "b"), (6e4, 2e4), strict=True):
        run.set(f"pressure_{name}", level)
    for _ in range(300):
        run.go(1)
        stepper.step([6e4, 2e4])
    seen = [run.get(n) for n in ("tip.x", "tip.y", "strain_lower", "strain_upper", "q_1", "q_2")]
    joints = mechanics_of(tuned).joint_coordinates(stepper.position)
    assert seen == pytest.approx([*stepper.stations()[0][-1], *joints[2:], *joints[:2]], abs=1e-12)
    assert np.abs(joints[2:] - pliant.equilibrium(model, np.zeros(2))[2:]).max() > 0.01
    run.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_two_chambers_and_creep(branched, version, made, tmp_path):
    model = branched.with_(chambers=tuple(replace(c, valve=replace(c.valve, dead_time=0.0)) for c in branched.chambers))
    run, stepper = Session(made(model, version), version, tmp_path), Stepper(model, 1e-3, [0.0, 0.0])
    worst = 0.0
    for near, far in ((0.0, 5e4), (8e4, 2e4), (3e4, 0.0)):
        run.set("pressure_near", near)
        run.set("pressure_far", far)
        for _ in range(100):
            run.go(1)
            stepper.step(np.array([near, far]))
            q = mechanics_of(model).joint_angles(stepper.angle)
            worst = max(worst, *(abs(run.get(f"q_{i + 1}") - q[i]) for i in range(model.n)))
    run.close()
    assert np.abs(q).max() > 0.02
    assert worst < 1e-9


@pytest.mark.parametrize("version", VERSIONS)
def test_state_saved_parameters_tuned(model, version, made, tmp_path):
    model = without_dead_time(model)
    run = Session(made(model, version), version, tmp_path)
    tip = f"{model.points[-1].name}.x"
    run.set("pressure", 9e4)
    run.go(80)
    saved = run.save()
    run.go(50)
    first = run.get(tip)
    run.restore(saved)
    run.go(5, 1e-2)  # ten steps at a time
    assert run.get(tip) == pytest.approx(first, abs=1e-15)
    run.restore(saved)
    names = [f"stiffness[{i + 1}]" for i in range(model.n)]
    before = [run.get(name) for name in names]
    assert before == pytest.approx(model.stiffness)
    for name, value in zip(names, before, strict=True):
        run.set(name, 1.5 * value)
    run.set("link_mass[1]", 0.02)
    run.go(10000)
    stiffer = model.with_(stiffness=1.5 * model.stiffness, link_mass=[0.02, *model.link_mass[1:]])
    if not model.memory:
        rest = pliant.equilibrium(stiffer, 9e4)
        assert [run.get(f"q_{i + 1}") for i in range(model.n)] == pytest.approx(rest, abs=1e-4)
    assert run.get("kinetic_energy") >= 0.0
    with pytest.raises(fmpy.fmi1.FMICallException):
        run.go(1, 1.5e-3)
    run.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_types_of_the_standard(version, made, tmp_path):
    """The official headers, which fmpy carries, agree with every function that the FMU defines."""
    headers = Path(fmpy.__file__).parent / "c-code"
    number = version[0]
    if not (headers / f"fmi{number}Functions.h").is_file():
        pytest.skip("this fmpy carries no headers of the standard")
    file = made(chen2018.model(), version)
    with zipfile.ZipFile(file) as archive:
        text = archive.read("sources/all.c").decode()
    declared = text[text.index("#include <stdarg.h>") :].split("FMI ")
    functions = [part.split("(")[0].split()[-1].lstrip("*") for part in declared[1:] if "(" in part]
    names = [f for f in functions if f.startswith(f"fmi{number}")]
    assert len(names) > 20
    library = fmu.compiled(text, tmp_path, number)
    assert library[1] == ""
    from ctypes import CDLL

    loaded = CDLL(str(tmp_path / "all.so"))
    header = (headers / f"fmi{number}Functions.h").read_text(encoding="utf-8")
    wanted = set(re.findall(rf"FMI{number}_Export fmi{number}\w+TYPE\s+(fmi{number}\w+);", header))
    wanted -= {w for w in wanted if version == "2.0" and any(k in w for k in MODEL_EXCHANGE)}
    missing = [w for w in sorted(wanted) if not hasattr(loaded, w)]
    assert not missing
    assert len(wanted) > 20


NAME = r"(?:[A-Za-z_][A-Za-z0-9_]*|'(?:[\w!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+')"
PART = rf"{NAME}(?:\[[0-9]+(?:,[0-9]+)*\])?"
STRUCTURED = re.compile(rf"(?:der\()?{PART}(?:\.{PART})*(?:,[0-9]+)?\)?", re.ASCII)  # FMI 2.0.4, 2.2.9


@pytest.mark.parametrize("version", VERSIONS)
def test_names_are_structured_and_differ_and_units_are_si(version, branched, made):
    stations = [("left tip", 1, 0.0), ("q_1", 2, 0.0), ("3", 2, 0.01), ("3.5 kPa", 1, 0.01), ("stiffness", 0, 0.01)]
    chambers = tuple(
        replace(c, name=name, valve=replace(c.valve, dead_time=0.0))
        for c, name in zip(branched.chambers, ("near end", "far"), strict=True)
    )
    model = branched.with_(stations=stations, chambers=chambers, name="odd names")
    from fmpy.validation import validate_fmu

    file = made(model, version)
    assert validate_fmu(file) == []
    described = fmpy.read_model_description(file)
    names = [v.name for v in described.modelVariables]
    assert len(set(names)) == len(names)
    assert all(STRUCTURED.fullmatch(name) for name in names)
    records = {name.partition(".")[0] for name in names if "." in name}
    assert not records & {name.partition("[")[0] for name in names if "." not in name}
    assert {"left_tip.x", "pressure_near_end", "pressure_far_behind_valve", "_3_5_kPa.angle"} <= set(names)
    units = {v.name: v.unit or "" for v in described.modelVariables}
    assert [units[f"valve[1,{k}]"] for k in (1, 2, 3, 4)] == ["s", "s", "Pa/s", "Pa/s"]
    assert [units[f"rubber[2,{k}]"] for k in (1, 2, 3, 4, 5)] == ["", "s", "Pa", "s", ""]
    bases = {u.name: u.baseUnit for u in described.unitDefinitions}
    torque = bases[units["torque[1,1]"]]
    assert (torque.kg, torque.m, torque.s, torque.rad) == (0, 3, 0, 0)  # N m/Pa is m^3
    stiff = bases[units["stiffness[1]"]]
    assert (stiff.kg, stiff.m, stiff.s, stiff.rad) == (1, 2, -2, -1)


def test_units_of_every_parameter_are_known():
    """A parameter that is added to the C needs a unit here, one for each column where they differ."""
    model = chen2018.model(
        torque=[6e-7, 1e-13, 1e-19], memory=Memory((0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.1),
        swell_share=0.1, inflation_limit=1e6, inflation_jm=20.0,
    )
    units = {v.name: v.unit for v in variables(model, 0.0)}
    assert [units[f"torque[1,{k}]"] for k in (1, 2, 3)] == ["N.m/Pa", "N.m/Pa2", "N.m/Pa3"]
    assert base_units("N.m/Pa3") == (-2, 5, 4, 0)
    assert {u for u in units.values() if u and base_units(u) is None} == {"1/rad^n"}


@pytest.mark.parametrize("version", VERSIONS)
def test_sources_in_a_program_carry_the_name_of_the_fmu(version, tmp_path):
    """Two FMUs in one program; compiled with the standard's macro, the names are those of the standard."""
    number = version[0]
    for name in ("left", "right"):
        file = pliant.export(chen2018.model(links=1), "fmu", tmp_path / f"{name}.fmu", fmi=version).files[0]
        with zipfile.ZipFile(file) as archive:
            (tmp_path / f"{name}.c").write_bytes(archive.read("sources/all.c"))
        assert fmpy.read_model_description(str(file)).coSimulation.modelIdentifier == name
    flags = ["cc", "-std=c99", "-O0", "-fPIC", "-shared"]
    compile_plain = [*flags, f"-DFMI{number}_OVERRIDE_FUNCTION_PREFIX", "left.c", "-o", "one.so", "-lm"]
    subprocess.run([*flags, "left.c", "right.c", "-o", "both.so", "-lm"], cwd=tmp_path, check=True)
    subprocess.run(compile_plain, cwd=tmp_path, check=True)
    symbols = []
    for library in ("both.so", "one.so"):
        listed = subprocess.check_output(["nm", "-D", "--defined-only", library], cwd=tmp_path, text=True)
        symbols.append({line.split()[-1] for line in listed.splitlines()})
    plain = {name for name in symbols[1] if name.startswith("fmi")}
    assert len(plain) > 30
    prefixed = {f"{who}_{name}" for who in ("left", "right") for name in plain}
    assert {name for name in symbols[0] if "fmi" in name} == prefixed


MODEL_EXCHANGE = (
    "EventMode", "NewDiscreteStates", "ContinuousTimeMode", "CompletedIntegratorStep", "SetTime", "ContinuousStates",
    "GetDerivatives", "EventIndicators", "NominalsOf",
)


def test_without_a_compiler_the_sources_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    done = pliant.export(chen2018.model(), "fmu", tmp_path / "arm.fmu")
    assert "no C compiler was found" in done.notes[0]
    with zipfile.ZipFile(done.files[0]) as archive:
        names = archive.namelist()
    assert "sources/all.c" in names
    assert not [n for n in names if n.startswith("binaries")]


@pytest.mark.slow
def test_the_same_model_gives_the_same_bytes(tmp_path):
    made = []
    for _ in range(2):
        file = Path(pliant.export(chen2018.model(), "fmu", tmp_path / "arm.fmu").files[0])
        with zipfile.ZipFile(file) as archive:
            made.append({name: archive.read(name) for name in archive.namelist()})
        file.unlink()
    first, second = made
    assert first == second
    assert any(name.startswith("binaries/") for name in first)


def test_bad_input(tmp_path):
    with pytest.raises(pliant.InputError, match=r"fmi must be 2\.0 or 3\.0, got '1\.0'"):
        pliant.export(chen2018.model(), "fmu", tmp_path / "a.fmu", fmi="1.0")


def test_sources_compile_alone(made, tmp_path):
    file = made(chen2018.model(), "3.0")
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path / "out")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror", "-c"]
    source = tmp_path / "out" / "sources" / "all.c"
    done = subprocess.run(["cc", *flags, str(source), "-o", str(tmp_path / "all.o")], capture_output=True, text=True,
                          check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr[:2000]
