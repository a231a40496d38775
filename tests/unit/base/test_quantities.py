"""Texts with numbers and units become quantities."""

import math

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.quantities import parse_quantity, read_quantity
from emla_cosim.base.units import BASE_UNITS, SiUnit


def si(**exponents: int) -> SiUnit:
    return SiUnit("SI", tuple(exponents.get(base, 0) for base in BASE_UNITS))


FORCE, SPEED = si(kg=1, m=1, s=-2), si(s=-1, rad=1)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("30kN", FORCE, 30e3),
        ("-3.4e3 N", FORCE, -3400.0),
        ("0.2", si(m=1), 0.2),
        (" .5 mm ", si(m=1), 5e-4),
        ("12.5 kg cm^2", si(kg=1, m=2), 12.5e-4),
        ("12.5 kg·cm²", si(kg=1, m=2), 12.5e-4),
        ("60 min⁻¹", si(s=-1), 1.0),
        ("60 1/min", SPEED, 2.0 * math.pi),  # of a speed, turns
        ("60 min^-1", SPEED, 2.0 * math.pi),
        ("8 Hz", SPEED, 16.0 * math.pi),
        ("8 Hz", si(s=-1), 8.0),
        ("8 1/s", SPEED, 8.0),
        ("2 kNm", si(kg=1, m=2, s=-2), 2e3),
        ("3 msec", si(s=1), 3e-3),
        ("1 μm", si(m=1), 1e-6),
        ("1.6 N m/A", si(kg=1, m=2, s=-2, A=-1), 1.6),
        ("95 V/krpm", si(kg=1, m=2, s=-2, A=-1, rad=-1), 95 / (1000 * 2 * math.pi / 60)),
        ("40 °C", si(K=1), 313.15),
        ("104 ℉", si(K=1), 313.15),
        ("2 °C/W", si(kg=-1, m=-2, s=3, K=1), 2.0),  # of a difference, without an offset
        ("3,6 W/degF", si(kg=1, m=2, s=-3, K=-1), 6.48),
        ("0,5 mm", si(m=1), 5e-4),
        ("-1,25e3 mm", si(m=1), -1.25),
        ("0,500 m", si(m=1), 0.5),  # no thousands
        ("1.5 t", si(kg=1), 1500.0),
        ("2 a", si(s=1), 63115200.0),
        ("20 yr", si(s=1), 631152000.0),
        ("3e6 cycles", si(), 3e6),
        ("100 rpm/V", si(kg=-1, m=-2, s=2, A=1, rad=1), 100 * 2.0 * math.pi / 60),
        ("10 lb", FORCE, 44.482216152605),
        ("10 lb", si(kg=1), 4.5359237),
        ("1 lb-in", si(kg=1, m=2, s=-2), 4.4482216152605 * 0.0254),
        ("5 gf.cm", si(kg=1, m=2, s=-2), 5e-5 * 9.80665),
        ("2 ozf.in", si(kg=1, m=2, s=-2), 2 * 4.4482216152605 / 16 * 0.0254),
        ("3 kgcm²", si(kg=1, m=2), 3e-4),
        ("3 gcm^2", si(kg=1, m=2), 3e-7),
        ("12 N / mm", si(kg=1, s=-2), 12e3),
        ("2 kWh", si(kg=1, m=2, s=-2), 7.2e6),
    ],
)
def test_text_means_a_quantity(text: str, unit: SiUnit, value: float) -> None:
    assert read_quantity(text, "the value", unit) == pytest.approx(value, rel=1e-12)


def test_number_without_a_unit_is_refused_with_its_readings() -> None:
    assert read_quantity("3", "--to", "s") == 3.0
    with pytest.raises(CommandError, match="--life 3 has no unit; write '3 h' or '3 s'"):
        read_quantity("3", "--life", "s", readings=("h", "s"))
    with pytest.raises(CommandError, match="--n has a unit, but takes none"):
        read_quantity("3 s", "--n", None)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        *(
            (text, "")
            for text in (
                "",
                "kN",
                "1.000,5 kN",
                "1,000,500 kN",
                "1, kN",
                "0x10",
                "1 2 kN",
                "nan",
                "1e3e3",
                "30 kN kN2 m",
            )
        ),
        ("1 e3", "has the unknown unit 'e3'"),
        ("1,500 N", "has two meanings; write '1.500 N' or '1500 N'"),
        ("3 F", "has the unknown unit 'F'"),  # farad or Fahrenheit
        ("30 mm", "has the units mm and SI"),
    ],
)
def test_invalid_quantity_is_refused_with_its_label(text: str, reason: str) -> None:
    with pytest.raises(CommandError, match=f"the load.*{reason}"):
        parse_quantity(text, "the load").in_unit(FORCE, "the load")
