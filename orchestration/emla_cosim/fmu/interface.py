"""The model description of an FMU: its variables and their units."""

import io
import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable, Unknown, ValidationError
from fmpy.validation import validate_model_description

from ..base.arrays import REAL, SignalType
from ..base.errors import CommandError, join_names, raise_machine_fault
from ..base.faults import ADVICE, is_lenient, note_fault
from ..base.units import SiUnit
from ..base.untrusted_xml import parse_xml
from .document import (
    DESCRIPTION,
    FmuDocument,
    describe_missing_variability,
    find_attribute_fault,
    list_variables_without_variability,
)
from .elements import (
    BINARY,
    CLOCK,
    WIDE,
    ElementVariable,
    declared_range,
    explain_unsupported_clock,
    is_supported,
    is_version_3,
    split_arrays,
)
from .units import FmuUnits

_BUILD = "sources/buildDescription.xml"
CO_SIMULATION, MODEL_EXCHANGE = "CoSimulation", "ModelExchange"
"""The kinds of an FMU, as the standard calls them."""

KINDS = {"cs": CO_SIMULATION, "me": MODEL_EXCHANGE}
"""The kinds by their names in options."""

_LARGEST = 2**28
"""The largest size of an unpacked model description in bytes."""


class Dependencies:
    """The dependencies of one list of unknowns, by names of variables."""

    def __init__(self, unknowns: Sequence[Unknown]) -> None:
        self._is_unlisted = not unknowns
        self._on_everything: set[str] = set()
        self._dependents: dict[str, set[str]] = {}
        for unknown in unknowns:
            if unknown.variable is None:
                continue
            name, knowns = str(unknown.variable.name), unknown.dependencies
            if knowns is None:
                self._on_everything.add(name)
            for dependency in knowns or ():
                self._dependents.setdefault(str(dependency.name), set()).add(name)

    def among(self, outputs: Set[str], known: str) -> Set[str]:
        """Return the outputs that depend on a known.

        Without a list of unknowns, all outputs depend on it. In a list, an output without an entry depends on
        nothing, and an output without declared dependencies depends on everything.

        Args:
            outputs: The names of the outputs to select from.
            known: The name of the known.
        """
        if self._is_unlisted:
            return outputs
        return (outputs & self._on_everything) | (outputs & self._dependents.get(known, set()))


