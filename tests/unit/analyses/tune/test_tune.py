"""Tunings find minima that are known by hand, and report conditions that are not met."""

import itertools
import json
import math
import os
import re
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.analyses.tune.plan import load_tuning_plan
from emla_cosim.analyses.tune.runner import Search
from emla_cosim.analyses.tune.score import Objective, Score
from emla_cosim.analyses.tune.space import parse_expression
from emla_cosim.analyses.variants.measures import DIVERGED, DONE, VariantOutcome
from emla_cosim.base.errors import CommandError
from emla_cosim.base.progress import Progress
from emla_cosim.run.requirements import parse_requirement
from emla_cosim.run.scenarios.scenario_file import TUNINGS
from emla_cosim.system.model import System
from fmublock import Block, DiscreteState, Input, Output, Parameter, StartTime, State, where
from tests.support.commands import Emla
from tests.support.tiers import mostly_slow


class Valley(Block):
    """A valley along y = x with its lowest point at x = y = 3, and a bias that a seed draws."""

    x = Parameter(1.0)
    y = Parameter(1.0)
    z = Parameter(0.0)
    seed = Parameter(1, minimum=1)
    depth = Output()
    bias = Output()
    sum = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        off, across = v.x - 3.0, v.x - v.y
        return {"depth": off * off + 10.0 * across * across, "bias": 1e-9 * v.seed, "sum": v.x + v.y + v.z}


METRICS = ["depth = last(v.f.depth)", "bias = last(v.f.bias)", "total = last(v.f.sum)"]
VALLEY: dict[str, Any] = {
    "vary": {"v.f.x": "0.5:20", "v.f.y": "0.5:20"},
    "metrics": METRICS,
    "objective": "1 + depth",
    "evaluations": 120,
    "stop_time": 0.1,
    "step_size": 0.1,
}


@pytest.fixture(scope="module")
def valley() -> System:
    return System.of({"v.f": Valley})


def test_lowest_point_is_found(valley: System, scheduler: Client) -> None:
    result = ec.tune(valley, **VALLEY, scheduler=scheduler)
    assert result.start.values == {"v.f.x": 1.0, "v.f.y": 1.0}
    assert result.start.training.objective == 5.0
    assert result.best.values == pytest.approx({"v.f.x": 3.0, "v.f.y": 3.0}, rel=0.01)
    assert result.complete and result.problem() is None
    assert result.history.height <= VALLEY["evaluations"]


def test_lowest_point_under_a_condition_is_found(valley: System, scheduler: Client) -> None:
    result = ec.tune(valley, **VALLEY, require=["total <= 4"], scheduler=scheduler)
    # (x - 3)^2 + 10 (x - y)^2 with x + y = 4: x = 83/41
    assert result.best.values == pytest.approx({"v.f.x": 83 / 41, "v.f.y": 81 / 41}, rel=0.02)
    assert result.best.training.holds


def test_margin_keeps_a_distance_to_conditions(valley: System, scheduler: Client) -> None:
    result = ec.tune(_plan(valley, margin=0.25), require=["total <= 4"], scheduler=scheduler)
    values = [float(x) for x in result.best.values.values() if x is not None]
    assert sum(values) == pytest.approx(3.0, rel=0.02)


def test_derived_values_follow_the_gains(valley: System, scheduler: Client) -> None:
    fields = {**VALLEY, "vary": {"radius": "0.5:20"}, "evaluations": 40}
    derive = {"v.f.x": "radius", "v.f.y": "2 * radius - 3"}
    result = ec.tune(valley, **fields, derive=derive, scheduler=scheduler)
    assert result.set["v.f.y"] == 2 * result.set["v.f.x"] - 3
    assert result.set["v.f.x"] == pytest.approx(3.0, rel=0.02)


