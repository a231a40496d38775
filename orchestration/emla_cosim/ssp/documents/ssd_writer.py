"""Writing of structure descriptions (SSD) to XML."""

from collections.abc import Iterable, Iterator

from ...base.units import SiUnit
from ...fmu.parameters.parameter_sets import add_parameter_set
from ...fmu.parameters.ssp_xml import (
    ANNOTATION_NAMESPACES,
    CORNERS,
    OWN_NAMESPACE,
    RENAMES,
    SYSTEM,
    XmlElement,
    add,
    add_units,
    child,
    document,
    format_float,
    to_bytes,
)
from .mappings import add_mapping, add_transformation
from .ssd_data import (
    ComponentElement,
    Connector,
    DictionaryReference,
    Element,
    FileReference,
    ParameterBinding,
    SsdConnection,
    Structure,
    SystemElement,
)

_OPENMODELICA = "org.openmodelica"
_OPEN_SIMULATION_PLATFORM = "com.opensimulationplatform"


def format_structure(structure: Structure) -> bytes:
    """Return a structure as an SSD file.

    An annotation of each system has the step size for OMSimulator, and one of the experiment has it for
    libcosim. Another annotation of the experiment has the content that the standard does not define.
    """
    namespaces = ANNOTATION_NAMESPACES
    if structure.samples or structure.bonds:
        namespaces = ANNOTATION_NAMESPACES | OWN_NAMESPACE
    root = document(
        "ssd",
        structure.version,
        namespaces,
        id=structure.id,
        name=structure.name,
        description=structure.description or None,
    )
    _add_system(root, structure.system, structure.step_size, structure.is_continuous)
    add_units(root, "ssd", _list_units(structure.system))
    start, stop = (
        None if t is None else format_float(t) for t in (structure.start_time, structure.stop_time)
    )
    experiment = add(root, "ssd:DefaultExperiment", startTime=start, stopTime=stop)
    if structure.step_size is not None:
        algorithm = add(_add_annotation(experiment, _OPEN_SIMULATION_PLATFORM), "osp:Algorithm")
        add(algorithm, "osp:FixedStepAlgorithm", baseStepSize=format_float(structure.step_size))
    if structure.samples or structure.bonds:
        annotation = add(_add_annotation(experiment, SYSTEM), "emla:System")
        for component in structure.samples:
            add(annotation, "emla:Samples", component=component)
        for name, bond in structure.bonds.items():
            add(annotation, "emla:Bond", name=name, effort=bond.effort, flow=bond.flow)
    return to_bytes(root)


def _add_annotation(parent: XmlElement, type_: str) -> XmlElement:
    group = child(parent, "ssd:Annotations")
    return add(add(parent, "ssd:Annotations") if group is None else group, "ssc:Annotation", type=type_)


def _list_units(element: Element) -> Iterator[SiUnit | None]:
    yield from (c.unit for c in element.connectors)
    if isinstance(element, SystemElement):
        for inside in element.elements:
            yield from _list_units(inside)


def _add_stepping_settings(system: XmlElement, step_size: float, is_continuous: bool) -> None:
    """Add the settings of OMSimulator, which it requires of each system.

    It integrates Model Exchange only in systems with a solver. There, a step has at most the largest length.
    """
    inside = add(_add_annotation(system, _OPENMODELICA), "oms:Annotations")
    information = add(inside, "oms:SimulationInformation")
    if is_continuous:
        # our reader takes the largest step as the communication step
        add(
            information,
            "oms:VariableStepSolver",
            description="cvode",
            relativeTolerance="0.000001",
            minimumStepSize="0.000000000001",
            maximumStepSize=format_float(step_size),
            initialStepSize="0.000001",
        )
        return
    add(
        information,
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=format_float(step_size),
        absoluteTolerance="1e-4",
        relativeTolerance="1e-4",
    )