@dataclass(frozen=True)
class Interface:
    """The model description of an FMU, by names; see `elements` for FMI 3.0.

    Attributes:
        description: The model description.
        clocks: Names of its Clock variables; `description` has them only if the FMU has event mode.
        without_value: Types of variables that cannot be set, by name: Clocks, Binary, arrays of Strings.
        structure: Values of structural parameters that differ from their start values, by name; arrays have
            the sizes that follow from them.
        inverse_units: Display units of FMI 3.0 that divide by the value, which a factor cannot convert.
    """

    description: ModelDescription
    clocks: tuple[str, ...] = ()
    without_value: Mapping[str, str] = field(default_factory=dict)
    structure: Mapping[str, int] = field(default_factory=dict)
    inverse_units: frozenset[str] = frozenset()

    @cached_property
    def kinds(self) -> dict[str, Any]:
        """Return fmpy's element for each kind that the FMU has; co-simulation is first."""
        elements = {
            CO_SIMULATION: self.description.coSimulation,
            MODEL_EXCHANGE: self.description.modelExchange,
        }
        return {kind: element for kind, element in elements.items() if element is not None}

    @property
    def tolerance(self) -> float | None:
        """Return the relative tolerance of the default experiment, None if it has no positive one."""
        experiment = self.description.defaultExperiment
        declared = None if experiment is None else experiment.tolerance
        try:
            tolerance = float(declared or math.nan)
        except ValueError:
            return None
        return tolerance if 0.0 < tolerance < math.inf else None

    @cached_property
    def variables(self) -> dict[str, ModelVariable]:
        """Return the variables by name."""
        return {str(v.name): v for v in self.description.modelVariables}

    @cached_property
    def units(self) -> FmuUnits:
        """Return the units that the FMU defines."""
        return FmuUnits(self.description, self.inverse_units)

    @cached_property
    def direct(self) -> Dependencies:
        """Return the dependencies of outputs at one instant."""
        return Dependencies(self.description.outputs)

    @cached_property
    def initial(self) -> Dependencies:
        """Return the dependencies of unknowns in initialization mode."""
        return Dependencies(self.description.initialUnknowns)

    def is_settable(self, name: str) -> bool:
        """Return whether a variable accepts a start value."""
        variable = self.variables[name]
        if variable.type in (CLOCK, BINARY):
            return False
        free = variable.causality in ("parameter", "input") or variable.initial in ("exact", "approx")
        return (free or self.is_structural(name)) and variable.variability != "constant"

    def is_structural(self, name: str) -> bool:
        """Return whether a variable is a structural parameter, which is set before initialization."""
        return self.variables[name].causality == "structuralParameter"

    @cached_property
    def sizes(self) -> frozenset[str]:
        """Return the names of the structural parameters that are sizes of arrays."""
        dimensions = (d for v in self.description.modelVariables for d in v.dimensions)
        return frozenset(str(d.variable.name) for d in dimensions if d.variable is not None)

    def signal_type(self, name: str) -> SignalType:
        """Return the type of a variable, with the names of an enumeration's values."""
        variable = self.variables[name]
        declared = variable.declaredType
        items = declared.items if variable.type == "Enumeration" and declared is not None else None
        return SignalType(str(variable.type), {int(str(i.value)): str(i.name) for i in items or ()})

    def column_type(self, name: str) -> SignalType:
        """Return the type of a variable in tables.

        It is Real for integers of more than 32 bits, and Integer for a Clock, which shows its ticks.
        """
        variable = self.variables[name]
        if variable.type == CLOCK:
            return SignalType("Integer")
        is_wide = isinstance(variable, ElementVariable) and variable.data_type in WIDE
        return REAL if is_wide else self.signal_type(name)

    def is_discrete(self, name: str) -> bool:
        """Return whether a variable holds its value between events: it is discrete, or is not a Real."""
        variable = self.variables[name]
        return variable.type != "Real" or variable.variability == "discrete"

    def unit(self, name: str) -> SiUnit | None:
        """Return the unit of a variable, None if it has none.

        The unit of a difference, such as of two temperatures, is marked as one.
        """
        variable = self.variables[name]
        declared = variable.declaredType
        unit = variable.unit or (declared.unit if declared is not None else None)
        if not unit:
            return None
        definition = self.units.find(unit)
        # a difference of 1 degC is one of 1 K: the offset does not count
        relative = variable.relativeQuantity or (declared is not None and declared.relativeQuantity)
        return (
            replace(definition, offset=0.0, is_difference=True) if relative in (True, "true") else definition
        )


def read_interface(path: Path, structure: Mapping[str, int] | None = None) -> Interface:
    """Read the model description of an FMU file.

    Violations of the standard that cannot change a result are accepted, others with the option `lenient`.

    Args:
        path: The FMU file.
        structure: Values of structural parameters; see `Interface`.

    Raises:
        CommandError: If the file does not exist, or this master cannot run it.
    """
    structure = structure or {}
    try:
        interface = read_description(path, structure=structure)
    except ValidationError as error:
        interface = _read_faulty(path, error, structure)
    if (reason := explain_unsupported(interface)) is not None:
        raise CommandError(f"'{path}' {reason}.")
    for unit in interface.description.unitDefinitions:
        if unit.baseUnit is not None and not (math.isfinite(f := float(unit.baseUnit.factor)) and f != 0.0):
            raise CommandError(
                f"'{path}' has the unit '{unit.name}' with the factor {f:g}; it must be finite and not 0."
            )
    if faults := list(_find_range_faults(interface)):
        note_fault(str(path), *faults)
    return interface


def _find_range_faults(interface: Interface) -> Iterator[str]:
    """Yield start values that the FMU itself declares out of range, and ranges without any value."""
    for name, variable in interface.variables.items():
        if variable.type not in ("Real", "Integer") or (variable.start is None and variable.min is None):
            continue
        low, high = declared_range(variable)
        if low > high:
            yield f"{name} has the minimum {low:g}, above its maximum of {high:g}"
            continue
        try:
            start = math.nan if variable.start is None else float(variable.start)
        except ValueError:  # a list, or not a number, which is another fault
            continue
        if start < low or start > high:
            limit = f"below its minimum of {low:g}" if start < low else f"above its maximum of {high:g}"
            yield f"{name} starts at {start:g}, {limit}"


