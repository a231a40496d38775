"""Read the declarations of a model description without resolving references.

fmpy resolves references and stops at the first invalid one. Checks report all of them. Value references of
FMI 3.0 become positions of variables in ModelVariables, as FMI 2.0 has them; one that no variable has becomes
a negative number.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from .messages import join_few_names

_T = TypeVar("_T")

NUMERIC = (
    *("Real", "Integer", "Enumeration", "Float32", "Float64"),
    *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
)
"""Types that are numbers, of FMI 2.0 and 3.0."""

REAL = ("Real", "Float32", "Float64")

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")

_PARAMETERS = ("parameter", "calculatedParameter", "structuralParameter")
_EXACT = ("exact",)
_CALCULATED = ("calculated", "approx")
_ANY = ("calculated", "exact", "approx")
_INITIAL = {
    ("parameter", "fixed"): _EXACT,
    ("parameter", "tunable"): _EXACT,
    ("calculatedParameter", "fixed"): _CALCULATED,
    ("calculatedParameter", "tunable"): _CALCULATED,
    ("input", "discrete"): (),
    ("input", "continuous"): (),
    ("output", "constant"): _EXACT,
    ("output", "discrete"): _ANY,
    ("output", "continuous"): _ANY,
    ("local", "constant"): _EXACT,
    ("local", "fixed"): _CALCULATED,
    ("local", "tunable"): _CALCULATED,
    ("local", "discrete"): _ANY,
    ("local", "continuous"): _ANY,
    ("independent", "continuous"): (),
}
"""Allowed causality and variability, and their `initial`, the default first (tables in 2.2.7)."""

_INITIAL_3 = {
    **_INITIAL,
    ("structuralParameter", "fixed"): _EXACT,
    ("structuralParameter", "tunable"): _EXACT,
    ("input", "discrete"): _EXACT,
    ("input", "continuous"): _EXACT,
}
"""The same for FMI 3.0 (tables in 2.4.7.4 and 2.4.7.5)."""


@dataclass(frozen=True)
class Dimension:
    """A dimension of an array of FMI 3.0: its size, or the position of the variable that has it."""

    size: int | None
    index: int | None


@dataclass(frozen=True)
class DeclaredVariable:
    """A variable. `own_attributes` are those of the variable; `attributes` has also those of its type."""

    index: int
    """Position in ModelVariables, from 1."""
    name: str
    reference: int
    causality: str
    variability: str
    declared_initial: str | None
    type: str
    own_attributes: Mapping[str, str]
    attributes: Mapping[str, str]
    multiple_sets: str
    """The attribute canHandleMultipleSetPerTimeInstant; empty without it."""
    aliases: tuple[str, ...]
    alias_display_units: tuple[str, ...]
    dimensions: tuple[Dimension, ...]
    clocks: tuple[int, ...] | None
    """Positions of its Clocks; None if it has none."""
    previous: int | None
    """Position of the variable with its previous value."""
    start_count: int
    """Number of start values."""
    version: int
    """Version of FMI."""

    @property
    def is_real(self) -> bool:
        """Whether it is a floating-point number."""
        return self.type in REAL

    @property
    def is_clocked(self) -> bool:
        """Whether it is a Clock or belongs to one."""
        return self.type == "Clock" or self.clocks is not None

    @property
    def initials(self) -> tuple[str, ...] | None:
        """Allowed values of `initial`; None if causality and variability are incompatible."""
        return (_INITIAL_3 if self.version == 3 else _INITIAL).get((self.causality, self.variability))

    @property
    def is_possible(self) -> bool:
        """Whether causality, variability and initial are compatible."""
        return self.initials is not None and self.declared_initial in (None, *self.initials)

    @property
    def initial(self) -> str | None:
        """The attribute `initial`, or its default; None if there is no default."""
        return self.declared_initial or (self.initials[0] if self.initials else None)

    @property
    def value_key(self) -> tuple[str, int]:
        """The base type and the value reference, which identify a value."""
        base = "Integer" if self.type == "Enumeration" else self.type
        return (base if self.version == 2 else ""), self.reference

    @property
    def derivative(self) -> int | None:
        """Position of the variable of which it is the derivative."""
        return int(self.own_attributes["derivative"]) if "derivative" in self.own_attributes else None

    @property
    def start(self) -> str | None:
        """The start value as written."""
        return self.own_attributes.get("start")

    @property
    def unit(self) -> str | None:
        """The name of the unit."""
        return self.attributes.get("unit")

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class DeclaredUnit:
    """A Unit: attributes of its BaseUnit (None if it has none) and of its DisplayUnits."""

    name: str
    base: Mapping[str, str] | None
    display: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class DeclaredType:
    """A SimpleType."""

    name: str
    type: str
    attributes: Mapping[str, str]
    items: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class DeclaredUnknown:
    """An Unknown of ModelStructure. Missing attributes are None, and so is a variable that does not exist."""

    index: int
    variable: DeclaredVariable | None
    dependencies: tuple[int, ...] | None
    kinds: tuple[str, ...] | None

    def __str__(self) -> str:
        return str(self.variable or self.index)


@dataclass(frozen=True)
class UnknownList:
    """A list of ModelStructure. Its name is that in this version of FMI."""

    name: str
    unknowns: tuple[DeclaredUnknown, ...]

    @property
    def indices(self) -> list[int]:
        """The positions of its variables, also invalid ones."""
        return [u.index for u in self.unknowns]

    @property
    def variables(self) -> list[DeclaredVariable]:
        """Its variables, without invalid references."""
        return [u.variable for u in self.unknowns if u.variable is not None]

    def __str__(self) -> str:
        return self.name


LISTS_3 = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
    "ClockedStates": "ClockedState",
    "EventIndicators": "EventIndicator",
}
"""Elements of ModelStructure of FMI 3.0, by the lists of FMI 2.0, or as these would be called.

