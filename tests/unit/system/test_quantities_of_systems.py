"""Start values with units that a system brings, and differences of temperature."""

from pathlib import Path

import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from fmublock import Block, Input, Output, Parameter, build
from tests.support.hand_written_fmus import edit_description


class Plain(Block):
    """A lever without parameters."""

    u = Input(unit="m", description="Position")
    y = Output(unit="m", description="Position")

    def outputs(self, v):
        return {"y": v.u}


class Heavy(Plain):
    """A lever with a mass, which the other one lacks."""

    m = Parameter(1.0, unit="kg", description="Mass")

    def outputs(self, v):
        return {"y": v.u * v.m}


OPTIONS = {"step_size": 0.1, "stop_time": 0.1}


def test_values_of_a_system_have_units() -> None:
    system = ec.System.of({"a": Plain}, set={"a.u": "20 mm"})
    with ec.load(system, **OPTIONS).prepare() as simulation:
        assert simulation.run()["a.y"][-1] == pytest.approx(0.02, rel=1e-15)
    with pytest.raises(CommandError, match="units kg and m"):
        ec.load(ec.System.of({"a": Plain}, set={"a.u": "20 kg"}), **OPTIONS).prepare()


def test_values_of_variables_that_only_a_replacement_has(tmp_path: Path) -> None:
    heavy = build(Heavy, tmp_path / "Heavy.fmu")
    system = ec.System.of({"a": Plain, "b": Plain}, ["a.y -> b.u"])
    values = {"a.m": "2e6 mg", "a.u": "20 mm"}
    with ec.load(system, **OPTIONS, replace={"a": heavy}, set=values).prepare() as simulation:
        assert simulation.run()["b.y"][-1] == pytest.approx(0.04, rel=1e-15)
    with pytest.raises(CommandError, match="units mm and kg"):
        ec.load(system, **OPTIONS, replace={"a": heavy}, set={"a.m": "20 mm"}).prepare()


class Temperature(Block):
    """A temperature that follows another one."""

    T = Input(300.0, unit="K", description="Temperature")
    y = Output(unit="K", description="The same temperature")

    def outputs(self, v):
        return {"y": v.T}


@pytest.fixture(scope="module")
def temperatures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs of an absolute temperature and of a difference."""
    folder = tmp_path_factory.mktemp("temperatures")
    plain = build(Temperature, folder / "Temperature.fmu")
    relative = 'unit="K" relativeQuantity="true"'
    return {
        "absolute": plain,
        "difference": edit_description(plain, folder / "Difference.fmu", 'unit="K"', relative),
    }


def connect(temperatures: dict[str, Path], source: str, target: str) -> ec.System:
    return ec.System.of({"a": temperatures[source], "b": temperatures[target]}, ["a.y -> b.T"])


def test_differences_connect(temperatures: dict[str, Path]) -> None:
    with ec.load(connect(temperatures, "difference", "difference"), **OPTIONS).prepare() as simulation:
        assert simulation.run()["b.y"][-1] == 300.0


@pytest.mark.parametrize(("source", "target"), [("absolute", "difference"), ("difference", "absolute")])
def test_temperature_cannot_drive_a_difference(
    temperatures: dict[str, Path], source: str, target: str
) -> None:
    system = connect(temperatures, source, target)
    with pytest.raises(CommandError, match=r"a\.y -> b\.T joins different quantities.*--lenient"):
        ec.load(system, **OPTIONS).prepare()
    with ec.load(system, **OPTIONS, lenient=True).prepare() as simulation:
        assert simulation.run()["b.y"][-1] == 300.0