def read_description(
    path: Path, validate: bool = True, structure: Mapping[str, int] | None = None
) -> Interface:
    """Read the model description of an FMU of any version and kind.

    Args:
        path: The FMU file.
        validate: Whether to check it against the standard. The variables of FMI 3.0 are split into elements
            only then, because the check needs them as they are.
        structure: Values of structural parameters; see `Interface`.

    Raises:
        CommandError: If the file does not exist or cannot be read.
        ValidationError: If `validate` finds a violation of the standard.
    """
    try:
        present = path.is_file()
    except (OSError, ValueError):  # an invalid or too long file name
        present = False
    if not present:
        raise CommandError(f"there is no FMU file '{path}'.")
    try:
        _check_size(path)
        try:
            description = read_with_fmpy(path, validate)
        except KeyError as error:  # fmpy (0.3.32) looks for the display units of an undefined unit
            if not validate:
                raise
            fault = find_attribute_fault(path)  # other exceptions of this kind
            raise ValidationError(
                [fault or "A display unit belongs to a unit that is not defined"]
            ) from error
        inverse_units = _complete_description(description, path)
        clocks = tuple(str(v.name) for v in description.modelVariables if v.type == "Clock")
        without_value = {
            str(v.name): f"array of {v.type}s" if v.shape else str(v.type)
            for v in (description.modelVariables if is_version_3(description) else ())
            if not is_supported(v)
        }
        if is_version_3(description) and validate:
            _split_arrays(description, path, structure or {})
    except (CommandError, ValidationError, ImportError, MemoryError):
        raise
    except Exception as error:  # zip and XML readers raise many types
        raise_machine_fault(error, f"'{path}'")
        if (fault := find_attribute_fault(path)) is not None:
            raise CommandError(f"'{path}' is not a valid FMU: {fault}.") from error
        text = str(error).rstrip(".")
        raise CommandError(f"'{path}' is not an FMU that can be read: {text}.") from error
    return Interface(description, clocks, without_value, structure or {}, inverse_units)


def read_with_fmpy(path: Path, validate: bool = True) -> ModelDescription:
    """Read a model description with fmpy, which (0.3.32) fails at some that are valid.

    Lists can have blanks at their ends and several between their entries, types of Binary variables can have
    attributes, and Clocks can have types.

    Parameters without `variability`, which the standard forbids, count as fixed.

    Args:
        path: The FMU file.
        validate: Whether to check it against the standard.

    Raises:
        ValidationError: If `validate` finds a violation of the standard.
    """
    try:
        return fmpy.read_model_description(str(path), validate=validate)
    except (ValidationError, MemoryError):
        raise
    except Exception:  # fmpy raises many types
        with zipfile.ZipFile(path) as archive:
            present = [name for name in (DESCRIPTION, _BUILD) if name in archive.namelist()]
            content = {name: archive.read(name) for name in present}
        root = parse_xml(content[DESCRIPTION])
        faults = list(_fix_parameters(root))
        if validate and faults:
            raise ValidationError(faults) from None
        if not _simplify(root) and not faults:
            raise
        from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # slow to import

        content[DESCRIPTION] = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
        copy = io.BytesIO()
        with zipfile.ZipFile(copy, "w") as archive:
            for name, text in content.items():
                archive.writestr(name, text)
        return fmpy.read_model_description(copy, validate=validate)


def _fix_parameters(root: Any) -> Iterator[str]:
    """Make parameters of FMI 2.0 without variability fixed, and yield what is wrong with them."""
    for variable in list_variables_without_variability(root):
        yield describe_missing_variability(variable)
        variable.set("variability", "fixed")


def _simplify(root: Any) -> bool:
    """Replace what fmpy cannot read by something with the same meaning; return whether anything changed."""
    is_changed = False
    for name in ("dependencies", "dependenciesKind", "clocks"):
        for element in root.iterfind(f".//*[@{name}]"):
            text = element.get(name)
            if text != (simple := " ".join(text.split())):
                element.set(name, simple)
                is_changed = True
    for element in root.iterfind("TypeDefinitions/BinaryType"):
        for name in ("mimeType", "maxSize"):
            is_changed = element.attrib.pop(name, None) is not None or is_changed
    types = {element.get("name") for element in root.iterfind("TypeDefinitions/ClockType")}
    for element in root.iterfind("ModelVariables/Clock"):
        if element.get("declaredType") in types:
            is_changed = element.attrib.pop("declaredType", None) is not None or is_changed
    return is_changed