def test_cases_without_a_name_have_their_position(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('scenario = "lift"\n[vary]\nx = "1:2"\n[[cases]]\n[[cases]]\nname = "late"\n[[cases]]\n')
    assert [case.name for case in load_tuning_plan(path).cases] == ["1", "late", "3"]


def test_cases_have_weights_conditions_and_values(valley: System, scheduler: Client) -> None:
    cases = [ec.Case("usual"), ec.Case("shifted", 3.0, {"v.f.z": 10}, ["total < 12"])]
    plan = _plan(valley, cases=cases, objective="total", evaluations=1)
    score = ec.tune(plan, scheduler=scheduler).start.training
    assert score.by_case == {"usual": 2.0, "shifted": 12.0}
    assert score.objective == (1 * 2.0 + 3 * 12.0) / 4
    assert score.list_unmet() == ["shifted: total < 12, but it is 12"]


class Ramp(Block):
    """A speed that grows with time."""

    v = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"v": v.time}


class Distance(Block):
    """The way at a speed, times a gain."""

    v = Input()
    k = Parameter(1.0)
    x = State(0.0)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.k * v.v}


@pytest.fixture(scope="module")
def way() -> System:
    return System.of({"ramp": Ramp, "way": Distance}, ["ramp.v -> way.v"])


WAY: dict[str, Any] = {
    "metrics": ["end = last(way.x)"],
    "objective": "end",
    "evaluations": 12,
    "stop_time": 1.0,
    "step_size": 0.1,
}
"""With the speed of the end of each step h, the way is k (1 + h) / 2."""


def test_change_by_half_the_step_is_that_of_the_closed_form(way: System, scheduler: Client) -> None:
    result = ec.tune(way, {"way.k": "0.5:2"}, **WAY, scheduler=scheduler)
    gain = result.best.values["way.k"]
    assert isinstance(gain, float) and result.best.training.objective == pytest.approx(gain * 0.55)
    assert result.best.half_step is not None
    assert result.best.half_step.objective == pytest.approx(gain * 0.525)
    (remark,) = result.remarks
    assert remark.startswith("Half the step changes the objective by -4.5 %; set --step-size 0.02 or")
    better = ec.tune(way, {"way.k": "0.5:2"}, **{**WAY, "step_size": 0.02}, scheduler=scheduler)
    assert not better.remarks


def test_step_that_matters_more_than_the_gains_is_reported(way: System, scheduler: Client) -> None:
    result = ec.tune(way, {"way.k": "0.99:1.01"}, **WAY, scheduler=scheduler)
    (remark,) = result.remarks
    assert remark.startswith("The step, not the gains, made the difference: half the step changes the ")
    fields = {**WAY, "evaluations": 1, "require": ["end > 0.54"]}
    unmet = ec.tune(way, {"way.k": "0.5:2"}, **fields, scheduler=scheduler).remarks[-1]
    assert unmet == "With half the step, conditions do not hold: usual: end > 0.54, but it is 0.525."


def test_step_is_not_judged_with_random_numbers(valley: System, scheduler: Client) -> None:
    result = ec.tune(valley, **{**VALLEY, "evaluations": 1}, scheduler=scheduler)
    assert result.best.half_step is None and result.problem() is None
    (remark,) = result.remarks
    assert "in the case 'usual': v.f draws random numbers in each step (v.f.seed)" in remark


class Fussy(Block):
    """It refuses steps that are shorter than 75 ms."""

    k = Parameter(1.0)
    x = State(0.0)
    before = StartTime(0.0)
    refused = DiscreteState(0.0)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": v.k}

    def update(self, v: Any) -> dict[str, Any]:
        return {"before": v.time, "refused": where(v.time - v.before < 0.075, math.inf, 0.0)}


def test_fmu_that_refuses_half_the_step_fails_no_tuning(scheduler: Client) -> None:
    fields = {**WAY, "metrics": ["end = last(f.x)"], "evaluations": 1}
    result = ec.tune(System.of({"f": Fussy}), {"f.k": "0.5:2"}, **fields, scheduler=scheduler)
    assert result.complete and result.best.training.objective == pytest.approx(1.0)
    (remark,) = result.remarks
    assert remark.startswith("The step is not judged in the case 'usual': ") and "refused" in remark


