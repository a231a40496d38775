"""The files that FMI-LS-REF lists, with their roles, and those of experiments.

The latter are tables and parameter sets (SSV).
"""

import hashlib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CommandError
from emla_cosim.base.files import read_file
from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.parameters.parameter_sets import convert_parameter, parse_parameter_set
from emla_cosim.fmu.variables import convert_start_value
from fmublock.recipe import RELATED_LIST

from ..check import NotRunError
from ..host.experiment import read_span
from ..layered_manifest import read_manifest
from ..messages import format_sentence
from ..subject import Subject
from .reference_files import ReferenceSolution, read_columns, read_tolerance

SRMD = "application/x-srmd-meta-data"
"""MIME type of simulation resource meta-data."""

_ROOT = "SimulationResourceMetaData"
_ENDINGS = (".xml", ".srmd", ".ssd", ".ssv", ".ssm", ".stmd", ".reqif")


@dataclass(frozen=True)
class RelatedFile:
    """A related file.

    Attributes:
        role: Its main role, such as `experiment`.
        purpose: The sub-role: `validation`, or a platform; empty without one.
        type: MIME type.
        source: Its URI in the manifest.
        path: The file; None if it is not in the FMU, which the standard allows.
    """

    role: str
    purpose: str
    type: str
    source: str
    path: Path | None


def list_related(unpacked: Path) -> list[RelatedFile]:
    """Return the related files of an FMU that is unpacked to a folder, in the order of the manifest.

    Raises:
        NotRunError: The manifest is not valid XML, which the check of manifests reports.
    """
    manifest = unpacked / RELATED_LIST
    if not manifest.is_file():
        return []
    try:
        root = read_manifest(manifest).root
    except CommandError as error:
        raise NotRunError(format_sentence(error)) from error
    related = []
    for element in root.iterfind("Related"):
        role, _, purpose = element.get("role", "").partition("/")
        source, type_ = element.get("source", ""), element.get("type", "application/octet-stream")
        path = resolve_source(manifest, source, unpacked)
        related.append(RelatedFile(role, purpose, type_, source, path))
    return related


def resolve_source(file: Path, source: str, unpacked: Path) -> Path | None:
    """Return the file of a relative URI in another file; None if the unpacked FMU has no such file."""
    if not is_relative(source):
        return None
    path = (file.parent / unquote(urlsplit(source).path)).resolve()
    return path if path.is_relative_to(unpacked.resolve()) and path.is_file() else None


def is_relative(source: str) -> bool:
    """Return whether a URI is relative, so that it is of a file in the FMU."""
    try:
        parts = urlsplit(source)
    except ValueError:
        return False
    return bool(parts.path) and not (parts.scheme or parts.netloc or parts.path.startswith("/"))


def is_of_type(file: RelatedFile, types: Collection[str], ending: str) -> bool:
    """Return whether a file has one of these MIME types, or an ending of its name such as `.exp`."""
    return file.type in types or file.source.lower().endswith(ending)


def is_xml(file: RelatedFile) -> bool:
    """Return whether a file is XML, by its type or its name."""
    plain = file.type.partition(";")[0].strip()
    return plain == SRMD or plain.endswith(("/xml", "+xml")) or file.source.lower().endswith(_ENDINGS)


def find_xml_fault(file: RelatedFile, unpacked: Path) -> str:
    """Return what is wrong with an XML document in the FMU, as a message; empty if nothing is.

    Raises:
        NotRunError: It is about a file that is not in the FMU, which the standard allows.
    """
    assert file.path is not None
    try:
        root = parse_xml(file.path.read_bytes())
    except (SyntaxError, OSError) as error:
        return f"It is not valid XML: {error}."
    return _find_srmd_fault(root, file.path, unpacked) if is_of_type(file, (SRMD,), ".srmd") else ""


def _find_srmd_fault(root: Any, path: Path, unpacked: Path) -> str:
    """Return what is wrong with meta-data or its checksum, as a message; empty if nothing is."""
    tag = etree.QName(root).localname
    if tag != _ROOT:
        return f"It has the root element {tag}, not {_ROOT}."
    for name in ("version", "name"):
        if not root.get(name):
            return f"Its root element has no {name}."
    for element in root.iterfind(".//{*}ClassificationEntry"):
        if element.get("keyword") is None:
            return f"Its ClassificationEntry in line {element.sourceline} has no keyword."
    source, checksum = root.get("data"), root.get("checksum")
    if source is None or not is_relative(source):
        return ""
    data = resolve_source(path, source, unpacked)
    if data is None:
        raise NotRunError(f"It is about '{source}', which is not in the FMU.")
    if checksum and hashlib.sha3_256(data.read_bytes()).hexdigest() != checksum.lower():
        return f"The SHA3-256 checksum of '{source}' is not the one that it has."
    return ""