_HARMLESS = re.compile(
    r"attribute 'generationDateAndTime'"
    r"|Element 'Annotation', attribute 'order'"  # Dymola 2023x writes it in FMI 3.0
    r"|^The unit .* is not defined"  # a connection that needs its definition is refused
    r"|^(The|A) display unit "
    r"|is of type (Integer|Boolean|String|Enumeration) and must have variability != \"continuous\""
)
"""Violations that cannot change a result."""


def _read_faulty(path: Path, error: ValidationError, structure: Mapping[str, int]) -> Interface:
    """Return the interface of an FMU that violates the standard.

    Raises:
        CommandError: If it cannot be read, or a violation is not accepted.
    """
    if (fault := find_attribute_fault(path)) is not None:
        raise CommandError(f"'{path}' is not a valid FMU: {fault}.") from error
    try:
        interface = read_description(path, validate=False, structure=structure)
        problems = [_join_lines(p) for p in (*error.problems, *_find_problems(interface.description))]
        _correct_booleans(interface.description)
        _check_numbers(interface)
    except MemoryError:
        raise
    except Exception as more:  # numbers and references that the schema would have found
        raise_machine_fault(more, f"'{path}'")
        text = _join_lines(error.problems[0]) if error.problems else "it has problems"
        raise CommandError(f"'{path}' is not a valid FMU: {text} (`emla verify` shows more).") from more
    if is_version_3(interface.description):
        try:
            _split_arrays(interface.description, path, structure)
        except ValueError as more:
            raise CommandError(f"'{path}' is not a valid FMU: {more}.") from more
    grave = [p for p in problems if not _HARMLESS.search(p)]
    if grave and not is_lenient():
        text = find_attribute_fault(path, fatal=False) or grave[0]
        raise CommandError(
            f"'{path}' is not a valid FMU: {text} (`emla verify` shows more). {ADVICE}."
        ) from error
    note_fault(str(path), *grave, *problems)
    return interface


def _find_problems(description: ModelDescription) -> list[str]:
    """Return what violates the standard in a description that was read without checks.

    Display units of undefined units are removed from it.
    """
    defined = {u.name for u in description.unitDefinitions}
    for variable in description.modelVariables:
        declared = variable.declaredType
        if (variable.unit or (declared.unit if declared is not None else None)) not in defined:
            variable.displayUnit = None  # fmpy (0.3.32) raises a KeyError
    return validate_model_description(description)


def _correct_booleans(description: ModelDescription) -> None:
    """Write start values of Booleans as the standard does: `true` for `True`; an empty one is none.

    Raise ValueError for any other text.
    """
    for variable in description.modelVariables:
        if variable.type == "Boolean" and variable.start is not None:
            words = str(variable.start).lower().split()
            wrong = [word for word in words if word not in ("true", "false", "1", "0")]
            if wrong:
                raise ValueError(f"the start value of {variable.name} is '{variable.start}', not a Boolean")
            variable.start = " ".join(words) or None


def _check_numbers(interface: Interface) -> None:
    """Raise an exception for numbers that are read later and that the schema would have checked."""
    if not all(kind.modelIdentifier for kind in interface.kinds.values()):
        raise ValueError("there is no model identifier")
    for unit in interface.units.by_name.values():
        math.isfinite(unit.factor)
    _ = interface.direct, interface.initial  # reads them
    for variable in interface.description.modelVariables:
        if variable.type in ("Real", "Integer"):
            for text in (variable.start, variable.min, variable.max):
                float(text if text is not None else 0.0)
    experiment = interface.description.defaultExperiment
    if experiment is not None:
        for name in ("startTime", "stopTime", "stepSize", "tolerance"):
            float(getattr(experiment, name) or 0.0)


def explain_unsupported(interface: Interface) -> str | None:
    """Return why this master cannot run an FMU, as the end of a message; None if it supports the kind."""
    description = interface.description
    if description.fmiVersion != "2.0" and not is_version_3(description):
        return f"is an FMI {description.fmiVersion} FMU; this master runs FMI 2.0 and 3.0"
    if not interface.kinds:
        return "is neither for co-simulation nor for Model Exchange"
    return explain_unsupported_kind(interface, next(iter(interface.kinds)))


