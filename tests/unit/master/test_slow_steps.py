"""Steps that become slow, or never end: Ctrl-C ends the run, which names the component."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.recorders.row_buffer import RowBuffer
from emla_cosim.system.model import Component, Connection, System
from tests.support.tiers import mostly_slow
from tests.support.waiting import wait_for

SLOW_FROM, PAUSE = 0.01, 0.02

WAYS = {
    "one thread": {"threads": 1},
    "two threads": {"threads": 2, "algorithm": "jacobi"},
    "strong": {"algorithm": "strong"},
    "isolated": {"isolate": True},
    "error control": {"error_tolerance": 1e-3, "largest_step": 1e-4},
}


def _pair(fmu: Path) -> System:
    slow = {"slow_from": SLOW_FROM, "pause": PAUSE}
    parts = (Component("a", fmu=fmu, parameters=slow), Component("b", fmu=fmu, parameters=slow))
    return System(parts, (Connection("a", "x", "b", "u"),))


@pytest.mark.parametrize("way", mostly_slow(WAYS, ["one thread"]))
def test_stretch_of_steps_is_limited_in_time(way: str, reluctant: Path) -> None:
    options: dict[str, Any] = {"stop_time": 100.0, "step_size": 1e-4, **WAYS[way]}
    with ec.load(_pair(reluctant), **options).prepare() as simulation:
        simulation.start(recorders=[])
        simulation.advance(SLOW_FROM / 2 if way != "error control" else 2e-4)
        stepping = simulation.stepping
        rows, reached = RowBuffer(1 + len(simulation.names), []), stepping.time
        start = time.monotonic()
        while stepping.time < SLOW_FROM + 1e-3:  # across the point where steps become slow
            stepping.advance(rows, 2**20)
            assert stepping.time > reached
            reached = stepping.time
            assert time.monotonic() - start < 60.0  # 2**20 steps take six hours
            start = time.monotonic()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`, so no supervision.")
@pytest.mark.parametrize("isolate", [False, True])
def test_step_that_never_ends_is_reported(reluctant: Path, isolate: bool, tmp_path: Path) -> None:
    """Without a request, and after one."""
    arguments = ["run", str(reluctant), "--set", "Reluctant.slow_from=0.5", "--set", "Reluctant.pause=1000"]
    arguments += ["--no-plots", "--output", str(tmp_path / "out"), *(["--isolate"] if isolate else [])]
    soon = (
        "import emla_cosim.cli.supervisor as s; s._PATIENCE = 4.0, 2.0\n"
        "from emla_cosim.cli.program import main; main()"
    )
    output = tmp_path / "output"
    with output.open("w") as stream:
        run = subprocess.Popen([sys.executable, "-c", soon, *arguments], stdout=stream, stderr=stream)
    try:
        for count, number in ((1, signal.SIGINT), (2, signal.SIGTERM)):
            wait_for(lambda count=count: output.read_text().count("no answer from") == count)
            run.send_signal(number)
        assert run.wait(300) == 1
    finally:
        run.kill()
    text = " ".join(output.read_text().split())
    assert "Warning: no answer from Reluctant in doStep at t = 0.5 s for" in text
    assert "Press Ctrl-C again to end the run now; the results so far are kept." in text
    table = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert [float(row.split(",")[0]) for row in table[1:]] == pytest.approx([0.1 * k for k in range(6)])
