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


class Sensor(Block):
    """A temperature."""

    T = Output(unit="K", description="Temperature")

    def outputs(self, v):
        return {"T": 300.0}


class Heater(Block):
    """Something that gets hot."""

    T = Input(unit="K", description="Temperature")
    y = Output(description="The same number")

    def outputs(self, v):
        return {"y": v.T}


@pytest.fixture(scope="module")
def temperatures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs of absolute temperatures and of differences."""
    folder = tmp_path_factory.mktemp("temperatures")
    plain = {block.__name__: build(block, folder / f"{block.__name__}.fmu") for block in (Sensor, Heater)}
    relative = {
        f"{name} of differences": edit_description(
            path, folder / f"relative{name}.fmu", 'unit="K"', 'unit="K" relativeQuantity="true"'
        )
        for name, path in plain.items()
    }
    return plain | relative


def run(temperatures: dict[str, Path], source: str, target: str, **options: object) -> ec.Result:
    system = ec.System.of({"a": temperatures[source], "b": temperatures[target]}, ["a.T -> b.T"])
    with ec.load(system, **OPTIONS, **options).prepare() as simulation:
        return simulation.run()


@pytest.mark.parametrize("kind", ["", " of differences"])
def test_equal_quantities_connect(temperatures: dict[str, Path], kind: str) -> None:
    assert run(temperatures, f"Sensor{kind}", f"Heater{kind}")["b.y"][-1] == 300.0


@pytest.mark.parametrize(("source", "target"), [("", " of differences"), (" of differences", "")])
def test_a_temperature_drives_no_difference(temperatures: dict[str, Path], source: str, target: str) -> None:
    names = f"Sensor{source}", f"Heater{target}"
    with pytest.raises(CommandError, match=r"a\.T -> b\.T joins different quantities.*--lenient"):
        run(temperatures, *names)
    assert run(temperatures, *names, lenient=True)["b.y"][-1] == 300.0
