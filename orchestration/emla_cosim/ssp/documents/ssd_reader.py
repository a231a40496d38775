"""Reading of structure descriptions (SSD) from XML."""

from collections.abc import Iterable, Iterator
from typing import Any

from ...base.errors import CommandError
from ...base.faults import note_fault
from ...base.units import SiUnit
from ...fmu.parameters.parameter_sets import read_parameter_set
from ...fmu.parameters.ssp_xml import (
    ANNOTATION_NAMESPACES,
    CORNERS,
    NAMESPACES,
    OWN_NAMESPACE,
    RENAMES,
    XmlElement,
    check,
    child,
    children,
    local_name,
    parse,
    parse_boolean,
    read_unit,
    read_units,
)
from ...system.bond import Bond
from .mappings import read_mapping, read_transformation
from .ssd_data import (
    FMU,
    ComponentElement,
    Connector,
    DictionaryReference,
    Dimension,
    Element,
    FileReference,
    ParameterBinding,
    SsdConnection,
    Structure,
    SystemElement,
)


def parse_structure(content: bytes, where: str) -> Structure:
    """Parse an SSD file.

    Args:
        content: The content of the file.
        where: Its name in error messages.

    Raises:
        CommandError: If it is not a valid SSD.
    """
    root = parse(content, where, "ssd")
    reader = _Reader(where, read_units(root, "ssd", where))
    experiment = child(root, "ssd:DefaultExperiment")
    times: Any = experiment.attrib if experiment is not None else {}
    return Structure(
        name=root.get("name"),
        system=reader.system(child(root, "ssd:System")),
        start_time=_parse_time(times.get("startTime")),
        stop_time=_parse_time(times.get("stopTime")),
        step_size=_read_step_size(root, where),
        description=root.get("description", ""),
        samples=tuple(e["component"] for e in _list_annotations(root, where, "Samples", ("component",))),
        bonds=_read_bonds(root, where),
        id=root.get("id"),
    )


def _read_bonds(root: XmlElement, where: str) -> dict[str, Bond]:
    """Return the power bonds by name; CommandError for two of one name."""
    bonds: dict[str, Bond] = {}
    for attributes in _list_annotations(root, where, "Bond", ("name", "effort", "flow")):
        if attributes["name"] in bonds:
            raise CommandError(f"'{where}': two power bonds have the name '{attributes['name']}'.")
        bonds[attributes["name"]] = Bond(attributes["effort"], attributes["flow"])
    return bonds


def _list_annotations(
    root: XmlElement, where: str, tag: str, attributes: Iterable[str]
) -> Iterator[dict[str, str]]:
    """Yield the attributes of elements in our own annotation; raise CommandError if one is missing."""
    for element in root.iterfind(f"ssd:DefaultExperiment//emla:{tag}", NAMESPACES | OWN_NAMESPACE):
        for name in attributes:
            if not element.get(name):
                raise CommandError(f"'{where}' line {element.sourceline}: the element {tag} has no {name}.")
        yield dict(element.attrib)


def _parse_time(text: str | None) -> float | None:
    return None if text is None else float(text)


def _read_step_size(root: XmlElement, where: str) -> float | None:
    """Return the step size in the annotations of OMSimulator or libcosim, in s; None without one."""
    for element, attribute in (
        ("oms:FixedStepMaster", "stepSize"),
        ("osp:FixedStepAlgorithm", "baseStepSize"),
        ("oms:VariableStepSolver", "maximumStepSize"),  # of a system for Model Exchange
    ):
        algorithm = root.find(f".//{element}", NAMESPACES | ANNOTATION_NAMESPACES)
        if algorithm is not None and algorithm.get(attribute):
            try:
                return float(algorithm.get(attribute))
            except ValueError as error:
                raise CommandError(
                    f"'{where}' line {algorithm.sourceline} has the step size '{algorithm.get(attribute)}'; "
                    "it must be a number."
                ) from error
    return None


