"""Entries of data sheets can be estimated: derived start values, invalid entries, estimates."""

from pathlib import Path
from typing import Any

import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.analyses.frame.plan_files import load_planned
from emla_cosim.analyses.identify.parameters import SheetEntries
from emla_cosim.analyses.identify.plan import IdentificationPlan
from emla_cosim.base.errors import CommandError

pytestmark = pytest.mark.usefixtures("on_one_cluster")

ENTRY, LEAD = "prototype.screw.lead", "prototype.plant.screw.lead"


def prepared(options: dict[str, Any]) -> dict[str, Any]:
    """All start values of a prepared scenario."""
    system = Preparation.of(ec.load("prototype", **options)).system
    return {f"{c.name}.{name}": value for c in system.components for name, value in c.parameters.items()}


def test_entry_changes_the_same_start_values_as_loading(fmu_folder: Path) -> None:
    """Values that an experiment sets itself stay, and those that follow from these with `follow_models`."""
    common: dict[str, Any] = {"fmus": fmu_folder}
    start_values: list[dict[str, Any]] = [
        {},
        {"set": {LEAD: "15 mm"}},
        {"set": {"prototype.plant.screw.le*": 0.015, "prototype.observer.model.A_eq": 19.0}},
        {"set": {LEAD: 0.015}, "follow_models": True},
    ]
    experiments = [ec.Experiment(str(i), options=options) for i, options in enumerate(start_values)]
    plan = IdentificationPlan("p", "prototype", {"x": "0:1"}, experiments, options=common)
    entries = SheetEntries(plan, [Preparation.of(load_planned(plan, options)) for options in start_values])
    for value in ("9 mm", "0.018 m"):
        for i, options in enumerate(start_values):
            changed = entries.start_values(i, {ENTRY: value})
            before = prepared({**common, **options})
            after = prepared({**common, **options, "sheet": {ENTRY: value}})
            assert {**before, **changed} == after
            assert changed and all(before[name] != x for name, x in changed.items())
            assert (LEAD in changed) == (i == 0)


@pytest.mark.slow
def test_entry_is_estimated(fmu_folder: Path, scheduler: Client, tmp_path: Path) -> None:
    F_C = "prototype.plant.friction.F_C"
    common: dict[str, Any] = {"fmus": fmu_folder, "stop_time": 0.1, "set": {F_C: 300.0}}
    run = ec.load("prototype", **common, sheet={ENTRY: "15.2 mm"}).prepare().run()
    x, i_q = "prototype.plant.x_L", "prototype.plant.i_q"
    result = ec.identify(
        "prototype",
        {f"actuator.{ENTRY}": "14 mm:18.1 mm"},
        measured=[ec.Input(data={"time": run.time, x: run[x], i_q: run[i_q]}, signals={x: x, i_q: i_q})],
        sigma={x: "1 um", i_q: "0.1 A"},
        scheduler=scheduler,
        output=tmp_path / "found",
        plots=False,
        **common,
    )
    estimate = result[f"actuator.{ENTRY}"]
    assert estimate.unit == "mm" and estimate.value == pytest.approx(15.2, rel=1e-4)
    assert estimate.error is not None
    assert result.set[LEAD] == pytest.approx(0.0152, rel=1e-4) and len(result.set) > 5
    reloaded = ec.load(str(tmp_path / "found/identified.toml"), fmus=fmu_folder)
    assert set(reloaded.options.set) == {F_C}
    assert reloaded.prepare().run()[x] == pytest.approx(run[x], abs=1e-7)


@pytest.mark.slow
def test_invalid_values_of_entries_are_avoided(fmu_folder: Path, scheduler: Client) -> None:
    """The search starts in the middle of the range, with an efficiency above 1."""
    common: dict[str, Any] = {"fmus": fmu_folder, "stop_time": 0.1}
    run = ec.load("prototype", **common, sheet={"prototype.gearbox.efficiency": 0.8}).prepare().run()
    i_q, name = "prototype.plant.i_q", "actuator.prototype.gearbox.efficiency"
    result = ec.identify(
        "prototype",
        {name: "0.5:1.9"},
        measured=[ec.Input(data={"time": run.time, i_q: run[i_q]}, signals={i_q: i_q})],
        sigma={i_q: "0.1 A"},
        scheduler=scheduler,
        starts=4,
        **common,
    )
    assert result[name].start == pytest.approx(1.2)
    assert result[name].value == pytest.approx(0.8, rel=1e-3)
    assert any(
        "failed, most often because: the actuator with changes cannot be used" in x for x in result.notes
    )


DATA = {"time": [0.0, 0.1, 0.2, 0.3], "x": [0.0, 1.0, 2.0, 3.0]}
POSITION = ec.Input(data=DATA, signals={"prototype.plant.x_L": "x"})


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"actuator.prototype.screw.leed": "14 mm:18 mm"}, "has the unknown entry 'leed'; did you mean"),
        ({"actuator.prototype.screw.lead": "14:18"}, "screw.lead is 14.0 without a unit; add one"),
        ({"actuator.prototype.screw.lead": "14 mm:18 mm", LEAD: "0.01:0.02"}, f"changes {LEAD}, which is"),
        ({"actuator.prototype.screw.lead": ["14 mm", "18 mm"]}, "needs a range LOW:HIGH"),
        ({"actuator.prototype": "14:18"}, "cannot be estimated: prototype is not a start value"),
    ],
)
def test_invalid_entries_are_reported(vary: dict[str, Any], words: str, fmu_folder: Path) -> None:
    with pytest.raises(CommandError) as refused:
        ec.identify("prototype", vary, measured=[POSITION], fmus=fmu_folder)
    assert words in str(refused.value)


def test_overridden_entry_is_reported(fmu_folder: Path) -> None:
    fixed_values = {name: x for name, x in prepared({"fmus": fmu_folder}).items() if not name.endswith("x_L")}
    fixed = [ec.Experiment("fixed", [POSITION], {"set": fixed_values})]
    with pytest.raises(CommandError, match="changes no start value of the experiment 'fixed'"):
        ec.identify("prototype", {f"actuator.{ENTRY}": "14 mm:18 mm"}, experiments=fixed, fmus=fmu_folder)
