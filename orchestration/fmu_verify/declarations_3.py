"""Read the declarations of an FMI 3.0 model description, in the terms of `declarations`.

Value references become positions of variables in ModelVariables, as FMI 2.0 has them. A value reference that
no variable has becomes a negative number.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from .declarations import (
    Declarations,
    DeclaredType,
    DeclaredUnit,
    DeclaredUnknown,
    DeclaredVariable,
    Dimension,
)

FLOATS = ("Float32", "Float64")
_PARAMETERS = ("parameter", "calculatedParameter", "structuralParameter")


def read_declarations_3(root: Any) -> Declarations:
    """Read the declarations from the root element of a valid model description of FMI 3.0."""
    elements = [e for e in root.find("ModelVariables").iterchildren() if isinstance(e.tag, str)]
    places: dict[int, int] = {}
    for place, element in enumerate(elements, start=1):
        places.setdefault(int(element.get("valueReference")), place)
    types = tuple(_type(e) for e in root.iterfind("TypeDefinitions/*") if isinstance(e.tag, str))
    by_name = {t.name: t for t in reversed(types)}
    return Declarations(
        variables=tuple(_variable(i, e, by_name, places) for i, e in enumerate(elements, start=1)),
        units=tuple(_unit(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        outputs=_unknowns(root, "Output", places),
        derivatives=_unknowns(root, "ContinuousStateDerivative", places),
        initial_unknowns=_unknowns(root, "InitialUnknown", places),
        clocked_states=_unknowns(root, "ClockedState", places),
        event_indicators=_unknowns(root, "EventIndicator", places),
        version=3,
    )


def _place(reference: str, places: Mapping[int, int]) -> int:
    return places.get(int(reference), -1 - int(reference))


def _variable(
    index: int, element: Any, types: Mapping[str, DeclaredType], places: Mapping[int, int]
) -> DeclaredVariable:
    own = dict(element.attrib)
    if "derivative" in own:
        own["derivative"] = str(_place(own["derivative"], places))
    if (starts := element.findall("Start")) and "start" not in own:
        own["start"] = " ".join(start.get("value", "") for start in starts)
    causality = own.get("causality", "local")
    declared_type = types.get(own.get("declaredType", ""))
    inherited = declared_type.attributes if declared_type else {}
    clocks = own.get("clocks")
    return DeclaredVariable(
        index=index,
        name=own["name"],
        reference=int(own["valueReference"]),
        causality=causality,
        variability=own.get("variability") or _default_variability(causality, element.tag),
        given_initial=own.get("initial"),
        type=element.tag,
        own=own,
        attributes={**inherited, **own},
        multiple_sets="canHandleMultipleSetPerTimeInstant" in own,
        aliases=tuple(e.get("name", "") for e in element.iterfind("Alias")),
        alias_display_units=tuple(
            text for e in element.iterfind("Alias") if (text := e.get("displayUnit")) is not None
        ),
        dimensions=tuple(_dimension(e, places) for e in element.iterfind("Dimension")),
        clocks=None if clocks is None else tuple(_place(word, places) for word in clocks.split()),
        previous=_place(own["previous"], places) if "previous" in own else None,
        starts=len(starts) or len(own.get("start", "").split()),
        version=3,
    )


def _default_variability(causality: str, type_: str) -> str:
    if causality in _PARAMETERS:
        return "fixed"
    return "continuous" if type_ in FLOATS else "discrete"


def _dimension(element: Any, places: Mapping[int, int]) -> Dimension:
    start, reference = element.get("start"), element.get("valueReference")
    return Dimension(
        None if start is None else int(start), None if reference is None else _place(reference, places)
    )


def _type(element: Any) -> DeclaredType:
    items = tuple(dict(e.attrib) for e in element.iterfind("Item"))
    return DeclaredType(element.get("name"), element.tag.removesuffix("Type"), _without_names(element), items)


def _without_names(element: Any) -> dict[str, str]:
    return {name: text for name, text in element.attrib.items() if name not in ("name", "description")}


def _unit(element: Any) -> DeclaredUnit:
    base = element.find("BaseUnit")
    display = tuple(dict(e.attrib) for e in element.iterfind("DisplayUnit"))
    return DeclaredUnit(element.get("name"), None if base is None else dict(base.attrib), display)


def _unknowns(root: Any, name: str, places: Mapping[int, int]) -> tuple[DeclaredUnknown, ...]:
    return tuple(_unknown(e, places) for e in root.iterfind(f"ModelStructure/{name}"))


def _unknown(element: Any, places: Mapping[int, int]) -> DeclaredUnknown:
    knowns, kinds = element.get("dependencies"), element.get("dependenciesKind")
    return DeclaredUnknown(
        _place(element.get("valueReference"), places),
        None if knowns is None else tuple(_place(word, places) for word in knowns.split()),
        None if kinds is None else tuple(kinds.split()),
    )


def sizes(variable: DeclaredVariable, declared: Declarations) -> Iterator[int | None]:
    """Yield the sizes of a variable's dimensions; None for one that is not known."""
    for dimension in variable.dimensions:
        if dimension.size is not None:
            yield dimension.size
            continue
        named = declared.variable(dimension.index or 0)
        start = "" if named is None else (named.start or "").strip()
        yield int(start) if start.isdigit() else None
