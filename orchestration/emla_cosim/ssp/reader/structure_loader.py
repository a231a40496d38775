"""Loading of a structure with the files that it names: parameter files and nested systems."""

import contextlib
import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

from ...base.errors import CommandError, join_names
from ...fmu.interface import KINDS
from ...fmu.parameters.parameter_sets import parse_parameter_set
from ..documents.mappings import parse_mapping
from ..documents.ssd_data import (
    FMU,
    SSD,
    SSP,
    ComponentElement,
    Connector,
    Element,
    FileReference,
    ParameterBinding,
    Structure,
    SystemElement,
)
from ..documents.ssd_reader import parse_structure
from .package import Package, open_package, read_inside_fmu

_DEEPEST = 50
"""The largest depth of nested documents."""
_MOST = 10_000
"""The largest number of components; references can turn few into many."""


def load_structure(package: Package, held: contextlib.ExitStack) -> Structure:
    """Return the structure of a package, with FMUs as its only components and values in its bindings.

    The source of a component is the path of its file. Nested packages stay open as long as `held`.

    Args:
        package: The package.
        held: Closes nested packages.

    Raises:
        CommandError: If something is missing, not supported, or contains itself.
    """
    return _Loader(package, held, (), itertools.count(1)).structure()


class _Loader:
    """Loads one SSD.

    `around` lists the outer SSD files, with ids within them. `count` numbers the components of the whole
    structure.
    """

    def __init__(
        self,
        package: Package,
        held: contextlib.ExitStack,
        around: tuple[str, ...],
        count: Iterator[int],
    ) -> None:
        self._package, self._held, self._around, self._count = package, held, around, count
        self._where = package.name
        self._by_id: dict[str, SystemElement] = {}

    def _fault(self, text: str) -> CommandError:
        return CommandError(f"'{self._where}': {text}")

    def structure(self) -> Structure:
        """Return the structure with its files."""
        read = self._parse_ssd()
        return replace(read, system=self._system(read.system))

    def _parse_ssd(self) -> Structure:
        read = parse_structure(_content(self._package.ssd), self._where)
        self._by_id = {s.id: s for s in _systems(read.system) if s.id is not None}
        return read

    def _system(self, system: SystemElement) -> SystemElement:
        return replace(
            system,
            bindings=tuple(self._binding(b, None) for b in system.bindings),
            elements=tuple(self._element(e) for e in system.elements),
        )

    def _element(self, element: Element) -> Element:
        if isinstance(element, SystemElement):
            return self._system(element)
        if not isinstance(element, ComponentElement):
            return element
        if next(self._count) > _MOST:
            raise self._fault(f"the structure has more than {_MOST} components.")
        match element.type:
            case _ if element.source.startswith("#"):
                return self._same_document(element)
            case t if t == FMU:
                return self._fmu(element)
            case t if t in (SSD, SSP):
                return self._other_document(element)
            case other:
                raise self._fault(
                    f"the component '{element.name}' is of type '{other}'; this master supports FMUs and "
                    "systems."
                )

    def _fmu(self, component: ComponentElement) -> ComponentElement:
        if not component.source:
            raise self._fault(f"the component '{component.name}' has no source.")
        if component.implementation not in ("any", *KINDS.values()):
            raise self._fault(
                f"the component '{component.name}' requires {component.implementation}; this "
                f"master supports {join_names(KINDS.values())}."
            )
        fmu = self._package.file(component.source, self._where)
        return replace(
            component, source=str(fmu), bindings=tuple(self._binding(b, fmu) for b in component.bindings)
        )

    def _same_document(self, component: ComponentElement) -> SystemElement:
        inner = self._read_inside_fmu(f"{self._package.ssd.resolve()}{component.source}", component)
        inner._where, inner._by_id = self._where, self._by_id
        return self._insert_system(component, inner._system(self._with_id(component.source[1:], component)))

    def _with_id(self, id_: str, component: ComponentElement) -> SystemElement:
        found = self._by_id.get(unquote(id_))
        if found is None:
            raise self._fault(
                f"the component '{component.name}' refers to '{component.source}', but no system has this id."
            )
        return found

    def _other_document(self, component: ComponentElement) -> SystemElement:
        uri, _, fragment = component.source.partition("#")
        file = self._package.file(uri, self._where)
        inner = self._read_inside_fmu(f"{file}#{fragment}", component)
        inner._where = f"{self._where}/{component.source}"
        if component.type == SSP:
            inner._package = self._held.enter_context(open_package(file, unquote(fragment)))
            return self._insert_system(component, inner.structure().system)
        inner._package = replace(self._package, ssd=file, name=inner._where)
        read = inner._parse_ssd().system
        return self._insert_system(
            component, inner._system(inner._with_id(fragment, component) if fragment else read)
        )

    def _read_inside_fmu(self, file: str, component: ComponentElement) -> "_Loader":
        around = self._around or (f"{self._package.ssd.resolve()}#",)
        if file in around:
            raise self._fault(
                f"the component '{component.name}' refers to '{component.source}', which contains it."
            )
        if len(around) > _DEEPEST:
            raise self._fault(f"the component '{component.name}' is nested more than {_DEEPEST} levels deep.")
        return _Loader(self._package, self._held, (*around, file), self._count)

    def _insert_system(self, component: ComponentElement, system: SystemElement) -> SystemElement:
        """Return a system under the name of the component that refers to it, with its bindings last."""
        own = tuple(self._binding(b, None) for b in component.bindings)
        connectors = {c.name: c for c in system.connectors}
        for connector in component.connectors:
            inside = connectors.get(connector.name)
            connectors[connector.name] = self._join_connectors(connector, inside, component)
        return replace(
            system,
            name=component.name,
            id=component.id,
            bindings=(*system.bindings, *own),
            connectors=tuple(connectors.values()),
        )

    def _join_connectors(
        self, outside: Connector, inside: Connector | None, component: ComponentElement
    ) -> Connector:
        """Return the connector of a component and its system; raise CommandError if they differ."""
        name = f"the connector '{outside.name}' of the component '{component.name}'"
        if inside is None:
            raise self._fault(f"{name} is not one of '{component.source}'.")
        if outside.kind != inside.kind:
            raise self._fault(f"{name} is of kind {outside.kind}, in '{component.source}' {inside.kind}.")
        if outside.unit is None or inside.unit is None:
            return replace(inside, unit=inside.unit or outside.unit)
        if not outside.unit.measures_as(inside.unit):
            raise self._fault(f"{name} is in {outside.unit}, in '{component.source}' in {inside.unit}.")
        return inside

    def _binding(self, binding: ParameterBinding, fmu: Path | None) -> ParameterBinding:
        values, mapping = binding.values, binding.mapping
        if isinstance(values, FileReference):
            values = parse_parameter_set(*self._read_reference(values, fmu))
        if isinstance(mapping, FileReference):
            mapping = parse_mapping(*self._read_reference(mapping, fmu))
        return replace(binding, values=values, mapping=mapping)

    def _read_reference(self, reference: FileReference, fmu: Path | None) -> tuple[bytes, str]:
        """Return content and name of a file."""
        if reference.base == "component" and fmu is not None:
            content = read_inside_fmu(fmu, reference.source, self._where)
            return content, f"{fmu.name}/{reference.source}"
        return _content(self._package.file(reference.source, self._where)), reference.source


def _systems(system: SystemElement) -> Iterator[SystemElement]:
    yield system
    for element in system.elements:
        if isinstance(element, SystemElement):
            yield from _systems(element)


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise CommandError(f"'{path.name}' cannot be read: {error.strerror}.") from error
