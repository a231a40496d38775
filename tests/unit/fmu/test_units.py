"""Units that an FMU defines, where users write values of its variables."""

from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.faults import accept_faults
from emla_cosim.fmu.interface import Interface, read_interface
from emla_cosim.system.fault import Fault
from emla_cosim.system.model import Component, System
from emla_cosim.system.names import Names
from emla_cosim.system.resolution import resolve_system
from emla_cosim.system.signal_faults import add_fault_components, wire_faults
from tests.support.hand_written_fmus import edit_description
from tests.support.ssp_documents import fake_fmu

MMHG = 133.322387415
"""Pascals, as in ISO 80000-4."""
TICKS = 4096 / 6.283185307179586
"""Ticks of an encoder per radian."""
UNITS = {
    "mmHg": f'kg="1" m="-1" s="-2" factor="{MMHG}"',
    "rad/s": 'rad="1" s="-1"',
    "p.u.": "",
    "EUR": "",
    "L/100km": 'm="2" factor="1e-8"',
    "K": 'K="1"',
    "mm": 'm="1"',
    "N": 'A="1"',
}
VARIABLES = {
    "pressure": "mmHg",
    "speed": "rad/s",
    "voltage": "p.u.",
    "price": "EUR",
    "use": "L/100km",
    "T": "K",
    "length": "mm",
    "force": "N",
    "plain": "",
}


@pytest.fixture
def interface(tmp_path: Path) -> Interface:
    parameters = [f"{name}:parameter:{unit}".rstrip(":") for name, unit in VARIABLES.items()]
    more = ["rise:parameter:K:relative", "u:input:mmHg"]
    fmu = fake_fmu(tmp_path / "a.fmu", *parameters, *more, units=UNITS)
    edit_description(
        fmu,
        fmu,
        'rad="1" s="-1"/>',
        f'rad="1" s="-1"/><DisplayUnit name="tick/s" factor="{TICKS}"/>',
        '<Unit name="EUR">',
        '<Unit name="EUR"><DisplayUnit name="kEUR" factor="0.001"/>',
        '<BaseUnit K="1"/>',
        '<BaseUnit K="1"/><DisplayUnit name="Grad C" offset="-273.15"/>',
    )
    return read_interface(fmu)


def system_of(interface: Interface) -> tuple[System, dict[str, Interface]]:
    return System((Component("a", fmu=Path("a.fmu")),), ()), {"a": interface}


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("pressure", "3 mmHg", 3.0),
        ("pressure", "0,5 mmHg", 0.5),
        ("pressure", "4 hPa", 400.0 / MMHG),
        ("speed", "3 tick/s", 3.0 / TICKS),
        ("speed", "60 1/min", 6.283185307179586),
        ("voltage", "1,05 p.u.", 1.05),
        ("price", "2 kEUR", 2000.0),
        ("use", "6 L/100km", 6.0),
        ("use", "6 mm2", 600.0),
        ("T", "20 Grad C", 293.15),
        ("T", "68 degF", 293.15),
        ("rise", "20 Grad C", 20.0),
        ("rise", "36 degF", 20.0),
        ("rise", "36 delta_degF", 20.0),
        ("plain", "1,5", 1.5),
    ],
)
def test_start_values_in_units_of_the_fmu(interface: Interface, name: str, text: str, value: float) -> None:
    start_values = Names(*system_of(interface)).start_values({f"a.{name}": text})
    assert start_values == {f"a.{name}": pytest.approx(value, rel=1e-12)}


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("pressure", "3 tick/s", "the units tick/s and mmHg, which cannot be converted"),
        ("pressure", "3 mmH", "the unknown unit 'mmH'.*The FMU defines mmHg"),
        ("voltage", "1 V", "p.u. is not defined in the UnitDefinitions of the FMU 'a'; add a Unit"),
        ("T", "20 delta_degC", "a difference, but must be a temperature"),
        ("pressure", "1,500 mmHg", "two meanings; write '1.500 mmHg' or '1500 mmHg'"),
        ("force", "3 kN", "N is declared as A, but it is kg m s-2"),
        ("plain", "3 mm", "has a unit, but takes none"),
    ],
)
def test_units_that_do_not_fit(interface: Interface, name: str, text: str, message: str) -> None:
    with pytest.raises(CommandError, match=message):
        Names(*system_of(interface)).start_values({f"a.{name}": text})


@pytest.mark.parametrize(("text", "value", "count"), [("3 mm", 3.0, 0), ("3 cm", 0.03, 1)])
def test_definition_that_contradicts_its_name_is_reported(
    interface: Interface, text: str, value: float, count: int
) -> None:
    """The FMU defines mm with the factor 1. Values in its own unit need no conversion."""
    with accept_faults(lenient=False) as faults:
        start_values = Names(*system_of(interface)).start_values({"a.length": text})
    assert start_values == {"a.length": pytest.approx(value)}
    assert len(faults.remarks()) == count
    assert all("the factor 1, but its name means 0.001 m" in remark for remark in faults.remarks())


@pytest.mark.parametrize("name", ["N", "T", "widget"])
def test_units_of_one_name_and_two_definitions(name: str, tmp_path: Path) -> None:
    """The message has the definitions, which differ; `T` may be a tesla or a tonne, `widget` is unknown."""
    powers = {"a": 'kg="1" s="-2" A="-1"', "b": 'kg="1"'}
    ends = {"a": f"y:output:{name}", "b": f"u:input:{name}"}
    paths = {c: fake_fmu(tmp_path / f"{c}.fmu", x, units={name: powers[c]}) for c, x in ends.items()}
    system = System.of(paths, ["a.y -> b.u"])
    message = rf"a.y -> b.u joins the units {name} \(kg s-2 A-1\) and {name} \(kg\)"
    with pytest.raises(CommandError, match=message):
        resolve_system(system, {c: read_interface(path) for c, path in paths.items()})


def test_contradiction_of_a_connection_is_reported(tmp_path: Path) -> None:
    fmus = {"a": ("y:output:mm", {"mm": 'm="1"'}), "b": ("u:input:m", {"m": 'm="1"'})}
    paths = {name: fake_fmu(tmp_path / f"{name}.fmu", x, units=u) for name, (x, u) in fmus.items()}
    system = System.of(paths, ["a.y -> b.u"])
    with accept_faults(lenient=False) as faults:
        resolved = resolve_system(system, {name: read_interface(path) for name, path in paths.items()})
    assert resolved.connections[0].transformation is not None
    assert resolved.connections[0].transformation(2.0) == 2.0
    assert ["the unit mm has the factor 1" in remark for remark in faults.remarks()] == [True]


def test_fault_with_units(interface: Interface) -> None:
    system, interfaces = system_of(interface)
    faults = [Fault.of_text("a.u=offset:4 hPa@100ms+0,5s"), Fault("a.u", "constant", 1.0, value="2 mmHg")]
    assert (faults[0].start, faults[0].duration) == (0.1, 0.5)
    faulty_system, components = add_fault_components(system, faults[:1])
    (name,) = components
    wired = wire_faults(faulty_system, components, interfaces).component(name)
    assert wired.parameters["offset"] == pytest.approx(400.0 / MMHG)
    faulty_system, components = add_fault_components(system, faults[1:])
    assert wire_faults(faulty_system, components, interfaces).component(name).parameters["offset"] == 2.0
    faulty_system, components = add_fault_components(system, [Fault("a.u", "offset", 1.0, value="2 s")])
    with pytest.raises(CommandError, match="the units s and mmHg, which cannot"):
        wire_faults(faulty_system, components, interfaces)
