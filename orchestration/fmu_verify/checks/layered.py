"""Check layered standards, terminals and icons."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from emla_cosim.base.errors import CommandError
from emla_cosim.base.untrusted_xml import parse_xml
from emla_cosim.fmu.document import TERMINALS

from ..check import CheckOutcome, Clause, check, failed, noted, quote, skipped
from ..declarations import find_repeated
from ..layered_manifest import (
    BUS,
    EXTRA,
    MANIFEST,
    MANIFESTS,
    REF,
    STRUCT,
    XCP,
    LayeredManifest,
    find_element_problems,
    list_manifests,
    read_manifest,
)
from ..messages import Breach, Problem, format_sentence, judge_problems, shorten_sentence
from ..subject import Subject
from ._layered_demands import judge_buses, judge_maps, judge_xcp, list_unusual_matching_rules
from .description import find_schema_problems

_DOMAIN = re.compile(r"[A-Za-z][\w-]*(\.[\w-]+)+")
"""A reverse domain name."""

_SEMANTIC = re.compile(r"(0|[1-9]\d*)\.(0|[1-9]\d*)(\.(0|[1-9]\d*))?([-+][\w.+-]+)?$")
_PRESENT = quote("layered.present")


class ManifestFindings(NamedTuple):
    """What manifests violate, what only warns, what is only recommended, and what was not judged."""

    problems: list[Problem]
    doubts: list[Problem]
    notes: list[str]
    gaps: list[str]


@check("layered.manifests", needs=("description.schema",))
def manifests(subject: Subject) -> CheckOutcome:
    """Check folders in `extra`, the manifests in them, and the files, variables and terminals they name."""
    findings = ManifestFindings([], [], [*_list_misnamed_entries(subject.folder / EXTRA)], [])
    _judge_folders(subject, findings)
    paths = list_manifests(subject.folder)
    for path in paths:
        try:
            manifest = read_manifest(path)
        except CommandError as error:
            findings.problems.append(format_sentence(error))
            continue
        # the folder decides, so that another name in the manifest is a fault
        name = path.parent.name if path.parent.name in _STANDARDS else manifest.name
        standard = _STANDARDS.get(name or "")
        if standard is None:
            _judge_attributes(manifest, findings)
        else:
            _judge_standard(manifest, name or "", standard, subject, findings)
    gaps = (*findings.notes, *findings.gaps)
    if not paths and not any(findings):
        return skipped("It has no manifest of a layered standard.")
    if findings.notes and not findings.problems and not findings.doubts:
        return noted(gaps[0], gaps=gaps[1:], clause=quote("layered.folders"))
    fine = f"{len(paths)} manifests of layered standards are valid."
    return judge_problems(findings.problems, fine, findings.doubts, gaps=gaps)


def _list_misnamed_entries(extra: Path) -> Iterator[str]:
    """Yield entries of `extra` whose names are not in reverse domain notation."""
    for path in sorted(extra.iterdir()) if extra.is_dir() else ():
        if path.is_file():
            yield f"{EXTRA} has the file {path.name}, which is in no folder of a standard or tool."
        elif not _DOMAIN.fullmatch(path.name):
            yield f"The name of the folder {EXTRA}/{path.name} is not in reverse domain notation."


def _judge_folders(subject: Subject, findings: ManifestFindings) -> None:
    """Add folders of known standards without a manifest, or whose names differ by case."""
    for path in sorted((subject.folder / EXTRA).glob("*/")):
        for name in _STANDARDS:
            where = f"{EXTRA}/{path.name}"
            if path.name.casefold() == name and path.name != name:
                findings.problems.append(Breach(f"The name of the folder {where} must be {name}.", _PRESENT))
            elif path.name == name and not (path / MANIFEST).is_file():
                similar_names = [p.name for p in path.iterdir() if p.name.casefold() == MANIFEST]
                but = f", but {similar_names[0]}" if similar_names else ""
                findings.doubts.append(Breach(f"{where} has no {MANIFEST}{but}.", _PRESENT))


def _judge_attributes(manifest: LayeredManifest, findings: ManifestFindings) -> None:
    """Add what is wrong with the attributes that all manifests should have."""
    for attribute in ("name", "version", "description"):
        text = getattr(manifest, attribute)
        if text is None and attribute == "description":
            findings.gaps.append(f"{manifest.label} has no fmi-ls-description.")
        elif text is None:
            lacks_namespace = manifest.root.get(f"fmi-ls-{attribute}") is not None
            where = " in its namespace" if lacks_namespace else ""
            message = f"{manifest.label} has no fmi-ls-{attribute}{where}."
            findings.doubts.append(Breach(message, quote("layered.attributes")))
        elif not text.strip():
            findings.gaps.append(f"The fmi-ls-{attribute} of {manifest.label} is empty.")
    if manifest.name and not _DOMAIN.fullmatch(manifest.name):
        message = f"The fmi-ls-name of {manifest.label}, {manifest.name}, is not in reverse domain notation."
        findings.gaps.append(message)
    elif manifest.name and manifest.name != manifest.path.parent.name:
        findings.gaps.append(f"{manifest.label} is for {manifest.name}, which is not the name of its folder.")


def _judge_standard(
    manifest: LayeredManifest, name: str, standard: "_Standard", subject: Subject, findings: ManifestFindings
) -> None:
    """Add what is wrong with the manifest of a known layered standard."""
    label, clause = manifest.label, standard.clause
    if manifest.name != name:
        has = f"the fmi-ls-name {manifest.name}" if manifest.name is not None else "no fmi-ls-name"
        findings.problems.append(Breach(f"{label} has {has}; it must be {name}.", clause))
    elif manifest.path.parent.name != name:
        findings.problems.append(Breach(f"{label} is for {name}; it must be in {EXTRA}/{name}.", clause))
    if not (manifest.version or "").strip():
        findings.problems.append(Breach(f"{label} has no fmi-ls-version.", clause))
    elif not _SEMANTIC.match(manifest.version or ""):
        message = f"{label} has the fmi-ls-version {manifest.version}, which is not a semantic version."
        findings.doubts.append(Breach(message, quote("layered.versions")))
    elif manifest.version is not None and not manifest.version.startswith("1."):
        findings.gaps.append(f"{label} is for version {manifest.version}; it was judged by version 1.")
    if not (manifest.description or "").strip():
        findings.gaps.append(f"{label} has no fmi-ls-description.")
    if subject.version not in standard.versions:
        message = f"{label} is for {name}, which is for FMI 3.0 only."
        findings.doubts.append(Breach(message, clause))
    violations = list(find_element_problems(manifest.root, MANIFESTS[name]))
    findings.problems.extend(Breach(f"{label}, {violation}", clause) for violation in violations)
    if not violations and subject.version in standard.versions:
        standard.judge(manifest, subject, findings)


def _judge_related(manifest: LayeredManifest, subject: Subject, findings: ManifestFindings) -> None:
    """Add related files that are not in the FMU."""
    for element in manifest.root.iter("{*}Related"):
        source = element.get("source")
        if urlsplit(source).scheme:
            findings.gaps.append(f"The related file {source} is not in the FMU, and was not examined.")
            continue
        path = (manifest.path.parent / unquote(urlsplit(source).path)).resolve()
        if not path.is_relative_to(subject.folder.resolve()):
            message = f"{manifest.label} names the file {source}, which is outside of the FMU."
            findings.problems.append(Breach(message, quote("layered.source")))
        elif not path.is_file():
            message = f"{manifest.label} names the file {source}, which does not exist."
            findings.doubts.append(Breach(message, quote("layered.related")))


def _judge_struct(manifest: LayeredManifest, subject: Subject, findings: ManifestFindings) -> None:
    findings.problems.extend(judge_maps(subject))
    findings.doubts.extend(list_unusual_matching_rules(subject))


class _Standard(NamedTuple):
    """A known layered standard: where it describes its manifest, for which FMI it is, and its judge."""

    clause: Clause
    versions: tuple[int, ...]
    judge: Callable[[LayeredManifest, Subject, ManifestFindings], None]


_STANDARDS = {
    REF: _Standard(quote("layered.ref"), (2, 3), _judge_related),
    BUS: _Standard(
        quote("layered.bus"),
        (3,),
        lambda manifest, subject, findings: findings.problems.extend(judge_buses(subject)),
    ),
    XCP: _Standard(
        quote("layered.xcp"),
        (2, 3),
        lambda manifest, subject, findings: findings.problems.extend(judge_xcp(manifest, subject)),
    ),
    STRUCT: _Standard(quote("layered.struct"), (3,), _judge_struct),
}
"""The layered standards of the FMI project by name."""


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
    violations += _judge_terminals([] if top is None else top.findall("Terminal"), names)
    violations += _judge_images(root, path.parent)
    return judge_problems(violations, f"{len(root.findall('.//Terminal'))} terminals are valid.")


def _judge_terminals(level: list[Any], names: set[str]) -> Iterator[Problem]:
    """Yield what is wrong with terminals of one level, and with those inside of them."""
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
                yield Breach(
                    f"The terminal {terminal.get('name')} has the member {name} more than once.", _MEMBER
                )
        yield from _judge_terminals(terminal.findall("Terminal"), names)


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