@pytest.mark.slow
def test_processes_of_a_cluster_find_the_same_gains(
    valley: System, scheduler: Client, cluster: Client
) -> None:
    first, second = (
        ec.tune(valley, **{**VALLEY, "evaluations": 40}, scheduler=c) for c in (scheduler, cluster)
    )
    assert first.history.equals(second.history)
    assert (first.best, first.seeds) == (second.best, second.seeds)


def test_another_seed_tries_other_gains(valley: System, scheduler: Client) -> None:
    fields = {**VALLEY, "evaluations": 8}
    first, second = (ec.tune(valley, **fields, seed=seed, scheduler=scheduler) for seed in (0, 1))
    assert not first.history["v.f.x"].equals(second.history["v.f.x"])
    assert not {*first.seeds["training"]} & {*second.seeds["training"]}


def test_validation_seeds_differ_from_training_seeds(valley: System, scheduler: Client) -> None:
    result = ec.tune(_plan(valley, objective="bias", evaluations=1, tolerance=0.0), scheduler=scheduler)
    training, validation = result.seeds["training"], result.seeds["validation"]
    assert not {*training} & {*validation}
    best = result.best
    assert best.validation is not None
    assert best.training.objective == pytest.approx(1e-9 * sum(training) / len(training))
    assert best.validation.objective == pytest.approx(1e-9 * sum(validation) / len(validation))
    assert (result.problem() is None) == (best.ratio <= 1.0)


def test_statement_counts_validation_seeds_that_meet_all_conditions(
    valley: System, scheduler: Client
) -> None:
    """The bias grows with the seed: a limit between the validation seeds is met with some of them."""
    plan = _plan(valley, objective="bias", evaluations=1)
    seeds = sorted(ec.tune(plan, scheduler=scheduler).seeds["validation"])
    limit = 1e-9 * (seeds[2] + seeds[3]) / 2.0
    result = ec.tune(plan, require=[f"bias < {limit!r}"], scheduler=scheduler)
    assert result.best.validation is not None and result.best.validation.met == 3
    assert result.statement is not None
    assert result.statement.startswith("3 of 4 validation seeds meet all conditions: 75 %, ")
    met = ec.tune(plan, require=["bias < 1e9"], scheduler=scheduler).statement
    # four of four: (1 - 0.95)^(1/4)
    assert met == "All 4 validation seeds meet all conditions: above 47.3 % with 95 % confidence."


def test_interrupted_tuning_keeps_the_best_gains(valley: System, scheduler: Client, tmp_path: Path) -> None:
    class Ending(Progress):
        evaluated = 0

        def advance(self, count: int) -> None:
            self.evaluated += count
            if self.evaluated > 30:
                os.kill(os.getpid(), signal.SIGINT)

    result = ec.tune(valley, **VALLEY, scheduler=scheduler, output=tmp_path, progress=Ending())
    assert not result.complete
    assert 20 < result.history.height < 60
    assert result.best.training.objective == result.history["objective"].min()
    assert json.loads((tmp_path / "tune.json").read_text())["status"] == "unfinished"


GAIN = ("--vary", "tilt.controller.beta[1]=200:4000")
TUNE_TILT = ("tune", "tilt", *GAIN, "--objective", "tilt.position_error_m")


