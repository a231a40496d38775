"""Commands that compare runs do not count one that an FMU ended before its stop time as complete."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import emla_cosim as ec
from emla_cosim.analyses.compare.rows import read_verdict
from emla_cosim.analyses.sweep.report import status_line
from emla_cosim.analyses.variants.measures import DONE, VariantOutcome
from emla_cosim.base.errors import CommandError, RunError
from tests.support.faulty_systems import Fault

if TYPE_CHECKING:
    from distributed import Client

OPTIONS = {"step_size": 0.1, "stop_time": 1.0}
ENDS = {"a.fault": int(Fault.TERMINATE), "a.at": 0.3}
"""The FMU asks to end the simulation in its step from 0.3 s."""


@pytest.fixture
def ending(faulty_fmu: Path) -> ec.System:
    return ec.System.of({"a": faulty_fmu}, set=ENDS)


def test_advance_beyond_the_end_is_refused(ending: ec.System) -> None:
    with ec.load(ending, **OPTIONS).prepare() as simulation:
        simulation.advance(0.5)
        assert simulation.time == pytest.approx(0.3)
        simulation.advance(0.3)
        for _ in range(2):
            with pytest.raises(CommandError, match=r"ended at t = 0\.3 s: a asked to end.*call `finish`"):
                simulation.advance(0.5)
        assert simulation.finish().end_s == pytest.approx(0.3)
        assert simulation.run(set={"a.fault": 0}).end_s == pytest.approx(1.0)


def test_linearize_says_why_the_operating_point_is_not_reached(ending: ec.System) -> None:
    with pytest.raises(
        RunError, match=r"operating point at t = 0\.5 s\. the run ended at t = 0\.3 s: a asked"
    ):
        ec.linearize(ending, matrices=True, at=0.5, **OPTIONS)


def test_a_longer_reference_run_disagrees(faulty_fmu: Path, tmp_path: Path) -> None:
    whole = ec.System.of({"a": faulty_fmu}, set={**ENDS, "a.fault": 0})
    for name, system in (("whole", whole), ("short", ec.System.of({"a": faulty_fmu}, set=ENDS))):
        with ec.load(system, **OPTIONS).prepare() as simulation:
            simulation.run().save(tmp_path / name)
    with ec.load(ec.System.of({"a": faulty_fmu}, set=ENDS), **OPTIONS).prepare() as simulation:
        problem = simulation.attempt(reference=tmp_path / "whole").problem
        assert problem is not None and "ended at 0.3 s, but" in problem and "until 1 s" in problem
        assert simulation.attempt(reference=tmp_path / "short").problem is None


def test_tuning_counts_the_run_as_lost(faulty_fmu: Path, scheduler: "Client") -> None:
    system = ec.System.of({"a": faulty_fmu}, set={"a.fault": int(Fault.TERMINATE), "a.at": 0.5})
    plan = {"vary": {"a.at": "0.35:5"}, "objective": "y", "metrics": ["y = max(a.y)"], "evaluations": 2}
    result = ec.tune(system, **plan, **OPTIONS, scheduler=scheduler)
    assert result.start.training.lost == result.start.training.runs
    assert not result.start.training.holds


def test_sweeps_count_the_variants_that_fmus_ended(faulty_fmu: Path, on_one_cluster: None) -> None:
    system = ec.System.of({"a": faulty_fmu}, set={"a.fault": int(Fault.TERMINATE)})
    swept = ec.sweep(ec.load(system, **OPTIONS), {"a.at": [0.3, 5.0]}, metrics=["x = last(a.y)"])
    assert swept.variants["status"].to_list() == ["done", "done"]
    assert swept.variants["end_s"].to_list() == pytest.approx([0.3, 1.0])
    assert "FMUs ended 1 of them before the stop time" in status_line(swept)


def test_comparisons_do_not_call_the_joint_held() -> None:
    figures = {"held": True, "reason": None}
    outcome = VariantOutcome(0, DONE, "the plant asked to end.", 0.3, {"lift": figures}, cut_short=True)
    assert read_verdict(figures, outcome) == (False, 0.3, "the plant asked to end")


def test_messages_reach_the_run_whose_fmu_wrote_them(faulty_fmu: Path) -> None:
    """Also if another simulation was prepared or run between."""
    failing = ec.System.of({"a": faulty_fmu}, set={"a.fault": int(Fault.ERROR), "a.at": 0.3})
    with ec.load(failing, **OPTIONS).prepare() as first, ec.load(failing, **OPTIONS).prepare() as second:
        for simulation in (first, second, first):
            assert "FMU log: " in str(simulation.attempt().problem)
