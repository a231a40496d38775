"""modelDescription.xml of a system (FMI 2.0.4, section 2.2)."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from fmpy.model_description import ModelVariable, Unit

from fmublock.description import BUILD_TIME, LOG_CATEGORIES

from ..base.version import __version__
from .plan import ContainerPlan
from .variables import ContainerVariable

_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


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
    structured = all(f.file.description.variableNamingConvention == "structured" for f in plan.libraries)
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=guid,
        description=description,
        generationTool=f"EMLA-Cosim {__version__}",
        generationDateAndTime=BUILD_TIME,
        variableNamingConvention="structured" if structured else "flat",
        numberOfEventIndicators="0",
    )
    _add_interface(root, plan, identifier, source_files)
    units = _Units()
    units_place, types_place = Element("UnitDefinitions"), Element("TypeDefinitions")
    enumerations = _Enumerations(types_place)
    model_variables = Element("ModelVariables")
    for reference, variable in enumerate(variables):
        file = plan.libraries[plan.parts[variable.part].library].file
        defined = {str(u.name): u for u in file.description.unitDefinitions}
        folder = plan.libraries[plan.parts[variable.part].library].folder
        _add_variable(model_variables, reference, variable, units.names(defined), enumerations, folder)
    units.write(units_place)
    root.extend(place for place in (units_place, types_place) if len(place))
    categories = SubElement(root, "LogCategories")
    for category, text in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=category, description=text)
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
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def _add_interface(root: Element, plan: ContainerPlan, identifier: str, source_files: Iterable[str]) -> None:
    flags = {
        "needsExecutionTool": any(x.file.has_capability("needsExecutionTool") for x in plan.libraries),
        "canHandleVariableCommunicationStepSize": False,
        "canInterpolateInputs": False,
        "canRunAsynchronuously": False,
        "canBeInstantiatedOnlyOncePerProcess": any(x.once for x in plan.libraries),
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
        self._defined: dict[str, tuple[Any, Unit]] = {}

    def names(self, defined: Mapping[str, Unit]) -> "_UnitNames":
        """Return the names in the container of the units of one FMU."""
        return _UnitNames(self, defined)

    def name(self, unit: Unit) -> str:
        """Return the name of a unit in the container."""
        meaning, name, number = _meaning(unit), str(unit.name), 2
        while name in self._defined and self._defined[name][0] != meaning:
            name, number = f"{unit.name}_{number}", number + 1
        self._defined[name] = meaning, unit
        return name

    def write(self, place: Element) -> None:
        """Write all units that are in use."""
        for name in sorted(self._defined):
            unit = self._defined[name][1]
            element = SubElement(place, "Unit", name=name)
            if unit.baseUnit is not None:
                SubElement(element, "BaseUnit", _base_unit(unit))
            for display in unit.displayUnits:
                offset = {} if not display.offset else {"offset": repr(float(display.offset))}
                factor = repr(float(display.factor))
                SubElement(element, "DisplayUnit", {"name": str(display.name), "factor": factor, **offset})


class _UnitNames:
    def __init__(self, units: _Units, defined: Mapping[str, Unit]) -> None:
        self._units, self._defined = units, defined

    def of(self, name: str | None) -> str | None:
        """Return the name in the container of a unit; None if the FMU does not define it."""
        return self._units.name(self._defined[name]) if name and name in self._defined else None


def _base_unit(unit: Unit) -> dict[str, str]:
    base: Any = unit.baseUnit
    exponents = {k: str(int(getattr(base, k))) for k in _EXPONENTS if int(getattr(base, k) or 0)}
    factor, offset = float(base.factor or 1.0), float(base.offset or 0.0)
    return (
        exponents
        | ({"factor": repr(factor)} if factor != 1.0 else {})
        | ({"offset": repr(offset)} if offset != 0.0 else {})
    )


def _meaning(unit: Unit) -> Any:
    displays = tuple((d.name, float(d.factor), float(d.offset or 0.0)) for d in unit.displayUnits)
    return None if unit.baseUnit is None else tuple(sorted(_base_unit(unit).items())), displays


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
                texts = {"name": str(item.name), "value": str(item.value)}
                SubElement(
                    items, "Item", texts | ({"description": item.description} if item.description else {})
                )
        return name


def _add_variable(
    place: Element,
    reference: int,
    variable: ContainerVariable,
    units: _UnitNames,
    enumerations: _Enumerations,
    folder: str,
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
        kind.set("declaredType", enumerations.name(own, folder))
    for name in ("quantity", "min", "max", "nominal"):
        if (value := attribute(name)) is not None and own.type not in ("Boolean", "String"):
            kind.set(name, str(value))
    if own.type == "Real":
        if (unit := units.of(attribute("unit"))) is not None:
            kind.set("unit", unit)
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