SSV = "application/x-ssp-parameter-set"
"""MIME type of parameter sets."""

TYPES = ("application/x-ma-hs-experiments", "application/x-ma-ls-experiments")
"""MIME types of files of experiments; the example of FMI-LS-REF has the second one."""

TRANSIENT = "TransientSimulation"
"""The analysis of an experiment that is run. Its element is in the schema, and not yet in the text."""

_ANALYSES = (
    *("SteadyState", "ParameterOptimization", "SetPointOptimization", "SensitivityAnalysis"),
    *("TrajectoryOptimization", "Linearization"),
)
_CSV = "text/csv"
_DATA = {"Parameters": SSV, "Stimuli": _CSV, "References": _CSV}
"""Elements that name files, with the MIME type that they have without an attribute."""


@dataclass(frozen=True)
class ExperimentData:
    """A file that an experiment names: MIME type, URI, and the path, None if the FMU has no such file."""

    type: str
    source: str
    path: Path | None


@dataclass(frozen=True)
class ExperimentSetup:
    """An experiment.

    Attributes:
        name: Its name.
        file: Name of the file.
        analysis: Name of its analysis: `TransientSimulation` or others, which are not run.
        numbers: startTime, stopTime, stepSize (in s) and tolerance, as far as it has them.
        data: The files that it names, by element: Parameters, Stimuli, References.
    """

    name: str
    file: str
    analysis: str
    numbers: Mapping[str, float]
    data: Mapping[str, ExperimentData]

    @property
    def label(self) -> str:
        """The subject of messages."""
        return f"The experiment '{self.name}' of {self.file}"


def list_experiment_files(subject: Subject) -> list[RelatedFile]:
    """Return the related files of an FMU that have experiments in the format that is read."""
    files = [f for f in list_related(subject.folder) if f.role == "experiment" and f.path is not None]
    return [f for f in files if is_of_type(f, TYPES, ".exp")]


def read_experiments(file: Path, unpacked: Path) -> list[ExperimentSetup]:
    """Read a file of experiments of an unpacked FMU.

    Raises:
        CommandError: The file is not valid.
    """
    try:
        root = parse_xml(file.read_bytes())
    except (SyntaxError, OSError) as error:
        raise CommandError(f"'{file.name}' is not valid XML: {error}.") from error
    if root.tag != "Experiments":
        raise CommandError(f"'{file.name}' has the root element {root.tag}, not Experiments.")
    elements = root.findall("Experiment")
    if not elements:
        raise CommandError(f"'{file.name}' has no Experiment.")
    return [_read_experiment(element, file, unpacked) for element in elements]


def _read_experiment(element: Any, file: Path, unpacked: Path) -> ExperimentSetup:
    """Read an element Experiment. Raise CommandError if it is not valid."""
    name = element.get("name")
    if name is None:
        raise CommandError(f"'{file.name}' has an Experiment without a name in line {element.sourceline}.")
    label = f"the experiment '{name}' of '{file.name}'"
    analysis, numbers, data = TRANSIENT, dict[str, float](), dict[str, ExperimentData]()
    for inside in element.iterchildren(tag=etree.Element):
        if inside.tag in _DATA:
            source = inside.get("source")
            if source is None:
                raise CommandError(f"{label} has the element {inside.tag} without the attribute 'source'.")
            path = resolve_source(file, source, unpacked)
            data[inside.tag] = ExperimentData(inside.get("type", _DATA[inside.tag]), source, path)
        elif inside.tag == TRANSIENT or inside.tag in _ANALYSES:
            analysis = inside.tag
        elif inside.tag != "Annotations":
            raise CommandError(f"{label} has the element {inside.tag}, which an Experiment does not have.")
    settings = {**dict(element.attrib), **dict(next((e.attrib for e in element.iterfind(TRANSIENT)), {}))}
    for key in ("startTime", "stopTime", "stepSize", "tolerance"):
        if key in settings:
            numbers[key] = _read_number(settings[key], key, label)
    return ExperimentSetup(name, file.name, analysis, numbers, data)