@pytest.mark.usefixtures("on_one_cluster")
def test_written_scenario_repeats_the_best_run(emla: Emla, tmp_path: Path, fmu_folder: Path) -> None:
    result = emla(
        *TUNE_TILT,
        *("--require", "tilt.torque_peak_N_m < 140", "--evaluations", "9", "--training", "1"),
        *("--validation", "1", "--stop-time", "0.4", "--output", "found", "--workers", "1", "--report"),
    )
    assert result.exit_code == 0, result.output
    assert "better" in result.stdout or "worse" in result.stdout
    page = (tmp_path / "found/tune.html").read_text()
    assert "Conditions, with the worst figures" in page and "tilt.torque_peak_N_m &lt; 140" in page
    assert "Values of the plan" in page and "Values of the plan" not in result.stdout
    assert page.count("data:image/png") == 1
    assert (tmp_path / "found/tuning.png").read_bytes().startswith(b"\x89PNG")
    record = json.loads((tmp_path / "found/tune.json").read_text())
    seed = record["seeds"]["training"][0]
    seeds = {f"tilt.{name}.seed": seed for name in ("plant.sensor", "disturbance.d_2")}
    run = ec.load(tmp_path / "found/best.toml", fmus=fmu_folder).prepare().run(set=seeds)
    figure = run.metrics["joints"]["tilt"]["position_error_m"]
    assert figure == record["best"]["training"]["objective"] < record["start"]["training"]["objective"]


@pytest.mark.usefixtures("on_one_cluster")
def test_unmet_conditions_are_exit_code_1(emla: Emla) -> None:
    result = emla(
        *TUNE_TILT,
        *("--require", "tilt.position_error_m < 1e-12", "--evaluations", "1", "--stop-time", "0.31"),
        *("--output", "none", "--workers", "1", "--no-plots"),
    )
    assert result.exit_code == 1
    nearest = "no gains meet the requirements; the nearest: usual: tilt.position_error_m < 1e-12, but"
    assert nearest in result.stderr


def test_joints_that_the_objective_does_not_name_do_not_count(scheduler: Client, fmu_folder: Path) -> None:
    """The violation of a missed condition contains the tracking error, of the tuned joint alone."""
    violations = [
        ec.tune(
            scenario,
            {"lift.controller.beta[1]": "500:3000"},
            objective="lift.position_error_m",
            require=["lift.position_error_m < 1e-12"],
            evaluations=1,
            validation=0,
            stop_time=0.31,
            scheduler=scheduler,
            fmus=fmu_folder,
        ).start.training.violation
        for scenario in ("lift", "study")
    ]
    assert violations[0] == violations[1] > 0.0


@pytest.mark.parametrize("name", TUNINGS)
def test_plans_of_the_study_have_margins(name: str) -> None:
    _, joint, *compliant = name.split("-")
    with_margins = {case.name: case.margins for case in load_tuning_plan(name).cases if case.margins}
    assert with_margins.pop("margins") == [joint, f"{joint}.controller.u_q->{joint}.plant.u_q"]
    assert with_margins == ({"load mass +50 %": [joint]} if compliant else {})


@pytest.mark.parametrize("name", mostly_slow(TUNINGS, ["foc-telescope"]))
def test_plans_of_the_study_run(name: str, scheduler: Client, fmu_folder: Path) -> None:
    study_plan = load_tuning_plan(name)
    plan = replace(study_plan, cases=[replace(case, margins=(), at=None) for case in study_plan.cases])
    shortened: dict[str, Any] = {"evaluations": 1, "training": 1, "validation": 1, "stop_time": 0.31}
    result = ec.tune(plan, **shortened, scheduler=scheduler, fmus=fmu_folder)
    assert result.complete
    assert all(value is not None for value in result.start.values.values())
    assert len(result.start.training.worst) == (14 if name.endswith("-compliant") else 10)


DELAY = {"lift.plant.inverter.delay": 1e-4}
AT = {"at": 0.3, "stop_time": 0.45}


def with_margins(
    scheduler: Client, fmus: Path, *loops: str, at: float | None = None, **fields: Any
) -> ec.TuneResult:
    """Tune the lift's `compensated`, whose position loop has little margin, with one set of gains."""
    cases = [ec.Case("usual"), ec.Case("late", 0.0, DELAY, margins=loops, at=at)]
    options = {"gains": "compensated", "stop_time": AT["stop_time"], "fmus": fmus}
    plan = ec.TuningPlan(
        "margins", "lift", {"lift.controller.beta[1]": "500:3000"}, "lift.position_error_m", cases=cases
    )
    return ec.tune(plan, evaluations=1, scheduler=scheduler, validation=0, **options, **fields)


