"""Mend the encoding, attributes and elements that have one right form.

Identifier and GUID must be those of the libraries, which are only read.
"""

import codecs
import re
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import PurePosixPath
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.units import BASE_UNITS, SiUnit, find_unit

from ..c_sources import BUILD_DESCRIPTION
from .record import Change, describe_element

_DATE = "generationDateAndTime"
_VALID_DATE = re.compile(r"-?\d{4,}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)?")
# Forms of dates whose parts have one order. Days before months could be months before days.
_DATES = (
    *("%Y-%m-%d %H:%M:%S", "%Y-%m-%d %H:%M:%SZ", "%Y-%m-%dT%H:%M", "%Y-%m-%dT%H:%M:%S%z", "%Y-%m-%d"),
    *("%Y-%m-%d %H:%M:%S%z", "%Y/%m/%d %H:%M:%S", "%Y%m%dT%H%M%S", "%Y%m%dT%H%M%SZ", "%a %b %d %H:%M:%S %Y"),
)

# attributes with a list of allowed words, which differ in more than case
_WORDS = {
    "causality": (
        *("parameter", "calculatedParameter", "structuralParameter", "input", "output", "local"),
        *("independent", "dependent"),
    ),
    "variability": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "initial": ("exact", "approx", "calculated"),
    "variableNamingConvention": ("flat", "structured"),
    "dependenciesKind": ("dependent", "constant", "fixed", "tunable", "discrete"),
}

_BOOLEANS = re.compile(r"(can|needs|provides|has|completed)[A-Z]\w*|relativeQuantity")
_BEFORE_UNITS = ("ModelExchange", "CoSimulation", "ScheduledExecution")
_NUMBER = ".17g"
_GUID = re.compile(r"\{?([0-9A-Fa-f-]{16,64})\}?")
_SUFFIXES = (".so", ".dll", ".dylib")
_KIND_ELEMENTS = "ModelExchange | CoSimulation | ScheduledExecution"


def mend_attributes(root: Any, version: int) -> Iterator[Change]:
    """Mend a model description, and yield what was changed."""
    rules: tuple[Callable[[Any, int], Iterator[Change]], ...] = (
        _mend_case,
        _mend_date,
        _mend_types,
        _mend_repetitions,
        _mend_variability,
        _mend_units,
    )
    for rule in rules:
        yield from rule(root, version)
    if version == 3:
        yield from mend_annotations(root, "description.schema")


def mend_annotations(root: Any, check: str) -> Iterator[Change]:
    """Remove the attribute `order`, which Dymola 2023x writes, from annotations of FMI 3.0."""
    for element in root.iterfind(".//Annotation[@order]"):
        before = describe_element(element)
        del element.attrib["order"]
        yield Change(check, _locate(element), before, describe_element(element))


def _mend_case(root: Any, version: int) -> Iterator[Change]:
    """Mend words in wrong case: of attributes with a list of words, and true and false."""
    for element in root.iter(etree.Element):
        for name, text in element.attrib.items():
            words = _WORDS.get(name)
            if words is None and _is_boolean_attribute(element, name):
                words = ("true", "false")
            right = {word.casefold(): word for word in words or ()}
            after = " ".join(right.get(word.casefold(), word) for word in text.split())
            if words and after != " ".join(text.split()):
                element.set(name, after)
                yield Change("description.schema", f"{name} of {_locate(element)}", text, after)


def _is_boolean_attribute(element: Any, name: str) -> bool:
    if name == "start":
        return element.tag == "Boolean"
    return bool(_BOOLEANS.fullmatch(name)) and not name.endswith(("Factor", "Order"))


def _mend_date(root: Any, version: int) -> Iterator[Change]:
    """Write the date of generation as the schema requires, if it has one of the known forms."""
    text = root.get(_DATE)
    if text is None or _VALID_DATE.fullmatch(text.strip()):
        return
    for form in _DATES:
        try:
            date = datetime.strptime(text.strip(), form)
        except ValueError:
            continue
        date = date.astimezone(UTC) if date.tzinfo is not None else date
        after = f"{date:%Y-%m-%dT%H:%M:%SZ}"
        root.set(_DATE, after)
        yield Change("description.schema", _DATE, text, after)
        return


