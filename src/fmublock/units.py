"""Units as FMI wants them: a name with its exponents of the SI base units."""

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
