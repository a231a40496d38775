"""Structure descriptions (SSD) as XML."""

from collections.abc import Iterable, Iterator
from typing import Any

from ..errors import CommandError
from ..units import Unit
from .parameters import add_mapping, add_parameter_set, read_mapping, read_parameter_set
from .structure import (
    FMU,
    Component,
    Connection,
    Connector,
    DictionaryReference,
    Element,
    ParameterBinding,
    Reference,
    Structure,
    SystemElement,
)
from .xml import (
    NAMESPACES,
    XmlElement,
    add,
    add_transformation,
    add_units,
    boolean,
    check,
    child,
    children,
    document,
    local_name,
    number,
    parse,
    read_transformation,
    read_unit,
    read_units,
    to_bytes,
)

_OPENMODELICA = "org.openmodelica"
_RENAMES = "emla-cosim.renames"
_OPEN_SIMULATION_PLATFORM = "com.opensimulationplatform"
_ANNOTATIONS = {
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}
_CORNERS = ("x1", "y1", "x2", "y2")


def parse_structure(content: bytes, where: str) -> Structure:
    """An SSD file; `where` is its name in messages. Raises CommandError for what is none."""
    root = parse(content, where, "ssd")
    reader = _Reader(where, read_units(root, "ssd", where))
    experiment = child(root, "ssd:DefaultExperiment")
    times: Any = experiment.attrib if experiment is not None else {}
    return Structure(
        name=root.get("name"),
        system=reader.system(child(root, "ssd:System")),
        start_time=_number(times.get("startTime")),
        stop_time=_number(times.get("stopTime")),
        step_size=_step_size(root, where),
        description=root.get("description", ""),
    )


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)


def _step_size(root: XmlElement, where: str) -> float | None:
    """The step size that OMSimulator or libcosim were told, in s; CommandError for what is no number."""
    for element, attribute in (
        ("oms:FixedStepMaster", "stepSize"),
        ("osp:FixedStepAlgorithm", "baseStepSize"),
    ):
        found = root.find(f".//{element}", NAMESPACES | _ANNOTATIONS)
        if found is not None and found.get(attribute):
            try:
                return float(found.get(attribute))
            except ValueError as error:
                raise CommandError(
                    f"'{where}' line {found.sourceline} has the step size '{found.get(attribute)}'."
                ) from error
    return None


