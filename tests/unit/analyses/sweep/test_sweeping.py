"""Variants of a sweep equal single runs, in this process and on a cluster."""

import html
import itertools
import json
import math
import shlex
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import Client

import emla_cosim as ec
from emla_cosim.analyses.sweep.result import read_sweep
from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.system.model import Replacement
from tests.support.commands import Emla
from tests.support.faulty_systems import line_with_a_fault
from tests.support.hand_written_fmus import Fault
from tests.support.paths import FOREIGN_MAPPING

R_S, SIGNAL = "lift.plant.motor.R_s", "lift.plant.i_q"
TABLE: dict[str, Any] = {"stop_time": 0.02}


def has_figures(row: dict[str, Any], metrics: Any) -> bool:
    """Whether a row has these metrics, to the bit."""
    pairs = [(row[f"lift.{n}"], x) for n, x in metrics["joints"]["lift"].items() if f"lift.{n}" in row]
    return bool(pairs) and all(a == b or (_none(a) and _none(b)) for a, b in pairs)


def _none(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


FACTORS: dict[str, Any] = {
    "vary": {R_S: "0.05:0.3:3", "step_size": [5e-5, 1e-4], "gains": ["robust", "published"]},
    "signals": [SIGNAL],
    **TABLE,
}


def test_variants_equal_single_runs(scheduler: Client, fmu_folder: Path) -> None:
    result = sweep("lift", **FACTORS, scheduler=scheduler, fmus=fmu_folder)
    assert result.complete and result.variants["variant"].to_list() == list(range(12))
    expected = list(itertools.product([0.05, 0.175, 0.3], [5e-5, 1e-4], ["robust", "published"]))
    rows = result.variants.select(R_S, "step_size", "gains").rows()
    assert [r[1:] for r in rows] == [e[1:] for e in expected]
    assert [r[0] for r in rows] == pytest.approx([e[0] for e in expected], rel=1e-15)
    assert result.series is not None
    series = result.series.collect().partition_by("variant", as_dict=True)
    for gains in ("robust", "published"):
        with ec.load("lift", gains=gains, fmus=fmu_folder).prepare() as simulation:
            for row in result.variants.filter(gains=gains).to_dicts():
                run = simulation.run(set={R_S: row[R_S]}, step_size=row["step_size"], **TABLE)
                assert has_figures(row, run.metrics)
                signals = series[row["variant"],]
                assert np.array_equal(signals[SIGNAL].to_numpy(), run[SIGNAL])
                assert np.array_equal(signals["time"].to_numpy(), run["time"])


@pytest.mark.slow
def test_processes_of_a_cluster_give_the_same_files(
    cluster: Client, scheduler: Client, fmu_folder: Path, tmp_path: Path
) -> None:
    for name, client in (("a", scheduler), ("b", cluster)):
        sweep("lift", **FACTORS, scheduler=client, fmus=fmu_folder, output=tmp_path / name)
    first, second = (ec.read_sweep(tmp_path / name) for name in "ab")
    assert (tmp_path / "a/variants.parquet").read_bytes() == (tmp_path / "b/variants.parquet").read_bytes()
    assert first.series is not None and second.series is not None
    assert first.series.collect().equals(second.series.collect())


def test_command_of_a_variant_gives_its_figures(scheduler: Client, emla: Emla, fmu_folder: Path) -> None:
    result = sweep(
        "lift",
        {"lift.plant.motor.[RL]_[sd]": "±7%", "algorithm": ["jacobi", "gauss-seidel"]},
        runs=3, scheduler=scheduler, fmus=fmu_folder, **TABLE,
    )  # fmt: skip
    assert result.factors == ["lift.plant.motor.R_s", "lift.plant.motor.L_d", "algorithm"]
    for row in result.variants.to_dicts():
        text = result.command(row["variant"])
        assert text is not None
        process = emla(*shlex.split(text)[1:], "--no-plots", "--output", f"v{row['variant']}")
        assert process.exit_code == 0, process.output
        figures = json.loads(Path(f"v{row['variant']}/metrics.json").read_text())
        assert figures["joints"]["lift"].keys() >= {n.removeprefix("lift.") for n in result.figures}
        assert has_figures(row, figures)


def test_pictures_and_page_are_written_on_request(
    scheduler: Client, fmu_folder: Path, tmp_path: Path
) -> None:
    vary = {R_S: "±10%", "lift.plant.motor.L_q": "±10%"}
    options: dict[str, Any] = {"runs": 3, "scheduler": scheduler, "fmus": fmu_folder, **TABLE}
    sweep("lift", vary, **options, output=tmp_path / "none")
    assert {path.name for path in (tmp_path / "none").iterdir()} == {"sweep.json", "variants.parquet"}
    result = sweep("lift", vary, **options, output=tmp_path / "out", plots=True, report=True)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"sweep.json", "variants.parquet", "figures.png", "sweep.html"}
    page = html.unescape((tmp_path / "out/sweep.html").read_text())
    for text in (
        "with 95 % confidence.",
        "Figures of the variants",
        "intervals of 95 %",
        "The worst variants",
    ):
        assert text in page
    assert all(str(result.command(i)) in page for i in range(3)) and page.count("<img") == 1


