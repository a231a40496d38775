"""Check the terminals and icons of FMI 3.0, which FMI 2.0.4 has, too."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.document import TERMINALS

from ..check import CheckOutcome, check, failed, quote, skipped
from ..declarations import find_repeated
from ..messages import Breach, Problem, judge_problems, shorten_sentence
from ..subject import Subject
from .description import find_schema_problems

_VERSION = quote("terminals.version")
_VARIABLE = quote("terminals.variable")
_MEMBER = quote("terminals.member")
_STREAM = quote("terminals.stream")
_SVG = quote("terminals.svg")
_PNG_START = b"\x89PNG\r\n\x1a\n"


@check("description.terminals", clause=quote("terminals.valid"), needs=("description.schema",))
def terminals(subject: Subject) -> CheckOutcome:
    """Check the description of terminals and icons: its schema, version, names and variables."""
    path = subject.folder / TERMINALS
    if not path.is_file():
        return skipped("It has no description of terminals and icons.")
    try:
        root = parse_xml(path.read_bytes())
    except SyntaxError as error:
        return failed(shorten_sentence(f"{TERMINALS} cannot be read: {str(error).rstrip('.')}."))
    if subject.version == 2 and not root.get("fmiVersion", "").startswith("3."):  # as FMI 2.0 allows
        return skipped(f"{TERMINALS} is for FMI {root.get('fmiVersion')}, not 3.0.")
    if problems := find_schema_problems(root, "fmi3TerminalsAndIcons.xsd"):
        return judge_problems(problems, "")
    violations: list[Problem] = []
    version, expected = root.get("fmiVersion"), subject.tree.get("fmiVersion")
    if version != expected and subject.version == 3:
        violations.append(Breach(f"The terminals have the fmiVersion {version}, not {expected}.", _VERSION))
    names = {name for v in subject.declared.variables for name in (v.name, *v.aliases)}
    top = root.find("Terminals")
    violations += _judge_level([] if top is None else top.findall("Terminal"), names)
    violations += _judge_images(root, path.parent)
    return judge_problems(violations, f"{len(root.findall('.//Terminal'))} terminals are valid.")


def _judge_level(level: list[Any], names: set[str]) -> Iterator[Problem]:
    for name in find_repeated(e.get("name") for e in level):
        yield Breach(f"More than one terminal has the name {name}.", quote("terminals.unique"))
    for terminal in level:
        members = terminal.findall("TerminalMemberVariable")
        for member in members:
            if member.get("variableName") not in names:
                message = f"{member.get('variableName')}, which is not a variable"
                yield Breach(f"The terminal {terminal.get('name')} has {message}.", _VARIABLE)
        for member in terminal.findall("TerminalStreamMemberVariable"):
            for name in (member.get("inStreamVariableName"), member.get("outStreamVariableName")):
                if name not in names:
                    message = f"The terminal {terminal.get('name')} has {name}, which is not a variable."
                    yield Breach(message, _STREAM)
        if terminal.get("matchingRule") in ("plug", "bus"):
            member_names = [m.get("memberName") for m in members]
            if None in member_names:
                yield Breach(f"A member of the terminal {terminal.get('name')} has no memberName.", _MEMBER)
            for name in find_repeated(n for n in member_names if n is not None):
                yield Breach(f"The terminal {terminal.get('name')} has the member {name} twice.", _MEMBER)
        yield from _judge_level(terminal.findall("Terminal"), names)


def _judge_images(root: Any, folder: Path) -> Iterator[Problem]:
    """Yield images that are missing or not PNG. That of the FMU is optional."""
    icon = folder / "icon.png"
    if not icon.is_file() and (folder / "icon.svg").is_file():
        yield Breach("The FMU has terminalsAndIcons/icon.svg, but no icon.png beside it.", _SVG)
    images = [(icon, quote("terminals.icon"))] if icon.is_file() else []
    for shape in root.iterfind("Terminals//TerminalGraphicalRepresentation"):
        source = urlsplit(shape.get("iconBaseName"))
        if not (source.scheme or source.netloc):
            images.append((folder / f"{unquote(source.path)}.png", quote("terminals.png")))
    for image, clause in dict.fromkeys(images):
        if not image.resolve().is_relative_to(folder.parent.resolve()) or not image.is_file():
            yield Breach(f"The image {image.relative_to(folder.parent)} is not in the FMU.", clause)
        elif not image.read_bytes().startswith(_PNG_START):
            yield Breach(f"The image {image.relative_to(folder.parent)} is not a PNG file.", clause)