def _mend_types(root: Any, version: int) -> Iterator[Change]:
    """Mend names of types that differ from those of one definition in case only."""
    names = [e.get("name", "") for e in root.iterfind("TypeDefinitions/*")]
    for element in root.iterfind("ModelVariables//*[@declaredType]"):
        text = element.get("declaredType")
        near = [name for name in names if name.casefold() == text.casefold()]
        if text not in names and len(near) == 1:
            element.set("declaredType", near[0])
            yield Change("description.types", f"declaredType of {_locate(element)}", text, near[0])


def _mend_repetitions(root: Any, version: int) -> Iterator[Change]:
    """Join lists of vendor annotations, and remove exact repetitions of their and of other entries."""
    lists = root.findall("VendorAnnotations")
    for element in lists[1:]:
        lists[0].extend(list(element))
        root.remove(element)
        yield Change("description.schema", "VendorAnnotations", "two lists", "one list")
    for path, check in (
        ("VendorAnnotations/Tool", "description.schema"),
        ("LogCategories/Category", "description.categories"),
        ("UnitDefinitions/Unit", "units.defined"),
    ):
        earlier = set[bytes]()
        for element in root.findall(path):
            content = etree.tostring(element, method="c14n", with_tail=False)
            if content in earlier:
                element.getparent().remove(element)
                yield Change(check, f"{path}, twice the same", describe_element(element), "")
            earlier.add(content)


def _mend_variability(root: Any, version: int) -> Iterator[Change]:
    """Make continuous variables discrete that are not Real, for which FMI 2.0 has no other meaning."""
    for variable in root.iterfind("ModelVariables/ScalarVariable") if version == 2 else ():
        variability, causality = variable.get("variability"), variable.get("causality", "local")
        is_continuous = variability in (None, "continuous") and causality in ("input", "output", "local")
        if not is_continuous or variable.find("Real") is not None:
            continue
        variable.set("variability", "discrete")
        where = f"variability of {_locate(variable)}"
        yield Change("variables.attributes", where, variability or "", "discrete")


def _mend_units(root: Any, version: int) -> Iterator[Change]:
    """Define units that are used and not defined, if the table of units has them."""
    units = {e.get("name"): e for e in root.iterfind("UnitDefinitions/Unit")}
    users = [*root.iterfind("TypeDefinitions//*[@unit]"), *root.iterfind("ModelVariables//*[@unit]")]
    for user in users:
        name = user.get("unit")
        if name in units or (unit := find_unit(name)) is None or unit.exponents is None or unit.multiple_of:
            continue
        units[name] = element = etree.SubElement(_find_or_make_units(root), "Unit", name=name)
        base = etree.SubElement(element, "BaseUnit", _make_base_attributes(unit))
        display_units = {user.get("displayUnit") for user in users if user.get("unit") == name}
        for display in sorted(filter(None, display_units)):
            if (display_unit := find_unit(display)) is not None and display_unit.exponents == unit.exponents:
                conversion = _make_display_attributes(unit, display_unit)
                etree.SubElement(element, "DisplayUnit", name=display, **conversion)
        yield Change("units.defined", f"Unit '{name}'", "", describe_element(base))


def _make_base_attributes(unit: SiUnit) -> dict[str, str]:
    powers = {base: str(unit.powers[base]) for base in BASE_UNITS if base in unit.powers}
    offset = 0.0 if unit.is_difference else unit.offset
    return powers | _make_conversion_attributes(unit.factor, offset)


def _make_display_attributes(unit: SiUnit, display: SiUnit) -> dict[str, str]:
    """Return factor and offset from a unit to its display unit: display = factor * unit + offset."""
    return _make_conversion_attributes(
        unit.factor / display.factor, (unit.offset - display.offset) / display.factor
    )


def _make_conversion_attributes(factor: float, offset: float) -> dict[str, str]:
    numbers: Mapping[str, tuple[float, float]] = {"factor": (factor, 1.0), "offset": (offset, 0.0)}
    return {name: format(x, _NUMBER) for name, (x, default) in numbers.items() if x != default}


def _find_or_make_units(root: Any) -> Any:
    """Return the list of units, which is added if there is none."""
    units = root.find("UnitDefinitions")
    if units is None:
        units = etree.Element("UnitDefinitions")
        kinds = [e for e in root if e.tag in _BEFORE_UNITS]
        root.insert(root.index(kinds[-1]) + 1 if kinds else 0, units)
    return units


def _locate(element: Any) -> str:
    """Return the name of the closest element that has one, with its tag."""
    holder = element
    while holder.get("name") is None and holder.getparent() is not None:
        holder = holder.getparent()
    return element.tag if holder.get("name") is None else f"{holder.tag} '{holder.get('name')}'"


