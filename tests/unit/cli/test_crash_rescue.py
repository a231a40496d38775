"""The parent of a run that ended finishes its results."""

import json
from pathlib import Path

import pytest

from emla_cosim.base.crash_page import Stage, current_activity
from emla_cosim.cli.commands import crash_rescue
from emla_cosim.cli.commands.crash_rescue import CrashPlan
from emla_cosim.views.terminal import Verbosity


@pytest.mark.parametrize("has_earlier_results", [False, True])
def test_run_that_ended_in_its_preparation(
    has_earlier_results: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    record = tmp_path / "run.json"
    if has_earlier_results:
        record.write_text('{"scenario": "earlier", "status": "completed"}')
        (tmp_path / "metrics.json").write_text("{}")
    plan = CrashPlan("lift", ["plant"], tmp_path, {}, [], Verbosity())
    monkeypatch.setattr(crash_rescue, "read_plan", lambda: plan)
    monkeypatch.setattr(current_activity(), "stage", Stage.PREPARING)
    crash_rescue.rescue_results("SIGKILL", 0.0)
    message = capsys.readouterr().err
    assert "the run ended before its first step: the process was killed" in message
    assert ("The earlier results in" in message) == has_earlier_results
    expected = {"scenario": "earlier", "status": "completed"} if has_earlier_results else {"scenario": "lift"}
    assert expected.items() <= json.loads(record.read_text()).items()
