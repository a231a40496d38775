"""Units as FMI wants them: a name with its exponents of the SI base units."""

import math
import re
from dataclasses import dataclass, field

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

# exponents of the units that are written with a symbol of their own
_DERIVED: dict[str, dict[str, int]] = {
    "1": {},
    **{base: {base: 1} for base in BASE_UNITS},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
}
_TERM = re.compile(r"(1|[A-Za-z]+)(-?\d+)?")


@dataclass(frozen=True)
class Unit:
    """A coherent SI unit: its name and its exponents of the base units (zeros left out)."""

    name: str
    exponents: dict[str, int] = field(hash=False)


@dataclass(frozen=True)
class Quantity:
    """What a unit measures: its name in ISO 80000, and the unit that people like to read.

    A value in SI units times `factor` is the value in the display unit.
    """

    name: str
    display_unit: str | None = None
    factor: float = 1.0


QUANTITIES = {
    "m": Quantity("Length", "mm", 1e3),
    "m/s": Quantity("Velocity", "mm/s", 1e3),
    "m/s2": Quantity("Acceleration"),
    "rad": Quantity("Angle", "deg", 180.0 / math.pi),
    "rad/s": Quantity("AngularVelocity", "rpm", 30.0 / math.pi),
    "s": Quantity("Time"),
    "kg": Quantity("Mass"),
    "kg.m2": Quantity("MomentOfInertia"),
    "N": Quantity("Force", "kN", 1e-3),
    "N.m": Quantity("Torque"),
    "W": Quantity("Power", "kW", 1e-3),
    "V": Quantity("ElectricPotential"),
    "A": Quantity("ElectricCurrent"),
    "Ohm": Quantity("Resistance"),
    "H": Quantity("Inductance", "mH", 1e3),
    "Wb": Quantity("MagneticFlux", "mWb", 1e3),
}
"""Units that measure one thing only; of the others (1/s, kg.m) the variable's description tells."""


def per_second(name: str) -> str:
    """The unit of a time derivative: "m" gives "m/s", "m/s" gives "m/s2", "V" gives "V/s"."""
    numerator, _, denominator = name.partition("/")
    terms = denominator.strip("()").split(".") if denominator else []
    powers = {term.rstrip("0123456789"): int(re.sub(r"\D", "", term) or 1) for term in terms}
    powers["s"] = powers.get("s", 0) + 1
    divisor = ".".join(term if power == 1 else f"{term}{power}" for term, power in powers.items())
    return f"{numerator}/{divisor}" if len(powers) == 1 else f"{numerator}/({divisor})"


def parse_unit(name: str) -> Unit:
    """Read a unit written as in Modelica: "m/s2", "N.m.s/rad", "1/s".

    Raises ValueError for a symbol that is not a coherent SI unit.
    """
    total: dict[str, int] = dict.fromkeys(BASE_UNITS, 0)
    numerator, *denominators = name.replace("(", "").replace(")", "").split("/")
    if len(denominators) > 1:
        raise ValueError(f"the unit '{name}' has more than one '/'")
    for factor, product in ((1, numerator), *((-1, d) for d in denominators)):
        for term in product.split("."):
            match = _TERM.fullmatch(term)
            if match is None or match[1] not in _DERIVED:
                raise ValueError(f"'{term}' in the unit '{name}' is not a coherent SI unit")
            for base, exponent in _DERIVED[match[1]].items():
                total[base] += factor * exponent * int(match[2] or 1)
    return Unit(name, {base: exponent for base, exponent in total.items() if exponent})