def find_libraries(names: list[str]) -> list[str]:
    """Return the entries of an archive that are libraries of platforms."""
    paths = ((name, PurePosixPath(name)) for name in names)
    return [n for n, p in paths if len(p.parts) == 3 and p.parts[0] == "binaries" and p.suffix in _SUFFIXES]


def mend_identifier(root: Any, names: list[str]) -> Iterator[Change]:
    """Mend a modelIdentifier that differs from the names of all libraries in case only."""
    stems = {PurePosixPath(name).stem for name in find_libraries(names)}
    kinds = root.xpath(_KIND_ELEMENTS) if BUILD_DESCRIPTION not in names else ()  # which has it, too
    for kind in kinds:
        identifier = kind.get("modelIdentifier", "")
        near = [stem for stem in stems if stem.casefold() == identifier.casefold()]
        if identifier not in stems and len(near) == 1:
            kind.set("modelIdentifier", near[0])
            yield Change("binaries.present", f"modelIdentifier of {kind.tag}", identifier, near[0])


def mend_guid(root: Any, version: int, libraries: Mapping[str, bytes]) -> Iterator[Change]:
    """Mend a GUID that libraries have in another case, or with braces; all libraries must agree."""
    name = "instantiationToken" if version == 3 else "guid"
    guid = root.get(name, "")
    if (match := _GUID.fullmatch(guid)) is None:
        return
    # the end of a text in the data of a library, whose beginning need not follow a zero
    pattern = re.compile(rb"(?<![\w{-])(\{?" + re.escape(match[1].encode()) + rb"\}?)(?=\0)", re.IGNORECASE)
    spellings = {m[1].decode() for content in libraries.values() for m in pattern.finditer(content)}
    # a library without the GUID could have it in another form
    if len(spellings) == 1 and guid not in spellings and all(pattern.search(c) for c in libraries.values()):
        (after,) = spellings
        root.set(name, after)
        yield Change("instance.guid", name, guid, after)


_CHECK = "description.encoding"
_DECLARATION = re.compile(r"\s*<\?xml\b[^>]*\?>\s*")
_ENCODING = re.compile(rb"""<\?xml\b[^>]*?encoding\s*=\s*["']([\w.:-]+)["']""")
_OF_UTF_8 = re.compile(rb"[\xc2-\xf4][\x80-\xbf]+")
_UTF_8 = '<?xml version="1.0" encoding="UTF-8"?>'
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_NAMES_OF_UTF_8 = ("utf-8", "utf_8", "utf8")


def mend_encoding(content: bytes) -> tuple[bytes, list[Change]]:
    """Return a document in UTF-8 that declares it, and what was changed.

    Bytes that are neither in the declared encoding nor, all of them, in Windows-1252 stay: nothing shows
    what they mean.
    """
    changes = list[Change]()
    text = _decode(content, changes)
    if text is None:
        return content, []
    declared = _DECLARATION.match(text)
    before = declared[0].strip() if declared else ""
    encoding = _ENCODING.search(before.encode("ascii", "replace"))
    if encoding is None or encoding[1].decode().lower() not in _NAMES_OF_UTF_8:
        changes.append(Change(_CHECK, "the first line", before, _UTF_8))
        text = f"{_UTF_8}\n{text[declared.end() if declared else 0 :]}"
    return (text.encode(), changes) if changes else (content, [])


def _decode(content: bytes, changes: list[Change]) -> str | None:
    """Return the text of a document, and note how it was read if it is not UTF-8."""
    if content.startswith(codecs.BOM_UTF8):
        changes.append(Change(_CHECK, "the byte order mark", "EF BB BF", ""))
        content = content.removeprefix(codecs.BOM_UTF8)
    match = _ENCODING.match(content[:200].lstrip())
    declared = "utf-8" if match is None else match[1].decode().lower()
    if content.startswith(_UTF_16):
        declared = "utf-16"
    for encoding in _list_encodings(content, declared):
        try:
            text = content.decode(encoding)
        except (UnicodeDecodeError, LookupError):
            continue
        if encoding not in _NAMES_OF_UTF_8:
            changes.append(Change(_CHECK, "the encoding", encoding.upper(), "UTF-8"))
        return text
    return None


def _list_encodings(content: bytes, declared: str) -> Iterator[str]:
    """Yield the encodings in which a document may be."""
    yield declared
    if declared in _NAMES_OF_UTF_8 and _OF_UTF_8.search(content) is None:
        yield "windows-1252"  # nothing in it is UTF-8