class _Reader:
    """Elements of one document, with its units."""

    def __init__(self, where: str, units: dict[str, Unit]) -> None:
        self._where, self._units = where, units

    def _fault(self, element: XmlElement, text: str) -> CommandError:
        return CommandError(f"'{self._where}' line {element.sourceline}: {text}.")

    def system(self, element: XmlElement) -> SystemElement:
        """A System element."""
        return SystemElement(
            **self._common(element),
            elements=tuple(self._elements(element)),
            connections=tuple(
                self._connection(c) for c in children(element, "ssd:Connections", "ssd:Connection")
            ),
            dictionaries=tuple(
                d.get("name") for d in children(element, "ssd:SignalDictionaries", "ssd:SignalDictionary")
            ),
            canvas=_corners(child(element, "ssd:SystemGeometry")),
        )

    def _elements(self, system: XmlElement) -> Iterator[Element]:
        names = set()
        for element in children(system, "ssd:Elements", "*"):
            name = element.get("name")
            if name in names:
                raise self._fault(element, f"the system '{system.get('name')}' has a second element '{name}'")
            names.add(name)
            yield self._element(element)

    def _element(self, element: XmlElement) -> Element:
        match local_name(element):
            case "System":
                return self.system(element)
            case "SignalDictionaryReference":
                return DictionaryReference(**self._common(element), dictionary=element.get("dictionary"))
            case _:
                return Component(
                    **self._common(element),
                    source=element.get("source", ""),
                    type=element.get("type", FMU),
                    implementation=element.get("implementation", "any"),
                )

    def _common(self, element: XmlElement) -> dict[str, Any]:
        return {
            "name": element.get("name"),
            "connectors": tuple(
                self._connector(c) for c in children(element, "ssd:Connectors", "ssd:Connector")
            ),
            "bindings": tuple(
                self._binding(b) for b in children(element, "ssd:ParameterBindings", "ssd:ParameterBinding")
            ),
            "extent": _corners(child(element, "ssd:ElementGeometry")),
            "id": element.get("id"),
        }

    def _connector(self, element: XmlElement) -> Connector:
        if child(element, "ssc:Dimension") is not None:
            raise self._fault(element, f"'{element.get('name')}' has dimensions; FMI 2.0 has no arrays")
        typed = [e for e in element if local_name(e) not in ("ConnectorGeometry", "Annotations", "Clock")]
        place = child(element, "ssd:ConnectorGeometry")
        return Connector(
            name=element.get("name"),
            kind=element.get("kind"),
            type=local_name(typed[0]) if typed else None,
            unit=read_unit(typed[0], self._units, self._where) if typed else None,
            position=(float(place.get("x")), float(place.get("y"))) if place is not None else None,
        )

    def _binding(self, element: XmlElement) -> ParameterBinding:
        mapping = child(element, "ssd:ParameterMapping")
        values = self._content(element, child(element, "ssd:ParameterValues"), "ssv")
        return ParameterBinding(
            values=values if isinstance(values, Reference) else read_parameter_set(values, self._where),
            prefix=element.get("prefix", ""),
            mapping=self._mapping(mapping) if mapping is not None else None,
            renames=any(
                a.get("type") == _RENAMES for a in children(element, "ssd:Annotations", "ssc:Annotation")
            ),
        )

    def _connection(self, element: XmlElement) -> Connection:
        if element.get("startIndices") or element.get("endIndices"):
            raise self._fault(element, "the connection has indices; FMI 2.0 has no arrays")
        geometry = child(element, "ssd:ConnectionGeometry")
        x, y = (
            [float(p) for p in geometry.get(name).split()] if geometry is not None else []
            for name in ("pointsX", "pointsY")
        )
        return Connection(
            start_element=element.get("startElement"),
            start_connector=element.get("startConnector"),
            end_element=element.get("endElement"),
            end_connector=element.get("endConnector"),
            transformation=read_transformation(element, self._where),
            suppress_unit_conversion=boolean(element.get("suppressUnitConversion")),
            waypoints=tuple(zip(x, y, strict=False)),
        )

    def _mapping(self, element: XmlElement) -> Any:
        entries = self._content(element, element, "ssm")
        return entries if isinstance(entries, Reference) else read_mapping(entries, self._where)

    def _content(self, element: XmlElement, holder: XmlElement | None, kind: str) -> Any:
        """The file that an element names, or what its holder has inside."""
        if element.get("source") is not None:
            return Reference(element.get("source"), element.get("sourceBase", "SSD"))
        inside = holder[0] if holder is not None and len(holder) else None
        if inside is None:
            raise self._fault(element, f"the {local_name(element)} has neither a source nor a content")
        check(inside, self._where, kind)
        return inside


def _corners(element: XmlElement | None) -> Any:
    return None if element is None else tuple(float(element.get(c)) for c in _CORNERS)


def format_structure(structure: Structure) -> bytes:
    """A structure as an SSD file.

    The step size is told to OMSimulator and to libcosim, each in its own annotation.
    """
    root = document("ssd", _ANNOTATIONS, name=structure.name, description=structure.description or None)
    system = _add_system(root, structure.system)
    if structure.step_size is not None:
        step = number(structure.step_size)
        inside = add(_annotation(system, _OPENMODELICA), "oms:Annotations")
        master = add(inside, "oms:SimulationInformation")
        add(
            master,
            "oms:FixedStepMaster",
            description="oms-ma",
            stepSize=step,
            absoluteTolerance="1e-4",
            relativeTolerance="1e-4",
        )
    add_units(root, "ssd", _units(structure.system))
    start, stop = (None if t is None else number(t) for t in (structure.start_time, structure.stop_time))
    experiment = add(root, "ssd:DefaultExperiment", startTime=start, stopTime=stop)
    if structure.step_size is not None:
        algorithm = add(_annotation(experiment, _OPEN_SIMULATION_PLATFORM), "osp:Algorithm")
        add(algorithm, "osp:FixedStepAlgorithm", baseStepSize=number(structure.step_size))
    return to_bytes(root)


