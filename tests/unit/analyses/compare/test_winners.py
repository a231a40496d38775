"""Winners are found seed by seed, and are not marked without a remark if the terms are not equal."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy.stats import binom

import emla_cosim as ec
from emla_cosim.analyses.compare.report import describe_lost_joints
from emla_cosim.analyses.compare.result import COLUMNS
from emla_cosim.analyses.compare.statistics import (
    FEWEST_SEEDS,
    SeedStatistics,
    describe_ranking,
    find_fewest_wins,
    format_lost,
    group_by_variant,
    is_significant,
    mark_winner,
    rank,
)
from emla_cosim.recorders.metrics import MetricDisplay
from emla_cosim.study.controllers import CONTROLLERS
from emla_cosim.study.joint import describe_observer
from emla_cosim.study.joints.schema import load_joint

ERROR = MetricDisplay("position_error_m", "position error", 1e6, "µm", "m")


def rows(controller: str, *errors: float, is_held: bool = True) -> list[dict[str, Any]]:
    """Runs of a controller that differ in their seeds, with these position errors in µm."""
    common = {"controller": controller, "gains": "own", "held": is_held, "random": True, "joint": "tilt"}
    common |= {"scenario": "own", "case": "nominal", "observer": "robust", "reserves": "0 % and 5 %"}
    return [common | {"seed": i, "position_error_m": 1e-6 * e} for i, e in enumerate(errors)]


def winner(*runs: list[dict[str, Any]]) -> str | None:
    """The winner of the position error, which is the only marked cell."""
    variants = group_by_variant([row for of_controller in runs for row in of_controller])
    ranking = rank(variants, ERROR)
    marked = [name for name, cell in mark_winner(variants, ERROR).items() if cell.is_best]
    assert marked == ([ranking.best] if ranking and ranking.is_winner else [])
    return next(iter(marked), None)


def test_unanimous_seeds_win_although_spreads_overlap() -> None:
    """The seeds differ by ten times the difference between the controllers."""
    errors = np.linspace(1.0, 2.0, 20)
    variants = group_by_variant([*rows("a", *errors)[::-1], *rows("b", *(errors + 0.1))])
    assert rank(variants, ERROR) == ("a/own", 20, 20, True)
    assert variants["a/own"].spread("position_error_m") > 3e-7  # m, beside a difference of 1e-7 m
    assert mark_winner(variants, ERROR)["a/own"] == ("1.5 ± 0.31, wins 20 of 20", True, False)


def test_half_of_the_seeds_is_no_win() -> None:
    first, second = rows("a", *[1.0, 3.0] * 5), rows("b", *[2.9, 1.0] * 5)
    assert winner(first, second) is None
    cells = mark_winner(group_by_variant([*first, *second]), ERROR)
    assert cells["b/own"] == ("1.95 ± 1, wins 5 of 10", False, False)


def test_a_win_is_a_seed_below_all_others() -> None:
    """Below each of two others in 6 of 8 seeds, below both in 4."""
    second, third = [2.0] * 6 + [0.9] * 2, [0.9] * 2 + [2.0] * 6
    assert winner(rows("a", *[1.0] * 8), rows("b", *second), rows("c", *third)) is None
    assert winner(rows("a", *[1.0] * 8), rows("b", *[2.0] * 8), rows("c", *[2.0] * 8)) == "a/own"


@pytest.mark.parametrize("seeds", range(1, 31))
def test_level_of_the_sign_test_in_closed_form(seeds: int) -> None:

    def chance_of(wins: int) -> float:
        return sum(math.comb(seeds, i) for i in range(wins, seeds + 1)) / 2 ** (seeds - 1)

    chance = {wins: chance_of(wins) for wins in range(seeds + 1)}
    assert all(is_significant(w, seeds) == (2 * w > seeds and p <= 0.05) for w, p in chance.items())
    significant = (w for w, p in chance.items() if 2 * w > seeds and p <= 0.05)
    assert find_fewest_wins(seeds) == next(significant, None)
    assert (find_fewest_wins(seeds) is None) == (seeds < FEWEST_SEEDS)


@pytest.mark.parametrize("controllers", [2, 3, 4, 10])
def test_several_controllers_do_not_raise_the_level(controllers: int) -> None:
    """Of controllers that are each below another one in at most half of the seeds, one is marked in 5 %."""
    random = np.random.default_rng(controllers)
    for seeds in (6, 10, 20):
        shares = random.dirichlet(np.full(controllers, 0.3), 500)
        shares = shares[shares.max(axis=1) <= 0.5]
        marked = binom.sf((find_fewest_wins(seeds) or 0) - 1, seeds, shares).sum(axis=1)
        assert marked.max(initial=0.0) <= 0.05


def test_one_random_run_has_no_winner() -> None:
    runs = [*rows("a", 1.0), *rows("b", 2.0)]
    assert winner(runs) is None
    assert "one run shows no winner; use --seeds 6" in describe_ranking(runs)[0]
    few = [*rows("a", 1.0, 1.0, 1.0), *rows("b", 2.0, 2.0, 2.0)]
    assert winner(few) is None and "3 seeds are too few" in describe_ranking(few)[0]
    of_scenario = [row | {"seed": None} for row in runs]
    assert winner(of_scenario) is None
    assert winner([row | {"random": False} for row in of_scenario]) == "a/own"


def test_run_without_noise_meets_every_seed() -> None:
    fixed = [row | {"seed": None, "random": False} for row in rows("a", 1.0)]
    assert winner(fixed, rows("b", *[1.5] * 6)) == "a/own"
    assert winner(fixed, rows("b", *[1.5] * 5, 0.5)) is None


def test_equal_figures_and_a_single_controller_have_no_winner() -> None:
    def without_noise(**errors: float) -> str | None:
        return winner([r | {"random": False, "seed": None} for n, e in errors.items() for r in rows(n, e)])

    assert without_noise(a=7.0, b=7.1) == without_noise(a=7.0, b=7.01) == "a/own"
    assert without_noise(a=7.061, b=7.0612) is None  # both are shown as 7.06
    assert without_noise(a=7.0649, b=7.0651) is None  # shown as 7.06 and 7.07
    assert without_noise(a=0.0, b=0.0) is None
    assert without_noise(a=7.0) is None
    assert winner(rows("a", *[7.061] * 9), rows("b", *[7.0612] * 9)) is None


def test_lost_joints_cannot_win() -> None:
    not_held = [*rows("a", *[0.1] * 5), *[row | {"seed": 5} for row in rows("a", 6040.0, is_held=False)]]
    held_rows = [*rows("b", *[1.0] * 6), *rows("c", *[3.0] * 6)]
    assert winner(not_held, held_rows) == "b/own"
    cells = mark_winner(group_by_variant([*not_held, *held_rows]), ERROR)
    assert cells["a/own"] == ("not held in 1 of 6 (6040)", False, True)
    assert format_lost(SeedStatistics(rows("a", 6040.0, is_held=False)), ERROR) == "not held (6040)"
    assert format_lost(SeedStatistics(rows("a", float("nan"), is_held=False)), ERROR) == "not held"


def test_interrupted_seeds_are_compared_in_pairs() -> None:
    variants = group_by_variant([*rows("a", *[1.0] * 9), *rows("b", *[2.0] * 7)])
    assert rank(variants, ERROR) == ("a/own", 7, 7, True)


def test_unequal_terms_stand_below_the_ranking() -> None:
    runs = [row | {"torque_effort_N_m": 11.0} for row in rows("a", *[1.0] * 6)]
    with_less_effort = [row | {"torque_effort_N_m": 10.0} for row in rows("b", *[2.0] * 6)]
    (_, effort) = describe_ranking([*runs, *with_less_effort])
    won = "a/own wins the position error of tilt"
    assert effort == f"Not equal: {won} with more torque effort than b/own (10 %)."
    reserved = [row | {"controller": "b", "observer": "none", "reserves": "2 % and 20 %"} for row in runs]
    assert describe_ranking([*runs, *reserved])[1:] == [
        "Not equal: observers of tilt: a/own robust; b/own none.",
        "Not equal: reserves of tilt, listed below; --reserves CURRENT,VOLTAGE sets equal ones.",
    ]
    unlimited = [row | {"controller": "c", "reserves": "0 % and no limit"} for row in runs]
    assert describe_ranking([*runs, *unlimited])[1:] == ["Not equal: reserves of tilt, listed below."]


@pytest.mark.usefixtures("scheduler")
def test_comparison_shows_observers_and_offers_equal_ones(fmu_folder: Path) -> None:
    options: Any = {"stop_time": 0.01, "fmus": fmu_folder, "workers": 1}
    unequal = ec.compare("lift", ["rsba", "foc"], gains=["rsba/robust", "foc/tuned"], **options)
    (grid,) = unequal.grids
    assert grid.header[1:] == [
        "rsba\nrobust\nobserver\nrobust\nat 4000 rad/s", "foc\ntuned\nobserver\ncompensated\nat 1959 rad/s"
    ]  # fmt: skip
    assert grid.under[0] == (
        "Not equal: observers of lift: rsba/robust robust at 4000 rad/s; foc/tuned compensated at 1959 rad/s."
    )
    assert unequal.notes[1] == "Equal observers in lift: --gains rsba/robust,foc/rule."
    equal = ec.compare("lift", ["rsba", "foc"], gains=["rsba/robust", "foc/rule"], **options)
    assert "observers" not in " ".join(equal.grids[0].under) and "observers" not in " ".join(equal.notes)
    set_ = {"lift.observer.alpha_2": 900.0}
    changed = ec.compare("lift", ["rsba"], gains=["rsba/robust"], set=set_, **options)
    assert changed.rows["observer"].to_list() == ["robust at 4000 rad/s, but alpha_2 = 900"]


def test_observers_are_named_by_the_rule_of_their_gains() -> None:
    """Those of all sets, beside the entries of the joint's file."""
    for controller, declared in CONTROLLERS.items():
        for gains in declared.gains:
            system = ec.load("tilt", controller=controller, gains=gains).system
            observer = load_joint("tilt").gain_set(controller, gains).observer.gains
            rule = describe_observer(system.component("tilt.observer").parameters.get)
            expected = "compensated" if observer.omega_d else "published" if observer.use_model else "robust"
            expected = "damped" if observer.omega_r else expected
            assert rule is not None and rule.startswith(f"{expected} ") and ", but" not in rule
    assert describe_observer({"alpha_1": 1.0}.get) is None


