"""The units that an FMU defines, and those in which it displays values."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import cached_property
from typing import Any

from fmpy.model_description import ModelDescription

from ..base.quantities import parse_quantity
from ..base.units import BASE_UNITS, SiUnit, define_display_unit


class FmuUnits:
    """The units of a model description.

    Args:
        description: The model description.
        inverse: Names of display units of FMI 3.0 that divide by the value, which a factor cannot convert.
    """

    def __init__(self, description: ModelDescription, inverse: Collection[str]) -> None:
        self._definitions = {str(u.name): u for u in description.unitDefinitions}
        self._inverse = inverse
        self._units: dict[str, SiUnit] = {}
        self._definer = f"the UnitDefinitions of the FMU '{description.modelName}'"

    @cached_property
    def by_name(self) -> dict[str, SiUnit]:
        """Units by name."""
        return {name: self._read_unit(name, d.baseUnit) for name, d in self._definitions.items()}

    @cached_property
    def everything(self) -> dict[str, SiUnit]:
        """Units and display units by name."""
        return {n: u for units in (*self._displayed.values(), self.by_name) for n, u in units.items()}

    def find(self, name: str) -> SiUnit:
        """Return the unit of this name, with all units of the FMU as its alternatives.

        It has no exponents if the FMU does not define it. Of display units with the same name, its own have
        precedence.
        """
        if name not in self._units:
            unit = self.by_name.get(name) or self._read_unit(name, None)
            alternatives = self.everything | self._displayed.get(name, {})
            self._units[name] = replace(unit, alternatives=alternatives)
        return self._units[name]

    def _read_unit(self, name: str, base: Any) -> SiUnit:
        if base is None:
            return SiUnit(name, definer=self._definer)
        exponents = tuple(int(getattr(base, b)) for b in BASE_UNITS)
        return SiUnit(name, exponents, float(base.factor), float(base.offset), definer=self._definer)

    @cached_property
    def _displayed(self) -> dict[str, dict[str, SiUnit]]:
        """Display units by the name of their unit, and by their own name."""
        return {
            name: {
                str(d.name): define_display_unit(
                    self.by_name[name], str(d.name), float(d.factor), float(d.offset)
                )
                for d in definition.displayUnits
                # those with the factor 0 could not be converted back
                if d.name not in self._inverse and float(d.factor)
            }
            for name, definition in self._definitions.items()
        }


def read_si_number(text: str, label: str, fmus: Iterable[FmuUnits]) -> float:
    """Return a quantity as a number in SI units, which keeps the order of quantities.

    Args:
        text: The text, in a unit of the project or of any FMU.
        label: What error messages call the quantity.
        fmus: The units of the FMUs.

    Raises:
        CommandError: If it is not a number with or without a unit.
    """
    units = {name: unit for fmu in fmus for name, unit in fmu.everything.items()}
    return parse_quantity(text, label, SiUnit("", alternatives=units)).si_number
