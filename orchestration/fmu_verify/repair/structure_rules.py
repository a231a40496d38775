"""Mend ModelStructure: lists that can be derived from the variables, and dependencies."""

from collections.abc import Iterator
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..checks.structure import LINEAR_KINDS, list_ignored_states, list_initially_unknown
from ..declarations import LISTS_3, REAL, Declarations
from ..subject import Subject
from .record import Change, describe_element

_ORDER_3 = ("Output", "ContinuousStateDerivative", "ClockedState", "InitialUnknown", "EventIndicator")
_ORDER_2 = ("Outputs", "Derivatives", "DiscreteStates", "InitialUnknowns")


def mend_structure(subject: Subject) -> Iterator[Change]:
    """Mend ModelStructure in the tree of a valid model description, and yield what was changed.

    An added unknown has no dependencies, which means that it depends on all knowns.
    """
    declared = subject.declared
    structure = subject.tree.find("ModelStructure")
    if structure is None:
        return
    mender = _Mender(structure, declared)
    outputs = {v.index for v in declared.variables if v.causality == "output"}
    yield from mender.add_missing("Outputs", outputs, "structure.outputs")
    doubtful = {
        v.index for v in declared.variables if not v.is_possible or v.is_clocked
    } | list_ignored_states(subject)
    required = list_initially_unknown(declared) - doubtful
    yield from mender.drop_surplus("InitialUnknowns", required | doubtful)
    yield from mender.add_missing("InitialUnknowns", required, "structure.initial_unknowns")
    if declared.version == 2:
        yield from mender.sort_initial_unknowns()
    for element in structure.xpath(".//*[@dependencies or @dependenciesKind]"):
        yield from mender.mend_dependencies(element)


class _Mender:
    """Changes the lists of an element ModelStructure."""

    def __init__(self, structure: Any, declared: Declarations) -> None:
        self._structure, self._declared = structure, declared
        self._is_3 = declared.version == 3
        self._attribute = "valueReference" if self._is_3 else "index"
        self._index_by_reference = {
            (v.reference if self._is_3 else v.index): v.index for v in reversed(declared.variables)
        }

    def _find_elements(self, name: str) -> list[Any]:
        """Return the elements of a list, by its name in FMI 2.0."""
        path = self._label(name) if self._is_3 else f"{name}/Unknown"
        return self._structure.findall(path)

    def _label(self, name: str) -> str:
        return LISTS_3[name] if self._is_3 else name

    def _find_index(self, element: Any) -> int:
        """Return the position of the variable of an element; 0 for none."""
        return self._index_by_reference.get(int(element.get(self._attribute)), 0)

    def _find_name(self, element: Any) -> str:
        return str(self._declared.variable(self._find_index(element)) or element.get(self._attribute))

    def add_missing(self, name: str, required: set[int], check: str) -> Iterator[Change]:
        """Add variables that a list lacks."""
        for index in sorted(required - {self._find_index(e) for e in self._find_elements(name)}):
            variable = self._declared.variables[index - 1]
            tag, reference = (LISTS_3[name], variable.reference) if self._is_3 else ("Unknown", index)
            element = etree.Element(tag, {self._attribute: str(reference)})
            self._insert(name, element)
            yield Change(check, f"{self._label(name)}, {variable}", "", describe_element(element))

    def _insert(self, name: str, element: Any) -> None:
        """Add an element to a list, at its end, or by its index in InitialUnknowns of FMI 2.0."""
        if not self._is_3:
            parent = self._structure.find(name)
            if parent is None:
                parent = etree.Element(name)
                self._structure.insert(self._find_position(_ORDER_2, name), parent)
            later = (e for e in parent.iterfind("Unknown") if self._find_index(e) > self._find_index(element))
            after = next(later, None) if name == "InitialUnknowns" else None  # which is in order
            parent.insert(len(parent) if after is None else parent.index(after), element)
            return
        self._structure.insert(self._find_position(_ORDER_3, LISTS_3[name]), element)

    def _find_position(self, order: tuple[str, ...], tag: str) -> int:
        """Return where to insert an element so that those of the structure stay in order."""
        before = order[: order.index(tag) + 1]
        positions = [i for i, e in enumerate(self._structure) if e.tag in before]
        return positions[-1] + 1 if positions else 0

    def drop_surplus(self, name: str, allowed: set[int]) -> Iterator[Change]:
        """Remove variables that do not belong to a list, and exact repetitions."""
        check, earlier = "structure.initial_unknowns", set[str]()
        for element in self._find_elements(name):
            text = describe_element(element)
            if self._find_index(element) in allowed and text not in earlier:
                earlier.add(text)
                continue
            parent = element.getparent()
            parent.remove(element)
            if not self._is_3 and parent.find("Unknown") is None:
                self._structure.remove(parent)
            yield Change(check, f"{self._label(name)}, {self._find_name(element)}", text, "")

    def sort_initial_unknowns(self) -> Iterator[Change]:
        """Sort InitialUnknowns of FMI 2.0 by index."""
        elements = self._find_elements("InitialUnknowns")
        current = [self._find_index(e) for e in elements]
        if current == sorted(current):
            return
        parent = elements[0].getparent()
        for element in sorted(elements, key=self._find_index):
            parent.append(element)
        before, after = (" ".join(map(str, indices)) for indices in (current, sorted(current)))
        yield Change("structure.initial_unknowns", "the order of InitialUnknowns", before, after)

    def mend_dependencies(self, element: Any) -> Iterator[Change]:
        """Mend the dependencies of an unknown: those on nothing, their order, and their kinds."""
        before = describe_element(element)
        words, kinds = (
            None if (text := element.get(name)) is None else text.split()
            for name in ("dependencies", "dependenciesKind")
        )
        if "0" in (words or ()) and not self._is_3:
            return  # perhaps all indices begin at 0
        if kinds is not None and len(kinds) != len(words or ()):
            kinds = None
        pairs = list(zip(words or (), kinds or [""] * len(words or ()), strict=True))
        valid_pairs = [pair for pair in pairs if int(pair[0]) in self._index_by_reference]
        if not self._is_3:
            valid_pairs = sorted(dict.fromkeys(valid_pairs), key=lambda pair: int(pair[0]))
        valid_pairs = [(word, self._choose_kind(element, kind)) for word, kind in valid_pairs]
        has_any = bool(valid_pairs) or not pairs
        _set_words(element, "dependencies", [word for word, _ in valid_pairs] if has_any else None, words)
        has_kinds = kinds is not None and has_any
        _set_words(
            element, "dependenciesKind", [kind for _, kind in valid_pairs] if has_kinds else None, kinds
        )
        if (after := describe_element(element)) != before:
            where = f"dependencies of {self._find_name(element)}"
            yield Change("structure.dependencies", where, before, after)

    def _choose_kind(self, element: Any, kind: str) -> str:
        """Return a kind of dependency, or the most general one if its unknown cannot have it."""
        variable = self._declared.variable(self._find_index(element))
        is_real = variable is None or variable.type in REAL
        is_later = element.tag == "InitialUnknown" and kind != "constant"
        return "dependent" if kind in LINEAR_KINDS and (not is_real or is_later) else kind


def _set_words(element: Any, name: str, words: list[str] | None, before: list[str] | None) -> None:
    """Set an attribute with a list of words if they differ; remove it if there are none left."""
    if words is None:
        element.attrib.pop(name, None)
    elif before is not None and words != before:
        element.set(name, " ".join(words))
