"""Check the build description of FMI 3.0 sources."""

from collections.abc import Iterator
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..c_sources import BUILD_DESCRIPTION, find_inside, read_build_description
from ..check import check
from ..declarations import find_repeated
from ..messages import Breach, Problem, judge_problems, shorten_sentence
from ..subject import Subject
from ..verdict import CheckOutcome, failed, fmi3, skipped, warned
from .description import find_schema_problems

_VALID = fmi3(
    "2.4",
    "Build information for source code FMUs is provided together with a buildDescription.xml file in the "
    "sources directory that adheres to the fmi3BuildDescription.xsd schema file.",
)
_VERSION = fmi3(
    "2.4.10",
    "Starting with FMI 3.0, this fmiVersion attribute must match the fmiVersion attribute of element "
    "fmiModelDescription of the modelDescription.xml file.",
)
_IDENTIFIER = fmi3(
    "2.4.10",
    "The attribute modelIdentifier of the <ModelExchange>, <CoSimulation> or <ScheduledExecution> elements "
    "this build configuration is associated with.",
)
_FALLBACK = fmi3(
    "2.4.10", "Thus there must not be more than one BuildConfiguration without a platform attribute."
)
_FILE = fmi3("2.4.10.2", "Path of the source file relative to the sources directory.")


@check(
    "sources.description",
    "The build description is valid",
    _VALID,
    "Name the model identifier and all files to compile, by their paths from the folder `sources`.",
    needs=("description.schema",),
    only_for=3,
)
def description(subject: Subject) -> CheckOutcome:
    """Check the build description: its schema, version, model identifiers and source files."""
    folder = subject.folder / "sources"
    try:
        root = read_build_description(subject)
    except etree.XMLSyntaxError as error:
        return failed(shorten_sentence(f"{BUILD_DESCRIPTION} cannot be read: {str(error).rstrip('.')}."))
    if root is None:
        if any(folder.rglob("*.c")):
            return warned(f"The FMU has sources, but no {BUILD_DESCRIPTION}.")
        return skipped("The FMU has no sources.")
    if problems := find_schema_problems(root, "fmi3BuildDescription.xsd"):
        return judge_problems(problems, "")
    names = dict.fromkeys(e.get("name") for e in root.iterfind(".//SourceFile"))
    missing = [
        Breach(f"The source file {name} is not in `sources`.", _FILE)
        for name in names
        if find_inside(folder, name) is None
    ]
    found: list[Problem] = [*_unlike_model(root, subject), *missing]
    count = len(root.findall("BuildConfiguration"))
    return judge_problems(found, f"The build description has {count} configurations; all files exist.")


def _unlike_model(root: Any, subject: Subject) -> Iterator[Problem]:
    """Yield contradictions to the model description."""
    version, wanted = root.get("fmiVersion"), subject.tree.get("fmiVersion")
    if version != wanted:
        yield Breach(f"The build description has the fmiVersion {version}, not {wanted}.", _VERSION)
    known = {subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    configurations = root.findall("BuildConfiguration")
    for name in dict.fromkeys(e.get("modelIdentifier") for e in configurations):
        if name not in known:
            yield Breach(f"A build configuration is for {name}, which is no modelIdentifier.", _IDENTIFIER)
    fallbacks = [e.get("modelIdentifier") for e in configurations if e.get("platform") is None]
    for name in find_repeated(fallbacks):
        yield Breach(f"{name} has more than one build configuration without a platform.", _FALLBACK)
