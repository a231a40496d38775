"""Start values by patterns and with units, and times with units."""

import json
import math
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
from fmpy import read_model_description
from hypothesis import given
from hypothesis import strategies as st

import emla_cosim as ec
from emla_cosim.base.quantities import has_unit, parse_quantity, parse_unit_name
from emla_cosim.fmu.models import fmu_path
from emla_cosim.run.options import Options
from tests.support.commands import Emla, sentence

ALPHA, RISE = "lift.observer.alpha_1", "lift.plant.motor.permitted_rise"
LEVELS = [f"lift.disturbance.load.level[{i}]" for i in range(1, 7)]
LEVEL = LEVELS[0]


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.001) as simulation:
        yield simulation


def parameters(result: ec.Result) -> dict[str, Any]:
    """All start values of a run, by full name."""
    components = result.record["components"].items()
    return {f"{c}.{n}": v for c, record in components for n, v in record["parameters"].items()}


@pytest.fixture(scope="module")
def before(lift: ec.Simulation) -> dict[str, Any]:
    return parameters(lift.run())


def changed(lift: ec.Simulation, before: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    return {n: v for n, v in parameters(lift.run(set=values)).items() if before.get(n) != v}


def test_pattern_sets_all_matching_parameters(
    lift: ec.Simulation, before: dict[str, Any], fmu_folder: Path
) -> None:
    """Against fmpy's own reading of the model."""
    model = read_model_description(str(fmu_path("EmlaPlant", "native", fmu_folder)))
    expected = {
        f"lift.plant.{v.name}"
        for v in model.modelVariables
        if fnmatchcase(v.name, "screw.*") and v.causality == "parameter" and v.variability != "constant"
    }
    assert len(expected) > 3
    assert set(changed(lift, before, {"*.plant.screw.*": 0.123})) == expected


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({ALPHA: 3.0, "*.alpha_1": 4.0}, {ALPHA: 3.0}),
        ({"*.alpha_1": 4.0, ALPHA: 3.0}, {ALPHA: 3.0}),
        ({"*.alpha_1": 4.0, "lift.observer.alpha_?": 5.0}, {ALPHA: 5.0, "lift.observer.alpha_2": 5.0}),
        ({"lift.observer.alpha_?": 5.0, "*.alpha_1": 4.0}, {ALPHA: 4.0, "lift.observer.alpha_2": 5.0}),
        ({"*.load.level[1]": 7.0}, {LEVEL: 7.0}),
        ({"lift.disturbance.load.level[*]": 7.0}, dict.fromkeys(LEVELS, 7.0)),
        ({LEVEL: "30.5 kN", "*.plant.screw.lead": "11 mm"}, {LEVEL: 30.5e3, "lift.plant.screw.lead": 0.011}),
        ({RISE: "90 °F"}, {RISE: 50.0}),
    ],
)
def test_names_override_patterns_and_later_patterns_earlier_ones(
    lift: ec.Simulation, before: dict[str, Any], values: dict[str, Any], expected: dict[str, float]
) -> None:
    assert changed(lift, before, values) == pytest.approx(expected, rel=1e-12)


def test_later_values_override_those_of_a_file(emla: Emla, fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        f'system = "lift"\nstop_time = 0.001\n[set]\n"{ALPHA}" = 3.0\n"*.plant.motor.R_?" = 0.2\n'
    )
    assert emla("run", "mine.toml", "--no-plots", "--set", "*.alpha_1=4").exit_code == 0
    record = json.loads((tmp_path / "results/mine/run.json").read_text())
    assert record["components"]["lift.observer"]["parameters"]["alpha_1"] == "4"
    assert record["components"]["lift.plant"]["parameters"]["motor.R_s"] == 0.2
    assert record["changed"]["set"] == {"*.alpha_1": "4"}
    assert record["settings"]["set"] == {"*.plant.motor.R_?": 0.2, "*.alpha_1": "4"}
    with ec.load(tmp_path / "mine.toml").prepare(fmus=fmu_folder) as simulation:
        assert parameters(simulation.run())[ALPHA] == 3.0
    with ec.load(tmp_path / "mine.toml", set={"*.alpha_1": 4.0}).prepare(fmus=fmu_folder) as simulation:
        for values, expected in (({}, 4.0), ({"*.alpha_1": 5.0}, 5.0), ({ALPHA: 6.0}, 6.0)):
            assert parameters(simulation.run(set=values))[ALPHA] == expected


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"*.alhpa_1": 1.0}, "matches '*.alhpa_1'; did you mean"),
        ({"*.qqqqqqqqqqqq": 1.0}, "* matches any text"),
        ({"*.plant.tau_m": 1.0}, "'*.plant.tau_m' matches lift.plant.tau_m, which cannot be set"),
        ({"*.plant.motor.R_s": "many"}, "lift.plant.motor.R_s = many is not a number"),
        ({"*.plant.motor.R_s": 1e308 * 10}, "out of range"),
        ({"*.load.level[1]": "30 kV"}, "= 30 kV has the units kV and N"),
        ({LEVEL: "30 qN"}, "has the unknown unit 'qN'"),
        ({LEVEL: "1e999 kN"}, "out of range"),
        ({"lift.observer.rate": "30 kN"}, "has no variable"),
        (
            {"lift.reference.waypoint": [0.25] * 10},
            "'waypoint[10]'; the elements of waypoint are waypoint[1]",
        ),
    ],
)
def test_invalid_start_values(lift: ec.Simulation, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ec.CommandError) as caught:
        lift.run(set=values)
    assert message in str(caught.value)


def test_replaced_component_keeps_its_names(fmu_folder: Path) -> None:
    mapping = {"lift.plant": ec.Replacement(fmu_path("EmlaPlant", "native", fmu_folder))}
    overrides = {"*.plant.motor.R_s": "200 mOhm"}
    with ec.load("lift", replace=mapping, set=overrides).prepare(fmus=fmu_folder) as simulation:
        assert parameters(simulation.run(stop_time=0.001))["lift.plant.motor.R_s"] == 0.2


def test_which_texts_have_units() -> None:
    assert has_unit("30 kN") and has_unit("30kN") and has_unit("0x10")
    assert not any(map(has_unit, ("30", "1_000", "1e5", "nan", "true", "left 3 m", "", 30, None)))


@given(st.integers(-(10**15) + 1, 10**15 - 1), st.integers(-12, 3))
def test_power_of_ten_costs_no_digit(digits: int, power: int) -> None:
    """The double nearest to the decimal number, as if it was written in the other unit."""
    second = parse_unit_name("s", "it")
    for unit, factor in (("ms", -3), ("us", -6), ("ns", -9), ("s", 0)):
        quantity = parse_quantity(f"{digits}e{power} {unit}", "it").in_unit(second, "it")
        assert quantity == float(f"{digits}e{power + factor}")
    assert math.isclose(parse_quantity("2 min", "it").in_unit(second, "it"), 120.0, rel_tol=0)


def test_times_may_have_units(emla: Emla) -> None:
    times = {"step_size": "0.1ms", "stop_time": "2 min", "output_interval": "500 us"}
    options = Options().updated(times)
    assert (options.step_size, options.stop_time, options.output_interval) == (1e-4, 120.0, 5e-4)
    for text, words in (("2 m", "has the units m and s"), ("soon", "be a number"), ("2 x", "unknown unit")):
        assert words in sentence(emla("run", "lift", "--stop-time", text), 2)
    for text in ("nan", "inf", "-1", ""):
        sentence(emla("run", "lift", f"--stop-time={text}"), 2)
