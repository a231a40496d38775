"""Clusters without workers, versions or an answer end a sweep with one message; others lose one variant."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from distributed import Client, KilledWorker

import emla_cosim as ec
from emla_cosim.analyses.execution import executor
from emla_cosim.analyses.execution.executor import LocalWorkers, WorkersLostError
from emla_cosim.analyses.variants.measures import DIED, DONE
from emla_cosim.base import extras
from emla_cosim.base.errors import CommandError, RunError

R_S = "lift.plant.motor.R_s"


def make_client(submit: Callable[..., Any], **more: Any) -> Mock:
    """Return a client of Dask whose tasks are what `submit` returns."""
    values = {"status": "running", "scheduler": Mock(addr="tcp://there"), "nthreads": lambda: {"worker": 2}}
    return Mock(spec=Client, id="client", submit=submit, **{**values, **more})


def sweep(fmus: Path, client: Any = None, **options: Any) -> ec.SweepResult:
    all_options: dict[str, Any] = {"stop_time": 0.002, "fmus": fmus, **options}
    return ec.sweep("lift", {R_S: [0.1, 0.2, 0.3]}, scheduler=client, **all_options)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError("gone"), r"the scheduler at tcp://there does not answer: gone\."),
        (KilledWorker("task", Mock(), 0), "the worker that prepares .* ended: out of memory, or its"),
        (ImportError("no polars"), "the workers of tcp://there cannot run this: no polars; install the same"),
        (ValueError("mine"), r"the scenario cannot be started on a worker: ValueError\('mine'\)"),
    ],
)
def test_failing_workers_give_one_message(error: BaseException, message: str, fmu_folder: Path) -> None:
    client = make_client(lambda *_, **__: Mock(done=lambda: True, result=Mock(side_effect=error)))
    with pytest.raises(RunError, match=message):
        sweep(fmu_folder, client)


def test_stopped_client_is_refused(fmu_folder: Path) -> None:
    with pytest.raises(RunError, match="the client in `scheduler` is closed; it must be running"):
        sweep(fmu_folder, make_client(Mock(), status="closed"))


def test_missing_workers_end_the_sweep_after_the_patience(fmu_folder: Path) -> None:
    client = make_client(lambda *_, **__: Mock(done=lambda: False), nthreads=dict)
    with pytest.raises(RunError, match=r"had no workers for 0\.3 s; start workers"):
        sweep(fmu_folder, client, patience=0.3)


def test_missing_dask_is_reported(fmu_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(CommandError, match=r"distributed is not .*: pip install 'emla-cosim\[cluster\]'\."):
        sweep(fmu_folder, "tcp://127.0.0.1:1")


def test_variant_that_loses_two_workers_has_died(
    fmu_folder: Path, monkeypatch: pytest.MonkeyPatch, on_one_cluster: None
) -> None:
    """Another variant of the same chunk runs again, and only the one to blame is lost."""

    class LosingWorkers(LocalWorkers):
        def submit(self, method: str, argument: Any) -> Any:
            if method == "describe" or 1 not in argument.numbers:
                return super().submit(method, argument)
            future = Future[Any]()
            future.set_exception(WorkersLostError(1))
            return future

    monkeypatch.setattr(executor, "LocalWorkers", LosingWorkers)
    result = sweep(fmu_folder)
    assert result.variants["status"].to_list() == [DONE, DIED, DONE]
    problem = "its worker ended 2 times: it ran out of memory, or its machine was lost."
    assert result.variants["problem"][1] == problem
