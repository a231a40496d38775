"""Random systems: written, read, and written again they are the same."""

import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from emla_cosim.base.units import IDENTITY, LinearTransformation, SiUnit, find_conversion
from emla_cosim.fmu.interface import Interface, read_interface
from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.ssp.writer.package_writer import SystemTimes, write_ssp
from emla_cosim.system.model import Alias, Component, Connection, System
from emla_cosim.system.resolution import resolve_system
from tests.support import tiers
from tests.support.ssp_documents import ITEMS, UNITS, fake_fmu

LENGTHS = {"m": UNITS["m"], "mm": UNITS["mm"], "inch": 'm="1" factor="0.0254"', "odd": 'm="1" offset="0.5"'}
OTHER_UNITS = {**LENGTHS, "odd": 'm="1" factor="3" offset="-2"', "mm": 'm="1" factor="0.002"'}
"""The same names for other units."""
MODELS = {
    "short": (LENGTHS, "u:input:mm", "v:input", "y:output:m", "k:parameter:m", "x:output:inch:exact"),
    "long": (OTHER_UNITS, "u:input:odd", "v:input:mm", "y:output:mm", "k:parameter:odd",
             "n:parameter:Integer", "on:parameter:Boolean", "mode:parameter:Enumeration", "a.b:parameter:m",
             "i:input:Integer", "o:output:Integer"),
    "none": (UNITS, "u:input", "v:input", "y:output", "z.y:output", "k:parameter", "n:parameter:Integer",
             "mode:parameter:Enumeration"),
    "other one": ({"vague": "", **LENGTHS}, "u:input:vague", "v:input:inch", "y:output:vague",
                  "k:parameter:vague", "n:parameter:Integer", "on:input:Boolean", "off:output:Boolean"),
}  # fmt: skip


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs that differ; two of them have the same file name."""
    top = tmp_path_factory.mktemp("fmus")
    paths = {
        name: top / name / ("same.fmu" if name in ("short", "none") else f"{name}.fmu") for name in MODELS
    }
    return {
        name: fake_fmu(paths[name], *variables, units=units) for name, (units, *variables) in MODELS.items()
    }


# ---- systems -----------------------------------------------------------------------------------

NUMBERS = st.floats(-1e9, 1e9, allow_subnormal=False).filter(lambda x: x == 0.0 or abs(x) > 1e-9)
FACTORS = st.one_of(st.floats(1e-3, 1e3), st.floats(-1e3, -1e-3))
LINEAR = st.builds(LinearTransformation, FACTORS, st.floats(-1e3, 1e3))
NAMES = st.lists(st.sampled_from(["a", "b", "c_d", "e-f", "Größe"]), min_size=1, max_size=3).map(".".join)
LENGTH_UNITS = [SiUnit("m", (0, 1, 0, 0, 0, 0, 0, 0)), SiUnit("km", (0, 1, 0, 0, 0, 0, 0, 0), 1e3)]
VALUES: dict[str, Any] = {
    "Real": NUMBERS,
    "Integer": st.integers(-9, 9),
    "Boolean": st.booleans(),
    "Enumeration": st.sampled_from(["off", ITEMS["off"]]),  # the start value; no other is exported
}


FITTING = {"Real": ("Real", "Integer"), "Integer": ("Integer",), "Boolean": ("Boolean",)}
"""Types of outputs for an input of each type."""


@dataclass(frozen=True)
class Example:
    """A system and the models that its components are, by name."""

    system: System
    models: dict[str, str]


@st.composite
def examples(draw: Any) -> Example:
    names = draw(st.lists(NAMES, min_size=1, max_size=5, unique=True))
    models = {name: draw(st.sampled_from(sorted(MODELS))) for name in names}
    components = {name: draw(component(name, models[name])) for name in names}
    outputs = [(n, v) for n in names for v in variables(models[n]) if causality(models[n], v) == "output"]
    connections = []
    for name in names:
        for input_ in (v for v in variables(models[name]) if causality(models[name], v) == "input"):
            if draw(st.booleans()):
                takes = type_of(models[name], input_)
                fitting = [(n, v) for n, v in outputs if type_of(models[n], v) in FITTING[takes]]
                if not fitting:
                    continue
                source, output = draw(st.sampled_from(fitting))
                options: list[Any] = [st.just(IDENTITY)] + ([LINEAR] if takes == "Real" else [])
                if convertible(unit_of(models[source], output), unit_of(models[name], input_)):
                    options.append(st.none())
                connections.append(Connection(source, output, name, input_, draw(st.one_of(options))))
                drop(components, name, input_)
    return Example(System(tuple(components.values()), tuple(connections)), models)


def drop(components: dict[str, Component], name: str, variable: str) -> None:
    """What is driven has no start value."""
    old = components[name]
    remaining = {n: v for n, v in old.parameters.items() if old.alias(n).variable != variable}
    components[name] = Component(name, parameters=remaining, aliases=old.aliases)


@st.composite
def component(draw: Any, name: str, model: str) -> Component:
    """Some aliases: other names, the same name in another unit; and some values."""
    aliases, values = {}, {}
    for variable in variables(model):
        real, kind = type_of(model, variable) == "Real", draw(st.sampled_from(["", "", "other", "same"]))
        linear = draw(st.one_of(st.just(IDENTITY), LINEAR)) if real else IDENTITY
        unit = draw(st.sampled_from([None, *LENGTH_UNITS])) if real else None
        if kind == "other":
            aliases[draw(st.sampled_from(["our ", "your "])) + variable] = Alias(variable, linear, unit)
        elif kind == "same" and linear != IDENTITY:
            aliases[variable] = Alias(variable, linear, unit)
        settable = causality(model, variable) in ("parameter", "input") or variable == "x"
        if settable and draw(st.booleans()):
            called_ = next((n for n, a in aliases.items() if a.variable == variable), variable)
            values[called_] = draw(VALUES[type_of(model, variable)])
    return Component(name, parameters=values, aliases=aliases)


def variables(model: str) -> Iterator[str]:
    return (text.split(":")[0] for text in MODELS[model][1:])


def _fields(model: str, variable: str) -> list[str]:
    return next(t.split(":") for t in MODELS[model][1:] if t.split(":")[0] == variable)


def causality(model: str, variable: str) -> str:
    return _fields(model, variable)[1]


def type_of(model: str, variable: str) -> str:
    actual = [f for f in _fields(model, variable)[2:] if f in VALUES]
    return actual[0] if actual else "Real"


def unit_of(model: str, variable: str) -> SiUnit | None:
    """The unit of a variable, all of which are lengths."""
    field = [f for f in _fields(model, variable)[2:] if f not in VALUES and f != "exact"]
    return SiUnit(field[0], None if field == ["vague"] else (0, 1, 0, 0, 0, 0, 0, 0)) if field else None


def convertible(source: SiUnit | None, target: SiUnit | None) -> bool:
    try:
        find_conversion(source, target)
    except ValueError:
        return False
    return True


# ---- there and back ----------------------------------------------------------------------------

EXPERIMENT = SystemTimes(0.5, 12.25, 1e-3)


def written(path: Path, system: System, fmus: dict[str, Path]) -> dict[str, bytes]:
    """The files of a package."""
    write_ssp(path, "name", "What it is", system, fmus, EXPERIMENT)
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@tiers.examples(15, 100, suppress_health_check=[HealthCheck.too_slow])
@given(examples())
def test_exported_package_is_read_back_unchanged(fmus: dict[str, Path], example: Example) -> None:
    files = {name: fmus[model] for name, model in example.models.items()}
    with tempfile.TemporaryDirectory() as folder:
        first = written(Path(folder, "first.ssp"), example.system, files)
        with read_ssp(Path(folder, "first.ssp")) as document:
            actual = document.system
            fmus_by_name = {c.name: c.fmu for c in actual.components if c.fmu is not None}
            second = written(Path(folder, "second.ssp"), actual, fmus_by_name)
            interfaces = {name: read_interface(file) for name, file in fmus_by_name.items()}
            plain = resolve_system(actual, interfaces)
        assert second == first
    assert document.stop_time == 12.25 and document.step_size == 1e-3 and document.notes == []
    check_equal(resolve_system(example.system, interfaces), plain, interfaces)


def check_equal(expected: System, actual: System, interfaces: dict[str, Interface]) -> None:
    """The same values and connections; start values may be given where they are the defaults."""
    assert {c.name for c in actual.components} == {c.name for c in expected.components}
    for component in expected.components:
        starts = {n: v.start for n, v in interfaces[component.name].variables.items() if v.start is not None}
        values = [
            {n: as_number(v) for n, v in {**starts, **c.parameters}.items()}
            for c in (component, actual.component(component.name))
        ]
        driven = {x.input for x in expected.connections if x.target == component.name}
        assert values[1] == values[0]
        assert not driven & set(actual.component(component.name).parameters)
    wires = [{str(x): x.transformation for x in s.connections} for s in (expected, actual)]
    assert wires[0] == wires[1]


def as_number(value: Any) -> Any:
    """A value whichever way it is written."""
    if value in ITEMS:
        return float(ITEMS[value])
    return float({"true": 1, "false": 0}.get(str(value).lower(), value))
