"""Checks of the model description: readable, valid, consistent."""

import math
import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import as_file, files
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.fmu.document import DESCRIPTION

from ..check import CheckOutcome, check, failed, passed, quote, skipped, translate_message
from ..declarations import find_repeated
from ..messages import Breach, Problem, judge_problems, shorten_sentence
from ..subject import Subject

_ROOT = "fmiModelDescription"


@check("description.readable", needs=("archive.safe",))
def readable(subject: Subject) -> CheckOutcome:
    """Check that the model description exists, is XML for FMI 2.0 or 3.0, and declares the FMU's kinds."""
    if not (subject.folder / DESCRIPTION).is_file():
        return failed(f"The FMU has no {DESCRIPTION}{_describe_location(subject)}.")
    try:
        root = subject.tree
    except MemoryError:
        raise
    except Exception as error:  # lxml has many kinds, and the file may be hostile
        return failed(f"{DESCRIPTION} cannot be read: {shorten_sentence(str(error)).rstrip('.')}.")
    if root.tag != _ROOT:
        return failed(
            shorten_sentence(f"The root element of {DESCRIPTION} is {root.tag}; it must be {_ROOT}.")
        )
    version = root.get("fmiVersion")
    if version != "2.0" and subject.version != 3:
        return _reject_version(version)
    # entities of a definition could fill the memory, or read other files
    if root.getroottree().docinfo.internalDTD is not None:
        return failed(f"{DESCRIPTION} has a document type definition, which FMI does not allow.")
    if not subject.kinds:
        kinds = "CoSimulation, ScheduledExecution" if subject.version == 3 else "CoSimulation"
        return failed(f"{DESCRIPTION} has no {kinds} or ModelExchange element.")
    return passed(
        shorten_sentence(f"It describes {root.get('modelName')}, for {' and '.join(subject.kinds)}.")
    )


def _describe_location(subject: Subject) -> str:
    """Return where a model description is that has another name, or is in a folder; empty without one."""
    paths = sorted(p for p in subject.folder.glob("*") if p.name.casefold() == DESCRIPTION.casefold())
    if paths:
        return f", but {paths[0].name}; the name must have this case"
    paths = sorted(subject.folder.glob(f"*/{DESCRIPTION}"))
    return f" at its top, but one in the folder {paths[0].parent.name}" if paths else ""


_VERSION = quote("description.version")


def _reject_version(version: str | None) -> CheckOutcome:
    """Return the failure for an fmiVersion that is not supported, or missing (None)."""
    if version is None:
        return failed(f"{DESCRIPTION} has no fmiVersion.", clause=_VERSION)
    if re.fullmatch(r"2\.0\.\d+", version):
        return failed(f"The fmiVersion is {version}; it must be 2.0.", hint="Write 2.0.", clause=_VERSION)
    return failed(
        shorten_sentence(f"It is an FMI {version} FMU; only FMI 2.0 and 3.0 are supported."),
        hint="Use a tool for its FMI version, or export the model for FMI 2.0 or 3.0.",
        clause=_VERSION,
    )


@check("description.schema", needs=("description.readable",))
def schema(subject: Subject) -> CheckOutcome:
    """Validate the model description against the XML schema of its version of FMI."""
    problems = find_schema_problems(subject.tree, f"fmi{subject.version}ModelDescription.xsd")
    fine = f"The model description is valid against the XML schema of FMI {subject.version}.0."
    version = subject.tree.get("fmiVersion")
    doubts = [Breach(f"The fmiVersion is {version}, with a patch number.", quote("description.no_patch"))]
    return judge_problems(problems, fine, doubts if _PATCH.match(version) else ())


_PATCH = re.compile(r"3\.\d+\.\d+$")


def find_schema_problems(root: Any, name: str) -> list[str]:
    """Return where a document violates a schema of FMI, such as `fmi3TerminalsAndIcons.xsd`."""
    schema_ = _read_schema(name)
    schema_.validate(root)
    return [f"Line {e.line}: {e.message.strip().rstrip('.')}." for e in schema_.error_log]


@cache
def _read_schema(name: str) -> Any:
    with as_file(files("fmpy") / "schema" / name[:4]) as folder:
        return etree.XMLSchema(file=str(folder / name))


@check("description.encoding", needs=("description.readable",))
def encoding(subject: Subject) -> CheckOutcome:
    """Check that the encoding is UTF-8 and declared in the first line."""
    declared_encoding = subject.tree.getroottree().docinfo.encoding or "UTF-8"
    first_bytes = (subject.folder / DESCRIPTION).read_bytes()[:200]
    if declared_encoding.upper() not in ("UTF-8", "UTF8"):
        return failed(shorten_sentence(f"The encoding is {declared_encoding}; it must be UTF-8."))
    if b"encoding" not in first_bytes.partition(b"?>")[0]:
        return judge_problems((), "", ["The first line does not declare the encoding."])
    return passed("The encoding is UTF-8.")


@check("description.capabilities", needs=("description.schema",))
def capabilities(subject: Subject) -> CheckOutcome:
    """Check that the capabilities which others require are declared too."""
    state = "State" if subject.version == 3 else "state"
    problems: list[Problem] = [
        f"{kind} declares canSerializeFMU{state}, but not canGetAndSetFMU{state}."
        for kind in subject.kinds
        if subject.has_flag(f"canSerializeFMU{state}", kind)
        and not subject.has_flag(f"canGetAndSetFMU{state}", kind)
    ]
    if subject.version == 3 and "CoSimulation" in subject.kinds:
        problems += _find_inconsistent_flags(subject)
    misspelled, doubts = _find_undefined_flags(subject) if subject.version == 3 else ([], [])
    problems = [*misspelled, *problems]  # a misspelled flag is the reason of others
    return judge_problems(problems, "The capability flags are consistent.", doubts)


