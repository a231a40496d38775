"""Units by their names: exponents for the FMI, rates, display units, and a comparison with pint."""

import math

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmublock.units import (
    _ALONE,
    _AMBIGUOUS,
    _COHERENT,
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
    "U/min": "rpm",
    "Grad": "degree",
    "kp": "kilogram_force",
}
SPOKEN = [name for name in _COHERENT if name not in _AMBIGUOUS]


@pytest.mark.parametrize(
    "symbol", [n for n in (*_COHERENT, *_ALONE) if "deg" not in n and n not in ("°C", "°F")]
)
def test_units_are_those_of_pint(symbol: str) -> None:
    known = {**_COHERENT, **_ALONE}[symbol]
    if symbol in ("Hz", "kHz", "MHz"):  # which pint takes for radians per second
        assert known.exponents == _ALONE["Hz"].exponents
        return
    quantity = PINT.Quantity(1.0, PINT_NAMES.get(symbol, symbol)).to_base_units()
    dimensions = {"[mass]": 0, "[length]": 1, "[time]": 2, "[current]": 3, "[temperature]": 4}
    dimensions |= {"[substance]": 5, "[luminosity]": 6}
    found = [0.0] * len(BASE_UNITS)
    for name, power in quantity.dimensionality.items():
        found[dimensions[name]] = power
    assert tuple(found[:-1]) == known.exponents[:-1]
    assert known.factor == pytest.approx(quantity.magnitude, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "exponents", "factor"),
    [
        ("kg.m2/s", {"kg": 1, "m": 2, "s": -1}, 1.0),
        ("kg.m2/(s2.A)", {"kg": 1, "m": 2, "s": -2, "A": -1}, 1.0),
        ("mm", {"m": 1}, 1e-3),
        ("kN", {"kg": 1, "m": 1, "s": -2}, 1e3),
        ("N.m", {"kg": 1, "m": 2, "s": -2}, 1.0),
        ("N*m", {"kg": 1, "m": 2, "s": -2}, 1.0),
        ("mN.mm/deg", {"kg": 1, "m": 2, "s": -2, "rad": -1}, 1e-6 * 180 / math.pi),
        ("m/s2", {"m": 1, "s": -2}, 1.0),
        ("m/s^2", {"m": 1, "s": -2}, 1.0),
        ("s-1", {"s": -1}, 1.0),
        ("1/min", {"s": -1}, 1 / 60),
        ("km/h", {"m": 1, "s": -1}, 1 / 3.6),
        ("cm2", {"m": 2}, 1e-4),
        ("bar/s", {"kg": 1, "m": -1, "s": -3}, 1e5),
        ("kW.h", {"kg": 1, "m": 2, "s": -2}, 3.6e6),
        ("W/(m2.K)", {"kg": 1, "s": -3, "K": -1}, 1.0),
        ("%/m", {"m": -1}, 1e-2),
        ("1", {}, 1.0),
    ],
)
def test_names(name: str, exponents: dict[str, int], factor: float) -> None:
    found = find_unit(name)
    assert found is not None
    assert dict(zip(BASE_UNITS, found.exponents, strict=True)) == {
        **dict.fromkeys(BASE_UNITS, 0),
        **exponents,
    }
    assert found.factor == pytest.approx(factor, rel=1e-14)


SAY_NOTHING = ["", "xNm", "C", "g", "foo", "m/", "/s", "m//s", "m/s/s", "(m", "m)", "m.", "Euro/PersonYear"]
SAY_NOTHING += ["m 2", "m200", "°C/W", "(" * 50 + "m", "m." * 5000 + "m", "m99.m99.Tm99.Tm99", "\x00", "µ"]
SAY_NOTHING += ["kkg", "²", "m²", "٣", "m٣"]


@pytest.mark.parametrize("name", SAY_NOTHING)
def test_unknown_and_ambiguous_names_have_no_unit(name: str) -> None:
    assert find_unit(name) is None