class _Reader:
    """Reads the elements of one document."""

    def __init__(self, where: str, units: dict[str, SiUnit]) -> None:
        self._where, self._units = where, units

    def _format_location(self, element: XmlElement) -> str:
        return f"'{self._where}' line {element.sourceline}"

    def _make_fault(self, element: XmlElement, text: str) -> CommandError:
        return CommandError(f"{self._format_location(element)}: {text}.")

    def system(self, element: XmlElement) -> SystemElement:
        """Read a System element."""
        return SystemElement(
            **self._read_common(element),
            elements=tuple(self._read_elements(element)),
            connections=tuple(
                self._read_connection(c) for c in children(element, "ssd:Connections", "ssd:Connection")
            ),
            dictionaries=tuple(
                d.get("name") for d in children(element, "ssd:SignalDictionaries", "ssd:SignalDictionary")
            ),
        )

    def _read_elements(self, system: XmlElement) -> Iterator[Element]:
        names = set()
        for element in children(system, "ssd:Elements", "*"):
            name = element.get("name")
            if name in names:
                raise self._make_fault(
                    element, f"the system '{system.get('name')}' has a second element '{name}'"
                )
            names.add(name)
            yield self._read_element(element)

    def _read_element(self, element: XmlElement) -> Element:
        match local_name(element):
            case "System":
                return self.system(element)
            case "SignalDictionaryReference":
                return DictionaryReference(**self._read_common(element), dictionary=element.get("dictionary"))
            case _:
                return ComponentElement(
                    **self._read_common(element),
                    source=element.get("source", ""),
                    type=element.get("type", FMU),
                    implementation=element.get("implementation", "any"),
                )

    def _read_common(self, element: XmlElement) -> dict[str, Any]:
        """Return the fields that all elements have, by name."""
        geometry = child(element, "ssd:ElementGeometry")
        return {
            "name": element.get("name"),
            "connectors": tuple(
                self._read_connector(c) for c in children(element, "ssd:Connectors", "ssd:Connector")
            ),
            "bindings": tuple(
                self._read_binding(b)
                for b in children(element, "ssd:ParameterBindings", "ssd:ParameterBinding")
            ),
            "extent": None if geometry is None else tuple(float(geometry.get(c)) for c in CORNERS),
            "id": element.get("id"),
        }

    def _read_connector(self, element: XmlElement) -> Connector:
        # SSP 2.0 has the dimensions of an array beside its type
        typed = [e for e in children(element, "ssc:*") if local_name(e) != "Dimension"]
        geometry = child(element, "ssd:ConnectorGeometry")
        return Connector(
            name=element.get("name"),
            kind=element.get("kind"),
            type=local_name(typed[0]) if typed else None,
            unit=read_unit(typed[0], self._units, self._where) if typed else None,
            position=(float(geometry.get("x")), float(geometry.get("y"))) if geometry is not None else None,
            dimensions=tuple(
                self._read_dimension(d, element.get("name")) for d in children(element, "ssc:Dimension")
            ),
            location=self._format_location(element),
        )

    def _read_dimension(self, element: XmlElement, owner: str) -> Dimension:
        size, connector = element.get("size"), element.get("sizeConnector")
        if size is not None and connector is not None:
            raise self._make_fault(
                element, f"a Dimension of '{owner}' has both size and sizeConnector; only one is allowed"
            )
        return Dimension(None if size is None else int(size), connector)

    def _read_binding(self, element: XmlElement) -> ParameterBinding:
        mapping = child(element, "ssd:ParameterMapping")
        values = self._read_content(element, child(element, "ssd:ParameterValues"), "ssv")
        return ParameterBinding(
            values=values if isinstance(values, FileReference) else read_parameter_set(values, self._where),
            prefix=element.get("prefix", ""),
            mapping=self._read_mapping(mapping) if mapping is not None else None,
            renames=any(
                a.get("type") == RENAMES for a in children(element, "ssd:Annotations", "ssc:Annotation")
            ),
        )

    def _read_connection(self, element: XmlElement) -> SsdConnection:
        geometry = child(element, "ssd:ConnectionGeometry")
        x, y = (
            [float(p) for p in geometry.get(name).split()] if geometry is not None else []
            for name in ("pointsX", "pointsY")
        )
        return SsdConnection(
            start_element=self._read_element_name(element, "startElement"),
            start_connector=element.get("startConnector"),
            end_element=self._read_element_name(element, "endElement"),
            end_connector=element.get("endConnector"),
            transformation=read_transformation(element, self._where),
            suppress_unit_conversion=parse_boolean(element.get("suppressUnitConversion")),
            waypoints=tuple(zip(x, y, strict=False)),
            start_indices=self._read_indices(element, "startIndices"),
            end_indices=self._read_indices(element, "endIndices"),
            location=self._format_location(element),
        )

    def _read_indices(self, connection: XmlElement, attribute: str) -> tuple[int, ...]:
        """Return the indices of an array's element, empty without the attribute."""
        text = connection.get(attribute)
        indices = tuple(map(int, text.split())) if text is not None else ()
        if text is not None and (not indices or 0 in indices):
            raise self._make_fault(
                connection, f"the {attribute} '{text}' must be one number for each dimension, at least 1"
            )
        return indices

    def _read_element_name(self, connection: XmlElement, attribute: str) -> str | None:
        """Return the element at an end of a connection, None for the system itself."""
        name = connection.get(attribute)
        if name == "":
            note_fault(self._where, f"an empty {attribute} of a connection, read as the system itself")
            return None
        return name

    def _read_mapping(self, element: XmlElement) -> Any:
        entries = self._read_content(element, element, "ssm")
        return entries if isinstance(entries, FileReference) else read_mapping(entries, self._where)

    def _read_content(self, element: XmlElement, holder: XmlElement | None, kind: str) -> Any:
        """Return the reference to an element's file, or its inline content."""
        if element.get("source") is not None:
            return FileReference(element.get("source"), element.get("sourceBase", "SSD"))
        inside = holder[0] if holder is not None and len(holder) else None
        if inside is None:
            raise self._make_fault(element, f"the {local_name(element)} has neither a source nor content")
        check(inside, self._where, kind)
        return inside
