"""Texts with numbers and units become quantities."""

import math

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.quantities import parse_quantity, parse_unit_name
from emla_cosim.base.units import BASE_UNITS, SiUnit


def si(**exponents: int) -> SiUnit:
    return SiUnit("SI", tuple(exponents.get(base, 0) for base in BASE_UNITS))


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("30 kN", si(kg=1, m=1, s=-2), 30e3),
        ("30kN", si(kg=1, m=1, s=-2), 30e3),
        ("-3.4e3 N", si(kg=1, m=1, s=-2), -3400.0),
        ("0.2", si(m=1), 0.2),
        (" .5 mm ", si(m=1), 5e-4),
        ("12.5 kg cm^2", si(kg=1, m=2), 12.5e-4),
        ("12.5 kg·cm²", si(kg=1, m=2), 12.5e-4),
        ("3000 rpm", si(s=-1, rad=1), 100 * math.pi),
        ("60 min⁻¹", si(s=-1), 1.0),
        ("60 1/min", si(s=-1, rad=1), 2.0 * math.pi),  # of a speed, turns
        ("60 min^-1", si(s=-1, rad=1), 2.0 * math.pi),
        ("8 Hz", si(s=-1, rad=1), 16.0 * math.pi),
        ("8 Hz", si(s=-1), 8.0),
        ("8 1/s", si(s=-1, rad=1), 8.0),
        ("60 U/min", si(s=-1, rad=1), 2.0 * math.pi),
        ("180 Grad", si(rad=1), math.pi),
        ("2 kNm", si(kg=1, m=2, s=-2), 2e3),
        ("2 kp", si(kg=1, m=1, s=-2), 19.6133),
        ("3 msec", si(s=1), 3e-3),
        ("1 μm", si(m=1), 1e-6),
        ("1.6 N m/A", si(kg=1, m=2, s=-2, A=-1), 1.6),
        ("95 V/krpm", si(kg=1, m=2, s=-2, A=-1, rad=-1), 95 / (1000 * 2 * math.pi / 60)),
        ("40 °C", si(K=1), 313.15),
        ("1 e3", None, None),
    ],
)
def test_text_means_a_quantity(text: str, unit: SiUnit | None, value: float | None) -> None:
    if value is None:
        with pytest.raises(CommandError, match="has the unknown unit 'e3'"):
            parse_quantity(text, "the mass")
    else:
        assert parse_quantity(text, "the value").in_unit(unit, "the value") == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["", "kN", "1,5 kN", "0x10", "1 2 kN", "nan", "1e3e3", "30 kN kN2 m"])
def test_invalid_quantity_is_refused_with_its_label(text: str) -> None:
    with pytest.raises(CommandError, match="the load"):
        parse_quantity(text, "the load").in_unit(si(kg=1, m=1, s=-2), "the load")


def test_wrong_unit_is_refused() -> None:
    with pytest.raises(CommandError, match="the load has the units mm and SI"):
        parse_quantity("30 mm", "the load").in_unit(si(kg=1, m=1, s=-2), "the load")


def test_ambiguous_unit_is_refused() -> None:
    with pytest.raises(CommandError, match="the axis has the unknown unit 'F'"):
        parse_unit_name("F", "the axis")
