"""Check the terminals and icons of FMI 3.0, which FMI 2.0.4 has, too."""

from collections.abc import Iterator
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.document import TERMINALS

from ..check import check
from ..declarations import find_repeated
from ..messages import Breach, Problem, judge_problems, shorten_sentence
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, failed, fmi3, skipped
from .description import find_schema_problems

_VALID = Clause(
    "2.3.2",
    "The optional directory terminalsAndIcons contains the definition of the Ports and Icons of the FMU as "
    "defined in the FMI 3.0 Specification, 2.4.9. Terminals and Icons.",
    in_3=fmi3(
        "2.4",
        "Additional optional information about the graphical representation and the grouping of FMU "
        "variables into terminals is stored in the optional text file "
        "terminalsAndIcons/terminalsAndIcons.xml in XML format as specified by the XML schema file "
        "fmi3TerminalsAndIcons.xsd.",
    ),
)
_VERSION = fmi3(
    "2.4.9",
    "Starting with FMI 3.0, this fmiVersion attribute must match the fmiVersion attribute of element "
    "fmiModelDescription of the modelDescription.xml file.",
)
_UNIQUE = fmi3("2.4.9.2.2", "The terminal name must be unique on each level.")
_VARIABLE = fmi3(
    "2.4.9.2.3",
    "The normalized string variableName identifies a variable in ModelVariables which is actually connected "
    "and for which fmi3Get{VariableType} and fmi3Set{VariableType} is called.",
)
_MEMBER = fmi3(
    "2.4.9.2.3",
    "Therefore, the memberName attribute is required for plug and bus and must be unique per terminal.",
)


@check(
    "description.terminals",
    "Terminals are valid",
    _VALID,
    "Name variables of the model description, each terminal of a level once, and each of its members once.",
    needs=("description.schema",),
)
def terminals(subject: Subject) -> CheckOutcome:
    """Check the description of terminals and icons: its schema, version, names and variables."""
    path = subject.folder / TERMINALS
    if not path.is_file():
        return skipped("It has no description of terminals and icons.")
    try:
        root = parse_xml(path.read_bytes())
    except etree.XMLSyntaxError as error:
        return failed(shorten_sentence(f"{TERMINALS} cannot be read: {str(error).rstrip('.')}."))
    if not root.get("fmiVersion", "").startswith("3."):  # as FMI 2.0 allows
        return skipped(f"{TERMINALS} is for FMI {root.get('fmiVersion')}, not 3.0.")
    if problems := find_schema_problems(root, "fmi3TerminalsAndIcons.xsd"):
        return judge_problems(problems, "")
    found: list[Problem] = []
    version, wanted = root.get("fmiVersion"), subject.tree.get("fmiVersion")
    if version != wanted and subject.version == 3:
        found.append(Breach(f"The terminals have the fmiVersion {version}, not {wanted}.", _VERSION))
    names = {name for v in subject.declared.variables for name in (v.name, *v.aliases)}
    top = root.find("Terminals")
    found += _wrong_level([] if top is None else top.findall("Terminal"), names)
    return judge_problems(found, f"{len(root.findall('.//Terminal'))} terminals are valid.")


def _wrong_level(level: list[Any], names: set[str]) -> Iterator[Problem]:
    for name in find_repeated(e.get("name") for e in level):
        yield Breach(f"More than one terminal has the name {name}.", _UNIQUE)
    for terminal in level:
        members = terminal.findall("TerminalMemberVariable")
        for member in members:
            if member.get("variableName") not in names:
                what = f"{member.get('variableName')}, which is no variable"
                yield Breach(f"The terminal {terminal.get('name')} has {what}.", _VARIABLE)
        if terminal.get("matchingRule") in ("plug", "bus"):
            given = [m.get("memberName") for m in members]
            if None in given:
                yield Breach(f"A member of the terminal {terminal.get('name')} has no memberName.", _MEMBER)
            for name in find_repeated(n for n in given if n is not None):
                yield Breach(f"The terminal {terminal.get('name')} has the member {name} twice.", _MEMBER)
        yield from _wrong_level(terminal.findall("Terminal"), names)
