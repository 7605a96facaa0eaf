"""Export of a model as an FMU for co-simulation (FMI 2.0 or 3.0), with C sources and a binary.

Inputs are the pressures. Outputs are the observed points, joint angles, pressures behind the valves and energies. Every
parameter is tunable. Without a C compiler the FMU holds only the sources, which tools can compile.

Variables of an exported FMU: their names (structured naming convention), units and start values.

Names and the order of value references match `templates/fmu.c`: time, inputs, outputs, parameters.
"""

from __future__ import annotations

import hashlib
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from pliant.errors import InputError
from pliant.exporters import c99
from pliant.exporters.c_functions import DERIVED, UNIT, parameters
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter, stated_levels, with_identifiers
from pliant.files import whole
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation.time_step import shared_step
from pliant.text import escaped, identifiers
from pliant.version import __version__

PLAIN = {n: f"FMI{n}_OVERRIDE_FUNCTION_PREFIX" for n in "23"}  # for function names without prefix
STAMP = (1980, 1, 1, 0, 0, 0)  # time of the files in the archive, so that the same model gives the same bytes


INSIDE = (*DERIVED, "dead_time")
BASE = {  # exponents of kg, m, s and rad
    "m": (0, 1, 0, 0), "kg": (1, 0, 0, 0), "s": (0, 0, 1, 0), "rad": (0, 0, 0, 1), "Pa": (1, -1, -2, 0),
    "J": (1, 2, -2, 0), "m/s2": (0, 1, -2, 0), "Pa/s": (1, -1, -3, 0), "1/rad": (0, 0, 0, -1),
    "N": (1, 1, -2, 0), "N.s": (1, 1, -1, 0), "N/m": (1, 0, -2, 0), "N/rad": (1, 1, -2, -1), "1/rad2": (0, 0, 0, -2),
    "m/s": (0, 1, -1, 0), "rad/s": (0, 0, -1, 1), "N/s": (1, 1, -3, 0),
    "N.m/rad": (1, 2, -2, -1), "N.m.s/rad": (1, 2, -1, -1), "kg.m2": (1, 2, 0, 0),
}


class Variable(NamedTuple):
    """One variable of the FMU: name, causality, unit and start value."""

    name: str
    causality: str
    unit: str
    start: float | None = None


def variables(model: Model, pressure: ArrayLike) -> list[Variable]:
    """Return all variables of the FMU in the order of their value references, with unique names."""
    model = with_identifiers(model)
    chambers = model.actuation.labels("{kind}")
    scalars = [
        *mechanics_of(model).joint_names,
        *(f"{kind}_energy" for kind in ("kinetic", "elastic", "gravitational")),
    ]
    visible = [name for name in parameters(model) if name not in INSIDE]
    chambers = list(identifiers(chambers, ["time", *scalars, *visible]))
    behind = list(identifiers([f"{name}_behind_valve" for name in chambers], ["time", *chambers, *scalars, *visible]))
    taken = ["time", *chambers, *behind, *scalars, *visible]
    stations = identifiers([point.name for point in model.points], taken)
    rows = [Variable("time", "independent", "s")]
    inputs = list(zip(chambers, behind, model.actuation.units, strict=True))
    start = np.broadcast_to(pressure, len(inputs))
    rows += [Variable(name, "input", unit, float(p)) for (name, _, unit), p in zip(inputs, start, strict=True)]
    for station in stations:
        rows += [Variable(f"{station}.{k}", "output", unit) for k, unit in pose_of(model)]
    rows += [Variable(name, "output", coordinate_unit(name)) for name in scalars[: model.size]]
    rows += [Variable(name, "output", unit) for _, name, unit in inputs]
    rows += [Variable(name, "output", "J") for name in scalars[model.size :]]
    for field in visible:
        value = parameters(model)[field]
        for index in np.ndindex(*value.shape):
            name = field + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")
            rows.append(Variable(name, "parameter", unit_of(model, field, index), float(value[index])))
    return rows


def pose_of(model: Model) -> list[tuple[str, str]]:
    """Return the components of an observed point as (name, unit): its coordinates and the angle of its link."""
    return [*((axis, "m") for axis in "xyz"[: mechanics_of(model).dimension]), ("angle", "rad")]


def coordinate_unit(name: str) -> str:
    """Return the FMU unit of a joint coordinate: "rad" for an angle, "" for a strain."""
    return "" if name.startswith("strain") else "rad"


def unit_of(model: Model, field: str, index: tuple[int, ...]) -> str:
    """Return the FMU unit of one element of the parameter `field`; "" for a dimensionless number."""
    if field == "torque":
        return fmu_unit(model.chambers[index[0]].law_unit(index[-1]))
    if field == "joint_gain":
        return fmu_unit(model.chambers[index[0]].gain_unit)
    columns = UNIT[field].split(", ")
    if field == "valve":
        columns = [unit.replace("Pa", model.chambers[index[0]].unit) for unit in columns]
    return fmu_unit(columns[index[-1]] if len(columns) > 1 else columns[0])