def explain_unsupported_kind(interface: Interface, kind: str) -> str | None:
    """Return why an FMU cannot run as one of its kinds, as the end of a message; None if it can."""
    if kind == MODEL_EXCHANGE and interface.clocks:
        return f"has the clock '{interface.clocks[0]}', and clocks are supported for co-simulation only"
    return None


def read_interfaces(fmus: Mapping[str, Path]) -> dict[str, Interface]:
    """Return the model descriptions of several components, by component; each file is read once.

    Args:
        fmus: The FMU files by component.

    Raises:
        CommandError: As for `read_interface`.
    """
    read = {file: read_interface(file) for file in dict.fromkeys(fmus.values())}
    return {name: read[file] for name, file in fmus.items()}


def _check_size(path: Path) -> None:
    """Raise CommandError if the model description is missing or too large."""
    with zipfile.ZipFile(path) as archive:
        sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
    if DESCRIPTION not in sizes:
        raise CommandError(f"'{path}' is not an FMU that can be read: it has no {DESCRIPTION}.")
    if sizes[DESCRIPTION] > _LARGEST:
        raise CommandError(f"the {DESCRIPTION} of '{path}' is larger than {_LARGEST // 2**20} MiB.")


def _complete_description(description: ModelDescription, path: Path) -> frozenset[str]:
    """Mark variables that are differences, and FMI 3.0 FMUs that have directional derivatives; read limits.

    fmpy (0.3.32) reads the attribute for differences for types only, the flag of FMI 2.0 only, and no
    limits of unsigned integers.

    Returns:
        The names of display units that are inverse, which fmpy does not read.
    """
    root = FmuDocument(path).root
    if description.fmiVersion == "2.0" and root.find("ModelStructure/*/Unknown[@index='0']") is not None:
        # fmpy takes the last variable; `find_attribute_fault` names the place
        raise ValueError("an index is 0")
    variables = {v.name: v for v in description.modelVariables}
    for real in root.iterfind("ModelVariables/ScalarVariable/Real[@relativeQuantity]"):
        variable = variables[real.getparent().get("name")]
        variable.relativeQuantity = real.get("relativeQuantity") in ("true", "1")
    for unsigned in root.xpath("ModelVariables/*[starts-with(name(), 'UInt')]"):
        limited = variables[unsigned.get("name")]
        limited.min, limited.max = unsigned.get("min"), unsigned.get("max")
    for kind, element in Interface(description).kinds.items() if is_version_3(description) else ():
        flag = root.find(kind).get("providesDirectionalDerivatives")
        element.providesDirectionalDerivative = flag in ("true", "1")
    inverse = root.iterfind("UnitDefinitions/Unit/DisplayUnit[@inverse]")
    return frozenset(d.get("name") for d in inverse if d.get("inverse") in ("true", "1"))


def _split_arrays(description: ModelDescription, path: Path, structure: Mapping[str, int]) -> None:
    """Split the variables of FMI 3.0; CommandError if the FMU needs clocks that are not supported."""
    if (reason := explain_unsupported_clock(description)) is not None:
        raise CommandError(f"'{path}' {reason}.")
    co_simulation = description.coSimulation
    has_events = co_simulation is not None and bool(co_simulation.hasEventMode)
    try:
        split_arrays(description, structure, keep=(BINARY, CLOCK) if has_events else (BINARY,))
        _read_binary_attributes(description, path)
    except ValueError as error:
        if not structure:
            raise
        values = join_names([f"{name} = {value}" for name, value in structure.items()])
        raise CommandError(f"'{path}' cannot have {values}: {error}.") from error


def _read_binary_attributes(description: ModelDescription, path: Path) -> None:
    """Read meaning and largest size of Binary variables, which fmpy (0.3.32) does not read."""
    binary = {v.name: v for v in description.modelVariables if v.type == BINARY}
    if not binary:
        return
    for element in FmuDocument(path).root.iterfind("ModelVariables/Binary"):
        variable, most = binary.get(element.get("name")), element.get("maxSize")
        if isinstance(variable, ElementVariable):
            variable.mime_type = element.get("mimeType", "application/octet-stream")
            variable.most_bytes = None if most is None else int(most)


def _join_lines(problem: str) -> str:
    """Return a message in one line, without its full stop."""
    return " ".join(problem.split()).rstrip(".")
