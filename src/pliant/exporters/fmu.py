"""FMU for co-simulation, FMI 2.0 or 3.0: the C of `c99` behind the functions of the standard, with sources and binary.

Inputs are the pressures, outputs the observed points, joint angles, pressures behind the valves and energies; every
parameter is tunable. Without a compiler the FMU holds the sources alone, which tools can compile.
"""

from __future__ import annotations

import hashlib
import platform
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

from pliant.errors import InputError
from pliant.exporters import c99
from pliant.exporters.c_functions import parameters
from pliant.exporters.provenance import Told
from pliant.exporters.registry import Exporter
from pliant.files import whole
from pliant.model import Model
from pliant.model.file import UNITS
from pliant.version import __version__

DERIVED = ("B", "I", "h", "K2", "K3", "dead_time")
STAMP = (1980, 1, 1, 0, 0, 0)  # of the files in the archive: the same model gives the same bytes


class Variable(NamedTuple):
    """One variable of the FMU."""

    name: str
    causality: str
    unit: str
    start: float | None = None


def variables(model: Model, pressure: float) -> list[Variable]:
    """All variables in the order of their value references; see templates/fmu.c."""
    n, single = model.n, len(model.chambers) == 1
    chambers = ["pressure"] if single else [f"pressure_{c + 1}" for c in range(len(model.chambers))]
    made = [Variable("time", "independent", "s")]
    made += [Variable(name, "input", "Pa", pressure) for name in chambers]
    for point in model.points:
        made += [Variable(f"{point.name}.{k}", "output", u) for k, u in (("x", "m"), ("y", "m"), ("angle", "rad"))]
    made += [Variable(f"q_{i + 1}", "output", "rad") for i in range(n)]
    made += [Variable(f"{name}_behind_valve", "output", "Pa") for name in chambers]
    made += [Variable(f"{kind}_energy", "output", "J") for kind in ("kinetic", "elastic", "gravitational")]
    for field, value in parameters(model).items():
        if field not in DERIVED:
            for index in np.ndindex(*value.shape):
                name = field + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")
                made.append(Variable(name, "parameter", UNITS.get(field, ""), float(value[index])))
    return made


