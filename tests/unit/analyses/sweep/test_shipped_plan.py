"""The built-in plan `study-robustness` varies the study within the limits of its FMUs."""

import math
from pathlib import Path

import polars
import pytest

from emla_cosim.analyses.sweep.plan import Design, design_variants, load_plan
from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.analyses.variants.factors import Factor, Target
from emla_cosim.analyses.variants.measures import DONE
from emla_cosim.base.progress import Progress
from tests.support.commands import Emla

pytestmark = pytest.mark.usefixtures("on_one_cluster")

NAME = "study-robustness"
JOINTS = ("lift", "tilt", "telescope")


@pytest.fixture(scope="module")
def design(fmu_folder: Path) -> Design:
    return design_variants(load_plan(NAME).updated({"options": {"fmus": fmu_folder}}), Progress())


def ends(factor: Factor, target: Target) -> list[float]:
    """The least and the largest start value that a target gets."""
    scale = 1.0 if target.nominal is None else target.nominal
    return sorted(scale * float(end) for end in factor.distribution.ends)


def test_plan_is_listed(emla: Emla) -> None:
    result = emla("list")
    assert result.exit_code == 0, result.output
    (line,) = [line for line in result.stdout.splitlines() if NAME in line]
    assert "Three joints" in line


def test_same_factors_vary_in_every_joint_of_the_study(design: Design) -> None:
    assert (design.count, [group.preparation.name for group in design.groups]) == (2000, ["study"])
    names = [f.name.partition(".") for f in design.factors]
    lift, tilt, telescope = ({variable for of, _, variable in names if of == joint} for joint in JOINTS)
    assert lift == tilt == telescope
    assert 3 * len(lift) == len(names)
    expected = {"plant.motor.R_s", "disturbance.load.level[2]", "plant.sensor.sigma", "seeds", "start"}
    assert expected <= lift


def test_ranges_are_within_those_of_the_fmus(design: Design) -> None:
    preparation = design.groups[0].preparation
    outside = []
    for target, low, high in ((t, *ends(f, t)) for f in design.factors for t in f.targets):
        component, name = preparation.system.split(target.name)
        variable = preparation.interfaces[component.name].variables[name]
        least = -math.inf if variable.min is None else float(variable.min)
        largest = math.inf if variable.max is None else float(variable.max)
        if not least <= low < high <= largest:
            outside.append(target.name)
    assert outside == []


def test_ranges_contain_the_values_of_the_study(design: Design) -> None:
    system = design.groups[0].preparation.system
    ranges = {t.name: ends(f, t) for f in design.factors for t in f.targets}
    for name in ("motor.R_s", "motor.Phi_PM", "gearbox.eta_GB", "inverter.u_max", "start.x_L"):
        for joint in JOINTS:
            component, variable = system.split(f"{joint}.plant.{name}")
            low, high = ranges[f"{joint}.plant.{name}"]
            assert low < float(component.parameters[variable]) < high


def test_observers_start_where_plants_do_and_models_do_not_vary(design: Design) -> None:
    targets = {f.name: {t.name for t in f.targets} for f in design.factors}
    for joint in JOINTS:
        starts = {f"{joint}.plant.start.x_L", f"{joint}.observer.start.x_hat"}
        assert targets.pop(f"{joint}.start") == starts
    assert not [t for names in targets.values() for t in names if ".controller." in t or ".observer." in t]


def test_plan_runs(fmu_folder: Path, tmp_path: Path) -> None:
    longer = 0.31  # than it takes to tell who is held
    result = sweep(NAME, runs=4, stop_time=longer, fmus=fmu_folder, workers=1, output=tmp_path / "out")
    assert result.complete
    assert result.variants["status"].to_list() == [DONE] * 4
    assert result.variants.select(polars.col("^.*held$")).columns == [f"{joint}.held" for joint in JOINTS]
    errors = result.variants.select(polars.col("^.*position_error_m$"))
    assert errors.width == 3
    assert all(0.0 < e < 0.02 for column in errors for e in column)  # no more than the starts are off
    peaks = result.variants.select(polars.col("^.*speed_peak_m_s$"))
    assert all(0.0 < v < 1.0 for column in peaks for v in column)
    assert result.series is not None
    assert len(result.signals) == 6