_NO_OTHER_FLAGS = quote("description.no_other_flags")
_EARLY_RETURN = quote("description.early_return")
_FIXED_STEP = quote("description.fixed_step")
_EVENT_MODE = quote("description.event_mode")


def _find_undefined_flags(subject: Subject) -> tuple[list[Problem], list[Problem]]:
    """Return attributes that differ by case from one of FMI 3.0, and others that it does not have.

    The schema allows any attribute.
    """
    misspelled, unknown = list[Problem](), list[Problem]()
    for kind in subject.kinds:
        names = _list_kind_attributes(kind)
        by_case = {name.casefold(): name for name in names}
        for name in subject.tree.find(kind).attrib:
            # terms also write names of FMI 2.0 as they are in FMI 3.0
            if correct_name := by_case.get(
                name.casefold(), by_case.get(translate_message(name, 3).casefold())
            ):
                message = f"{kind} has the attribute {correct_name}, but not with exactly this name."
                misspelled += [Breach(message, _NO_OTHER_FLAGS)] if name != correct_name else []
            elif not name.startswith("{"):
                message = f"{kind} has the attribute {name}, which FMI 3.0 does not have."
                unknown.append(Breach(message, _NO_OTHER_FLAGS))
    return misspelled, unknown


@cache
def _list_kind_attributes(kind: str) -> tuple[str, ...]:
    """Return the names of the attributes of an interface type of FMI 3.0."""
    with as_file(files("fmpy") / "schema" / "fmi3") as folder:
        root = etree.parse(str(folder / "fmi3InterfaceType.xsd"))
    names = ("fmi3InterfaceType", f"fmi3{kind}")
    types = [t for t in root.iterfind("{*}complexType") if t.get("name") in names]
    return tuple(e.get("name") for t in types for e in t.iterfind(".//{*}attribute"))


def _find_inconsistent_flags(subject: Subject) -> Iterator[Problem]:
    """Yield contradictory flags of co-simulation in FMI 3.0."""
    early_return, update = "canReturnEarlyAfterIntermediateUpdate", "providesIntermediateUpdate"
    if subject.has_flag(early_return, "CoSimulation") and not subject.has_flag(update, "CoSimulation"):
        yield Breach(f"CoSimulation declares {early_return}, but not {update}.", _EARLY_RETURN)
    step = subject.tree.find("CoSimulation").get("fixedInternalStepSize")
    if step is not None and not float(step) > 0.0:
        yield Breach(f"The fixedInternalStepSize is {step} s; it must be positive.", _FIXED_STEP)
    clock = next((v for v in subject.declared.variables if v.type == "Clock"), None)
    if clock is not None and not subject.has_flag("hasEventMode", "CoSimulation"):
        message = f"The FMU has the Clock {clock}, but CoSimulation does not declare hasEventMode."
        yield Breach(message, _EVENT_MODE)


@check("description.categories", needs=("description.schema",))
def categories(subject: Subject) -> CheckOutcome:
    """Check that log categories have names, all different."""
    names = [e.get("name") for e in subject.tree.iterfind("LogCategories/Category")]
    problems = [f"More than one log category has the name {name}." for name in find_repeated(names)]
    problems += ["A log category has no name."] if "" in names else []
    return judge_problems(problems, f"{len(names)} log categories have different names.")


@check("description.identifier", needs=("description.schema",))
def identifier(subject: Subject) -> CheckOutcome:
    """Check that each modelIdentifier is a C identifier, and therefore no path either."""
    identifiers = {kind: subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    problems = [
        f"The modelIdentifier '{name}' of {kind} is not a C identifier."
        for kind, name in identifiers.items()
        if not (name.isascii() and name.isidentifier())
    ]
    names = " and ".join(sorted(set(identifiers.values())))
    return judge_problems(problems, shorten_sentence(f"The model identifier is {names}."))


@check("description.experiment", needs=("description.schema",))
def experiment(subject: Subject) -> CheckOutcome:
    """Check that times are finite, the stop is after the start, and step and tolerance are positive."""
    element = subject.tree.find("DefaultExperiment")
    if element is None:
        return skipped("The FMU has no default experiment.")
    attributes = {name: float(text) for name, text in element.attrib.items() if "}" not in name}
    fine = ", ".join(f"{name} {value:g}" for name, value in attributes.items())
    fine = f"The default experiment has {fine or 'no attributes'}."
    return judge_problems((), fine, list(_find_doubtful_times(attributes)))


def _find_doubtful_times(attributes: Mapping[str, float]) -> Iterator[str]:
    """Yield what is wrong with the times, the step size and the tolerance."""
    for name, value in attributes.items():
        if not math.isfinite(value):
            yield f"{name} is {value}; it must be a finite number."
    start, stop = attributes.get("startTime", 0.0), attributes.get("stopTime", math.inf)
    if stop <= start:
        yield f"stopTime is {stop:g} s, which is not after startTime, {start:g} s."
    for name in ("stepSize", "tolerance"):
        if attributes.get(name, 1.0) <= 0.0:
            yield f"{name} is {attributes[name]:g}; it should be positive."
