"""Units are read into the exponents that FMI wants."""

import pytest

from fmublock.units import parse_unit


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
    assert parse_unit(name).exponents == exponents


def test_volt_times_ampere_is_watt() -> None:
    assert parse_unit("V.A").exponents == parse_unit("W").exponents


@pytest.mark.parametrize("name", ["furlong", "m//s", "m/s/s", "mm", "", "m2.5"])
def test_what_is_not_a_coherent_unit_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"unit"):
        parse_unit(name)
