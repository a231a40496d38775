"""Clusters without workers, versions or an answer end a sweep with one message; others lose one variant."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from distributed import KilledWorker

import emla_cosim as ec
from emla_cosim.analyses.variants.data import DIED, DONE
from emla_cosim.base.errors import RunError
from tests.support.in_process_workers import InProcessClient

R_S = "lift.plant.motor.R_s"


class FaultyClient(InProcessClient):
    """A client whose calls of workers fail, where `fault` returns an exception for method and argument."""

    def __init__(self, fault: Callable[[str, Any], BaseException | None]) -> None:
        super().__init__()
        self.fault = fault

    def submit(self, _: Any, method: str, argument: Any, **options: Any) -> Any:
        if (error := self.fault(method, argument)) is None:
            return super().submit(_, method, argument, **options)
        if isinstance(error, OSError):
            raise error
        return Mock(
            done=lambda: True,
            result=Mock(side_effect=error),
            add_done_callback=lambda call: None,
            cancel=Mock(),
        )


def killed() -> KilledWorker:
    return KilledWorker("task", Mock(), 0)


def sweep(client: InProcessClient, fmus: Path, **options: Any) -> ec.SweepResult:
    given: dict[str, Any] = {"stop_time": 0.002, "fmus": fmus, **options}
    return ec.sweep("lift", {R_S: [0.1, 0.2, 0.3]}, scheduler=client, **given)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError("gone"), r"the scheduler at in-process does not answer: gone\."),
        (killed(), "the worker that prepares the scenario ended: memory ran out, or its machine is lost"),
        (ImportError("no polars"), "the workers of in-process cannot run this: no polars; install the same"),
        (ValueError("mine"), r"the scenario cannot be started on a worker: ValueError\('mine'\)"),
    ],
)
def test_failing_workers_give_one_message(error: BaseException, message: str, fmu_folder: Path) -> None:
    with FaultyClient(lambda method, _: error) as client, pytest.raises(RunError, match=message):
        sweep(client, fmu_folder)


def test_stopped_client_is_refused(fmu_folder: Path) -> None:
    with InProcessClient() as client:
        client.status = "closed"
        with pytest.raises(RunError, match="the client in `scheduler` is closed; it must be running"):
            sweep(client, fmu_folder)


def test_missing_workers_are_waited_for(fmu_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with InProcessClient() as client:
        monkeypatch.setattr(client, "nthreads", dict)
        monkeypatch.setattr(client, "submit", lambda *_, **__: Mock(done=lambda: False))
        with pytest.raises(RunError, match=r"had no workers for 0\.3 s; start workers"):
            sweep(client, fmu_folder, patience=0.3)


def test_variant_that_loses_two_workers_has_died(fmu_folder: Path) -> None:
    """Another variant of the same chunk runs again, and only the one to blame is lost."""

    def fault(method: str, argument: Any) -> BaseException | None:
        return killed() if method == "run" and 1 in pickle.loads(argument).numbers else None

    with FaultyClient(fault) as client:
        result = sweep(client, fmu_folder)
    assert result.variants["status"].to_list() == [DONE, DIED, DONE]
    problem = "its worker ended 2 times: it ran out of memory, or its machine was lost."
    assert result.variants["problem"][1] == problem


def test_files_of_a_sweep_are_removed_from_workers(fmu_folder: Path) -> None:
    with InProcessClient() as client:
        assert sweep(client, fmu_folder).complete
        assert client.folders() == []
