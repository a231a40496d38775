"""modelDescription.xml of a system (FMI 2.0.4, section 2.2)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from fmpy.model_description import ModelVariable

from fmublock.description import add_log_categories, add_unit, describe_model, format_xml
from fmublock.recipe import Producer

from ..base.units import SiUnit
from ..base.version import __version__
from .plan import ContainerPlan, Library
from .variables import ContainerVariable


def describe_container(
    plan: ContainerPlan,
    name: str,
    identifier: str,
    description: str,
    guid: str,
    variables: Sequence[ContainerVariable],
    source_files: Iterable[str],
) -> bytes:
    """Return the model description as UTF-8 XML."""
    root = describe_model(name, description, Producer(f"EMLA-Cosim {__version__}"), guid)
    if any(x.file.description.variableNamingConvention != "structured" for x in plan.libraries):
        root.set("variableNamingConvention", "flat")
    _add_interface(root, plan, identifier, source_files)
    units, types, model_variables = _Units(), Element("TypeDefinitions"), Element("ModelVariables")
    enumerations = _Enumerations(types)
    for reference, variable in enumerate(variables):
        library = plan.libraries[plan.parts[variable.part].library]
        _add_variable(model_variables, reference, variable, library, units, enumerations)
    root.extend(place for place in (units.element(), types) if len(place))
    add_log_categories(root)
    times = plan.times
    SubElement(
        root,
        "DefaultExperiment",
        startTime=repr(times.start),
        stopTime=repr(times.stop),
        stepSize=repr(times.step),
    )
    root.append(model_variables)
    _add_structure(root, variables)
    return format_xml(root)


def _add_interface(root: Element, plan: ContainerPlan, identifier: str, source_files: Iterable[str]) -> None:
    flags = {
        "needsExecutionTool": any(x.file.has_capability("needsExecutionTool") for x in plan.libraries),
        "canHandleVariableCommunicationStepSize": False,
        "canInterpolateInputs": False,
        "canRunAsynchronuously": False,
        "canBeInstantiatedOnlyOncePerProcess": any(
            x.file.has_capability("canBeInstantiatedOnlyOncePerProcess") for x in plan.libraries
        ),
        "canNotUseMemoryManagementFunctions": True,
        "canGetAndSetFMUstate": plan.all_can("canGetAndSetFMUstate"),
        "canSerializeFMUstate": plan.all_can("canGetAndSetFMUstate") and plan.all_can("canSerializeFMUstate"),
        "providesDirectionalDerivative": False,
    }
    texts = {flag: "true" for flag, value in flags.items() if value}
    named = {"modelIdentifier": identifier, "maxOutputDerivativeOrder": "0"}
    element = SubElement(root, "CoSimulation", named | texts)
    listed = list(source_files)
    if listed:
        files = SubElement(element, "SourceFiles")
        for file in listed:
            SubElement(files, "File", name=file)


class _Units:
    """The units of all parts; a name that two FMUs define otherwise gets a number."""

    def __init__(self) -> None:
        self._units: dict[str, SiUnit] = {}
        self._displays: dict[str, dict[str, dict[str, str]]] = {}
        self._names: dict[tuple[str, str], str] = {}

    def name(self, unit: str, library: Library) -> str:
        """Return the name in the container of a unit of an FMU."""
        if (known := self._names.get((library.folder, unit))) is not None:
            return known
        defined = replace(library.file.interface.units.get(unit, SiUnit(unit)), name=unit)
        name, number = unit, 2
        while name in self._units and not self._units[name].measures_as(defined):
            name, number = f"{unit}_{number}", number + 1
        self._units[name] = replace(defined, name=name)
        displays = self._displays.setdefault(name, {})
        for definition in library.file.description.unitDefinitions:
            for display in definition.displayUnits if definition.name == unit else ():
                offset = {"offset": repr(float(display.offset))} if display.offset else {}
                displays.setdefault(str(display.name), {"factor": repr(float(display.factor))} | offset)
        self._names[library.folder, unit] = name
        return name

    def element(self) -> Element:
        """Return the definitions of all units that are in use."""
        definitions = Element("UnitDefinitions")
        for name in sorted(self._units):
            unit = add_unit(definitions, self._units[name])
            for display, values in self._displays[name].items():
                SubElement(unit, "DisplayUnit", {"name": display} | values)
        return definitions


class _Enumerations:
    """The enumerations of all parts, as `FMU.Type`."""

    def __init__(self, place: Element) -> None:
        self._place, self._known = place, set[str]()

    def name(self, own: ModelVariable, folder: str) -> str:
        """Return the name of the type of an Enumeration in the container."""
        declared: Any = own.declaredType
        name = f"{folder}.{declared.name}"
        if name not in self._known:
            self._known.add(name)
            element = SubElement(self._place, "SimpleType", name=name)
            items = SubElement(element, "Enumeration")
            for item in declared.items or ():
                texts = {"name": item.name, "value": item.value, "description": item.description}
                SubElement(items, "Item", {k: str(v) for k, v in texts.items() if v is not None})
        return name


def _add_variable(
    place: Element,
    reference: int,
    variable: ContainerVariable,
    library: Library,
    units: _Units,
    enumerations: _Enumerations,
) -> None:
    own, declared = variable.own, variable.own.declaredType
    attributes = {"name": variable.name, "valueReference": str(reference)}
    if own.description:
        attributes["description"] = own.description
    attributes |= {"causality": variable.causality, "variability": variable.variability}
    if variable.initial is not None:
        attributes["initial"] = variable.initial
    element = SubElement(place, "ScalarVariable", attributes)
    kind = SubElement(element, str(own.type))

    def attribute(name: str) -> Any:
        found = getattr(own, name, None)
        return getattr(declared, name, None) if found is None and declared is not None else found

    if own.type == "Enumeration":
        kind.set("declaredType", enumerations.name(own, library.folder))
    for name in ("quantity", "min", "max", "nominal"):
        if (value := attribute(name)) is not None and own.type not in ("Boolean", "String"):
            kind.set(name, str(value))
    if own.type == "Real":
        if (unit := attribute("unit")) is not None:
            kind.set("unit", units.name(str(unit), library))
            if (display := attribute("displayUnit")) is not None:
                kind.set("displayUnit", str(display))
        for name in ("relativeQuantity", "unbounded"):
            if attribute(name) in (True, "true"):
                kind.set(name, "true")
    starts = variable.causality == "input" or variable.initial in ("exact", "approx")
    if starts or variable.variability == "constant":
        kind.set("start", _start(variable))


def _start(variable: ContainerVariable) -> str:
    value, type_ = variable.start, variable.own.type
    if value is not None and not variable.changed:
        return str(value)  # as its FMU writes it
    if type_ == "String":
        return "" if value is None else str(value)
    if value is None:
        return "false" if type_ == "Boolean" else "0"
    if type_ == "Boolean":
        return "true" if value in (True, "true", "1", 1) else "false"
    return repr(float(value)) if type_ == "Real" else str(int(value))


def _add_structure(root: Element, variables: Sequence[ContainerVariable]) -> None:
    """Add outputs, which depend on no input at a communication point: an input acts from the next step on.

    Initial values may depend on all inputs and parameters, through the connections.
    """
    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, v in enumerate(variables, 1) if v.causality == "output"]
    if outputs:
        element = SubElement(structure, "Outputs")
        for i in outputs:
            SubElement(element, "Unknown", index=str(i), dependencies="")
    initial = [
        i
        for i, v in enumerate(variables, 1)
        if (v.causality == "output" and v.initial in ("approx", "calculated"))
        or v.causality == "calculatedParameter"
    ]
    if initial:
        element = SubElement(structure, "InitialUnknowns")
        for i in initial:
            SubElement(element, "Unknown", index=str(i))
