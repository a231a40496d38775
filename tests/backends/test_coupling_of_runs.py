"""The error of the coupling in runs of FMUs: where it is reported, and that parts of a run do not change it.

That no stepper changes it is shown in test_matrix.py.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.study.loading import load
from tests.support.rigid_load import rigid_load

HOW: dict[str, Any] = {"algorithm": "strong", "step_size": 1e-3, "stop_time": 3.0}
BOND = {"rod": "load.F_load * mass.v"}
JOINTS = ((1, "lift"), (2, "tilt"), (3, "telescope"))


@pytest.fixture(scope="module")
def simulation(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with load(rigid_load(), fmus=fmu_folder, **HOW).prepare() as prepared:
        yield prepared


@pytest.fixture(scope="module")
def uninterrupted(simulation: ec.Simulation) -> ec.Result:
    return simulation.run(bonds=BOND)


def same(actual: ec.Result, expected: ec.Result, share: float = 1e-9) -> None:
    assert actual.coupling.keys() == expected.coupling.keys()
    assert actual.coupling["rod"] == pytest.approx(expected.coupling["rod"], rel=share)


def test_result_files_and_record_have_bonds(uninterrupted: ec.Result, tmp_path: Path) -> None:
    assert uninterrupted.coupling["rod"]["energy_error"] > 0.2
    assert uninterrupted.remarks[0].startswith("Coupling error: about ")
    uninterrupted.save(tmp_path, plots=False, report=True)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["coupling"]["rod"] == uninterrupted.coupling["rod"]
    assert "rod" in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "run.json").read_text())["settings"]["bonds"] == BOND


def test_extrapolation_needs_no_remark(simulation: ec.Simulation) -> None:
    result = simulation.run(bonds=BOND, extrapolation="fmu")
    assert result.coupling["rod"]["energy_error"] < 1e-3
    assert not result.remarks


def test_parts_and_a_second_start_change_no_figures(
    simulation: ec.Simulation, uninterrupted: ec.Result
) -> None:
    simulation.start(bonds=BOND)
    for time in (0.001, 0.5, 2.999):
        simulation.advance(time)
        assert set(simulation.so_far().coupling) == set(uninterrupted.coupling)
    simulation.advance(3.0)
    same(simulation.finish(), uninterrupted)
    same(simulation.run(bonds=BOND, start_time=100.0, stop_time=103.0), uninterrupted, 1e-6)


def test_checkpoint_changes_no_figures(
    simulation: ec.Simulation, uninterrupted: ec.Result, tmp_path: Path
) -> None:
    path = tmp_path / "half.checkpoint"
    simulation.run(bonds=BOND, stop_time=1.234, checkpoint=path)
    same(simulation.run(bonds=BOND, resume=path), uninterrupted)


def test_under_error_control_every_step_counts(simulation: ec.Simulation) -> None:
    """Rows 0.25 s apart would see nothing of the steps between."""
    how = {"bonds": BOND, "error_tolerance": 1e-4, "stop_time": 1.0}
    result = simulation.run(**how)
    assert result.steps > 20 and 0.0 < result.coupling["rod"]["energy_error"] < 0.1
    with pytest.raises(ec.CommandError, match="remove --output-interval or --bond"):
        simulation.run(**how, output_interval=0.25)


def test_figure_can_be_required(simulation: ec.Simulation) -> None:
    with pytest.raises(ec.RunError, match=r"requirements not met: rod\.energy_error < 0\.02"):
        simulation.run(bonds=BOND, require=["rod.energy_error < 0.02"])
    with pytest.raises(ec.CommandError, match=r"no metric 'rod\.energy_eror'"):
        simulation.run(bonds=BOND, require=["rod.energy_eror < 0.02"])


@pytest.mark.parametrize(
    ("bonds", "problem"),
    [
        ({"rod": "load.F_load * mass.w"}, "there is no signal 'mass.w' for the bond rod"),
        ({"rod": "load.F_load"}, "write two signals"),
        ({"rod": ""}, "no power bond of the system matches 'rod'"),
        ({"rod": "mass.x * mass.v"}, "no component reads"),
        ({"mass.a -> load.a_load": "load.F_load * mass.v"}, "is the name of a connection"),
    ],
)
def test_impossible_bonds_are_refused(simulation: ec.Simulation, bonds: dict[str, str], problem: str) -> None:
    with pytest.raises(ec.CommandError, match=problem):
        simulation.run(bonds=bonds)


@pytest.mark.parametrize(
    ("options", "bonds"),
    [
        ({}, set()),
        ({"bonds": {"l*": "", "tele*": ""}}, {"lift", "telescope"}),
        ({"require": ["tilt.energy_error < 1"]}, {"tilt"}),
    ],
)
def test_bonds_of_a_system_on_request(fmu_folder: Path, options: dict[str, Any], bonds: set[str]) -> None:
    with load("hdrm-coupled", fmus=fmu_folder, stop_time=0.01).prepare() as prepared:
        result = prepared.run(**options)
    assert {of for of, figures in result.coupling.items() if "energy_error" in figures} == bonds
    signals = {name: f"machine.manipulator.F_L[{i}] * {name}.plant.v_L" for i, name in JOINTS}
    assert result.record["settings"].get("bonds", {}) == {name: signals[name] for name in bonds}


@pytest.mark.parametrize("name", ["rod", "r*"])
def test_name_without_signals_requests_a_bond_of_the_scenario(fmu_folder: Path, name: str) -> None:
    with load(rigid_load(), fmus=fmu_folder, bonds=BOND, **HOW).prepare() as prepared:
        result = prepared.run(bonds={name: ""}, stop_time=0.01)
    assert "energy_error" in result.coupling["rod"]
    assert result.record["settings"]["bonds"] == BOND


def test_checkpoint_without_energies_is_not_continued_with_some(
    simulation: ec.Simulation, tmp_path: Path
) -> None:
    simulation.run(stop_time=1.0, checkpoint=tmp_path / "plain")
    with pytest.raises(ec.CommandError, match="bonds"):
        simulation.run(bonds=BOND, resume=tmp_path / "plain")
