"""Comparisons of controllers have the figures of single runs, under the same conditions."""

import json
import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from distributed import Client
from markupsafe import escape

import emla_cosim as ec
from emla_cosim.analyses.compare.controller_variants import ControllerVariant, select_variants
from emla_cosim.analyses.compare.plan import (
    ComparisonCase,
    ComparisonPlan,
    ComparisonRun,
    ComparisonTerms,
    find_independent_subsystems,
    plan_runs,
    read_robustness_cases,
    read_stability_maps,
)
from emla_cosim.analyses.compare.report import OUTPUTS, build_report, describe_lost_joints
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.analyses.frame.outputs import render_page
from emla_cosim.analyses.frame.report import Report, Section
from emla_cosim.base.errors import CommandError
from emla_cosim.base.progress import Progress
from emla_cosim.cli.commands.analysis import show_report
from emla_cosim.study.controllers import ROBUSTNESS_SETS
from emla_cosim.study.loading import load
from emla_cosim.study.paper import TABLE_VI, TABLE_VIII
from rsba_fmu import FocController
from tests.support.commands import Emla, sentence
from tests.support.whole_files import names as names_in

pytestmark = pytest.mark.usefixtures("on_one_cluster")

FILES = {"comparison.csv", "comparison.md", "comparison.json"}
SHORT_RUN = ("--stop-time", "0.4", "--workers", "1", "--no-plots")


def names(controllers: list[Any] | None, *gains: str, also: Sequence[str] = ()) -> list[str]:
    return [str(variant) for variant in select_variants(controllers, gains or None, also)]


def test_selection_of_controllers_and_gains() -> None:
    """Without gains the recommended set of each, which is declared in one place."""
    recommended = ["rsba/damped", "foc/damped", "cac/damped", "anatc/damped"]
    assert names(None) == names(None, "recommended") == recommended
    assert recommended == [f"{name}/{entry.recommended}" for name, entry in ec.CONTROLLERS.items()]
    assert names(["rsba"]) == ["rsba/damped"]
    assert names(["foc", "rsba"], "recommended", "rule") == ["foc/damped", "foc/rule", "rsba/damped"]
    assert names(["rsba"], "all") == [f"rsba/{s}" for s in ec.CONTROLLERS["rsba"].gains]
    assert names(["foc", "rsba"], "published") == ["foc/damped", "rsba/published"]
    assert names(["foc", "rsba"], "rsba/compensated", "tuned") == ["foc/tuned", "rsba/compensated"]
    assert names(["rsba", "rsba"], "robust", "rsba/robust") == ["rsba/robust"]
    robustness = partial(names, also=ROBUSTNESS_SETS)
    assert robustness(None)[:3] == ["rsba/damped", "rsba/robust", "foc/damped"]
    assert robustness(["rsba", "foc"], "recommended") == ["rsba/damped", "foc/damped"]
    assert robustness([FocController]) == ["FocController/compensated"]  # of a block of the user's


def test_selection_for_loads_that_are_not_rigid() -> None:
    """Their set is the recommended one of each controller that has it."""
    select = partial(select_variants, ["foc", FocController], preferred="compliant")
    names_of = ["foc/compliant", "FocController/compensated"]
    assert list(map(str, select())) == list(map(str, select(["recommended"]))) == names_of
    assert list(map(str, select(["foc/rule"]))) == ["foc/rule", "FocController/compensated"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--controllers", "pid"), "there is no controller 'pid'"),
        (("--controllers", "rsba,foc", "--gains", "soft"), "no controller that is compared has the set"),
        (("--controllers", "rsba", "--gains", "rsba/soft"), "the controller rsba has no set of gains 'soft'"),
        (("--controllers", "rsba", "--gains", "foc/rule"), "for the controller 'foc', which is not compared"),
        (("--table", "small"), "there is no table 'small'; choose from paper, robustness, stability and"),
        (("--resolution", "5"), "only the table stability has a resolution"),
        (("--table", "stability", "--resolution", "1"), "must be from 2 to 100"),
        (("--table", "paper"), "not 'lift'"),
        (("--set", "lift.plant.motor.R=1"), "R_s"),
        (("--workers", "0"), "at least 1"),
        (("--reserves", "0.02"), "must be two parts from 0 to 0.9, of current and voltage, such as 0.02,0.2"),
        (("--reserves", "0,1"), "must be two parts from 0 to 0.9, of current and voltage"),
        (("--reserves", "a,b"), "the reserves are 'a,b'; they must be two numbers"),
        (("--seeds", "-1"), "the number of seeds is -1; it must be from 0 to 1000"),
        (("--table", "certificate", "--seeds", "2"), "certificate does not support --seeds"),
    ],
)
def test_invalid_options_give_one_message(
    arguments: tuple[str, ...], words: str, emla: Emla, tmp_path: Path
) -> None:
    folder = tmp_path / "place"
    assert words in sentence(emla("compare", "lift", *arguments, "--output", str(folder)), 2)
    assert not folder.exists()