def _annotation(parent: XmlElement, type_: str) -> XmlElement:
    return add(add(parent, "ssd:Annotations"), "ssc:Annotation", type=type_)


def _units(element: Element) -> Iterator[Unit | None]:
    yield from (c.unit for c in element.connectors)
    if isinstance(element, SystemElement):
        for inside in element.elements:
            yield from _units(inside)


def _add_system(parent: XmlElement, system: SystemElement) -> XmlElement:
    element = _add_common(parent, "ssd:System", system)
    if system.elements:
        group = add(element, "ssd:Elements")
        for inside in system.elements:
            if isinstance(inside, SystemElement):
                _add_system(group, inside)
            elif isinstance(inside, Component):
                how = None if inside.implementation == "any" else inside.implementation
                _add_common(
                    group, "ssd:Component", inside, type=inside.type, source=inside.source, implementation=how
                )
            elif isinstance(inside, DictionaryReference):
                _add_common(group, "ssd:SignalDictionaryReference", inside, dictionary=inside.dictionary)
    if system.connections:
        _add_connections(add(element, "ssd:Connections"), system.connections)
    if system.canvas is not None:
        add(element, "ssd:SystemGeometry", **_geometry(system.canvas))
    return element


def _add_common(parent: XmlElement, tag: str, element: Element, /, **attributes: str | None) -> XmlElement:
    added = add(parent, tag, id=element.id, name=element.name, **attributes)
    if element.connectors:
        group = add(added, "ssd:Connectors")
        for connector in element.connectors:
            _add_connector(group, connector)
    if element.extent is not None:
        add(added, "ssd:ElementGeometry", **_geometry(element.extent))
    if element.bindings:
        group = add(added, "ssd:ParameterBindings")
        for binding in element.bindings:
            _add_binding(group, binding)
    return added


def _add_connector(group: XmlElement, connector: Connector) -> None:
    added = add(group, "ssd:Connector", name=connector.name, kind=connector.kind)
    if connector.type is not None:
        add(added, f"ssc:{connector.type}", unit=connector.unit.name if connector.unit is not None else None)
    if connector.position is not None:
        x, y = connector.position
        add(added, "ssd:ConnectorGeometry", x=number(x), y=number(y))


def _add_binding(group: XmlElement, binding: ParameterBinding) -> None:
    added = add(group, "ssd:ParameterBinding", **_source(binding.values), prefix=binding.prefix or None)
    if not isinstance(binding.values, Reference):
        inside = add(add(added, "ssd:ParameterValues"), "ssv:ParameterSet", version="1.0")
        inside.set("name", binding.values.name)
        add_parameter_set(inside, binding.values)
    if binding.mapping is not None:
        mapping = add(added, "ssd:ParameterMapping", **_source(binding.mapping))
        if not isinstance(binding.mapping, Reference):
            add_mapping(add(mapping, "ssm:ParameterMapping", version="1.0"), binding.mapping)
    if binding.renames:
        _annotation(added, _RENAMES)


def _source(content: object) -> dict[str, str | None]:
    if not isinstance(content, Reference):
        return {}
    return {"source": content.source, "sourceBase": content.base if content.base != "SSD" else None}


def _add_connections(group: XmlElement, connections: Iterable[Connection]) -> None:
    for connection in connections:
        added = add(
            group,
            "ssd:Connection",
            startElement=connection.start_element,
            startConnector=connection.start_connector,
            endElement=connection.end_element,
            endConnector=connection.end_connector,
            suppressUnitConversion="true" if connection.suppress_unit_conversion else None,
        )
        add_transformation(added, connection.transformation)
        if connection.waypoints:
            x, y = zip(*connection.waypoints, strict=True)
            points = {name: " ".join(map(number, p)) for name, p in (("pointsX", x), ("pointsY", y))}
            add(added, "ssd:ConnectionGeometry", **points)


def _geometry(corners: Iterable[float]) -> dict[str, str | None]:
    return {name: number(value) for name, value in zip(_CORNERS, corners, strict=True)}