def robustness() -> ec.CompareResult:
    """A table of two cases with six seeds, in which one controller loses one run of twelve."""
    common = {"run": 0, "joint": "lift", "saturated_after_settling": 0.01, "torque_peak_N_m": 100.0}
    ends = {False: {"lost_at_s": 0.5, "why": "lift tripped on its speed at t = 0.5 s"}, True: {}}
    table_rows = [
        row | common | {"case": case} | ends[row["held"]]
        for case, is_held in (("nominal", True), ("noise", False))
        for runs in (
            rows("a", *[1.0, 1.1] * 3),
            rows("b", *[2.0] * 5),
            rows("b", *[2.4] * 6, is_held=is_held)[5:],
        )
        for row in runs
    ]
    table = polars.DataFrame(table_rows, schema=dict(COLUMNS), orient="row")
    return ec.CompareResult("own", "robustness", table, ["a/own", "b/own"])


def test_robustness_table_has_means_and_counts_held_runs() -> None:
    cases, counts = robustness().grids
    first, second = ([cell.text for cell in row] for row in cases.cells)
    assert first == ["nominal", "1.05 ± 0.055, wins 6 of 6 / 100 / 1", "2.07 ± 0.16 / 100 / 1"]
    assert second[1:] == ["1.05 ± 0.055 / 100 / 1", "not held in 1 of 6 (2.4)"]
    assert [cell.is_best for cell in cases.cells[0]] == [False, True, False]
    assert not any(cell.is_best for cell in cases.cells[1])  # there is only one left
    assert [[cell.text for cell in row] for row in counts.cells] == [["lift", "2 of 2", "1 of 2"]]
    assert counts.under == [
        "For a joint with one controller, of all seeds that could be drawn: "
        "0 of 6 not held: below 39.3 % with 95 % confidence; "
        "1 of 6 not held: 16.7 %, 0.42 % to 64.1 % with 95 % confidence."
    ]
    assert describe_lost_joints(robustness()) == [
        "noise, lift with b/own (1 of 6 runs): lift tripped on its speed at t = 0.5 s."
    ]
    assert list(robustness().figures()) == ["comparison-robustness"]
