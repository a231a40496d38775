"""Units by their names: exponents for the FMI, rates, display units, and a comparison with pint."""

import math

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmublock.units import (
    _AMBIGUOUS,
    _NOT_PREFIXABLE,
    _PREFIXABLE,
    _PREFIXES,
    BASE_UNITS,
    QUANTITIES,
    find_unit,
    parse_unit,
)
from fmublock.variables import per_second

PINT = pint.UnitRegistry()
PINT_NAMES = {
    "kg": "kilogram",
    "Ohm": "ohm",
    "Ω": "ohm",
    "rev": "turn",
    "rpm": "rpm",
    "°": "degree",
    "%": "percent",
    "lbm": "pound",
    "ozm": "ounce",
    "Nm": "newton * meter",
    "RPM": "rpm",
    "krpm": "kilorpm",
    "kRPM": "kilorpm",
    "Ncm": "newton * centimeter",
    "Nmm": "newton * millimeter",
    "U/min": "rpm",
    "Grad": "degree",
    "kp": "kilogram_force",
}
SPOKEN = [name for name in _PREFIXABLE if name not in _AMBIGUOUS]


@pytest.mark.parametrize(
    "symbol",
    [
        n
        for n in (*_PREFIXABLE, *_NOT_PREFIXABLE)
        if not n.startswith(("deg", "delta")) and n not in ("°C", "°F")
    ],
)
def test_units_match_pint(symbol: str) -> None:
    existing = {**_PREFIXABLE, **_NOT_PREFIXABLE}[symbol]
    if symbol in ("Hz", "kHz", "MHz"):  # which pint takes for radians per second
        assert existing.exponents == _NOT_PREFIXABLE["Hz"].exponents
        return
    if symbol in ("cycle", "cycles"):  # which pint takes for a turn
        assert existing.powers == {} and existing.factor == 1.0
        return
    quantity = PINT.Quantity(1.0, PINT_NAMES.get(symbol, symbol)).to_base_units()
    dimensions = {"[mass]": 0, "[length]": 1, "[time]": 2, "[current]": 3, "[temperature]": 4}
    dimensions |= {"[substance]": 5, "[luminosity]": 6}
    actual = [0.0] * len(BASE_UNITS)
    for name, power in quantity.dimensionality.items():
        actual[dimensions[name]] = power
    assert tuple(actual[:-1]) == existing.exponents[:-1]
    assert existing.factor == pytest.approx(quantity.magnitude, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "exponents", "factor"),
    [
        ("kg.m2/(s2.A)", {"kg": 1, "m": 2, "s": -2, "A": -1}, 1.0),
        ("N*m", {"kg": 1, "m": 2, "s": -2}, 1.0),
        ("mN.mm/deg", {"kg": 1, "m": 2, "s": -2, "rad": -1}, 1e-6 * 180 / math.pi),
        ("m/s^2", {"m": 1, "s": -2}, 1.0),
        ("s-1", {"s": -1}, 1.0),
        ("1/min", {"s": -1}, 1 / 60),
        ("kW.h", {"kg": 1, "m": 2, "s": -2}, 3.6e6),
        ("%/m", {"m": -1}, 1e-2),
        ("1", {}, 1.0),
    ],
)
def test_names(name: str, exponents: dict[str, int], factor: float) -> None:
    actual = find_unit(name)
    assert actual is not None
    assert dict(zip(BASE_UNITS, actual.exponents, strict=True)) == {
        **dict.fromkeys(BASE_UNITS, 0),
        **exponents,
    }
    assert actual.factor == pytest.approx(factor, rel=1e-14)


SAY_NOTHING = ["", "xNm", "C", "g", "foo", "m/", "/s", "m//s", "m/s/s", "(m", "m)", "m.", "Euro/PersonYear"]
SAY_NOTHING += ["kt", "mt", "dt", "ha", "ma", "kyr", "delta_m", "°K"]
SAY_NOTHING += ["m 2", "m200", "(" * 50 + "m", "m." * 5000 + "m", "m99.m99.Tm99.Tm99", "\x00", "µ"]
SAY_NOTHING += ["kkg", "²", "m²", "٣", "m٣"]


@pytest.mark.parametrize("name", SAY_NOTHING)
def test_unknown_and_ambiguous_names_have_no_unit(name: str) -> None:
    assert find_unit(name) is None


@given(st.text(max_size=60))
def test_any_text_is_a_unit_or_none(text: str) -> None:
    actual = find_unit(text)
    assert actual is None or (math.isfinite(actual.factor) and actual.factor > 0.0)


symbols = st.tuples(
    st.sampled_from(["", *_PREFIXES]), st.sampled_from(SPOKEN), st.integers(-3, 3).filter(bool)
)


@given(st.lists(symbols, min_size=1, max_size=4), symbols)
def test_products_multiply(parts: list[tuple[str, str, int]], below: tuple[str, str, int]) -> None:
    """The meaning of a whole name is the product of those of its parts, as far as each has one."""

    def written(prefix: str, symbol: str, power: int) -> str:
        return f"{prefix}{symbol}{power}"

    name = ".".join(written(*part) for part in parts) + f"/{written(*below)}"
    actual = find_unit(name)
    single = [find_unit(f"{prefix}{symbol}.s/s") for prefix, symbol, _ in (*parts, below)]
    if any(unit is None for unit in single):
        assert actual is None
        return
    assert actual is not None
    powers = [power for _, _, power in parts] + [-below[2]]
    factor = math.prod(unit.factor**power for unit, power in zip(single, powers, strict=True) if unit)
    assert actual.factor == pytest.approx(factor, rel=1e-9)
    for k in range(len(BASE_UNITS)):
        assert actual.exponents[k] == sum(
            unit.exponents[k] * power for unit, power in zip(single, powers, strict=True) if unit
        )


@pytest.mark.parametrize(("name", "boiling_water"), [("degC", 100.0), ("degF", 212.0)])
def test_temperatures_have_offsets(name: str, boiling_water: float) -> None:
    unit = find_unit(name)
    assert unit is not None
    assert unit.factor * boiling_water + unit.offset == pytest.approx(373.15)


# ---- units of blocks, which are products of coherent SI units


@pytest.mark.parametrize(
    ("name", "powers", "rate"),
    [
        ("m/s", {"m": 1, "s": -1}, "m/s2"),
        ("A", {"A": 1}, "A/s"),
        ("1", {}, "1/s"),
        ("1/s", {"s": -1}, "1/s2"),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, "N.m.s/(rad.s)"),
        ("J/(kg.K)", {"m": 2, "s": -2, "K": -1}, "J/(kg.K.s)"),
    ],
)
def test_units_of_blocks_and_of_their_rates(name: str, powers: dict[str, int], rate: str) -> None:
    assert parse_unit(name).powers == powers
    assert per_second(name) == rate
    assert parse_unit(rate).powers == {**powers, "s": powers.get("s", 0) - 1}


@pytest.mark.parametrize("name", ["furlong", "m//s", "m/s/s", "N/(m/s)", "mm", "degC", "", "m2.5"])
def test_other_units_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"unit"):
        parse_unit(name)


def test_quantities_have_units_and_different_names() -> None:
    assert len({q.name for q in QUANTITIES.values()}) == len(QUANTITIES)
    for unit, quantity in QUANTITIES.items():
        assert parse_unit(unit).name == unit
        display = find_unit(quantity.display_unit or unit)
        assert display is not None
        assert quantity.factor * display.factor == pytest.approx(1.0, rel=1e-15)
