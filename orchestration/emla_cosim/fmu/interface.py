"""What an FMU shows of itself: its variables and their units."""

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable, ValidationError

from ..base.errors import CommandError
from ..base.units import BASE_UNITS, SiUnit
from .dependencies import Dependencies

_DESCRIPTION = "modelDescription.xml"
_LARGEST = 2**28
"""Bytes that a model description may have when unpacked."""


@dataclass(frozen=True)
class Interface:
    """The model description of an FMI 2.0 co-simulation FMU, by names."""

    description: ModelDescription

    @property
    def model_identifier(self) -> str:
        """The name of the FMU's library, without its ending."""
        means = self.description.coSimulation
        return str(means.modelIdentifier) if means is not None else ""

    @cached_property
    def variables(self) -> dict[str, ModelVariable]:
        """Variables by name."""
        return {str(v.name): v for v in self.description.modelVariables}

    @cached_property
    def units(self) -> dict[str, SiUnit]:
        """Units that the FMU defines, by name."""
        return {str(u.name): _unit(u) for u in self.description.unitDefinitions}

    @cached_property
    def direct(self) -> Dependencies:
        """What outputs depend on within one instant."""
        return Dependencies(self.description.outputs)

    @cached_property
    def initial(self) -> Dependencies:
        """What unknowns depend on in initialization mode."""
        return Dependencies(self.description.initialUnknowns)

    def is_settable(self, name: str) -> bool:
        """Whether a variable may get a start value."""
        variable = self.variables[name]
        free = variable.causality in ("parameter", "input") or variable.initial in ("exact", "approx")
        return free and variable.variability != "constant"

    def unit(self, name: str) -> SiUnit | None:
        """The unit of a variable; None where it has none.

        The unit of a difference, as of two temperatures, has no offset.
        """
        variable = self.variables[name]
        declared = variable.declaredType
        unit = variable.unit or (declared.unit if declared is not None else None)
        if not unit:
            return None
        found = self.units.get(unit, SiUnit(unit))
        relative = variable.relativeQuantity or (declared is not None and declared.relativeQuantity)
        return SiUnit(found.name, found.exponents, found.factor) if relative in (True, "true") else found


def read_interface(path: Path) -> Interface:
    """Read it from an FMU file; CommandError where that is missing, or nothing this master can run."""
    try:
        interface = read_description(path)
    except ValidationError as error:
        raise CommandError(
            f"'{path}' is not a valid FMU: {first_problem(error)} (`fmpy validate` shows more)."
        ) from error
    if (reason := explain_unsupported(interface)) is not None:
        raise CommandError(f"'{path}' {reason}.")
    for unit in interface.description.unitDefinitions:
        if unit.baseUnit is not None and not (math.isfinite(f := float(unit.baseUnit.factor)) and f != 0.0):
            raise CommandError(f"'{path}' has the unit '{unit.name}' with the factor {f:g}.")
    return interface


def read_description(path: Path, validate: bool = True) -> Interface:
    """What any FMU says of itself, of whatever version and kind.

    Raises CommandError for what is missing or unreadable, and, with `validate`, fmpy's ValidationError for
    what the standard does not allow.
    """
    try:
        present = path.is_file()
    except (OSError, ValueError):  # too long a name, or one that no file can have
        present = False
    if not present:
        raise CommandError(f"there is no FMU file '{path}'.")
    try:
        _check_size(path)
        description = fmpy.read_model_description(str(path), validate=validate)
        _mark_differences(description, path)
    except (CommandError, ValidationError, ImportError, MemoryError):
        raise
    except Exception as error:  # fmpy raises whatever zip and XML readers raise
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    return Interface(description)


def explain_unsupported(interface: Interface) -> str | None:
    """Why this master cannot run an FMU, as the end of a sentence; None where its kind is right."""
    description = interface.description
    if description.fmiVersion != "2.0":
        return f"is an FMI {description.fmiVersion} FMU; this master runs FMI 2.0"
    if description.coSimulation is None:
        return "is for model exchange only; this master needs co-simulation"
    return None


def read_interfaces(fmus: Mapping[str, Path]) -> dict[str, Interface]:
    """Those of several components, each file read once; CommandError as `read_interface`."""
    read = {file: read_interface(file) for file in dict.fromkeys(fmus.values())}
    return {name: read[file] for name, file in fmus.items()}


def _check_size(path: Path) -> None:
    """Raise CommandError for a model description that is missing, or too large to be one."""
    with zipfile.ZipFile(path) as archive:
        sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
    if _DESCRIPTION not in sizes:
        raise CommandError(f"'{path}' is not an FMU that can be read: it has no {_DESCRIPTION}.")
    if sizes[_DESCRIPTION] > _LARGEST:
        raise CommandError(f"the {_DESCRIPTION} of '{path}' is larger than {_LARGEST // 2**20} MiB.")


def _mark_differences(description: ModelDescription, path: Path) -> None:
    """Note which variables are differences; fmpy (0.3.32) overlooks that but for types."""
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # slow to load, and not always needed

    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read(_DESCRIPTION), etree.XMLParser(resolve_entities=False))
    variables = {v.name: v for v in description.modelVariables}
    for real in root.iterfind("ModelVariables/ScalarVariable/Real[@relativeQuantity]"):
        variable = variables[real.getparent().get("name")]
        variable.relativeQuantity = real.get("relativeQuantity") in ("true", "1")


def first_problem(error: ValidationError) -> str:
    """The first of several problems, in one line and without a full stop."""
    problems = error.problems
    return " ".join(problems[0].split()).rstrip(".") if problems else "it has problems"


def _unit(definition: Any) -> SiUnit:
    base = definition.baseUnit
    if base is None:
        return SiUnit(str(definition.name))
    exponents = tuple(int(getattr(base, b)) for b in BASE_UNITS)
    return SiUnit(str(definition.name), exponents, float(base.factor), float(base.offset))
