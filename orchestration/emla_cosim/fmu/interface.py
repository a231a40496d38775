"""What an FMU shows of itself: its variables and their units."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable, ValidationError

from ..errors import CommandError
from ..units import BASE_UNITS, Unit


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
    def units(self) -> dict[str, Unit]:
        """Units that the FMU defines, by name."""
        return {str(u.name): _unit(u) for u in self.description.unitDefinitions}

    def unit(self, name: str) -> Unit | None:
        """The unit of a variable; None where it has none.

        The unit of a difference, as of two temperatures, has no offset.
        """
        variable = self.variables[name]
        declared = variable.declaredType
        unit = variable.unit or (declared.unit if declared is not None else None)
        if not unit:
            return None
        found = self.units.get(unit, Unit(unit))
        relative = variable.relativeQuantity or (declared is not None and declared.relativeQuantity)
        return Unit(found.name, found.exponents, found.factor) if relative in (True, "true") else found


def read_interface(path: Path) -> Interface:
    """Read it from an FMU file; CommandError where that is missing, or nothing this master can run."""
    if not path.is_file():
        raise CommandError(f"there is no FMU file '{path}'.")
    try:
        description = fmpy.read_model_description(str(path))
    except ValidationError as error:
        raise CommandError(
            f"'{path}' is not a valid FMU: {'; '.join(error.problems)}. `fmpy validate` shows more."
        ) from error
    except Exception as error:  # fmpy raises whatever zip and XML readers raise
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    if description.fmiVersion != "2.0":
        raise CommandError(f"'{path}' is an FMI {description.fmiVersion} FMU; this master runs FMI 2.0.")
    if description.coSimulation is None:
        raise CommandError(f"'{path}' is for model exchange only; this master needs co-simulation.")
    return Interface(description)


def _unit(definition: Any) -> Unit:
    base = definition.baseUnit
    if base is None:
        return Unit(str(definition.name))
    exponents = tuple(int(getattr(base, b)) for b in BASE_UNITS)
    return Unit(str(definition.name), exponents, float(base.factor), float(base.offset))
