"""Overrides of a plan are merged into it."""

import pytest

from emla_cosim.sweeps.plan import Plan


def test_overrides_are_merged_into_tables() -> None:
    plan = Plan("p", "lift", {"a.x": [1]}, options={"stop_time": 1.0, "set": {"a.y": 1.0, "a.z": 2.0}})
    changed = plan.updated({"vary": {"a.w": [2]}, "options": {"stop_time": 2.0, "set": {"a.z": 3.0}}})
    assert changed.vary == {"a.x": [1], "a.w": [2]}
    assert changed.options == {"stop_time": 2.0, "set": {"a.y": 1.0, "a.z": 3.0}}
    assert plan.options["set"] == {"a.y": 1.0, "a.z": 2.0}


@pytest.mark.parametrize(
    ("given", "runs"),
    [
        ({"sampling": "one-at-a-time"}, None),
        ({"sampling": "grid", "runs": None}, None),
        ({"sampling": "grid", "runs": 7}, 7),  # which is for the sampling to refuse
        ({"sampling": "sobol"}, 2000),
        ({"seed": 3}, 2000),
    ],
)
def test_sampling_without_runs_drops_the_runs_of_the_plan(given: dict, runs: int | None) -> None:
    plan = Plan("p", "lift", {"a.x": [1, 2]}, sampling="random", runs=2000)
    assert plan.updated(given).runs == runs
