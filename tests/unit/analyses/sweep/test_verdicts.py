"""Sweeps report for each variant whether its joints are held; metrics decide it."""

import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.analyses.sweep.report import find_worst_variants, status_line, tabulate_figures
from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.analyses.variants.measures import MetricRequest, add_verdicts, resolve_measures
from emla_cosim.recorders.metrics import Figure
from emla_cosim.system.model import Component, System
from fmublock import Block, Output, Parameter, build
from tests.support.faulty_systems import line_with_a_fault
from tests.support.hand_written_fmus import Fault
from tests.support.sweep_results import swept
from tests.support.toy_fmu import PRODUCER

GAINS, RATES = [0.5, 1.0, 1.5], [1.0, 2.0, 3.0]


class Growth(Block):
    """a k t, which is beyond 2 at t = 1 where a k is."""

    a = Parameter(1.0, maximum=2.0)
    k = Parameter(1.0)
    y = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.a * v.k * v.time}


def limit_metrics(layout: ec.RunLayout) -> Any:
    """Metrics that hold what stays below 2."""
    from typing import Any  # which this takes along, as it does `ec`

    class Limit(ec.Metrics):
        largest = 0.0

        def write(self, rows: Any) -> None:
            self.largest = max(self.largest, float(rows[:, 1 + list(layout.names).index("j.y.y")].max()))

        def figures(self) -> dict[str, dict[str, Any]]:
            is_held = self.largest < 2.0
            reason = None if is_held else f"y comes to {self.largest:g}, beyond 2."
            return {"j": {"largest": self.largest, "held": is_held, "reason": reason}}

        def state_dict(self) -> Any:
            return self.largest

        def load_state_dict(self, state: Any) -> None:
            self.largest = state

    return Limit()


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> System:
    path = tmp_path_factory.mktemp("growth") / "Growth.fmu"
    build(Growth, path, producer=PRODUCER)
    return System((Component("j.y", "Growth", {}, path),), ())


def plan(scheduler: Client, **fields: Any) -> dict[str, Any]:
    vary = {"j.y.a": GAINS, "j.y.k": RATES}
    return {"vary": vary, "scheduler": scheduler, "stop_time": 1.0, "step_size": 0.1, **fields}


@pytest.mark.parametrize("metrics", [None, ["j.largest"], ["peak = max(j.y.y)"], ["j.held", "j.largest"]])
def test_tables_have_the_verdict(
    metrics: Any, growth: System, scheduler: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ec.METRICS, "limit", limit_metrics)
    result = sweep(growth, metrics=metrics, **plan(scheduler))
    assert set(result.variants["status"]) == {"done"}
    product = np.array([a * k for a in GAINS for k in RATES])
    assert result.variants["j.held"].to_list() == (product < 2.0).tolist()
    assert result.variants.columns.count("j.held") == 1
    failing = int((product >= 2.0).sum())
    assert str(status_line(result)) == f"9 variants: 9 done ({failing} of them not held)"
    axes = result.plot("map")
    assert axes.get_suptitle() == "system: where it is held"
    legend = [text.get_text() for text in axes.legends[0].get_texts()]
    assert legend == [f"held ({9 - failing})", f"not held ({failing})"]
    size = next(figure for figure in ("j.largest", "peak") if figure in result.figures)
    last = find_worst_variants(result, size, 1).row(0, named=True)
    assert not last["j.held"] and last["problem"] == f"j: y comes to {product.max():g}, beyond 2."
    held_rows = result.variants.filter("j.held")
    assert held_rows["problem"].null_count() == len(held_rows)