def test_fmu_of_a_component_varies(scheduler: Client, fmu_folder: Path, foreign_plant: Path) -> None:
    """Another plant in the place of ours, which a mapping fits, beside the same one under another name."""
    copy = foreign_plant.with_name("Copy.fmu")
    copy.write_bytes(foreign_plant.read_bytes())
    options: dict[str, Any] = {
        "replace": {"lift.plant": Replacement(foreign_plant)}, "mapping": {"lift.plant": FOREIGN_MAPPING},
        "fmus": fmu_folder, **TABLE,
    }  # fmt: skip
    vary = {"lift.plant": [str(foreign_plant), str(copy)], "lift.reference.move.start[1]": [0.0, 0.001]}
    result = sweep("lift", vary, scheduler=scheduler, **options)
    assert result.variants["status"].to_list() == ["done"] * 4
    peaks = result.variants["lift.torque_peak_N_m"].to_list()
    assert peaks[:2] == peaks[2:]
    with ec.load("lift", **options).prepare() as simulation:
        run = simulation.run(set={"lift.reference.move.start[1]": 0.001})
    assert has_figures(result.variants.row(1, named=True), run.metrics)


def test_one_factor_scales_several_values(scheduler: Client, fmu_folder: Path) -> None:
    names = [R_S, "lift.plant.motor.Phi_PM"]
    with ec.load("lift", fmus=fmu_folder, **TABLE).prepare() as simulation:
        before = [simulation[name] for name in names]
        simulation.finish()
        result = sweep(
            "lift", {"k": {"of": names, "distribution": "values", "values": [0.9, 1.1], "relative": True}},
            scheduler=scheduler, fmus=fmu_folder, **TABLE,
        )  # fmt: skip
        for row in result.variants.to_dicts():
            values = {name: x * row["k"] for name, x in zip(names, before, strict=True)}
            assert result.options(row["variant"]) == {"set": values}
            assert has_figures(row, simulation.run(set=values).metrics)


def test_metrics_of_every_kind(scheduler: Client, fmu_folder: Path) -> None:
    def last(result: Any) -> float:
        return float(result[SIGNAL][-1])

    metrics = [
        "lift.torque_peak_N_m",
        f"largest = max(abs({SIGNAL}))",
        f"high = max({SIGNAL}) > 0",
        "n = 1",
        last,
    ]
    result = sweep("lift", {R_S: [0.1, 0.2]}, metrics=metrics, scheduler=scheduler, fmus=fmu_folder, **TABLE)
    figures = [figure for figure in result.figures if figure not in result.verdicts]
    assert figures == ["lift.torque_peak_N_m", "largest", "high", "n", "last"]
    with ec.load("lift", fmus=fmu_folder, **TABLE).prepare() as simulation:
        for row in result.variants.to_dicts():
            run = simulation.run(set={R_S: row[R_S]})
            i_q = run[SIGNAL]
            assert row["largest"] == np.max(np.abs(i_q)) and row["high"] is bool(np.max(i_q) > 0)
            assert (row["n"], row["last"]) == (1.0, i_q[-1])
            assert has_figures(row, run.metrics)