They are in the order of the fields of `Declarations`."""


@dataclass(frozen=True)
class Declarations:
    """The declarations that checks compare, in the order of the model description."""

    variables: tuple[DeclaredVariable, ...]
    units: tuple[DeclaredUnit, ...]
    types: tuple[DeclaredType, ...]
    outputs: UnknownList
    derivatives: UnknownList
    initial_unknowns: UnknownList
    clocked_states: UnknownList
    event_indicators: UnknownList
    version: int

    def describe_missing(self, index: int) -> str:
        """Return what is wrong with an index of no variable: `variable 9; there are only 8`."""
        if self.version == 3:
            return f"value reference {-1 - index}, which no variable has"
        return f"variable {index}; there are only {len(self.variables)}"

    def variable(self, index: int | None) -> DeclaredVariable | None:
        """Return the variable with an index of ModelStructure, or None."""
        return self.variables[index - 1] if index and 1 <= index <= len(self.variables) else None

    def join_names(self, indices: Iterable[int]) -> str:
        """Return a few names of variables, in the order of the model description."""
        return join_few_names([str(self.variable(i)) for i in sorted(indices)])

    def states(self) -> set[int]:
        """Return the indices of continuous-time states, without invalid references."""
        states = (self.variable(v.derivative) for v in self.derivatives.variables)
        return {v.index for v in states if v is not None}

    def find_aliases(self, variable: DeclaredVariable) -> list[DeclaredVariable]:
        """Return a variable and its aliases: those of its base type with its value reference."""
        return self._by_value[variable.value_key]

    @cached_property
    def _by_value(self) -> dict[tuple[str, int], list[DeclaredVariable]]:
        variables_by_value: dict[tuple[str, int], list[DeclaredVariable]] = defaultdict(list)
        for variable in self.variables:
            variables_by_value[variable.value_key].append(variable)
        return variables_by_value

    @property
    def alias_sets(self) -> list[list[DeclaredVariable]]:
        """Variables of FMI 2.0 with the same value, where there are several."""
        return [several for several in self._by_value.values() if len(several) > 1]

    def unit_of(self, variable: DeclaredVariable) -> DeclaredUnit | None:
        """Return the unit of a variable; None if it has none or an undefined one."""
        return None if variable.unit is None else self.units_by_name.get(variable.unit)

    @cached_property
    def units_by_name(self) -> dict[str, DeclaredUnit]:
        """Units by name; the first one if several have the same name."""
        return {u.name: u for u in reversed(self.units)}

    def sizes(self, variable: DeclaredVariable) -> Iterator[int | None]:
        """Yield the sizes of a variable's dimensions; None for one that is not known."""
        for dimension in variable.dimensions:
            if dimension.size is not None:
                yield dimension.size
                continue
            size_variable = self.variable(dimension.index or 0)
            start = "" if size_variable is None else (size_variable.start or "").strip()
            yield int(start) if start.isdigit() else None