def root_of(model: Model, told: Told, version: str, token: str, step: float) -> ET.Element:
    """The model description without its variables."""
    name, text = c99.identifier(model.name), "\n".join(told.lines())
    root = ET.Element(
        "fmiModelDescription", fmiVersion=version, modelName=model.name, description=text,
        generationTool=f"pliant {__version__}", variableNamingConvention="structured",
    )
    root.set("guid" if version == "2.0" else "instantiationToken", token)
    abilities = {
        "modelIdentifier": name, "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    if version == "2.0":
        abilities |= {
            "canNotUseMemoryManagementFunctions": "true", "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
        }
        own = ET.SubElement(root, "CoSimulation", abilities)
        ET.SubElement(ET.SubElement(own, "SourceFiles"), "File", name="all.c")
    else:
        abilities |= {
            "canGetAndSetFMUState": "true", "canSerializeFMUState": "true", "fixedInternalStepSize": repr(step),
        }
        ET.SubElement(root, "CoSimulation", abilities)
    return root


def description(model: Model, told: Told, version: str, token: str, options: Mapping[str, Any]) -> bytes:
    """modelDescription.xml."""
    step = float(options["step"])
    root, rows = root_of(model, told, version, token, step), variables(model, options["pressure"])
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({v.unit for v in rows if v.unit}):
        ET.SubElement(units, "Unit", name=unit)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", stepSize=repr(step))
    held = ET.SubElement(root, "ModelVariables")
    for ref, v in enumerate(rows):
        words = {"name": v.name, "valueReference": str(ref), "causality": v.causality}
        words["variability"] = "tunable" if v.causality == "parameter" else "continuous"
        kind = {"unit": v.unit} if v.unit else {}
        if v.start is not None:
            kind["start"] = repr(v.start)
        if version == "2.0":
            ET.SubElement(ET.SubElement(held, "ScalarVariable", words), "Real", kind)
        else:
            ET.SubElement(held, "Float64", words | kind)
    structure(root, [ref for ref, v in enumerate(rows) if v.causality == "output"], version)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def structure(root: ET.Element, outputs: list[int], version: str) -> None:
    """Which variables are outputs, and known only after initialisation."""
    own = ET.SubElement(root, "ModelStructure")
    if version == "2.0":
        for group in ("Outputs", "InitialUnknowns"):
            parent = ET.SubElement(own, group)
            for ref in outputs:
                ET.SubElement(parent, "Unknown", index=str(ref + 1))
        return
    for kind in ("Output", "InitialUnknown"):
        for ref in outputs:
            ET.SubElement(own, kind, valueReference=str(ref))


def build_description(name: str) -> bytes:
    """sources/buildDescription.xml of FMI 3."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    own = ET.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    ET.SubElement(ET.SubElement(own, "SourceFileSet", language="C99"), "SourceFile", name="all.c")
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def sources(model: Model, told: Told, version: str, token: str, options: Mapping[str, Any]) -> str:
    """The whole FMU in one file of C."""
    prefix, pressure = c99.identifier(model.name), options["pressure"]
    made = c99.code(model, told, step=options["step"], precision="double", pressure=pressure, prefix=prefix)
    rows = variables(model, pressure)
    count = {kind: sum(v.causality == kind for v in rows) for kind in ("input", "output", "parameter")}
    start = "\n".join(f"    i->now.command[{c}] = {float(pressure)!r};" for c in range(count["input"]))
    words = {
        "@P@": prefix, "@INPUTS@": str(count["input"]), "@OUTPUTS@": str(count["output"]),
        "@PARAMETERS@": str(count["parameter"]), "@STATIONS@": str(len(model.points)), "@LINKS@": str(model.n),
        "@STEP@": repr(float(options["step"])), "@GUID@": token, "@START@": start,
    }
    folder = files("pliant.exporters") / "templates"
    wrapper = "".join((folder / f).read_text(encoding="utf-8") for f in ("fmu.c", f"fmi{version[0]}.c"))
    for word, value in words.items():
        wrapper = wrapper.replace(word, value)
    return made.header + made.source.replace(f'#include "{prefix}.h"\n', "") + wrapper


def compiled(text: str, folder: Path) -> tuple[bytes | None, str]:
    """The binary, or nothing and the sentence that says why."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or sys.platform not in ("linux", "darwin"):
        return None, "no C compiler was found: the FMU holds its sources alone, and no binary"
    source, binary = folder / "all.c", folder / "all.so"
    source.write_text(text, encoding="utf-8")
    command = [compiler, "-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", str(source), "-o", str(binary)]
    done = subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False)  # noqa: S603  our own source
    if done.returncode:
        return None, f"the C compiler refused the sources: the FMU holds no binary ({done.stderr.strip()[:200]})"
    return binary.read_bytes(), ""


def places(version: str) -> tuple[str, str]:
    """Folder and ending of the binary of this platform."""
    ending = "dylib" if sys.platform == "darwin" else "so"
    if version == "2.0":
        return ("darwin64" if sys.platform == "darwin" else "linux64"), ending
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return f"{machine}-{'darwin' if sys.platform == 'darwin' else 'linux'}", ending


def write(model: Model, told: Told, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write the FMU."""
    version = {"2": "2.0", "2.0": "2.0", "3": "3.0", "3.0": "3.0"}.get(str(options["fmi"]))
    if version is None:
        raise InputError(f"fmu fmi must be 2.0 or 3.0, got {options['fmi']!r}")
    name = c99.identifier(model.name)
    token = "{" + hashlib.sha256("\n".join([version, *told.lines()]).encode()).hexdigest()[:32] + "}"
    text = sources(model, told, version, token, options)
    with tempfile.TemporaryDirectory() as folder:
        binary, why = compiled(text, Path(folder))
    content: dict[str, bytes] = {
        "modelDescription.xml": description(model, told, version, token, options),
        "sources/all.c": text.encode(),
    }
    if version == "3.0":
        content["sources/buildDescription.xml"] = build_description(name)
    if binary is not None:
        where, ending = places(version)
        content[f"binaries/{where}/{name}.{ending}"] = binary
    content["resources/pliant.json"] = told.json().encode()
    content["documentation/README.txt"] = "\n".join([*told.lines(), why]).encode()
    with whole(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in content.items():
            archive.writestr(zipfile.ZipInfo(entry, STAMP), data, zipfile.ZIP_DEFLATED)
    if why:
        told.said.append(why)
    return (path,)


EXPORTER = Exporter(
    "fmu", "FMU for co-simulation, FMI 2.0 or 3.0", (".fmu",), c99.CAN, write,
    {"fmi": "2.0", "step": 1e-3, "pressure": 0.0},
)
