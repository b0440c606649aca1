"""A model as an FMU for co-simulation, after FMI 3.0 or 2.0.

``NAME.fmu`` is an archive of the description in XML, the C sources, and a binary for Linux and for Windows where a C
compiler for it is present. Inputs and outputs have the names and units of the record. The parameters of a plant can be
set before the first step, with the fitted values as start; those that the state at rest depends on, and the parameters
of other models, are constants. The step of an importer may have any length: the model passes its own samples.
"""

from __future__ import annotations

import platform
import re
import subprocess
import sys
from collections.abc import Sequence
from io import BytesIO
from math import inf, isfinite
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from uuid import NAMESPACE_OID, uuid5
from xml.etree import ElementTree
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from emsid.errors import ModelError, listed
from emsid.estimation.estimates import Estimate, Status
from emsid.exports.assumptions import assumed
from emsid.exports.c99 import c99
from emsid.exports.fmi_source import fmi_source
from emsid.exports.formats import Export, Files
from emsid.models.starting import start
from emsid.units import plain_unit

VERSIONS = {"3": "3.0", "3.0": "3.0", "2": "2.0", "2.0": "2.0"}
FOLDERS = {
    ("3.0", "x86_64"): "x86_64-linux",
    ("3.0", "aarch64"): "aarch64-linux",
    ("2.0", "x86_64"): "linux64",
}
"""Where each standard looks for the binary of a Linux machine."""
WINDOWS = {"3.0": "x86_64-windows", "2.0": "win64"}
"""Where it looks for that of Windows."""
HERE, CROSS = ("cc", "gcc", "clang"), ("x86_64-w64-mingw32-gcc",)
"""Compilers for this machine, and for Windows on any other (mingw-w64)."""
BASE = {
    **{name: {name: 1} for name in ("kg", "m", "s", "A", "K", "rad")},
    "N": {"kg": 1, "m": 1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Hz": {"s": -1},
}
"""Exponents of the base units in a unit."""
UNHELD = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Signs that XML cannot hold."""
COMPILER = ("-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden")


class Variable(NamedTuple):
    """A variable of the description.

    Attributes:
        name, unit: of the record or the parameter; the unit is empty where there is none.
        kind: ``input``, ``output``, ``parameter`` or ``constant``.
        value: the start value; None for an output.
        text: what it is.
        bounds: between which a parameter can be set.
    """

    name: str
    unit: str
    kind: str
    value: float | None = None
    text: str = ""
    bounds: tuple[float, float] = (-inf, inf)


def fmu(export: Export) -> tuple[Files, list[str]]:
    """The archive.

    Raises:
        ModelError: for a model without a form in C, a sample time that is missing, an unknown version of the
            standard, or a name that XML cannot hold.
    """
    asked = str(export.options.get("version", "3.0"))
    if asked not in VERSIONS:
        raise ModelError(f"there is no version {asked!r} of FMI; give 3.0 or 2.0", arguments=("option",))
    version = VERSIONS[asked]
    plant: Any = getattr(export.model, "plant", None)
    asked_for = plant.handles if export.fit is None and plant is not None else [row.name for row in shown(export)]
    sources, notes = c99(Export(export.model, export.fit, export.name, export.dt, {"settable": tuple(asked_for)}))
    found = variables(export, str(sources[f"{export.name}.h"]))
    token = "{" + str(uuid5(NAMESPACE_OID, "".join(map(str, sources.values())) + repr(found) + version)) + "}"
    values = [each.value for each in found if each.kind in ("parameter", "constant") and each.value is not None]
    bounds = [each.bounds for each in found if each.kind == "parameter"]
    sources["fmi.c"] = fmi_source(export, version, token, values, bounds)
    content: Files = {"modelDescription.xml": description(export, version, token, found)}
    content |= {f"sources/{name}": text for name, text in sources.items()}
    if version == "3.0":
        content["sources/buildDescription.xml"] = build(export.name)
    folder = FOLDERS.get((version, platform.machine())) if sys.platform == "linux" else None
    machines = []
    for place, compilers, ending in ((folder, HERE, "so"), (WINDOWS[version], CROSS, "dll")):
        binary = compiled(export.name, sources, compilers, ending) if place else None
        if binary:
            content[f"binaries/{place}/{export.name}.{ending}"] = binary
            machines.append(str(place))
    if machines:
        there = f"There is a binary for {listed(machines)}"
        notes.append(f"{there}; other machines compile the sources, which are in the archive.")
    else:
        notes.append("There is no binary, as there is no C compiler for Linux here: the importer compiles the sources.")
    if WINDOWS[version] in machines:
        notes.append("The binary for Windows was compiled here and never run.")
    if direct(export):
        notes.append("The output follows the input of the same time: set the input before the output is read.")
    fixed = [each.name for each in found if each.kind == "constant"]
    if bounds and fixed:
        notes.append(f"Constants that cannot be set: {listed(fixed)}.")
    notes.append("Before the first sample the input is zero, whatever its start value.")
    return {f"{export.name}.fmu": archive(content)}, notes


def direct(export: Export) -> bool:
    """Whether the output of a sample depends on its input, seen from rest."""
    stepper = start(export.model, dt=export.dt)
    ends = [export.model.run(stepper.state, np.full((1, stepper.inputs), level))[0] for level in (0.0, 1.0, -1.0)]
    return not (np.array_equal(ends[0], ends[1]) and np.array_equal(ends[0], ends[2]))


def shown(export: Export) -> list[Estimate]:
    """The parameters of a fit without those that the data do not show."""
    rows = () if export.fit is None else export.fit.parameters.values()
    return [row for row in rows if not (row.status is Status.KEPT and row.value == 0)]


def variables(export: Export, header: str) -> list[Variable]:
    """The variables of a model: its inputs, its outputs and its parameters, with names that differ."""
    channels = export.fit.channels if export.fit is not None else None
    found: list[Variable] = []
    for kind, letter, named in (("input", "u", "inputs"), ("output", "y", "outputs")):
        size = re.search(rf"_{named.upper()} (\d+)$", header, re.MULTILINE)
        count = int(size[1]) if size else 0
        pairs = getattr(channels, named, ())
        for k in range(count):
            name, unit = pairs[k] if len(pairs) == count else (f"{letter}{k + 1}" if count > 1 else letter, "")
            found.append(Variable(name, unit, kind, 0.0 if kind == "input" else None))
    unknown = {row.name for row in assumed(export.fit)}
    settable = re.findall(r"Set the parameters: (.*)\. \*/", header)
    rows = {row.name: row for row in shown(export)}
    handles = getattr(getattr(export.model, "plant", None), "handles", {})
    parameters = settable[0].split(", ") if settable else []
    for name in [*parameters, *(name for name in rows if name not in parameters)]:
        row, text, unit = rows.get(name), "", handles[name].parameter.unit if name in handles else ""
        if row is not None:
            text = "" if row.interval is None else "95 % interval {:.4g} to {:.4g}".format(*row.interval)
            if name in unknown:
                text = "assumed, not measured"
            elif unknown.intersection(row.given):
                text = ", ".join([text] * bool(text) + [f"given {listed(row.given)}"])
        if name in parameters:
            value, bounds = float(export.model.plant.value(name)), (handles[name].lower, handles[name].upper)  # type: ignore[attr-defined]
            found.append(Variable(name, unit, "parameter", value, text, bounds))
        elif row is not None:
            found.append(Variable(name, row.unit, "constant", float(row.value), text))
    names = {"time"}
    for k, variable in enumerate(found):
        for text in (variable.name, variable.unit):
            if UNHELD.search(text):
                raise ModelError(f"{text!r} has a sign that XML cannot hold; rename the channel", arguments=("name",))
        name, unit = (re.sub(r"\s+", " ", text).strip() for text in (variable.name, variable.unit))
        while name in names or not name:
            name = f"{variable.kind} {name}".strip()
        names.add(name)
        found[k] = variable._replace(name=name, unit=unit)
    return found


def base_unit(unit: str) -> dict[str, str] | None:
    """The exponents of the base units in a unit; None where it has another part.

    >>> base_unit("N*m/A"), base_unit("rpm")
    ({'kg': '1', 'm': '2', 's': '-2', 'A': '-1'}, None)
    """
    powers: dict[str, int] = {}
    for k, part in enumerate(unit.replace("(", "").replace(")", "*/").replace("·", "*").split("/")):
        for factor in filter(None, part.split("*")):
            name, sign, power = factor.partition("^")
            if name == "1":
                continue
            if name not in BASE or not re.fullmatch(r"-?\d{1,2}" if sign else "", power):
                return None
            for base, exponent in BASE[name].items():
                powers[base] = powers.get(base, 0) + (-1 if k else 1) * exponent * int(power or 1)
    return {base: str(power) for base, power in powers.items() if power}


def description(export: Export, version: str, token: str, found: list[Variable]) -> str:
    """The description of the model in XML."""
    two = version == "2.0"
    state = "state" if two else "State"
    able = {f"canGetAndSetFMU{state}": "true", f"canSerializeFMU{state}": "true"}
    able |= {"canHandleVariableCommunicationStepSize": "true", "modelIdentifier": export.name}
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": export.name,
            "guid" if two else "instantiationToken": token,
            "description": UNHELD.sub(" ", f"{export.model.name}, identified by emsid"),
            "generationTool": "emsid",
            **({"numberOfEventIndicators": "0"} if two else {}),
        },
    )
    simulation = ElementTree.SubElement(
        root, "CoSimulation", able if two else able | {"fixedInternalStepSize": repr(export.dt)}
    )
    if two:
        files = ElementTree.SubElement(simulation, "SourceFiles")
        for name in (f"{export.name}.c", "fmi.c"):
            ElementTree.SubElement(files, "File", {"name": name})
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in sorted({"s", *(variable.unit for variable in found if plain_unit(variable.unit))}):
        base = base_unit(unit)
        one = ElementTree.SubElement(units, "Unit", {"name": plain_unit(unit)})
        if base is not None:
            ElementTree.SubElement(one, "BaseUnit", base)
    log = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(log, "Category", {"name": "logStatusError"})
    ElementTree.SubElement(root, "DefaultExperiment", {"startTime": "0.0", "stepSize": repr(export.dt)})
    body = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    rows = [Variable("time", "s", "independent"), *found]
    for k, row in enumerate(rows):
        (_variable2 if two else _variable3)(body, k, row)
    at = [k for k, row in enumerate(rows) if row.kind == "output"]
    if two:
        for heading in ("Outputs", "InitialUnknowns"):
            part = ElementTree.SubElement(structure, heading)
            for k in at:
                ElementTree.SubElement(part, "Unknown", {"index": str(k + 1)})
    else:
        for heading in ("Output", "InitialUnknown"):
            for k in at:
                ElementTree.SubElement(structure, heading, {"valueReference": str(k)})
    return _text(root)


def _attributes(k: int, variable: Variable) -> tuple[dict[str, str], dict[str, str]]:
    """The attributes of a variable, and those of its type."""
    causality = "local" if variable.kind == "constant" else variable.kind
    whole = {"name": variable.name, "valueReference": str(k), "causality": causality}
    whole |= {"variability": {"constant": "constant", "parameter": "fixed"}.get(variable.kind, "continuous")}
    whole |= {"description": variable.text} if variable.text else {}
    typed = {"unit": plain_unit(variable.unit)} if plain_unit(variable.unit) else {}
    typed |= {name: repr(end) for name, end in zip(("min", "max"), variable.bounds, strict=True) if isfinite(end)}
    return whole, typed | ({} if variable.value is None else {"start": repr(variable.value)})


def _variable3(body: Any, k: int, variable: Variable) -> None:
    whole, typed = _attributes(k, variable)
    ElementTree.SubElement(body, "Float64", whole | typed)


def _variable2(body: Any, k: int, variable: Variable) -> None:
    whole, typed = _attributes(k, variable)
    ElementTree.SubElement(ElementTree.SubElement(body, "ScalarVariable", whole), "Real", typed)


def build(name: str) -> str:
    """The description of how the sources of an FMU of version 3.0 are compiled."""
    root = ElementTree.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    one = ElementTree.SubElement(root, "BuildConfiguration", {"modelIdentifier": name})
    group = ElementTree.SubElement(one, "SourceFileSet", {"language": "C99"})
    for file in (f"{name}.c", "fmi.c"):
        ElementTree.SubElement(group, "SourceFile", {"name": file})
    return _text(root)


def _text(root: Any) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def compiled(name: str, sources: Files, compilers: Sequence[str], ending: str) -> bytes | None:
    """A shared library of the sources; None without one of the compilers, or where it fails."""
    compiler = next(filter(None, map(which, compilers)), None)
    if compiler is None:
        return None
    with TemporaryDirectory() as folder:
        for file, text in sources.items():
            (Path(folder) / file).write_text(str(text), "utf-8")
        inputs = [file for file in sources if file.endswith(".c")]
        words = [compiler, *COMPILER, "-o", f"{name}.{ending}", *inputs, "-lm"]
        done = subprocess.run(words, cwd=folder, capture_output=True, check=False)
        made = Path(folder) / f"{name}.{ending}"
        return made.read_bytes() if done.returncode == 0 and made.exists() else None


def archive(content: Files) -> bytes:
    """A ZIP archive, the same bytes for the same content."""
    memory = BytesIO()
    with ZipFile(memory, "w", ZIP_DEFLATED) as target:
        for name, text in content.items():
            target.writestr(ZipInfo(name), text, ZIP_DEFLATED)  # of 1980, so that the time is no part of it
    return memory.getvalue()