@pytest.mark.slow
def test_margins_are_conditions_with_the_figures_of_linearize(
    scheduler: Client, fmu_folder: Path, tmp_path: Path
) -> None:
    result = with_margins(scheduler, fmu_folder, "lift", at=AT["at"], output=tmp_path / "out", plots=False)
    settings = {"gains": "compensated", "set": DELAY, "stop_time": AT["stop_time"], "fmus": fmu_folder}
    (margins,) = ec.linearize("lift", open="lift", at=AT["at"], duration=0.15, **settings).margins.values()
    worst = {name.partition(": ")[2]: entry for name, entry in result.best.training.worst["late"].items()}
    assert worst["phase_margin_deg >= 30"] == {"figure": pytest.approx(margins.phase_deg), "met": False}
    assert worst["gain_margin_up_dB >= 6"] == {"figure": pytest.approx(margins.gain_up_dB), "met": False}
    assert worst["gain_margin_down_dB <= -6"] == {"figure": pytest.approx(margins.gain_down_dB), "met": False}
    assert worst["Ms <= 2.2"] == {"figure": pytest.approx(margins.Ms), "met": False}
    assert not result.best.training.holds and 3.0 < result.best.training.violation < 6.0
    recorded = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert recorded["best"]["training"]["worst"]["late"]["lift: Ms <= 2.2"]["met"] is False
    assert recorded["plan"]["cases"][1]["margins"] == ["lift"]


def test_margins_are_not_measured_where_another_condition_fails(scheduler: Client, fmu_folder: Path) -> None:
    result = with_margins(
        scheduler, fmu_folder, "lift", at=AT["at"], require=["lift.position_error_m < 1e-12"]
    )
    worst = result.best.training.worst["late"]
    assert worst["lift: Ms <= 2.2"] == {"figure": None, "met": False}


@pytest.mark.parametrize(
    ("loops", "at", "sentence"),
    [
        (["lift.plant.nothing->lift.observer.y"], None, "nothing"),
        (["lift"], 0.4, "'at' of the case 'late' of the tuning is 0.4 s; choose a time from 0 to 0.3 s"),
    ],
)
def test_invalid_loops_give_one_message(
    loops: list[str], at: float | None, sentence: str, scheduler: Client, fmu_folder: Path
) -> None:
    with pytest.raises(CommandError, match=re.escape(sentence)):
        with_margins(scheduler, fmu_folder, *loops, at=at)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"vary": {}}, "varies nothing; add a gain"),
        ({"objective": ""}, "has no objective; add a figure to minimise"),
        ({"objective": "depth +"}, "'depth +' is not an expression; use numbers"),
        ({"objective": "dept"}, "no metric matches 'dept'"),
        ({"vary": {"v.f.q": "1:2"}}, "has no variable 'q'"),
        ({"vary": {"x": "1:2"}}, "'x' of the tuning is neither a start value nor an option nor used in"),
        ({"vary": {"step_size": "0.1:0.2"}}, "'step_size' of the tuning is not a start value; gains must be"),
        ({"derive": {"v.f.z": "v.f.q * 2"}}, "uses 'v.f.q', which does not vary; use v.f.x and v.f.y"),
        ({"derive": {"v.f.x": "v.f.y"}}, "sets v.f.x twice: in 'vary' and in 'derive'"),
        ({"require": ["total"]}, "the requirement 'total' is invalid"),
        ({"require": ["total == true"]}, "total is a number"),
        ({"cases": [ec.Case("a"), ec.Case("a")]}, "has two cases 'a'"),
        ({"cases": [ec.Case("a", 0.0)]}, "no case of the tuning has a weight"),
        ({"cases": [ec.Case("a", 1.0, {"v.f.x": "1:2"})]}, "must be one value"),
        ({"cases": [ec.Case("a", 1.0, {"flavour": "python"})]}, "'flavour' of the case 'a' of the tuning"),
        ({"seeds": ["v.f.nothing*"]}, "no variable that can be set matches 'v.f.nothing*'"),
        ({"training": 0}, "'training' of the tuning is 0; it must be at least 1"),
        ({"tolerance": -1.0}, "'tolerance' of the tuning is -1.0; it must be at least 0"),
    ],
)
def test_invalid_plans_give_one_message(
    fields: dict[str, Any], sentence: str, valley: System, scheduler: Client
) -> None:
    with pytest.raises(CommandError) as refused:
        ec.tune(_plan(valley, **fields), scheduler=scheduler)
    assert sentence in str(refused.value)


