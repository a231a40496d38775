"""Comparisons are fair: recommended gains, held-out seeds, equal reserves and observers."""

import itertools
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.analyses.compare.controller_variants import (
    HeldOutSeeds,
    Reserves,
    describe_reserves,
    find_reserve_values,
    list_random_seeds,
    list_tuning_seeds,
)
from emla_cosim.analyses.compare.rows import read_verdict
from emla_cosim.analyses.compare.runner import compare
from emla_cosim.analyses.execution.worker_payload import Preparation
from emla_cosim.analyses.variants.measures import VariantOutcome
from emla_cosim.fmu.models import build
from emla_cosim.run.scenarios.scenario_file import TUNINGS
from emla_cosim.study.controllers import CONTROLLERS
from emla_cosim.study.loading import load
from fmublock import Block, Input, Output, clamp

pytestmark = pytest.mark.usefixtures("on_one_cluster")

HELD_VERDICT = {"held": True, "reason": None}
SWINGS = {"held": False, "reason": "it swings.", "oscillation": {"time_s": 0.4}}
TRIPPED = {"held": False, "reason": "it tripped.", "trip": {"time_s": 0.2}}


@pytest.mark.parametrize(
    ("figures", "status", "expected"),
    [
        (HELD_VERDICT, "done", (True, None, None)),
        (SWINGS, "done", (False, 0.4, "it swings")),
        (TRIPPED, "diverged", (False, 0.2, "it tripped")),
        ({"held": False, "reason": "not settled.", "trip": None}, "done", (False, 0.7, "not settled")),
        (HELD_VERDICT, "diverged", (False, 0.7, "another joint ended")),
        ({}, "died", (False, 0.7, "its process ended")),
        ({}, "done", (False, 0.7, "it has no figures")),
    ],
)
def test_verdict_follows_from_figures_and_status(
    figures: dict[str, Any], status: str, expected: tuple[bool, float | None, str | None]
) -> None:
    outcome = VariantOutcome(0, status, "another joint ended.", 0.7, {"lift": figures})
    assert read_verdict(figures, outcome) == expected


def test_comparison_seeds_differ_from_tuning_seeds() -> None:
    """None of those that the plans train or validate with, drawn here as `emla tune` does."""
    used = set[int]()
    for text in TUNINGS.values():
        plan = tomllib.loads(text())
        random = np.random.default_rng(plan["seed"])
        used |= {int(random.integers(1, 2**31 - 2)) for _ in range(plan["training"] + plan["validation"])}
    assert len(used) == 5 and used == list_tuning_seeds()
    many, few = HeldOutSeeds(200), HeldOutSeeds(5)
    assert len(set(many.seeds)) == 200 and not used & set(many.seeds) and many.seeds[:5] == few.seeds
    names = [f"{joint}.plant.sensor.seed" for joint in ("lift", "tilt")]
    values = [few.values(names, seed)[name] for seed in few.seeds for name in names]
    assert len(set(values)) == 10 and not used & set(values)


@pytest.fixture(scope="module")
def prepared(fmu_folder: Path) -> dict[str, Preparation]:
    return {name: Preparation.of(load(name, fmus=fmu_folder)) for name in ("study", "study-drive")}


def test_random_components_get_seeds(prepared: dict[str, Preparation]) -> None:
    """On the study nothing but tilt's disturbance, until a sensor has noise or its disturbance none."""
    study, tilt = prepared["study"], "tilt.disturbance.d_2.seed"
    assert list_random_seeds(study, {}) == [tilt]
    assert list_random_seeds(study, {"lift.plant.sensor.sigma": 1e-6}) == ["lift.plant.sensor.seed", tilt]
    assert list_random_seeds(study, {"tilt.disturbance.d_2.high": 0.0}) == []
    assert len(list_random_seeds(prepared["study-drive"], {})) == 7


@pytest.fixture(scope="module")
def compared(
    fmu_folder: Path, scheduler: Client, tmp_path_factory: pytest.TempPathFactory
) -> ec.CompareResult:
    return ec.compare(
        "study",
        ["rsba", "foc"],
        seeds=3,
        stop_time=0.4,
        fmus=fmu_folder,
        scheduler=scheduler,
        output=tmp_path_factory.mktemp("compared"),
    )


def test_joints_without_noise_run_once(compared: ec.CompareResult) -> None:
    assert compared.entrants == ["rsba/damped", "foc/damped"]
    seeds = HeldOutSeeds(3).seeds
    for joint, controller in itertools.product(("lift", "tilt", "telescope"), ("rsba", "foc")):
        selected = compared.rows.filter(joint=joint, controller=controller)
        assert selected["seed"].to_list() == (seeds if joint == "tilt" else [None])
    tilt = compared.rows.filter(joint="tilt")
    assert tilt["torque_effort_N_m"].n_unique() == 6


def test_controllers_get_the_same_random_sequences(compared: ec.CompareResult, fmu_folder: Path) -> None:
    assert compared.folder is not None
    runs = json.loads((compared.folder / "comparison.json").read_text())["runs"]
    sets = {(r["controller"], r["seed"]): r["set"] for r in runs if r["joints"] == ["tilt"]}
    assert len(sets) == 6
    assert all(sets["rsba", seed] == sets["foc", seed] for seed in HeldOutSeeds(3).seeds)
    run = next(r for r in runs if r["joints"] == ["tilt"] and r["controller"] == "foc")
    scenario = load("tilt", controller="foc", gains="damped", set=run["set"], stop_time=0.4, fmus=fmu_folder)
    single_run = scenario.prepare().run().metrics["joints"]["tilt"]
    assert single_run["position_error_m"] == compared.rows.filter(run=run["run"])["position_error_m"][0]


