"""modelDescription.xml of a system (FMI 2.0.4, section 2.2; FMI 3.0.1, section 2.4)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from fmpy.model_description import ModelVariable

from fmublock.description import FMI3_TYPES, add_log_categories, add_unit, describe_model, format_xml
from fmublock.recipe import Producer
from fmublock.units import parse_unit

from ..base.errors import CommandError
from ..base.units import SiUnit
from ..base.version import __version__
from ..fmu.elements import declared_type
from .plan import ContainerPlan, Library
from .variables import ContainerVariable, choose_time_name


def describe_container(
    plan: ContainerPlan,
    name: str,
    identifier: str,
    description: str,
    guid: str,
    variables: Sequence[ContainerVariable],
    source_files: Iterable[str],
    fmi: int,
) -> bytes:
    """Return the model description for a version of FMI as UTF-8 XML."""
    root = describe_model(name, description, Producer(f"EMLA-Cosim {__version__}"), guid, fmi)
    # names of a component that are not structured stay as they are
    if any(x.file.description.variableNamingConvention != "structured" for x in plan.libraries):
        root.set("variableNamingConvention", "flat")
    interface = SubElement(root, "CoSimulation", _list_interface_attributes(plan, identifier, fmi))
    source_paths = list(source_files) if fmi == 2 else []
    if source_paths:  # not if libraries are carried along, which sources alone do not make
        source_list = SubElement(interface, "SourceFiles")
        for file in source_paths:
            SubElement(source_list, "File", name=file)
    units, types, model_variables = _Units(), Element("TypeDefinitions"), Element("ModelVariables")
    enumerations = _Enumerations(types, fmi)
    for reference, variable in enumerate(variables):
        library = plan.libraries[plan.parts[variable.part].library]
        attributes = _list_attributes(reference, variable)
        if fmi == 3:
            declared = declared_type(variable.origin)
            kind = SubElement(model_variables, FMI3_TYPES.get(declared, declared), attributes)
        else:
            element = SubElement(model_variables, "ScalarVariable", attributes)
            kind = SubElement(element, str(variable.origin.type))
        _set_type_attributes(kind, variable, library, units, enumerations)
        _set_start(kind, variable, fmi)
        if fmi == 2 and variable.origin.type == "Integer":
            _fit_into_integer(kind, variable)
    if fmi == 3:
        _add_time_variable(model_variables, choose_time_name(variables), units)
    root.extend(section for section in (units.element(), types) if len(section))
    add_log_categories(root, fmi)
    times = plan.times
    SubElement(
        root,
        "DefaultExperiment",
        startTime=repr(times.start),
        stopTime=repr(times.stop),
        stepSize=repr(times.step),
    )
    root.append(model_variables)
    _add_structure(root, variables, fmi)
    return format_xml(root)


def _list_interface_attributes(plan: ContainerPlan, identifier: str, fmi: int) -> dict[str, str]:
    """Return the attributes of CoSimulation.

    Other abilities are left out, and so false: the host's steps are whole numbers of the system's steps,
    inputs have no derivatives, and directional derivatives are zero because an input acts from the next step
    on.
    """
    state, has_states = "State" if fmi == 3 else "state", plan.all_can("canGetAndSetFMUstate")
    flags = {
        "needsExecutionTool": plan.any_has("needsExecutionTool"),
        "canBeInstantiatedOnlyOncePerProcess": plan.any_has("canBeInstantiatedOnlyOncePerProcess"),
        "canNotUseMemoryManagementFunctions": fmi == 2,
        f"canGetAndSetFMU{state}": has_states,
        # the standard allows serializing only with saved states
        f"canSerializeFMU{state}": has_states and plan.all_can("canSerializeFMUstate"),
    }
    attributes = {"modelIdentifier": identifier}
    if fmi == 2:
        attributes["maxOutputDerivativeOrder"] = "0"
    attributes |= {flag: "true" for flag, value in flags.items() if value}
    if fmi == 3:  # a host can use a multiple of this step only
        attributes["fixedInternalStepSize"] = repr(plan.times.step)
    return attributes


class _Units:
    """The units of all parts; a name that two FMUs define otherwise gets a number."""

    def __init__(self) -> None:
        self._units: dict[str, SiUnit] = {}
        self._displays: dict[str, dict[str, dict[str, str]]] = {}
        self._names: dict[tuple[str, str], str] = {}

    def name(self, unit: str, library: Library) -> str:
        """Return the name in the container of a unit of an FMU; the first call adds it."""
        if (existing := self._names.get((library.folder, unit))) is not None:
            return existing
        defined = replace(library.file.interface.units.find(unit), name=unit)
        name = self.add(defined)
        displays = self._displays.setdefault(name, {})
        for definition in library.file.description.unitDefinitions:
            for display in definition.displayUnits if definition.name == unit else ():
                offset = {"offset": repr(float(display.offset))} if display.offset else {}
                # of two FMUs with the same unit, the first one defines how it is displayed
                displays.setdefault(str(display.name), {"factor": repr(float(display.factor))} | offset)
        self._names[library.folder, unit] = name
        return name

    def add(self, unit: SiUnit) -> str:
        """Add a unit of no FMU, and return its name in the container."""
        name, number = unit.name, 2
        while name in self._units and not self._units[name].measures_as(unit):
            name, number = f"{unit.name}_{number}", number + 1
        self._units.setdefault(name, replace(unit, name=name))
        return name

    def element(self) -> Element:
        """Return the definitions of all units that are in use."""
        definitions = Element("UnitDefinitions")
        for name in sorted(self._units):
            unit = add_unit(definitions, self._units[name])
            for display, values in self._displays.get(name, {}).items():
                SubElement(unit, "DisplayUnit", {"name": display} | values)
        return definitions


class _Enumerations:
    """The enumerations of all parts, as `FMU.Type`."""

    def __init__(self, parent: Element, fmi: int) -> None:
        self._parent, self._fmi, self._names_so_far = parent, fmi, set[str]()

    def name(self, variable: ModelVariable, folder: str) -> str:
        """Return the name of the type of an Enumeration in the container; the first call adds the type."""
        declared: Any = variable.declaredType
        name = f"{folder}.{declared.name}"  # two FMUs may define different types of one name
        if name not in self._names_so_far:
            self._names_so_far.add(name)
            if self._fmi == 3:
                items = SubElement(self._parent, "EnumerationType", name=name)
            else:
                items = SubElement(SubElement(self._parent, "SimpleType", name=name), "Enumeration")
            for item in declared.items or ():
                texts = {"name": item.name, "value": item.value, "description": item.description}
                SubElement(items, "Item", {k: str(v) for k, v in texts.items() if v is not None})
        return name


def _list_attributes(reference: int, variable: ContainerVariable) -> dict[str, str]:
    """Return the attributes of a variable that do not depend on its type."""
    origin = variable.origin
    attributes = {"name": variable.name, "valueReference": str(reference)}
    if origin.description:
        attributes["description"] = origin.description
    attributes |= {"causality": variable.causality, "variability": variable.variability}
    if variable.initial is not None:
        attributes["initial"] = variable.initial
    return attributes


def _set_type_attributes(
    kind: Element, variable: ContainerVariable, library: Library, units: _Units, enumerations: _Enumerations
) -> None:
    """Set unit, range and other attributes of the type of a variable."""
    origin, declared = variable.origin, variable.origin.declaredType

    def attribute(name: str) -> Any:
        value = getattr(origin, name, None)
        return getattr(declared, name, None) if value is None and declared is not None else value

    if origin.type == "Enumeration":
        kind.set("declaredType", enumerations.name(origin, library.folder))
    for name in ("quantity", "min", "max", "nominal"):
        if (value := attribute(name)) is not None and origin.type not in ("Boolean", "String"):
            kind.set(name, str(value))
    if origin.type == "Real":
        if (unit := attribute("unit")) is not None:
            kind.set("unit", units.name(str(unit), library))
            if (display := attribute("displayUnit")) is not None:
                kind.set("displayUnit", str(display))
        for name in ("relativeQuantity", "unbounded"):
            if attribute(name) in (True, "true"):
                kind.set(name, "true")


def _set_start(kind: Element, variable: ContainerVariable, fmi: int) -> None:
    """Set the start value, if a variable has one."""
    starts = variable.causality == "input" or variable.initial in ("exact", "approx")
    if not starts and variable.variability != "constant":
        return
    if fmi == 3 and variable.origin.type == "String":
        SubElement(kind, "Start", value=_format_start(variable))
    else:
        kind.set("start", _format_start(variable))


def _fit_into_integer(kind: Element, variable: ContainerVariable) -> None:
    """Check the start value of an Integer of FMI 2.0, and leave out limits that it cannot reach.

    Raises:
        CommandError: The part has a wider type, and this start value does not fit.
    """
    for name in ("min", "max", "start"):
        text = kind.get(name)
        if text is None or -(2**31) <= int(text) < 2**31:
            continue
        if name == "start":
            raise CommandError(
                f"{variable.name} = {text} does not fit into an Integer of FMI 2.0; use --fmi 3.",
                variable=variable.name,
            )
        del kind.attrib[name]


def _add_time_variable(parent: Element, name: str, units: _Units) -> None:
    """Add the time as a variable, which FMI 3.0 requires."""
    attributes = {"name": name, "valueReference": str(len(parent)), "description": "Time"}
    attributes |= {"causality": "independent", "variability": "continuous"}
    SubElement(parent, "Float64", attributes, unit=units.add(parse_unit("s")))


def _format_start(variable: ContainerVariable) -> str:
    """Return the start value as XML has it; one that FMU and system leave out is 0, false or empty."""
    value, type_ = variable.start, variable.origin.type
    if value is not None and not variable.is_overridden:
        return str(value)  # as its FMU writes it
    if type_ == "String":
        return "" if value is None else str(value)
    if value is None:
        return "false" if type_ == "Boolean" else "0"
    if type_ == "Boolean":
        return "true" if value in (True, "true", "1", 1) else "false"
    return repr(float(value)) if type_ == "Real" else str(int(value))


def _add_structure(root: Element, variables: Sequence[ContainerVariable], fmi: int) -> None:
    """Add outputs. They depend on no input at a communication point: an input acts from the next step on.

    Outputs that are not signals, such as Strings, are read from their part at once and may depend on
    anything. So may initial values, through the connections.
    """
    structure = SubElement(root, "ModelStructure")
    # without the attribute, an unknown may depend on everything
    outputs = {
        reference: {"dependencies": ""} if variable.signal >= 0 else {}
        for reference, variable in enumerate(variables)
        if variable.causality == "output"
    }
    initial = {reference: {} for reference, variable in enumerate(variables) if _is_initial_unknown(variable)}
    for kind, unknowns in (("Output", outputs), ("InitialUnknown", initial)):
        if fmi == 3:
            for reference, attributes in unknowns.items():
                SubElement(structure, kind, {"valueReference": str(reference)} | attributes)
        elif unknowns:
            group = SubElement(structure, f"{kind}s")
            for reference, attributes in unknowns.items():
                SubElement(group, "Unknown", {"index": str(reference + 1)} | attributes)


def _is_initial_unknown(variable: ContainerVariable) -> bool:
    is_computed = variable.causality == "output" and variable.initial in ("approx", "calculated")
    return is_computed or variable.causality == "calculatedParameter"
