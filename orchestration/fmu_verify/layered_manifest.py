"""Read manifests of layered standards, `extra/NAME/fmi-ls-manifest.xml`; tables of what they may contain."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.errors import CommandError
from emla_cosim.base.untrusted_xml import parse_xml

EXTRA = "extra"
"""Folder of an FMU with the folders of layered standards and of tools."""

MANIFEST = "fmi-ls-manifest.xml"
"""Name of the manifest in the folder of a layered standard."""

_NAMESPACE = "{http://fmi-standard.org/fmi-ls-manifest}"

REF, BUS, XCP, STRUCT = (f"org.fmi-standard.fmi-ls-{name}" for name in ("ref", "bus", "xcp", "struct"))
"""Names of the layered standards of the FMI project."""

XCP_ROLES = {
    f"XCPService{protocol}{setting}": types
    for protocol in ("TCP", "UDP")
    for setting, types in (
        ("Enable", ("Boolean",)),
        ("Port", ("UInt16", "Integer")),
        ("ListenAddress", ("String",)),
    )
}
"""Roles of variables in FMI-LS-XCP, and their types in FMI 3.0 and 2.0."""

_ROLES = (
    *("document", "requirement", "specification", "model", "parameter", "system", "testcase", "experiment"),
    *("experiment/smoke-test", "experiment/validation", "experiment/uncertainty-analysis", "result"),
    *("method", "rationale", "report", "request", "delivery", "configuration", "signature"),
    *("serialized-state(/.*)?", "meta-data", "other"),
)
"""Roles of related files in FMI-LS-REF 1.0.0-alpha.1, as patterns."""

_BOOLEAN = "true|false|0|1"
_KIND = "CoSimulation|ModelExchange|ScheduledExecution"


@dataclass(frozen=True)
class LayeredManifest:
    """The manifest of a layered standard.

    Attributes:
        path: The file.
        root: Its root element.
        name: Name of the standard in reverse domain name notation; None if the manifest has none.
        version: Version of the standard, or None.
        description: Description of the standard for users, or None.
    """

    path: Path
    root: Any
    name: str | None
    version: str | None
    description: str | None

    @property
    def label(self) -> str:
        """Path of the manifest in the FMU."""
        return label_manifest(self.path)


def list_manifests(unpacked: Path) -> list[Path]:
    """Return the manifests of an FMU that is unpacked to a folder, sorted by path."""
    return sorted(path for path in (unpacked / EXTRA).glob(f"*/{MANIFEST}") if path.is_file())


def label_manifest(path: Path) -> str:
    """Return the path of a manifest in the FMU, for messages."""
    return f"{EXTRA}/{path.parent.name}/{path.name}"


def read_manifest(path: Path) -> LayeredManifest:
    """Read a manifest. Its content is not checked.

    Raises:
        CommandError: The file cannot be read, or is not valid XML.
    """
    try:
        root = parse_xml(path.read_bytes())
    except (SyntaxError, OSError) as error:
        raise CommandError(f"'{label_manifest(path)}' is not valid XML: {error}.") from error
    texts = [root.get(f"{_NAMESPACE}fmi-ls-{name}") for name in ("name", "version", "description")]
    return LayeredManifest(path, root, *texts)


@dataclass(frozen=True)
class ElementRule:
    """What an element may have.

    Attributes:
        name: Name of the element without its namespace.
        required: Patterns of required attributes, by name.
        optional: Patterns of optional attributes, by name.
        children: Rules of child elements; others are not allowed.
        least: Fewest elements of this name in their parent.
        is_open: Whether its content is free.
    """

    name: str
    required: Mapping[str, str] = field(default_factory=dict)
    optional: Mapping[str, str] = field(default_factory=dict)
    children: tuple["ElementRule", ...] = ()
    least: int = 0
    is_open: bool = False


_ANNOTATIONS = ElementRule("Annotations", is_open=True)
_LABEL = ElementRule("Label", {"name": ".*"}, {"description": ".*"})
_RELATED = ElementRule(
    "Related",
    {"source": r"\S.*", "role": "|".join(_ROLES)},
    {"type": r"[^/\s]+/[^/\s].*", "description": ".*"},
    (_LABEL, _ANNOTATIONS),
)
_XCP_VARIABLE = ElementRule("Variable", {"name": ".+", "role": "|".join(XCP_ROLES)})
_INTERFACE = ElementRule(
    "Interface",
    {"definition": r"\S.*"},
    {
        "types": rf"\s*({_KIND})(\s+({_KIND}))*\s*",
        "containsXCPService": _BOOLEAN,
        "supportsDirectMemoryAccess": _BOOLEAN,
        "description": ".*",
    },
    (_XCP_VARIABLE,),
    least=1,
)

MANIFESTS = {
    REF: ElementRule("fmiReferences", children=(_RELATED, _ANNOTATIONS)),
    BUS: ElementRule("fmiLayeredStandardManifest", optional={"isBusSimulationFMU": _BOOLEAN}),
    XCP: ElementRule("fmiLayeredStandardManifest", children=(_INTERFACE,)),
    STRUCT: ElementRule("fmiLayeredStandardManifest"),
}
"""Rules of root elements by layered standard, besides attributes with a namespace."""


def find_element_problems(root: Any, rule: ElementRule) -> Iterator[str]:
    """Yield where a manifest violates the rule of its root element, with line numbers."""
    if (name := _read_local_name(root)) != rule.name:
        yield f"its root element is {name}; it must be {rule.name}."
        return
    yield from _find_problems(root, rule)


def _find_problems(element: Any, rule: ElementRule) -> Iterator[str]:
    """Yield where an element and those in it violate a rule."""
    where = f"line {element.sourceline}: {rule.name}"
    # attributes with a namespace are judged elsewhere
    attributes = {name: text for name, text in element.attrib.items() if not name.startswith("{")}
    patterns = {**rule.required, **rule.optional}
    for name in rule.required:
        if name not in attributes:
            yield f"{where} has no attribute {name}."
    for name, text in attributes.items():
        if name not in patterns:
            yield f"{where} cannot have the attribute {name}."
        elif not re.fullmatch(patterns[name], text, re.DOTALL):
            yield f"{where} has the {name} '{text}', which is not allowed."
    if rule.is_open:
        return
    children = [child for child in element if isinstance(child.tag, str)]
    rules = {child.name: child for child in rule.children}
    for child in children:
        if _read_local_name(child) in rules:
            yield from _find_problems(child, rules[_read_local_name(child)])
        else:
            yield f"{where} cannot have the element {_read_local_name(child)}."
    for child_rule in rule.children:
        if sum(_read_local_name(child) == child_rule.name for child in children) < child_rule.least:
            yield f"{where} has no element {child_rule.name}."


def _read_local_name(element: Any) -> str:
    return etree.QName(element).localname