def test_controllers_meet_equal_noise_and_disturbances(fmu_folder: Path) -> None:
    """Bit by bit, though their loops differ: one seed gives one sequence."""
    seed = HeldOutSeeds(1).values(["tilt.disturbance.d_2.seed", "tilt.plant.sensor.seed"], 1)
    sensor = {"tilt.plant.sensor.sigma": 1e-7, "tilt.plant.sensor.resolution": 0.0}
    sequences = []
    for controller in ("rsba", "foc"):
        scenario = load("tilt", controller=controller, stop_time=0.05, output_interval=1e-4, fmus=fmu_folder)
        result = scenario.prepare().run(set=seed | sensor)
        noise = result["tilt.plant.x_measured"] - result["tilt.plant.x_L"]
        sequences.append([*result["tilt.disturbance.d_2"], *noise])
    assert sequences[0] == sequences[1] and np.std(sequences[0]) > 0.0


def test_table_shows_mean_and_spread(compared: ec.CompareResult) -> None:
    (grid,) = compared.grids
    tilt = compared.rows.filter(joint="tilt", controller="foc")["position_error_m"].to_numpy()
    cell = next(row for row in grid.cells if row[0].text.startswith("tilt: position error"))[2]
    assert cell.text == f"{1e6 * tilt.mean():.3g} ± {1e6 * tilt.std(ddof=1):.2g}"
    assert "3 seeds that no tuning used" in grid.under[0]
    assert grid.under[-1] == (
        "For a joint with one controller, of all seeds that could be drawn: "
        "0 of 3 not held: below 63.2 % with 95 % confidence."
    )
    assert "±" not in grid.cells[0][1].text
    written = polars.read_csv(compared.folder / "comparison.csv")  # type: ignore[operator]
    assert written["seed"].drop_nulls().n_unique() == 3


def test_notes_state_reserves_and_offer_other_sets(compared: ec.CompareResult) -> None:
    reserves, equal, other_sets = compared.notes
    assert reserves == ("Reserves of current and voltage: rsba/damped 2 % and 20 %; foc/damped 0 % and 5 %.")
    assert equal == "Equal observers in study: --gains rsba/robust,foc/rule."
    expected = (
        "rsba/compensated, rsba/robust, rsba/published, rsba/compliant, foc/tuned, foc/rule and foc/compliant"
    )
    assert other_sets.startswith(f"Further sets of gains: {expected}")


@pytest.mark.parametrize("controller", list(CONTROLLERS))
def test_equal_reserves_are_set_on_every_controller(controller: str, fmu_folder: Path) -> None:
    part = Preparation.of(load("tilt", controller=controller, fmus=fmu_folder))
    values = find_reserve_values(part, Reserves(0.02, 0.2))
    assert values == {"tilt.controller.limit.i_reserve": 0.02, "tilt.controller.limit.u_reserve": 0.2}
    assert describe_reserves(part, values) == "2 % and 20 %"


@pytest.mark.parametrize(
    ("gains", "words"), [("robust", "0 % and no limit"), ("published", "no limit and no limit")]
)
def test_gains_without_limits_have_no_reserve(gains: str, words: str, fmu_folder: Path) -> None:
    part = Preparation.of(load("lift", controller="rsba", gains=gains, fmus=fmu_folder))
    assert describe_reserves(part, {}) == words


def test_reserve_reduces_the_peak_torque(fmu_folder: Path) -> None:
    """The lift starts at its limit of current: with a reserve the peak of the torque is that much less."""
    options = {"stop_time": 0.4, "fmus": fmu_folder, "workers": 1}
    usual = compare("lift", ["foc"], **options)
    less = compare("lift", ["foc"], reserves=(0.3, 0.05), **options)
    assert less.notes[0] == "Reserves of current and voltage: foc/damped 30 % and 5 %."
    ratio = less.rows["torque_peak_N_m"][0] / usual.rows["torque_peak_N_m"][0]
    assert 0.65 < ratio < 0.8 and less.rows["held"][0]


class Proportional(Block):
    """A controller of another company, without currents, limits, gains or reserves."""

    x_d = Input(unit="m")
    x_hat = Input(unit="m")
    v_hat = Input(unit="m/s")
    u_q = Output(unit="V")
    u_d = Output(unit="V")

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u_q": clamp(1e5 * (v.x_d - v.x_hat) - 1e3 * v.v_hat, -300.0, 300.0), "u_d": 0.0 * v.x_d}


def test_controllers_of_users_are_compared(fmu_folder: Path) -> None:
    """On another scenario, whose controllers sample at 1 kHz; what cannot be set is reported."""
    fmu = str(build("FocController", "native", [], fmu_folder))
    controllers = ["rsba", fmu, Proportional]
    how = {"seeds": 2, "reserves": (0.1, 0.1), "stop_time": 0.35, "fmus": fmu_folder, "workers": 1}
    result = ec.compare("prototype", controllers, **how)
    assert result.entrants == ["rsba/damped", f"{fmu}/compensated", "Proportional/compensated"]
    assert result.rows["seed"].to_list() == [None] * 3  # its sensors are ideal
    assert result.notes[0].count("10 % and 10 %") == 2
    assert "Proportional/compensated not stated" in result.notes[0]
    assert result.notes[1].startswith("Proportional/compensated keeps its own reserves")
    assert len(result.grids) == 1