def _read_number(text: str, key: str, label: str) -> float:
    """Return a finite number, positive for steps and tolerances. Raise CommandError for other texts."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or (key in ("stepSize", "tolerance") and number <= 0.0):
        needed = "a positive number" if key in ("stepSize", "tolerance") else "a finite number"
        raise CommandError(f"{label} has {key} = {text}; it must be {needed}.")
    return number


def read_setup(subject: Subject, setup: ExperimentSetup) -> tuple[ReferenceSolution, list[str]]:
    """Read the files of an experiment. What it does not say is as in the default experiment of the FMU.

    Returns:
        How to run it, with the solution to compare with (only `time` if there is none), and the names of
        parameters that the FMU does not have.

    Raises:
        CommandError: A file is invalid, does not fit the FMU, or is missing.
        NotRunError: A file has a type that is not read, or is elsewhere.
    """
    start, step, count = read_span(subject)
    stop = start + count * step
    start, stop = setup.numbers.get("startTime", start), setup.numbers.get("stopTime", stop)
    if not stop > start:
        raise CommandError(f"it ends at t = {stop:g} s, not after its start at t = {start:g} s.")
    # rounding must not add a step
    step = setup.numbers.get("stepSize") or (stop - start) / math.ceil((stop - start) / step - 1e-6)
    if abs((stop - start) / step - round((stop - start) / step)) > 1e-3:
        raise NotRunError(
            f"{start:g} s to {stop:g} s is not a whole number of steps of stepSize = {step:g} s."
        )
    values, unknown = {}, []
    if (path := _find_data(setup, "Parameters")) is not None:
        values, unknown = read_parameter_values(subject, path)
    inputs, notes = _read_data(subject, setup, "Stimuli", start)
    solution, more = _read_data(subject, setup, "References", start)
    references = setup.data.get("References")
    reference = ReferenceSolution(
        solution=solution or {"time": np.array([start, stop])},
        inputs=inputs,
        start=start,
        stop=stop,
        step=step,
        start_values=values,
        tolerance={} if references is None or references.path is None else read_tolerance(references.path),
        notes=[*notes, *more],
        solver_tolerance=setup.numbers.get("tolerance"),
    )
    return reference, unknown


def read_parameter_values(subject: Subject, file: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the values of a parameter set by variable, and the names that the FMU does not have.

    Raises:
        CommandError: The file is invalid, or a variable does not accept its value.
        NotRunError: It sets structural parameters, which are not set here.
    """
    values, unknown, interface = dict[str, Any](), list[str](), subject.interface
    for parameter in parse_parameter_set(read_file(file, "the parameter set"), file.name).parameters:
        variable = interface.variables.get(parameter.name)
        if variable is None:
            unknown.append(parameter.name)
            continue
        kind = variable.type
        if parameter.type != kind and (parameter.type in ("Boolean", "String") or kind == "String"):
            message = f"'{parameter.name}' of '{file.name}' has the type {parameter.type}"
            raise CommandError(f"{message}, but the variable of the FMU has the type {kind}.")
        if interface.is_structural(parameter.name):
            raise NotRunError(f"It sets the structural parameter {parameter.name}.")
        value = convert_parameter(parameter, interface.unit(parameter.name), file.name)
        values[parameter.name] = convert_start_value(subject.path.stem, interface, variable, value)
    return values, unknown


def _find_data(setup: ExperimentSetup, element: str) -> Path | None:
    """Return the file of an element such as Stimuli, or None. Raise an error if it cannot be read here."""
    data = setup.data.get(element)
    if data is None:
        return None
    if not is_relative(data.source):
        raise NotRunError(f"Its {element} are at '{data.source}', outside of the FMU.")
    if data.type != _DATA[element]:
        raise NotRunError(f"Its {element} have the type {data.type}, which is not read.")
    if data.path is None:
        raise CommandError(f"its {element} are in '{data.source}', which is not in the FMU.")
    return data.path


def _read_data(
    subject: Subject, setup: ExperimentSetup, element: str, start: float
) -> tuple[dict[str, Vector], list[str]]:
    """Return the columns of Stimuli or References and notes on them; none of both without the element."""
    if (path := _find_data(setup, element)) is None:
        return {}, []
    description = {"Stimuli": "the inputs", "References": "the reference"}[element]
    return read_columns(path, description, subject.interface, start, has_gaps=element == "References")