@pytest.fixture(scope="module")
def compared(
    fmu_folder: Path, scheduler: Client, tmp_path_factory: pytest.TempPathFactory
) -> ec.CompareResult:
    return ec.compare(
        "study",
        ["rsba", "foc"],
        gains=["robust", "published", "rule"],
        seeds=0,
        stop_time=0.4,
        fmus=fmu_folder,
        scheduler=scheduler,
        output=tmp_path_factory.mktemp("compared"),
    )


@pytest.mark.parametrize(("controller", "gains"), [("rsba", "robust"), ("foc", "rule")])
def test_rows_equal_single_runs(
    controller: str, gains: str, compared: ec.CompareResult, fmu_folder: Path
) -> None:
    """Though there the three joints run together, and here each alone."""
    scenario = load("study", controller=controller, gains=gains, stop_time=0.4, fmus=fmu_folder)
    figures = scenario.prepare().run().metrics["joints"]
    rows = compared.rows.filter(controller=controller, gains=gains).rows(named=True)
    assert [row["joint"] for row in rows] == list(figures)
    for row in rows:
        assert row["held"] and figures[row["joint"]]["held"]
        numbers = {name: value for name, value in figures[row["joint"]].items() if isinstance(value, float)}
        assert len(numbers) == 15
        for name, value in numbers.items():  # a sum's rounding depends on how many joints are summed at once
            rounding = 1e-12 if "_rms_" in name else 0.0
            assert row[name] == pytest.approx(value, rel=rounding, abs=0.0, nan_ok=True), name


def test_lost_joint_does_not_end_the_runs_of_others(compared: ec.CompareResult) -> None:
    """With the published gains tilt ends its run in the first millisecond; lift and telescope continue."""
    rows = {r["joint"]: r for r in compared.rows.filter(gains="published").rows(named=True)}
    assert not any(row["held"] for row in rows.values())
    assert rows["tilt"]["lost_at_s"] < 1e-3 and "the run ended" in rows["tilt"]["why"]
    assert rows["lift"]["why"].startswith("lift tripped on its current at t = ")
    assert rows["lift"]["torque_peak_N_m"] > 0.0
    assert [row["joint"] for row in compared.failed_rows.rows(named=True)] == list(rows)


def test_table_marks_figures_of_lost_joints(compared: ec.CompareResult) -> None:
    (grid,) = compared.grids
    column = next(i for i, head in enumerate(grid.header) if head.startswith("rsba\npublished"))
    assert all(row[column].is_failure and row[column].text.startswith("not held") for row in grid.cells)
    lift = {row["gains"]: row for row in compared.rows.filter(joint="lift").rows(named=True)}
    assert grid.cells[3][column].text == f"not held ({lift['published']['torque_peak_N_m']:.3g})"
    assert grid.cells[0][column - 1].text == f"{1e6 * lift['robust']['position_error_m']:.3g}"
    held_errors = compared.rows.filter(joint="lift", held=True)["position_error_m"]
    best = [c.text for c in grid.cells[0] if c.is_best]
    assert best == [f"{1e6 * held_errors.min():.3g}"]  # type: ignore[operator]


def test_command_in_the_folder_repeats_a_run(compared: ec.CompareResult, emla: Emla, tmp_path: Path) -> None:
    assert compared.folder is not None
    rows = polars.read_csv(compared.folder / "comparison.csv")
    assert rows.height == compared.rows.height == 9
    assert (compared.folder / "comparison.md").read_text().count("not held") >= 21
    record = json.loads((compared.folder / "comparison.json").read_text())
    assert record["status"] == "completed"
    (run,) = (r for r in record["runs"] if r["gains"] == "robust" and r["joints"] == ["telescope"])
    words = shlex.split(run["command"])[1:]
    assert emla(*words, "--no-plots", "--output", str(tmp_path)).exit_code == 0
    repeated = json.loads((tmp_path / "metrics.json").read_text())["joints"]["telescope"]
    row = compared.rows.filter(run=run["run"]).row(0, named=True)
    assert repeated["position_error_m"] == row["position_error_m"]