def fmu_unit(unit: str) -> str:
    """Return a unit such as "N m/rad^2" in the notation of FMUs, "N.m/rad2"; "" for a dimensionless number."""
    return re.sub(r"\^(?=\d)", "", unit.replace(" ", ".")) if unit != "1" else ""


def unit_definitions(root: ET.Element, rows: list[Variable]) -> None:
    """Add the element UnitDefinitions, with the SI exponents of all units, to the FMU's model description."""
    group = ET.SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in rows if v.unit}):
        unit = ET.SubElement(group, "Unit", name=name)
        if (exponents := base_units(name)) is not None:
            named = zip(("kg", "m", "s", "rad"), exponents, strict=True)
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in named if power})


def base_units(unit: str) -> tuple[int, int, int, int] | None:
    """Return the exponents of kg, m, s and rad of a unit, or None if they are unknown, as for "1/rad^n", where n is a
    model parameter.
    """
    if unit.startswith("N.m/Pa"):
        k = int(unit.removeprefix("N.m/Pa") or 1)
        return 1 - k, 2 + k, 2 * k - 2, 0
    return BASE.get(unit)


class Identity(NamedTuple):
    """Name, FMI version, token, time step and initial inputs of an exported FMU."""

    name: str  # model identifier, in the names of file, functions and binary
    version: str  # FMI version
    token: str  # GUID or instantiation token
    time_step: float  # s
    pressure: tuple[float, ...]  # SI, initial value of each input


def root_of(provenance: Provenance, this: Identity) -> ET.Element:
    """Return the root element of the FMU's model description (XML), without the variables."""
    root = ET.Element(
        "fmiModelDescription", fmiVersion=this.version, modelName=escaped(provenance.model.name, "line"),
        description="\n".join(provenance.lines("line")), generationTool=f"pliant {__version__}",
        variableNamingConvention="structured",
    )
    root.set("guid" if this.version == "2.0" else "instantiationToken", this.token)
    node = ET.SubElement(root, "CoSimulation", modelIdentifier=this.name, canHandleVariableCommunicationStepSize="true",
                        canBeInstantiatedOnlyOncePerProcess="false")  # fmt: skip
    if this.version == "2.0":
        names = ("canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate")
        node.attrib.update(dict.fromkeys(names, "true"))
        ET.SubElement(ET.SubElement(node, "SourceFiles"), "File", name="all.c")
    else:
        node.attrib.update(dict.fromkeys(("canGetAndSetFMUState", "canSerializeFMUState"), "true"))
        node.set("fixedInternalStepSize", repr(this.time_step))
    return root


def description(model: Model, provenance: Provenance, this: Identity) -> bytes:
    """Return the content of the FMU's file modelDescription.xml."""
    root, rows = root_of(provenance, this), variables(model, this.pressure)
    unit_definitions(root, rows)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", stepSize=repr(this.time_step))
    variable_list = ET.SubElement(root, "ModelVariables")
    for ref, v in enumerate(rows):
        words = {"name": v.name, "valueReference": str(ref), "causality": v.causality}
        words["variability"] = "tunable" if v.causality == "parameter" else "continuous"
        kind = {"unit": v.unit} if v.unit else {}
        if v.start is not None:
            kind["start"] = repr(v.start)
        if this.version == "2.0":
            ET.SubElement(ET.SubElement(variable_list, "ScalarVariable", words), "Real", kind)
        else:
            ET.SubElement(variable_list, "Float64", words | kind)
    structure(root, [ref for ref, v in enumerate(rows) if v.causality == "output"], this.version)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def structure(root: ET.Element, outputs: list[int], version: str) -> None:
    """Add the element ModelStructure to the FMU's model description: its outputs and initial unknowns."""
    section = ET.SubElement(root, "ModelStructure")
    if version == "2.0":
        for group in ("Outputs", "InitialUnknowns"):
            parent = ET.SubElement(section, group)
            for ref in outputs:
                ET.SubElement(parent, "Unknown", index=str(ref + 1))
        return
    for kind in ("Output", "InitialUnknown"):
        for ref in outputs:
            ET.SubElement(section, kind, valueReference=str(ref))


