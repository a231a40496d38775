"""A chosen algorithm or step-size control overrides options of the scenario that it does not have."""

from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.run.choices import resolve
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from tests.support.tiers import mostly_slow

NOTE = "the order of the scenario is not used: the algorithm jacobi has none"


@pytest.mark.parametrize("name", mostly_slow(SCENARIOS, ["lift", "study", "lift_table"]))
@pytest.mark.parametrize("algorithm", ["jacobi", "strong"])
def test_every_scenario_accepts_every_algorithm(name: str, algorithm: str) -> None:
    scenario, scenario_options = ec.load(name, algorithm=algorithm), ec.load(name).options.class_options
    algorithm_object = scenario.options.make_algorithm()
    expected = {
        option: value
        for option, value in scenario_options.items()
        if option != "order" or algorithm != "jacobi"
    }
    assert scenario.options.class_options == expected
    assert all(getattr(algorithm_object, option) == value for option, value in expected.items())
    assert (NOTE in scenario.notes) == ("order" in scenario_options and algorithm == "jacobi")
    for control in ({"error_tolerance": 1e-3}, {"step_size_control": "fixed"}):
        ec.load(name, **control).options.make_step_size_control()


def test_order_of_the_user_is_not_overridden() -> None:
    with pytest.raises(ec.CommandError, match="the algorithm jacobi has no order; gauss-seidel and strong"):
        ec.load("prototype", algorithm="jacobi", order=["prototype.plant"]).options.make_algorithm()


def test_order_returns_with_an_algorithm_that_has_it() -> None:
    original = ec.load("prototype")
    repeated = original.with_options({"algorithm": "jacobi"}).with_options({"algorithm": "strong"})
    assert repeated.options.class_options["order"] == original.options.class_options["order"]
    assert repeated.notes == original.notes


def test_later_files_override_earlier_ones(tmp_path: Path) -> None:
    """Each file overrides the one before, the user all of them."""
    file = tmp_path / "mine.toml"
    file.write_text(
        'system = "prototype"\nalgorithm = "jacobi"\nerror_tolerance = 1e-3\nlargest_step = 1e-2\n'
    )
    scenario = ec.load(file)
    assert NOTE in scenario.notes and scenario.options.step_size_control_name == "error"
    fixed = ec.load(file, step_size_control="fixed")
    fixed.options.make_step_size_control()
    assert "the largest step of the scenario is not used: the step size control fixed has none" in fixed.notes
    file.write_text('system = "prototype"\nstep_size_control = "fixed"\n')
    assert ec.load(file, error_tolerance=1e-3).options.step_size_control_name == "error"
    file.write_text('system = "prototype"\nalgorithm = "jacobi"\norder = ["prototype.plant"]\n')
    with pytest.raises(ec.CommandError, match="the algorithm jacobi has no order"):
        ec.load(file).options.make_algorithm()


def test_order_in_a_record_is_dropped_for_another_algorithm(fmu_folder: Path, tmp_path: Path) -> None:
    """The new algorithm removes the order in its record, too."""
    order = list(ec.load("lift").options.class_options.get("order", ())) or [
        f"lift.{part}" for part in ("reference", "disturbance", "plant", "observer", "controller")
    ]
    ec.load("lift", order=order, fmus=fmu_folder).prepare().run(stop_time=0.001).save(tmp_path, plots=False)
    repeated = ec.load(tmp_path / "run.json", algorithm="jacobi")
    repeated.options.make_algorithm()
    assert "order" not in repeated.options.class_options


JACOBI = ec.Jacobi()
LAYERS = [
    ([], {}, []),
    ([{"order": ["a"]}, {"algorithm": "jacobi"}], {"algorithm": "jacobi"}, ["order"]),
    (
        [{"order": ["a"]}, {"algorithm": "jacobi"}, {"algorithm": "strong"}],
        {"order": ["a"], "algorithm": "strong"},
        [],
    ),
    ([{"order": ["a"]}, {"algorithm": JACOBI}], {"algorithm": JACOBI}, ["order"]),
    ([{"algorithm": "jacobi", "order": ["a"]}], {"algorithm": "jacobi", "order": ["a"]}, []),
    ([{"algorithm": "jacobi"}, {"order": ["a"]}], {"algorithm": "jacobi", "order": ["a"]}, []),
    (
        [{"largest_step": 1.0}, {"step_size_control": "fixed"}],
        {"step_size_control": "fixed"},
        ["largest_step"],
    ),
    (
        [{"largest_step": 1.0}, {"step_size_control": "fixed"}, {"error_tolerance": 0.1}],
        {"step_size_control": None, "error_tolerance": 0.1},
        ["largest_step"],
    ),
    (
        [{"step_size_control": "fixed"}, {"step_size_control": None, "error_tolerance": 0.1}],
        {"step_size_control": None, "error_tolerance": 0.1},
        [],
    ),
    (
        [{"step_multiples": {"a": 2, "b": 3}}, {"step_multiples": {"b": 4}}],
        {"step_multiples": {"a": 2, "b": 4}},
        [],
    ),
    ([{"set": {"a.x": 1, "b.x": 2}}, {"set": {"a.*": 3}}], {"set": {"b.x": 2, "a.*": 3}}, []),
    ([{"signals": ["a"]}, {"signals": []}], {"signals": []}, []),
]


@pytest.mark.parametrize(("layers", "values", "unused"), LAYERS)
def test_layers_override_earlier_ones(
    layers: list[dict[str, Any]], values: dict[str, Any], unused: list[str]
) -> None:
    resolution = resolve(layers)
    assert resolution.values == values and list(resolution.unused) == unused