def test_errors_over_time_agree_with_metrics(compared: ec.CompareResult) -> None:
    row = compared.rows.filter(gains="robust", joint="lift").row(0, named=True)
    errors = compared.errors[row["run"]]
    late = errors.filter(polars.col("time") >= 0.3)["lift"].abs().max()
    assert late == pytest.approx(row["position_error_m"], rel=1e-2)  # rows of 1 ms, metrics of 0.1 ms


def test_motion_and_load_of_each_joint_are_kept_once(compared: ec.CompareResult, fmu_folder: Path) -> None:
    assert list(compared.motions) == [("study", joint) for joint in ("lift", "tilt", "telescope")]
    motion = compared.motions["study", "lift"]
    assert 200 <= motion.height <= 500 and motion["time"][-1] == pytest.approx(0.4, abs=2e-3)
    run = load("lift", stop_time=0.4, fmus=fmu_folder).prepare().run()
    reference = np.interp(motion["time"], run["time"], run["lift.reference.x_d"])
    assert motion["reference"].to_numpy() == pytest.approx(reference, abs=1e-12)
    assert motion["load"].to_list() == pytest.approx([57e3] * motion.height)


def test_page_has_tables_lost_joints_notes_and_pictures(compared: ec.CompareResult) -> None:
    pictures = dict(OUTPUTS.draw(compared))
    axes = {name: len(figure.axes) for name, figure in pictures.items()}
    assert axes == {"comparison-figures.png": 12, "comparison-errors.png": 3, "comparison-motion.png": 6}
    page = render_page(build_report(compared), dict.fromkeys(pictures, b"")).decode()
    for text in (*describe_lost_joints(compared), *compared.notes, "Motion and load"):
        assert str(escape(text)) in page
    assert page.count("<table>") == len(compared.grids)


def test_command_writes_page_and_pictures(emla: Emla, tmp_path: Path) -> None:
    arguments = ("--controllers", "rsba", "--stop-time", "0.01", "--seeds", "0", "--workers", "1")
    result = emla("compare", "lift", *arguments, "--report", "--output", str(tmp_path))
    assert result.exit_code == 0
    pictures = {f"comparison-{name}.png" for name in ("figures", "errors", "motion")}
    assert names_in(tmp_path) == {"compare.html", *FILES, *pictures}
    assert emla("compare", "lift", *arguments, "--no-plots", "--output", str(tmp_path)).exit_code == 0
    assert names_in(tmp_path) == FILES


def test_terminal_shows_a_part_of_many_lost_joints(capsys: pytest.CaptureFixture[str]) -> None:
    sections = [Section(lines=["a", "b", "c"], most=1), Section(lines=["for the page"], is_detail=True)]
    show_report(Report("Comparison", "lift", [], sections))
    assert capsys.readouterr().out == "a\nand 2 more, in the files\n"


def test_command_reports_lost_joints_first(emla: Emla, tmp_path: Path) -> None:
    arguments = ("--controllers", "rsba", "--gains", "published", *SHORT_RUN, "--output", str(tmp_path))
    result = emla("compare", "lift", *arguments)
    assert result.exit_code == 0
    message = "lift with rsba/published: lift tripped on its current"
    assert result.stdout.startswith(f"Not held: 1 of 1.\n{message}")
    assert names_in(tmp_path) == FILES


def test_command_has_the_values_of_a_case_instead_of_common_ones() -> None:
    """As the run itself has: a case is for a value that `--set` gives to all."""
    options = {"set": {"a.b": 1.0, "a.c": 2.0}, "stop_time": 0.4, "step_size": 1e-3, "gains": "soft"}
    overrides = {"set": {"a.b": 3.0}, "step_size": 1e-4}
    variant, case = ControllerVariant("rsba", "robust"), ComparisonCase("heavy")
    run = ComparisonRun("lift", variant, case, ["lift"], overrides, 0)
    words = ComparisonPlan([run], [], options, []).command(0) or []
    assert words[:3] == ["emla", "run", "lift"]
    assert set(zip(words[3::2], words[4::2], strict=True)) == {
        ("--set", "a.b=3.0"), ("--set", "a.c=2.0"), ("--stop-time", "0.4"), ("--step-size", "0.0001"),
        ("--controller", "rsba"), ("--gains", "robust"),
    }  # fmt: skip


@pytest.fixture(scope="module")
def prepared(fmu_folder: Path) -> Preparation:
    return find_independent_subsystems(Preparation.of(load("study", fmus=fmu_folder)))[1]  # tilt