def build_description(name: str) -> bytes:
    """Return the content of the FMU's file sources/buildDescription.xml (FMI 3)."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    section = ET.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    ET.SubElement(ET.SubElement(section, "SourceFileSet", language="C99"), "SourceFile", name="all.c")
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def sources(model: Model, provenance: Provenance, this: Identity) -> str:
    """Return all C code of the FMU as the text of one source file."""
    text = c99.code(
        model, provenance, time_step=this.time_step, precision="double", pressure=this.pressure, prefix=this.name
    )
    rows = variables(model, this.pressure)
    count = {kind: sum(v.causality == kind for v in rows) for kind in ("input", "output", "parameter")}
    start = "\n".join(f"    i->now.command[{c}] = {level!r};" for c, level in enumerate(this.pressure))
    number, folder = this.version[0], files("pliant.exporters") / "templates"
    shared, wrapper = ((folder / f).read_text(encoding="utf-8") for f in ("fmu.c", f"fmi{number}.c"))
    words = {
        "P": text.prefix, "INPUTS": count["input"], "OUTPUTS": count["output"], "PARAMETERS": count["parameter"],
        "STATIONS": len(model.points), "POSE": len(pose_of(model)), "COORDINATES": model.size,
        "STEP": repr(this.time_step), "GUID": this.token, "START": start,
        "FMI": f"FMI{number}", "NAME": this.name,
        "FUNCTIONS": "\n".join(f"#define {name} FULL_NAME({name})" for name in functions_of(wrapper, number)),
    }
    return text.header + text.source.replace(f'#include "{text.prefix}.h"\n', "") + c99.filled(shared + wrapper, words)


def functions_of(wrapper: str, number: str) -> list[str]:
    """Return the names of the FMI functions that a C template defines, including those defined by its macros."""
    names = re.findall(rf"^FMI [\w *]*?\b(fmi{number}\w+)\(", wrapper, re.MULTILINE)
    names += re.findall(rf"^(?:NONE|REFUSE|REFUSE_PLAIN)\((fmi{number}\w+)", wrapper, re.MULTILINE)
    types = re.findall(r"^NONE\(([A-Z]\w+),", wrapper, re.MULTILINE)
    return names + [f"fmi{number}{verb}{kind}" for kind in types for verb in ("Get", "Set")]


def compiled(text: str, folder: Path, number: str) -> tuple[bytes | None, str]:
    """Compile the FMU's C source. Return the binary and "", or None and the reason if it could not be compiled."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or sys.platform not in ("linux", "darwin"):
        return None, "no C compiler was found: the FMU holds only its sources and no binary"
    source, binary = folder / "all.c", folder / "all.so"
    source.write_text(text, encoding="utf-8")
    flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", f"-D{PLAIN[number]}"]
    command = [compiler, *flags, str(source), "-o", str(binary)]
    done = subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False)  # noqa: S603  our own source
    if done.returncode:
        return None, f"the C compiler failed on the sources: the FMU holds no binary ({done.stderr.strip()[:200]})"
    return binary.read_bytes(), ""


def places(version: str) -> tuple[str, str]:
    """Return the folder and the file extension of this platform's binary inside an FMU."""
    ending = "dylib" if sys.platform == "darwin" else "so"
    if version == "2.0":
        return ("darwin64" if sys.platform == "darwin" else "linux64"), ending
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return f"{machine}-{'darwin' if sys.platform == 'darwin' else 'linux'}", ending


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write a model as an FMU to `path`, and return the path."""
    version = {"2": "2.0", "2.0": "2.0", "3": "3.0", "3.0": "3.0"}.get(str(options["fmi"]))
    if version is None:
        raise InputError(f"fmu option fmi must be 2.0 or 3.0, got {options['fmi']!r}")
    token = "{" + hashlib.sha256("\n".join([version, *provenance.lines("line")]).encode()).hexdigest()[:32] + "}"
    name = escaped(path.stem, "identifier")
    time_step = float(options["time_step"]) or shared_step([model])
    level = stated_levels("fmu", "pressure", options["pressure"], model)
    this = Identity(name, version, token, time_step, tuple(map(float, level)))
    text = sources(model, provenance, this)
    with tempfile.TemporaryDirectory() as folder:
        binary, why = compiled(text, Path(folder), version[0])
    content: dict[str, bytes] = {
        "modelDescription.xml": description(model, provenance, this),
        "sources/all.c": text.encode(),
    }
    if version == "3.0":
        content["sources/buildDescription.xml"] = build_description(name)
    if binary is not None:
        where, ending = places(version)
        content[f"binaries/{where}/{name}.{ending}"] = binary
    content["resources/pliant.json"] = provenance.json().encode()
    content["documentation/README.txt"] = "\n".join([*provenance.lines("line"), why]).encode()
    with whole(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in content.items():
            archive.writestr(zipfile.ZipInfo(entry, STAMP), data, zipfile.ZIP_DEFLATED)
    if why:
        provenance.messages.append(why)
    return (path,)


EXPORTER = Exporter(
    "fmu", "FMU for co-simulation, FMI 2.0 or 3.0", (".fmu",), c99.CAN, write,
    {"fmi": "2.0", "time_step": 0.0, "pressure": "0"},
)
