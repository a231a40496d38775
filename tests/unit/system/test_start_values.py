"""Start values by patterns and with units, and times with units."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from hypothesis import given
from hypothesis import strategies as st

import emla_cosim as ec
from emla_cosim.base.quantities import has_unit, parse_quantity, parse_unit_name
from emla_cosim.base.units import find_conversion
from emla_cosim.fmu.interface import read_interface
from emla_cosim.fmu.models import fmu_path
from emla_cosim.run.options import Options
from tests.support.commands import Emla, sentence

ALPHA = "lift.observer.alpha_1"


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.001) as simulation:
        yield simulation


def parameters(result: ec.Result) -> dict[str, Any]:
    """All start values of a run, by full name."""
    components = result.record["components"]
    return {f"{c}.{n}": v for c, one in components.items() for n, v in one["parameters"].items()}


def changed(lift: ec.Simulation, values: dict[str, Any]) -> dict[str, Any]:
    before, after = parameters(lift.run()), parameters(lift.run(set=values))
    return {n: v for n, v in after.items() if before.get(n) != v}


def test_a_pattern_sets_all_that_fit_and_can_be_set(lift: ec.Simulation, fmu_folder: Path) -> None:
    """Against fmpy's own reading of the model."""
    model = read_model_description(str(fmu_path("EmlaPlant", "native", fmu_folder)))
    wanted = {
        f"lift.plant.{v.name}"
        for v in model.modelVariables
        if fnmatchcase(v.name, "screw.*") and v.causality == "parameter" and v.variability != "constant"
    }
    assert len(wanted) > 3
    assert set(changed(lift, {"*.plant.screw.*": 0.123})) == wanted


def test_names_win_over_patterns_and_later_patterns_over_earlier(lift: ec.Simulation) -> None:
    for values in ({ALPHA: 3.0, "*.alpha_1": 4.0}, {"*.alpha_1": 4.0, ALPHA: 3.0}):
        assert changed(lift, values) == {ALPHA: 3.0}
    assert changed(lift, {"*.alpha_1": 4.0, "lift.observer.alpha_?": 5.0})[ALPHA] == 5.0
    assert changed(lift, {"lift.observer.alpha_?": 5.0, "*.alpha_1": 4.0})[ALPHA] == 4.0


def test_what_is_given_later_wins_over_what_a_file_names(
    emla: Emla, fmu_folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(
        f'system = "lift"\nstop_time = 0.001\n[set]\n"{ALPHA}" = 3.0\n"*.plant.motor.R_?" = 0.2\n'
    )
    for more, value in (((), 3.0), (("--set", "*.alpha_1=4"), "4")):
        assert emla("run", "mine.toml", "--no-plots", *more).exit_code == 0
        record = json.loads((tmp_path / "results/mine/run.json").read_text())
        assert record["components"]["lift.observer"]["parameters"]["alpha_1"] == value
        assert record["components"]["lift.plant"]["parameters"]["motor.R_s"] == 0.2
    assert record["changed"]["set"] == {"*.alpha_1": "4"}
    assert record["settings"]["set"] == {"*.plant.motor.R_?": 0.2, "*.alpha_1": "4"}
    with ec.load(tmp_path / "mine.toml", set={"*.alpha_1": 4.0}).prepare(fmus=fmu_folder) as simulation:
        assert parameters(simulation.run())[ALPHA] == 4.0
        assert parameters(simulation.run(set={"*.alpha_1": 5.0}))[ALPHA] == 5.0
        assert parameters(simulation.run(set={ALPHA: 6.0}))[ALPHA] == 6.0


def test_arrays_have_brackets_and_patterns_in_them(lift: ec.Simulation) -> None:
    levels = [f"lift.disturbance.load.level[{i}]" for i in (1, 2)]
    assert changed(lift, {"*.load.level[1]": 7.0}) == {levels[0]: 7.0}
    found = changed(lift, {"lift.disturbance.load.level[*]": 7.0})
    assert set(levels) <= set(found) and all(n.startswith("lift.disturbance.load.level[") for n in found)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"*.alhpa_1": 1.0}, "matches '*.alhpa_1'; did you mean"),
        ({"*.qqqqqqqqqqqq": 1.0}, "* matches any text"),
        ({"*.plant.tau_m": 1.0}, "'*.plant.tau_m' matches lift.plant.tau_m, which cannot be set"),
        ({"*.plant.motor.R_s": "many"}, "lift.plant.motor.R_s = many is not a number"),
        ({"*.plant.motor.R_s": 1e308 * 10}, "out of range"),
        ({"*.load.level[1]": "30 kV"}, "= 30 kV has the units kV and N"),
        ({"lift.disturbance.load.level[1]": "30 kV"}, "= 30 kV has the units kV and N"),
        ({"lift.disturbance.load.level[1]": "30 qN"}, "has the unknown unit 'qN'"),
        ({"lift.disturbance.load.level[1]": "1e999 kN"}, "out of range"),
        ({"lift.observer.rate": "30 kN"}, "has no variable"),
        (
            {"lift.reference.waypoint": [0.25] * 10},
            "no variable 'waypoint[10]'; the elements of waypoint are waypoint[1] to waypoint[9]",
        ),
    ],
)
def test_what_does_not_fit_is_told_in_one_sentence(
    lift: ec.Simulation, values: dict[str, Any], said: str
) -> None:
    with pytest.raises(ec.CommandError) as caught:
        lift.run(set=values)
    assert said in str(caught.value)