@pytest.mark.slow
def test_metrics_of_users_are_registered_on_workers_for_one_sweep(
    cluster: Client, fmu_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def rows(layout: ec.RunLayout) -> Any:
        from typing import Any  # which this takes along, as it does `ec`

        class Rows(ec.Metrics):
            count = 0

            def write(self, rows: Any) -> None:
                self.count += len(rows)

            def figures(self) -> dict[str, dict[str, float]]:
                return {"table": {"rows": self.count}}

            def state_dict(self) -> Any:
                return self.count

            def load_state_dict(self, state: Any) -> None:
                self.count = state

        return Rows()

    plan: dict[str, Any] = {"vary": {R_S: [0.1]}, "scheduler": cluster, "fmus": fmu_folder, **TABLE}
    with monkeypatch.context() as patched:
        patched.setitem(ec.METRICS, "rows", rows)
        assert sweep("lift", **plan).variants["table.rows"].to_list() == [201.0]
    assert "table.rows" not in sweep("lift", **plan).figures


def test_failed_variants_have_status_and_problem(scheduler: Client, faulty_fmu: Path) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.45)
    faults = [Fault.NONE, Fault.DISCARD, Fault.ERROR, Fault.EXIT_INITIALIZATION, Fault.NAN_Y, 99]

    result = sweep(
        system, {"j.bad.fault": [int(f) for f in faults]}, scheduler=scheduler, stop_time=1.0,
        step_size=0.1,
    )  # fmt: skip
    outcomes = dict(zip(faults, result.variants.select("status", "problem", "end_s").rows(), strict=True))
    assert outcomes[Fault.NONE] == ("done", None, 1.0)
    assert outcomes[Fault.DISCARD][0] == "diverged" and 0.3 < outcomes[Fault.DISCARD][2] < 0.5
    assert outcomes[Fault.ERROR][0] == "failed" and "j.bad" in outcomes[Fault.ERROR][1]
    assert outcomes[Fault.EXIT_INITIALIZATION][0] == "refused" and outcomes[Fault.EXIT_INITIALIZATION][1]


def test_fmu_with_a_fatal_error_leaves_later_variants(faulty_fmu: Path) -> None:
    """The standard forbids any further call of its library; other variants use a new copy."""
    faults = [Fault.NONE, Fault.FATAL, Fault.NONE, Fault.FATAL, Fault.FATAL, Fault.NONE, Fault.NONE]
    result = sweep(
        line_with_a_fault(faulty_fmu, Fault.NONE, 0.45), {"j.bad.fault": list(map(int, faults))}, workers=1,
        stop_time=1.0, step_size=0.1,
    )  # fmt: skip
    assert result.variants["status"].to_list() == ["failed" if f else "done" for f in faults]


@pytest.mark.parametrize(
    "raised", ["sys.exit(3)", "1 / 0", "(_ for _ in ()).throw(KeyboardInterrupt)", "'x'"]
)
def test_exceptions_of_metrics_fail_the_variant(raised: str, scheduler: Client, faulty_fmu: Path) -> None:
    """Even what would end the thread of a worker is what came out of a variant."""
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.45)
    metric = eval(f"lambda result: {raised}", {"sys": sys})
    options: dict[str, Any] = {"scheduler": scheduler, "stop_time": 1.0, "step_size": 0.1}
    result = sweep(system, {"j.bad.b": [0.1, 0.2]}, metrics={"m": metric}, **options)
    assert result.variants["status"].to_list() == ["failed"] * 2
    assert all(text.startswith("the metric 'm' raised ") for text in result.variants["problem"])


def test_metric_that_cannot_be_pickled_is_refused(scheduler: Client, faulty_fmu: Path) -> None:
    lock = threading.Lock()
    with pytest.raises(ec.CommandError, match="the metric 'm' cannot be sent to workers"):
        sweep(
            line_with_a_fault(faulty_fmu, Fault.NONE, 0.45), {"j.bad.b": [0.1]},
            metrics={"m": lambda _: lock}, scheduler=scheduler, stop_time=1.0, step_size=0.1,
        )  # fmt: skip


@pytest.mark.usefixtures("on_one_cluster")
def test_variants_that_do_not_meet_requirements_fail(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(
        'scenario = "lift"\nstop_time = 0.02\nrequire = ["lift.torque_peak_N_m > 180"]\n'
        f'[vary]\n"{R_S}" = [0.1, 5.0]\n'
    )
    process = emla("sweep", "plan.toml", "--output", "out", "--workers", "1", "--no-plots")
    assert process.exit_code == 1, process.output
    assert "Error: 1 of 2 variants do not meet the requirements; see above." in process.stderr
    assert ", 1 failed" in process.stdout.splitlines()[0]
    assert "--require 'lift.torque_peak_N_m > 180'" in process.stdout
    result = read_sweep(tmp_path / "out")
    assert result.required == ["lift.torque_peak_N_m > 180"]
    peaks = result.variants["lift.torque_peak_N_m"]
    assert peaks[0] > 180.0 > peaks[1]
    assert result.variants["status"].to_list() == ["done", "failed"]
    assert "requirements not met: lift.torque_peak_N_m > 180, but it is" in result.variants["problem"][1]
