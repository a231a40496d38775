"""Read the declarations of a model description without resolving references.

fmpy resolves references and stops at the first invalid one. Checks report all of them.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

NUMERIC = (
    *("Real", "Integer", "Enumeration", "Float32", "Float64"),
    *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
)
"""Types that are numbers, of FMI 2.0 and 3.0."""

REAL = ("Real", "Float32", "Float64")

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")

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
    """A variable. `own` has its own attributes; `attributes` also those of its type."""

    index: int
    """Position in ModelVariables, from 1."""
    name: str
    reference: int
    causality: str
    variability: str
    given_initial: str | None
    type: str
    own: Mapping[str, str]
    attributes: Mapping[str, str]
    multiple_sets: bool
    """Whether it has the attribute canHandleMultipleSetPerTimeInstant."""
    aliases: tuple[str, ...] = ()
    alias_display_units: tuple[str, ...] = ()
    dimensions: tuple[Dimension, ...] = ()
    clocks: tuple[int, ...] | None = None
    """Positions of its Clocks; None if it has none."""
    previous: int | None = None
    """Position of the variable with its previous value."""
    starts: int = 0
    """Number of start values of an array."""
    version: int = 2
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
    def possible(self) -> bool:
        """Whether causality, variability and initial are compatible."""
        return self.initials is not None and self.given_initial in (None, *self.initials)

    @property
    def initial(self) -> str | None:
        """The attribute `initial`, or its default; None if there is no default."""
        return self.given_initial or (self.initials[0] if self.initials else None)

    @property
    def value_key(self) -> tuple[str, int]:
        """The base type and the value reference, which identify a value."""
        base = "Integer" if self.type == "Enumeration" else self.type
        return (base if self.version == 2 else ""), self.reference

    @property
    def start(self) -> str | None:
        """The start value as written."""
        return self.own.get("start")

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
    """An Unknown of ModelStructure. Missing attributes are None."""

    index: int
    dependencies: tuple[int, ...] | None
    kinds: tuple[str, ...] | None


_LISTS_3 = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
}


@dataclass(frozen=True)
class Declarations:
    """The declarations that checks compare, in the order of the model description."""

    variables: tuple[DeclaredVariable, ...]
    units: tuple[DeclaredUnit, ...]
    types: tuple[DeclaredType, ...]
    outputs: tuple[DeclaredUnknown, ...]
    derivatives: tuple[DeclaredUnknown, ...]
    initial_unknowns: tuple[DeclaredUnknown, ...]
    clocked_states: tuple[DeclaredUnknown, ...] = ()
    event_indicators: tuple[DeclaredUnknown, ...] = ()
    version: int = 2

    def describe_missing(self, index: int) -> str:
        """Return what is wrong with an index of no variable: `variable 9; there are only 8`."""
        if self.version == 3:
            return f"value reference {-1 - index}, which no variable has"
        return f"variable {index}; there are only {len(self.variables)}"

    def list_name(self, name: str) -> str:
        """Return how this version of FMI calls a list of ModelStructure."""
        return _LISTS_3.get(name, name) if self.version == 3 else name

    def variable(self, index: int) -> DeclaredVariable | None:
        """Return the variable with an index of ModelStructure, or None."""
        return self.variables[index - 1] if 1 <= index <= len(self.variables) else None

    def states(self) -> set[int]:
        """Return the indices of continuous-time states, without invalid references."""
        found = set()
        for unknown in self.derivatives:
            derivative = self.variable(unknown.index)
            if derivative and self.variable(state := int(derivative.own.get("derivative", 0))):
                found.add(state)
        return found

    def share_value(self, variable: DeclaredVariable) -> list[DeclaredVariable]:
        """Return a variable and its aliases: those of its base type with its value reference."""
        return self._by_value[variable.value_key]

    @cached_property
    def _by_value(self) -> dict[tuple[str, int], list[DeclaredVariable]]:
        found: dict[tuple[str, int], list[DeclaredVariable]] = defaultdict(list)
        for variable in self.variables:
            found[variable.value_key].append(variable)
        return found

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


def read_declarations(root: Any) -> Declarations:
    """Read the declarations from the root element of a valid model description."""
    types = tuple(_type(e) for e in root.iterfind("TypeDefinitions/SimpleType"))
    by_name = {t.name: t for t in reversed(types)}
    variables = root.iterfind("ModelVariables/ScalarVariable")
    return Declarations(
        variables=tuple(_variable(i, e, by_name) for i, e in enumerate(variables, start=1)),
        units=tuple(_unit(e) for e in root.iterfind("UnitDefinitions/Unit")),
        types=types,
        outputs=_unknowns(root, "Outputs"),
        derivatives=_unknowns(root, "Derivatives"),
        initial_unknowns=_unknowns(root, "InitialUnknowns"),
    )


def find_repeated(names: Iterable[str]) -> list[str]:
    """Return names that occur more than once, in the order of their first occurrence."""
    return [name for name, count in Counter(names).items() if count > 1]


def _variable(index: int, element: Any, types: Mapping[str, DeclaredType]) -> DeclaredVariable:
    value = _typed(element)
    own = dict(value.attrib)
    declared_type = types.get(own.get("declaredType", ""))
    inherited = declared_type.attributes if declared_type else {}
    return DeclaredVariable(
        index=index,
        name=element.get("name"),
        reference=int(element.get("valueReference")),
        causality=element.get("causality", "local"),
        variability=element.get("variability", "continuous"),
        given_initial=element.get("initial"),
        type=value.tag,
        own=own,
        attributes={**inherited, **own},
        multiple_sets="canHandleMultipleSetPerTimeInstant" in element.attrib,
    )


def _typed(element: Any) -> Any:
    """Return the child element with the type of a variable or SimpleType."""
    return next(child for child in element.iterchildren(*TYPES))


def _unit(element: Any) -> DeclaredUnit:
    base = element.find("BaseUnit")
    display = tuple(dict(e.attrib) for e in element.iterfind("DisplayUnit"))
    return DeclaredUnit(element.get("name"), None if base is None else dict(base.attrib), display)


def _type(element: Any) -> DeclaredType:
    value = _typed(element)
    items = tuple(dict(e.attrib) for e in value.iterfind("Item"))
    return DeclaredType(element.get("name"), value.tag, dict(value.attrib), items)


def _unknowns(root: Any, name: str) -> tuple[DeclaredUnknown, ...]:
    return tuple(
        DeclaredUnknown(
            int(e.get("index")), _indices(e.get("dependencies")), _words(e.get("dependenciesKind"))
        )
        for e in root.iterfind(f"ModelStructure/{name}/Unknown")
    )


def _indices(text: str | None) -> tuple[int, ...] | None:
    return None if text is None else tuple(int(word) for word in text.split())


def _words(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(text.split())