def test_a_replaced_component_is_called_as_before(fmu_folder: Path) -> None:
    own = fmu_path("EmlaPlant", "native", fmu_folder)
    mapping = {"lift.plant": ec.Replacement(own)}
    given = {"*.plant.motor.R_s": "200 mOhm"}
    with ec.load("lift", replace=mapping, set=given).prepare(fmus=fmu_folder) as simulation:
        assert parameters(simulation.run(stop_time=0.001))["lift.plant.motor.R_s"] == 0.2


def test_a_quantity_is_the_number_in_the_unit_of_its_variable(lift: ec.Simulation) -> None:
    level = "lift.disturbance.load.level[1]"
    plain = lift.run(set={level: 30e3, "*.plant.screw.lead": 0.01})
    for values in (
        {level: "30 kN", "*.plant.screw.lead": "10 mm"},
        {level: "3e4N", "lift.plant.screw.lead": "1 cm/rev"},
    ):
        found = lift.run(set=values)
        if "*.plant.screw.lead" in values:
            assert np.array_equal(found["lift.plant.x_L"], plain["lift.plant.x_L"])
        assert parameters(found)[level] == 30e3


def test_texts_stay_texts_and_python_numbers_numbers() -> None:
    assert has_unit("30 kN") and has_unit("30kN") and has_unit("0x10")
    assert not any(map(has_unit, ("30", "1_000", "1e5", "nan", "true", "left 3 m", "", 30, None)))


@given(st.integers(-(10**15) + 1, 10**15 - 1), st.integers(-12, 3))
def test_a_power_of_ten_costs_no_digit(digits: int, power: int) -> None:
    """The double nearest to the decimal number, as if it was written in the other unit."""
    text = f"{digits}e{power}"
    for unit, factor in (("ms", -3), ("us", -6), ("ns", -9), ("s", 0)):
        assert parse_quantity(f"{text} {unit}", "it").in_unit(parse_unit_name("s", "it"), "it") == float(
            f"{digits}e{power + factor}"
        )
    assert math.isclose(
        parse_quantity("2 min", "it").in_unit(parse_unit_name("s", "it"), "it"), 120.0, rel_tol=0
    )


def test_times_may_have_units(emla: Emla, tmp_path: Path) -> None:
    times = ("--step-size", "0.1ms", "--stop-time", "2 ms", "--output-interval", "500 us")
    assert emla("run", "lift", *times, "--no-plots", "--output", "out").exit_code == 0
    settings = json.loads((tmp_path / "out/run.json").read_text())["settings"]
    assert settings["step_size_s"] == 1e-4 and settings["stop_time_s"] == 2e-3
    assert settings["output_interval_s"] == 5e-4
    assert Options().updated({"stop_time": "2 min"}).stop_time == 120.0
    for text, said in (
        ("2 m", "has the units m and s"),
        ("soon", "must be a number"),
        ("2 x", "unknown unit"),
    ):
        assert said in sentence(emla("run", "lift", "--stop-time", text), 2)
    for text in ("nan", "inf", "1e999", "-1", "1e-400 s", ""):
        sentence(emla("run", "lift", f"--stop-time={text}"), 2)


@pytest.mark.parametrize(
    ("text", "number"), [("180 degF", 100.0), ("180 °F", 100.0), ("100 °C", 100.0), ("100 K", 100.0)]
)
def test_a_rise_of_temperature_converts_without_offset(lift: ec.Simulation, text: str, number: float) -> None:
    name = "lift.plant.motor.permitted_rise"
    assert parameters(lift.run(set={name: text}))[name] == pytest.approx(number, rel=1e-12)


def test_only_differences_convert_without_offset(fmu_folder: Path) -> None:
    """The block declares a difference; its model description says so, and both kinds are read back."""
    description = read_interface(fmu_path("EmlaPlant", "native", fmu_folder))
    unit = description.unit("motor.permitted_rise")
    assert unit is not None and unit.is_difference
    speed = description.unit("screw.v_max")
    assert speed is not None and not speed.is_difference
    kelvin, fahrenheit = parse_unit_name("K", "x"), parse_unit_name("degF", "x")
    absolute = find_conversion(fahrenheit, kelvin)
    assert absolute(212.0) == pytest.approx(373.15)
    for pair in (
        (fahrenheit, replace(kelvin, is_difference=True)),
        (replace(fahrenheit, is_difference=True), kelvin),
    ):
        assert find_conversion(*pair)(180.0) == pytest.approx(100.0, rel=1e-12)