@pytest.mark.parametrize("dimension", [1, 3])
def test_converged_search_restarts_with_twice_as_many_points(dimension: int) -> None:
    search = Search([0.0] * dimension, 1)  # begins at the end of a range
    sizes, firsts = list[int](), list[Any]()
    for _ in range(1000):
        points = search.propose()
        assert all(len(p) == dimension and ((p >= 0.0) & (p <= 1.0)).all() for p in points)
        if not sizes or len(points) != sizes[-1]:
            sizes.append(len(points))
            firsts.append(np.mean(points, axis=0))
        if len(sizes) == 4:
            break
        search.report_order([(False, float(((p - 0.3) ** 2).sum())) for p in points])
    assert sizes == [sizes[0] * 2**i for i in range(4)]
    assert len({tuple(first) for first in firsts}) == 4


def test_a_score_without_numbers_is_worse_than_any_other() -> None:
    """The tracking error of a run that diverged, a part of the violation, can be NaN."""
    worst = Score(math.nan, math.nan, 1, 1)
    scores = [Score(2.0, 0.0, 0, 1), Score(math.nan, 1e9, 1, 1), worst]
    for order in itertools.permutations(scores):
        assert sorted(order, key=lambda score: score.order) == scores


def test_expressions_are_those_of_python() -> None:
    values = {"a.b[1]": 3.0, "a.c": 2.0}
    expression = parse_expression("-a.b[1] ** 2 / (4 - a.c) + max(a.c, sqrt(9), 1e0)", "here")
    assert expression.names == {"a.b[1]", "a.c"}
    assert expression.value(values) == -(3.0**2) / 2 + 3.0
    for without in ("log(0 * a.c)", "10**10**10", "max((0 - a.c) ** 0.5, 1)", "9" * 400):
        assert math.isnan(parse_expression(without, "here").value(values))


@pytest.mark.parametrize("text", ["max(1)", "max()", "sqrt(1, 2)", "abs()", "log(1, 2, 3)", "max(*a)", "1j"])
def test_invalid_expressions_are_reported(text: str) -> None:
    with pytest.raises(CommandError, match=re.escape(f"here: '{text}' is not an expression; use")):
        parse_expression(text, "here")


def test_order_of_scores() -> None:
    judge = Objective(
        parse_expression("j.e", "here"),
        [ec.Case("usual")],
        [[parse_requirement("j.e < 1")]],
        0.0,
        10.0,
        tracking_errors=["j.miss"],
    )

    def order(status: str = DONE, end: float = 10.0, **figures: float) -> tuple[bool, float]:
        full_names = {f"j.{name}": value for name, value in figures.items()}
        return judge.score([[VariantOutcome(0, status, None, end, full_names)]]).order

    ordered = [
        order(e=0.5),
        order(e=0.9),
        order(e=1.1, miss=1.0),
        order(e=3.0, miss=1.0),
        order(e=math.nan, miss=2.0),
        order(e=math.nan, miss=5.0),
        order(DIVERGED, 6.0, miss=5.0),
        order(DIVERGED, 2.0, miss=5.0),
    ]
    assert ordered == sorted(ordered)
    assert [bad for bad, _ in ordered] == [False, False] + [True] * 6


def _plan(valley: System, **fields: Any) -> ec.TuningPlan:
    options = {name: VALLEY[name] for name in ("stop_time", "step_size")}
    usual = {name: value for name, value in VALLEY.items() if name not in options}
    return ec.TuningPlan("valley", valley, **{**usual, **fields}, options=options)