def test_resumed_sweep_has_the_same_verdicts_and_adds_its_time(
    growth: System, scheduler: Client, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As if it had ended after two of its variants, which took 1000 s."""
    monkeypatch.setitem(ec.METRICS, "limit", limit_metrics)
    fields = plan(scheduler, metrics=["j.largest"])
    complete = sweep(growth, output=tmp_path / "a", **fields)
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    part = complete.variants.select("variant", "status", "problem", "end_s", *complete.figures).filter(
        polars.col("variant").is_in([4, 8])
    )
    (tmp_path / "b/parts").mkdir()
    part.write_parquet(tmp_path / "b/parts/000000004.parquet")
    record = json.loads((tmp_path / "b/sweep.json").read_text())
    (tmp_path / "b/sweep.json").write_text(json.dumps({**record, "status": "unfinished", "wall_s": 1e3}))
    resumed = sweep(growth, output=tmp_path / "b", resume=True, **fields)
    assert resumed.complete and resumed.variants.equals(complete.variants)
    assert 1e3 < resumed.wall_s < 1e3 + 60.0
    assert json.loads((tmp_path / "b/sweep.json").read_text())["wall_s"] == resumed.wall_s


def test_sweep_without_metrics_has_no_verdict(growth: System, scheduler: Client) -> None:
    result = sweep(growth, metrics=["largest = max(j.y.y)"], **plan(scheduler))
    assert str(status_line(result)) == "9 variants: 9 done"
    figure = result.plot("map")
    assert figure.get_suptitle() == "system: which variants are done"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["done (9)"]


def test_missing_verdict_counts_as_not_held() -> None:
    figures = {"a.held": [True, None, True, False], "b.held": [True, True, False, True]}
    result = swept({"x": range(4)}, {**figures, "size": [1.0, 2.0, 3.0, 4.0]})
    assert str(status_line(result)) == "4 variants: 4 done (3 of them not held)"
    assert [row[0] for row in tabulate_figures(result).rows] == ["a.held", "b.held", "size"]


FIGURES = {
    "lift.held": Figure("lift", "held", True),
    "lift.error_m": Figure("lift", "error_m", 0.0),
    "tilt.held": Figure("tilt", "held", False),
}


def test_missing_verdicts_are_added_last() -> None:
    for metrics, names in (
        (["lift.error_m"], ["lift.error_m", "lift.held", "tilt.held"]),
        (["tilt.held"], ["tilt.held", "lift.held"]),
        ([], list(FIGURES)),
    ):
        measures = resolve_measures(MetricRequest.of(metrics, "the plan"), FIGURES, [], [], [], "the plan")
        got = add_verdicts(measures, FIGURES)
        assert got.names == names and sorted(got.truths) == got.verdicts == ["lift.held", "tilt.held"]


@pytest.mark.parametrize("name", ["held", "lift.held", "mine.held"])
def test_held_is_a_reserved_name(name: str) -> None:
    with pytest.raises(ec.CommandError, match=f"'{name}', but 'held' is the verdict"):
        MetricRequest.of([f"{name} = max(lift.x) < 1"], "the plan")


def test_problem_has_divergence_and_failed_metric(scheduler: Client, faulty_fmu: Path) -> None:
    """Both in one variant; its neighbour only has the metric that fails."""

    def failing(result: Any) -> float:
        raise ValueError("no number")

    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.45)
    result = sweep(
        system, {"j.bad.fault": [int(Fault.DISCARD), int(Fault.NONE)]}, metrics={"m": failing},
        scheduler=scheduler, stop_time=1.0, step_size=0.1,
    )  # fmt: skip
    discarded, diverged = result.variants["problem"].to_list()
    with pytest.raises(ec.RunError) as caught:
        ec.load(system, stop_time=1.0, step_size=0.1).prepare().run(set={"j.bad.fault": int(Fault.DISCARD)})
    assert discarded == f"{caught.value} {diverged}"
    assert diverged == "the metric 'm' raised ValueError('no number')."


def test_provenance_depends_on_the_fmu_of_a_variant(
    growth: System, scheduler: Client, tmp_path: Path
) -> None:
    """Two FMUs with the same values give four different hashes, in any order."""

    class Doubled(Growth):
        def outputs(self, v: Any) -> dict[str, Any]:
            return {"y": 2.0 * v.a * v.k * v.time}

    first, second = growth.components[0].fmu, tmp_path / "Doubled.fmu"
    build(Doubled, second, producer=PRODUCER)

    def provenances(files: list[Any]) -> dict[tuple[str, float], str]:
        vary = {"j.y": [str(file) for file in files], "j.y.a": [1.0, 2.0]}
        result = sweep(growth, **{**plan(scheduler), "vary": vary})
        keys = result.variants.select("j.y", "j.y.a").rows()
        return dict(zip(keys, result.variants["provenance"].to_list(), strict=True))

    hashes = provenances([first, second])
    assert len(set(hashes.values())) == 4
    assert provenances([second, first]) == hashes


def test_unknown_lead_is_not_held_unless_models_follow(scheduler: Client, fmu_folder: Path) -> None:
    lead, leads = "prototype.plant.screw.lead", [0.016, 0.028, 0.04]
    options: dict[str, Any] = {"scheduler": scheduler, "fmus": fmu_folder, "stop_time": 1.0}
    result = sweep("prototype", {lead: leads}, metrics=["prototype.torque_peak_N_m"], **options)
    assert result.variants["status"].to_list() == ["done"] * 3
    assert result.variants["prototype.held"].to_list() == [True, False, False]
    assert all(text.startswith("prototype ") for text in result.variants["problem"][1:])
    (note,) = result.notes
    assert note.startswith(f"{lead} changes") and "--follow-models" in note
    followed = sweep("prototype", {lead: leads}, follow_models=True, **options)
    assert followed.variants["prototype.held"].to_list() == [True, True, True]
    assert max(followed.variants["prototype.position_error_m"].to_list()) < 1e-4


@pytest.mark.parametrize("high", [2.0, 3.0])
def test_record_has_indices_with_their_warning(
    high: float, scheduler: Client, growth: System, tmp_path: Path
) -> None:
    fields: dict[str, Any] = {"vary": {"j.y.a": f"0:{high}", "j.y.k": "0:1"}, "scheduler": scheduler}
    fields |= {"metrics": ["y = last(j.y.y)", "same = 1"], "sampling": "saltelli", "runs": 32}
    fields |= {"stop_time": 0.1, "step_size": 0.1}
    result = sweep(growth, **fields, output=tmp_path / "out")
    with warnings.catch_warnings(record=True) as shown_warnings:
        warnings.simplefilter("always")
        indices = result.sobol("y")
    recorded = json.loads((tmp_path / "out/sweep.json").read_text())["sobol"]
    assert list(recorded) == ["y"]
    assert recorded["y"]["factors"] == ["j.y.a", "j.y.k"]
    for name in ("first", "first_confidence", "total", "total_confidence"):
        assert recorded["y"][name] == getattr(indices, name).tolist()
    failed = int((result.variants["status"] != "done").sum())
    assert (failed > 0) == (high > 2.0) == (recorded["y"]["left_out"] > 0) == bool(shown_warnings)
    assert recorded["y"]["warning"] == indices.warning
    text = (tmp_path / "out/sweep.json").read_text()
    resumed = sweep(growth, **fields, output=tmp_path / "out", resume=True)
    assert (tmp_path / "out/sweep.json").read_text() == text
    assert resumed.variants.equals(result.variants)
