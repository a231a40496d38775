"""Names of variables: short ones, patterns, elements, and the reasons why a variable cannot be set."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, suggest_names
from emla_cosim.base.wording import find_names, matches_pattern
from emla_cosim.system.fault import Fault, read_faults
from emla_cosim.system.model import find_main_component
from fmublock import Block, Input, Output, Parameter, State, build
from tests.support.commands import Emla, sentence

TIMES = {"step_size": 0.1, "stop_time": 0.5}


class Tank(Block):
    """A tank with an inflow."""

    q = Input(2.0, unit="m3/s", description="Inflow")
    area = Parameter(1.0, unit="m2", description="Area")
    h = State(0.0, unit="m", description="Level")
    level = Output(unit="m", description="Measured level")

    def derivatives(self, v):
        return {"h": v.q / v.area}

    def outputs(self, v):
        return {"level": v.h}


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(Tank, tmp_path_factory.mktemp("tank") / "Tank.fmu")


def run(tank: Path, **options: object) -> ec.Result:
    with ec.load(tank, **TIMES, **options).prepare() as simulation:
        return simulation.run()


def test_one_fmu_needs_no_component_name(tank: Path, emla: Emla, tmp_path: Path) -> None:
    expected = {
        "set": {"a*": 2.0},
        "signals": ["lev*"],
        "require": ["level.final > 0.35"],
        "stop_when": ["level > 0.35"],
    }
    result = run(tank, **expected)
    assert result.stopped_when == "Tank.level > 0.35"
    np.testing.assert_array_equal(result["level"], result["Tank.level"])
    assert result["level"][-1] == pytest.approx(0.4, rel=1e-9)
    result.save(tmp_path / "kept", plots=False)
    process = emla("plot", "kept", "--signals", "level", "--output", "level.png")
    assert process.exit_code == 0, process.output
    assert result.plot("level").axes


def test_one_fmu_with_data_keeps_its_short_names(tank: Path, tmp_path: Path) -> None:
    (tmp_path / "q.csv").write_text("time,q\n0,1\n1,1\n", encoding="utf-8")
    result = run(tank, input=[tmp_path / "q.csv"])
    assert len(result.record["components"]) == 2
    np.testing.assert_array_equal(result["level"], result["Tank.level"])
    assert result.plot("level").axes


def test_sweep_accepts_short_names(tank: Path) -> None:
    result = ec.sweep(
        tank, {"area": [1.0, 2.0]}, metrics=["top = max(Tank.level)"], signals=["level"], workers=1, **TIMES
    )
    assert result.variants["Tank.area"].to_list() == [1.0, 2.0]
    assert result.variants["top"].to_list() == pytest.approx([1.0, 0.5], rel=1e-9)


def test_roles_accept_short_names(tank: Path) -> None:
    result = run(tank, roles={"j.x_L": "level", "j.x_d": "q"}, signals=["level", "q"])
    assert result.record["settings"]["roles"] == {"j.x_L": "Tank.level", "j.x_d": "Tank.q"}
    assert "j" in result.metrics["joints"]


def test_variables_that_are_not_recorded_can_end_a_run(tank: Path) -> None:
    result = run(tank, stop_when=["q > 1"], signals=["level"])
    assert result.names == ["Tank.level"]
    assert (result.stopped_when, result.end_s) == ("Tank.q > 1", 0.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"level": 1.0}, "'level' is not a full name; write a.level or b.level."),
        ({"area": "1 m2"}, "'area' is not a full name; write a.area or b.area."),
        ({"a.ara": 1.0}, "a has no variable 'ara'; did you mean area?"),
        ({"c.area": 1.0}, "there is no component 'c'; there are a and b."),
        ({"b.q": 1.0}, "b.q cannot be set: it is driven by a.level."),
        ({"a.level": 1.0}, "a.level cannot be set: it is computed by the FMU."),
        ({"*.level": 1.0}, "'*.level' matches a.level and b.level, which cannot be set: it is computed"),
        ({"b.q*": 1.0}, "'b.q*' matches b.q, which cannot be set: it is driven by a.level."),
        ({"*.araa": 1.0}, "no variable that can be set matches '*.araa'; did you mean"),
    ],
)  # fmt: skip
def test_messages_for_invalid_names(values: dict[str, float], message: str, tank: Path) -> None:
    class Flow(Tank):
        q = Input(2.0, unit="m", description="A level as a flow, so that it can be connected")
        area = Parameter(1.0, unit="s", description="Area")

    system = ec.System.of({"a": tank, "b": Flow}, ["a.level -> b.q"])
    with pytest.raises(CommandError) as caught:
        ec.load(system, **TIMES, set=values).prepare()
    assert message in str(caught.value)


def test_brackets_can_be_a_character_class(tank: Path) -> None:
    result = run(tank, set={"[a]rea": 4.0})
    assert result["level"][-1] == pytest.approx(0.25, rel=1e-9)


@pytest.mark.parametrize("option", ["--stop-when", "--require"])
def test_unknown_short_names_suggest_full_ones(option: str, tank: Path, emla: Emla) -> None:
    text = sentence(emla("run", str(tank), "--no-plots", option, "levle > 1"), 2)
    assert "did you mean Tank.level" in text


def test_faults_of_elements() -> None:
    text = "a.u[1,2]=offset:1.0@0.0,a.u[2]=freeze@1.0+0.5"
    assert read_faults(text) == [
        Fault("a.u[1,2]", "offset", 0.0, value=1.0),
        Fault("a.u[2]", "freeze", 1.0, duration=0.5),
    ]


@pytest.mark.parametrize(
    ("record", "main"),
    [
        ({"components": {"Tank": {}}}, "Tank"),
        ({"components": {"input": {}, "Tank": {}}, "scenario": "Tank", "source": "/x/Tank.FMU"}, "Tank"),
        ({"components": {"a": {}, "b": {}}, "scenario": "a", "source": None}, ""),
        ({"components": {"a": {}, "b": {}}, "scenario": "mine", "source": "x.fmu"}, ""),
        ({"components": []}, ""),
        (json.loads("{}"), ""),
    ],
)
def test_main_component_of_a_record(record: dict, main: str) -> None:
    assert find_main_component(record) == main


names = st.lists(st.text("ab.", min_size=1, max_size=4), max_size=6, unique=True)


@given(st.text("ab.*?", min_size=1, max_size=4), names)
def test_short_names_count_only_without_a_full_match(text: str, all_names: list[str]) -> None:
    full = [name for name in all_names if matches_pattern(name, text)]
    short_matches = [name for name in all_names if matches_pattern(name, f"a.{text}")]
    assert find_names(text, all_names) == full
    assert find_names(text, all_names, "a") == (full or short_matches)


def test_a_name_is_never_suggested_for_itself() -> None:
    assert suggest_names("area", ["area", "areas"]) == "did you mean areas?"
    assert suggest_names("area", ["area"], "see the list.") == "see the list."