def read_declarations(root: Any, version: int) -> Declarations:
    """Read the declarations from the root element of a valid model description of FMI 2.0 or 3.0."""
    variable_tag, type_tag = ("*", "*") if version == 3 else ("ScalarVariable", "SimpleType")
    elements = list(root.iterfind(f"ModelVariables/{variable_tag}"))
    find_position: Callable[[str], int] = int
    if version == 3:
        position_by_reference: dict[int, int] = {}
        for position, element in enumerate(elements, start=1):
            # the first of several counts: a check reports that there are several
            position_by_reference.setdefault(int(element.get("valueReference")), position)
        find_position = lambda reference: position_by_reference.get(int(reference), -1 - int(reference))  # noqa: E731
    types = tuple(_read_type(e, version) for e in root.iterfind(f"TypeDefinitions/{type_tag}"))
    # the first of several counts
    by_name = {t.name: t for t in reversed(types)}

    variables = tuple(
        _read_variable(i, e, version, by_name, find_position) for i, e in enumerate(elements, 1)
    )
    by_index = {v.index: v for v in variables}

    def read_list(name: str) -> UnknownList:
        path, reference = (LISTS_3[name], "valueReference") if version == 3 else (f"{name}/Unknown", "index")
        unknowns = tuple(
            DeclaredUnknown(
                index := find_position(e.get(reference)),
                by_index.get(index),
                _find_positions(e.get("dependencies"), find_position),
                None if (kinds := e.get("dependenciesKind")) is None else tuple(kinds.split()),
            )
            for e in root.iterfind(f"ModelStructure/{path}")
        )
        return UnknownList(path if version == 3 else name, unknowns)

    return Declarations(
        variables,
        tuple(_read_unit(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types,
        *(read_list(name) for name in LISTS_3),
        version=version,
    )


def find_repeated(names: Iterable[_T]) -> list[_T]:
    """Return names, or other items, that occur more than once, in the order of their first occurrence."""
    return [name for name, count in Counter(names).items() if count > 1]


def _find_positions(words: str | None, find_position: Callable[[str], int]) -> tuple[int, ...] | None:
    return None if words is None else tuple(find_position(word) for word in words.split())


def _read_variable(
    index: int,
    element: Any,
    version: int,
    types: Mapping[str, DeclaredType],
    find_position: Callable[[str], int],
) -> DeclaredVariable:
    """Read a variable, with defaults for attributes that it lacks."""
    value = _find_typed_element(element, version)
    own_attributes = dict(value.attrib)
    if "derivative" in own_attributes:
        own_attributes["derivative"] = str(find_position(own_attributes["derivative"]))
    if (starts := element.findall("Start")) and "start" not in own_attributes:
        own_attributes["start"] = " ".join(start.get("value", "") for start in starts)
    causality, variability = element.get("causality", "local"), element.get("variability")
    if variability is None and version == 3 and causality in _PARAMETERS:
        variability = "fixed"
    elif variability is None:
        variability = "continuous" if version == 2 or value.tag in REAL else "discrete"
    declared_type = types.get(own_attributes.get("declaredType", ""))
    aliases = element.findall("Alias")
    return DeclaredVariable(
        index=index,
        name=element.get("name"),
        reference=int(element.get("valueReference")),
        causality=causality,
        variability=variability,
        declared_initial=element.get("initial"),
        type=value.tag,
        own_attributes=own_attributes,
        attributes={**(declared_type.attributes if declared_type else {}), **own_attributes},
        multiple_sets=element.get("canHandleMultipleSetPerTimeInstant", ""),
        aliases=tuple(e.get("name", "") for e in aliases),
        alias_display_units=tuple(text for e in aliases if (text := e.get("displayUnit")) is not None),
        dimensions=tuple(_read_dimension(e, find_position) for e in element.iterfind("Dimension")),
        clocks=_find_positions(own_attributes.get("clocks"), find_position),
        previous=find_position(own_attributes["previous"]) if "previous" in own_attributes else None,
        start_count=len(starts) or len(own_attributes.get("start", "").split()),
        version=version,
    )


def _read_dimension(element: Any, find_position: Callable[[str], int]) -> Dimension:
    size, reference = element.get("start"), element.get("valueReference")
    index = None if reference is None else find_position(reference)
    return Dimension(None if size is None else int(size), index)


def _find_typed_element(element: Any, version: int) -> Any:
    """Return the element with the type of a variable or type: in FMI 2.0 a child."""
    return element if version == 3 else next(child for child in element.iterchildren(*TYPES))


def _read_type(element: Any, version: int) -> DeclaredType:
    value = _find_typed_element(element, version)
    attributes = {name: text for name, text in value.attrib.items() if name not in ("name", "description")}
    items = tuple(dict(e.attrib) for e in value.iterfind("Item"))
    return DeclaredType(element.get("name"), value.tag.removesuffix("Type"), attributes, items)


def _read_unit(element: Any) -> DeclaredUnit:
    base = element.find("BaseUnit")
    display = tuple(dict(e.attrib) for e in element.iterfind("DisplayUnit"))
    return DeclaredUnit(element.get("name"), None if base is None else dict(base.attrib), display)
