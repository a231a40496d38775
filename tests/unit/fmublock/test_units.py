"""Units are read into the exponents that FMI wants."""

import math

import pytest

from fmublock.units import QUANTITIES, parse_unit
from fmublock.variables import per_second


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


def test_volt_times_ampere_is_watt() -> None:
    assert parse_unit("V.A").exponents == parse_unit("W").exponents


@pytest.mark.parametrize("name", ["furlong", "m//s", "m/s/s", "N/(m/s)", "mm", "degC", "", "m2.5"])
def test_what_is_not_a_coherent_unit_is_refused(name: str) -> None:
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
def test_display_units_show_what_people_read(
    unit: str, value: float, shown: float, display_unit: str
) -> None:
    quantity = QUANTITIES[unit]
    assert quantity.display_unit == display_unit
    assert value * quantity.factor == pytest.approx(shown, rel=1e-15)


def test_every_quantity_has_a_known_unit_and_a_name_of_its_own() -> None:
    assert len({q.name for q in QUANTITIES.values()}) == len(QUANTITIES)
    for unit in QUANTITIES:
        assert parse_unit(unit).name == unit