def _add_system(
    parent: XmlElement, system: SystemElement, step_size: float | None, is_continuous: bool
) -> None:
    element = _add_common(parent, "ssd:System", system)
    if system.elements:
        group = add(element, "ssd:Elements")
        for inside in system.elements:
            if isinstance(inside, SystemElement):
                _add_system(group, inside, step_size, is_continuous)
            elif isinstance(inside, ComponentElement):
                how = None if inside.implementation == "any" else inside.implementation
                _add_common(
                    group, "ssd:Component", inside, type=inside.type, source=inside.source, implementation=how
                )
            elif isinstance(inside, DictionaryReference):
                _add_common(group, "ssd:SignalDictionaryReference", inside, dictionary=inside.dictionary)
    if system.connections:
        _add_connections(add(element, "ssd:Connections"), system.connections)
    if step_size is not None:
        _add_stepping_settings(element, step_size, is_continuous)


def _add_common(parent: XmlElement, tag: str, element: Element, /, **attributes: str | None) -> XmlElement:
    """Add an element with the fields that all elements have, and return its XML."""
    added = add(parent, tag, id=element.id, name=element.name, **attributes)
    if element.connectors:
        group = add(added, "ssd:Connectors")
        for connector in element.connectors:
            _add_connector(group, connector)
    if element.extent is not None:
        corners = map(format_float, element.extent)
        add(added, "ssd:ElementGeometry", **dict(zip(CORNERS, corners, strict=True)))
    if element.bindings:
        group = add(added, "ssd:ParameterBindings")
        for binding in element.bindings:
            _add_binding(group, binding)
    return added


def _add_connector(group: XmlElement, connector: Connector) -> None:
    added = add(group, "ssd:Connector", name=connector.name, kind=connector.kind)
    if connector.type is not None:
        add(added, f"ssc:{connector.type}", unit=connector.unit.name if connector.unit is not None else None)
    for dimension in connector.dimensions:
        size = None if dimension.size is None else str(dimension.size)
        add(added, "ssc:Dimension", size=size, sizeConnector=dimension.connector)
    if connector.position is not None:
        x, y = connector.position
        add(added, "ssd:ConnectorGeometry", x=format_float(x), y=format_float(y))


def _add_binding(group: XmlElement, binding: ParameterBinding) -> None:
    added = add(
        group, "ssd:ParameterBinding", **_format_source(binding.values), prefix=binding.prefix or None
    )
    if not isinstance(binding.values, FileReference):
        inside = add(add(added, "ssd:ParameterValues"), "ssv:ParameterSet", version=_read_version(group))
        inside.set("name", binding.values.name)
        add_parameter_set(inside, binding.values)
    if binding.mapping is not None:
        mapping = add(added, "ssd:ParameterMapping", **_format_source(binding.mapping))
        if not isinstance(binding.mapping, FileReference):
            add_mapping(add(mapping, "ssm:ParameterMapping", version=_read_version(group)), binding.mapping)
    if binding.renames:
        _add_annotation(added, RENAMES)


def _read_version(element: XmlElement) -> str:
    """Return the version of the document with an element."""
    return element.getroottree().getroot().get("version")


def _format_source(content: object) -> dict[str, str | None]:
    """Return the attributes that name a file; none for content inside of the element."""
    if not isinstance(content, FileReference):
        return {}
    return {"source": content.source, "sourceBase": content.base if content.base != "SSD" else None}


def _add_connections(group: XmlElement, connections: Iterable[SsdConnection]) -> None:
    for connection in connections:
        added = add(
            group,
            "ssd:Connection",
            startElement=connection.start_element,
            startConnector=connection.start_connector,
            startIndices=_format_indices(connection.start_indices),
            endElement=connection.end_element,
            endConnector=connection.end_connector,
            endIndices=_format_indices(connection.end_indices),
            suppressUnitConversion="true" if connection.suppress_unit_conversion else None,
        )
        add_transformation(added, connection.transformation)
        if connection.waypoints:
            x, y = zip(*connection.waypoints, strict=True)
            points = {name: " ".join(map(format_float, p)) for name, p in (("pointsX", x), ("pointsY", y))}
            add(added, "ssd:ConnectionGeometry", **points)


def _format_indices(indices: Iterable[int]) -> str | None:
    return " ".join(map(str, indices)) or None
