"""Values of structural parameters in a package: the connectors of arrays depend on them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from ...fmu.interface import Interface
from ...fmu.structure import convert_structure
from ..documents.ssd_data import ComponentElement, Element, SystemElement
from .binding import BoundValue, resolve_bindings
from .wiring import Fmu, Path_, Wiring


def find_structures(
    root: SystemElement, where: str, interface: Callable[[ComponentElement], Interface]
) -> SystemElement:
    """Return a system whose components have the values that bindings give structural parameters by name.

    Args:
        root: The root system.
        where: The name of the structure in error messages.
        interface: Returns the interface of a component's FMU.

    Raises:
        CommandError: A structural parameter does not accept its value.
    """
    fmus = {path: Fmu(path, component, interface(component)) for path, component in _components(root, ())}
    if not any(f.interface.is_structural(n) for f in fmus.values() for n in f.interface.variables):
        return root
    values, _ = resolve_bindings(root, Wiring(where, fmus), has_sizes=False)
    return _with_structures(root, (), {path: read_structure(fmu, values[path]) for path, fmu in fmus.items()})


def read_structure(fmu: Fmu, values: Mapping[str, BoundValue]) -> dict[str, int]:
    """Return the values of a component's structural parameters that differ from their start values."""
    return convert_structure(
        ".".join(fmu.path), fmu.interface, {name: bound.value for name, bound in values.items()}
    )


def _components(element: Element, path: Path_) -> Iterator[tuple[Path_, ComponentElement]]:
    """Yield all components in an element, with their paths."""
    if isinstance(element, ComponentElement):
        yield path, element
    if isinstance(element, SystemElement):
        for inside in element.elements:
            yield from _components(inside, (*path, inside.name))


def _with_structures(
    system: SystemElement, path: Path_, structures: Mapping[Path_, Mapping[str, int]]
) -> SystemElement:
    def changed(element: Element) -> Element:
        own = (*path, element.name)
        if isinstance(element, SystemElement):
            return _with_structures(element, own, structures)
        if isinstance(element, ComponentElement):
            return replace(element, structure=tuple(structures[own].items()))
        return element

    return replace(system, elements=tuple(changed(element) for element in system.elements))