def test_cases_change_start_values_of_the_plant(prepared: Preparation) -> None:
    cases = {case.name: case.resolve_start_values(prepared) or {} for case in read_robustness_cases()}
    plant = prepared.system.component("tilt.plant").parameters
    assert cases["nominal"] == {}
    assert cases["inductance +50 %"] == {
        f"tilt.plant.motor.{L}": 1.5 * float(plant[f"motor.{L}"]) for L in ("L_d", "L_q")
    }
    assert cases["efficiency +50 %, at most 1"] == {"tilt.plant.gearbox.eta_GB": 1.0}
    assert cases["start -20 mm"] == pytest.approx(
        {"tilt.plant.start.x_L": 0.389 - 0.02, "tilt.observer.start.x_hat": 0.389 - 0.02}
    )
    step = cases["load from -F to F at 0.5 s"]
    assert (step["tilt.disturbance.load.level[1]"], step["tilt.disturbance.load.start[2]"]) == (-25e3, 0.5)
    assert all(values or case == "nominal" or "encoder" in case for case, values in cases.items())
    for case in (ComparisonCase("rain", **{how: {"*.weather.rain": 1.0}}) for how in ("set", "scale")):
        assert case.resolve_start_values(prepared) is None  # without its variable it is omitted
    (freezing,) = (c for c in read_robustness_cases() if c.name == "encoder freezes at 0.5 s for 1 ms")
    faults = [f"{joint}.plant.x_measured=freeze@0.5+0.001" for joint in ("lift", "tilt")]
    assert list(map(str, freezing.faults(["lift", "tilt"]))) == faults
    assert not any("controller" in name or "observer.model" in name for c in cases.values() for name in c)


def test_map_has_all_points_of_its_grid() -> None:
    stability_map = read_stability_maps()[0]
    cases = stability_map.cases(3)
    assert [case.at for case in cases] == [(x, y) for y in (0.4, 1.0, 1.6) for x in (0.0, 0.3, 0.6)]
    assert cases[-1].set == {"*.plant.inverter.delay": pytest.approx(6e-4)}
    assert cases[-1].scale == {"*.plant.motor.L_?": pytest.approx(1.6)}


def test_stability_map_separates_stable_and_unstable_corners(fmu_folder: Path) -> None:
    """Without delay lift holds with its own inductance, with 0.6 ms and 0.4 of it no gains do."""
    result = ec.compare(
        "lift", ["rsba"], table="stability", resolution=2, stop_time=0.4, fmus=fmu_folder, workers=1
    )
    of_map = result.rows.filter(polars.col("case").str.starts_with("delay and inductance"))
    verdicts = {(row["x"], row["y"]): row["held"] for row in of_map.rows(named=True)}
    assert verdicts[0.0, 1.6] and not verdicts[0.6, 0.4]
    assert list(result.figures()) == ["comparison-stability-1", "comparison-stability-2"]


@pytest.mark.parametrize(("table", "count"), [(TABLE_VI, 3), (TABLE_VIII, 2)])
def test_averages_of_the_paper_are_ratios_of_means(table: Any, count: int) -> None:
    """All but two of the printed ones, those of the speed in Table VI."""
    assert len(table.cells) == count
    for controller, printed in table.averages.items():
        recomputed = table.recomputed(controller)
        for name, value, printed_value in zip(recomputed.__struct_fields__, recomputed, printed, strict=True):
            wrong = table is TABLE_VI and name == "velocity_error_m_s" and controller != "rsba"
            assert math.isclose(value, printed_value, abs_tol=0.006) != wrong, (controller, name)


def test_all_sets_leave_out_joints_that_lack_one() -> None:
    """The prototype has no gains for loads that are not rigid."""
    terms = ComparisonTerms(0, None, {"stop_time": 0.01}, skips_missing_gains=True)
    variants = select_variants(["rsba"], ["all"])
    plan = plan_runs(["prototype"], variants, [ComparisonCase()], terms, Progress())
    gains = set(ec.CONTROLLERS["rsba"].gains)
    assert {run.controller_variant.gains for run in plan.runs} == gains - {"compliant"}
    assert "prototype runs without rsba/compliant: the joint prototype has no such gains." in plan.notes
    strict = replace(terms, skips_missing_gains=False)
    with pytest.raises(CommandError, match="has no gains 'compliant'"):
        plan_runs(["prototype"], variants, [ComparisonCase()], strict, Progress())