@given(st.text(max_size=60))
def test_any_text_is_a_unit_or_none(text: str) -> None:
    found = find_unit(text)
    assert found is None or (math.isfinite(found.factor) and found.factor > 0.0)


symbols = st.tuples(
    st.sampled_from(["", *_PREFIXES]), st.sampled_from(SPOKEN), st.integers(-3, 3).filter(bool)
)


@given(st.lists(symbols, min_size=1, max_size=4), symbols)
def test_products_multiply(parts: list[tuple[str, str, int]], below: tuple[str, str, int]) -> None:
    """The meaning of a whole name is the product of those of its parts, as far as each has one."""

    def written(prefix: str, symbol: str, power: int) -> str:
        return f"{prefix}{symbol}{power}"

    name = ".".join(written(*part) for part in parts) + f"/{written(*below)}"
    found = find_unit(name)
    single = [find_unit(f"{prefix}{symbol}.s/s") for prefix, symbol, _ in (*parts, below)]
    if any(one is None for one in single):
        assert found is None
        return
    assert found is not None
    powers = [power for _, _, power in parts] + [-below[2]]
    factor = math.prod(one.factor**power for one, power in zip(single, powers, strict=True) if one)
    assert found.factor == pytest.approx(factor, rel=1e-9)
    for k in range(len(BASE_UNITS)):
        assert found.exponents[k] == sum(
            one.exponents[k] * power for one, power in zip(single, powers, strict=True) if one
        )


def test_temperatures_have_offsets() -> None:
    celsius, fahrenheit = find_unit("degC"), find_unit("degF")
    assert celsius is not None
    assert fahrenheit is not None
    assert celsius.factor * 100.0 + celsius.offset == pytest.approx(373.15)
    assert fahrenheit.factor * 212.0 + fahrenheit.offset == pytest.approx(373.15)


# ---- units of blocks, which are products of coherent SI units


@pytest.mark.parametrize(
    ("name", "exponents"),
    [
        ("m/s2", {"m": 1, "s": -2}),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("Ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("Wb", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("1/s", {"s": -1}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("J/(kg.K)", {"m": 2, "s": -2, "K": -1}),
        ("1", {}),
    ],
)
def test_known_units(name: str, exponents: dict[str, int]) -> None:
    assert parse_unit(name).powers == exponents


@pytest.mark.parametrize("name", ["furlong", "m//s", "m/s/s", "N/(m/s)", "mm", "degC", "", "m2.5"])
def test_other_units_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"unit"):
        parse_unit(name)


@pytest.mark.parametrize(
    ("name", "rate"),
    [
        ("m", "m/s"),
        ("m/s", "m/s2"),
        ("A", "A/s"),
        ("1", "1/s"),
        ("N.m.s/rad", "N.m.s/(rad.s)"),
        ("J/(kg.K)", "J/(kg.K.s)"),
    ],
)
def test_a_rate_has_the_unit_per_second(name: str, rate: str) -> None:
    assert per_second(name) == rate
    expected = dict(parse_unit(name).powers)
    expected["s"] = expected.get("s", 0) - 1
    assert parse_unit(rate).powers == {base: power for base, power in expected.items() if power}


@pytest.mark.parametrize(
    ("unit", "value", "shown", "display_unit"),
    [("rad/s", math.pi, 30.0, "rpm"), ("m", 0.24, 240.0, "mm"), ("rad", math.pi / 2, 90.0, "deg")],
)
def test_display_units(unit: str, value: float, shown: float, display_unit: str) -> None:
    quantity = QUANTITIES[unit]
    assert quantity.display_unit == display_unit
    assert value * quantity.factor == pytest.approx(shown, rel=1e-15)


def test_quantities_have_units_and_different_names() -> None:
    assert len({q.name for q in QUANTITIES.values()}) == len(QUANTITIES)
    for unit in QUANTITIES:
        assert parse_unit(unit).name == unit
