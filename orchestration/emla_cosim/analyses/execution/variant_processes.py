"""Run the variants of one analysis in processes of their own, which an FMU may end."""

import contextlib
import math
import os
import pickle
import platform
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cloudpickle
import polars

from fmublock.files import remove_folder

from ...base.channel import Channel
from ...base.errors import CosimError, RunError
from ...base.process import Child, ChildEndedError, ChildPool, silence
from ...master.instances.fmu_instance import DiscardedStepError
from ...recorders.metrics import describe_divergence, explain_verdicts, list_figures
from ...recorders.table import TimeSeries
from ...run.half_step import halve_step
from ...run.options import Options
from ...run.remarks import describe_lost_values
from ...run.result import Result
from ...run.run_setup import count_steps_per_row
from ...run.simulation import Simulation
from ...study.loading import register
from ...system.model import System
from ..variants.measures import (
    DIVERGED,
    DONE,
    FAILED,
    REFUSED,
    VARIANT,
    MeasureError,
    Measures,
    SimulationDescription,
    Variant,
    VariantOutcome,
    to_parquet,
)
from .chunk_queue import ChunkAnswer, ChunkRequest
from .worker_payload import REGISTRIES

ANSWER, ERROR, READY, OUTCOME = "answer", "error", "ready", "outcome"
"""Kinds of messages: the answer, an exception, the simulation is prepared, and the outcome of a variant."""

PAYLOAD = "payload.pickle"
"""The file with prepared systems and registered objects, beside the FMUs."""

_SLOW_S = 10.0
"""Seconds after which a variant that still runs is reported; again after twice the time."""

_CLOSE_S = 2.0
"""Seconds that an idle process may take to end its FMUs."""


class VariantHost:
    """A folder with the FMUs and systems of one analysis, and the processes that run its variants.

    Threads may call the methods at the same time.

    Args:
        folder: An empty folder, which the processes remove if this one is killed.
        count: Number of processes. They start now, and read the folder at the first request.

    Raises:
        RunError: A process cannot start.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self.count, self._folder, self._is_loaded = count, folder, False
        self._pool = ChildPool(self._start_child, count)

    def load(self, files: Mapping[str, bytes], content: bytes) -> None:
        """Write the files of a `WorkerPayload`. Raise RunError if they cannot be written."""
        self._is_loaded = True
        try:
            for name, file in {**files, PAYLOAD: content}.items():
                path = self._folder / name
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(file)
        except OSError as error:
            raise RunError(
                f"the FMUs cannot be written to a temporary folder on {platform.node()}: {error}."
            ) from error

    def describe(self, group: int) -> bytes:
        """Return the pickled `SimulationDescription` of a group.

        Raises:
            CosimError: The simulation cannot be prepared.
        """
        with self._pool.member() as child:
            try:
                child.send(("describe", group))
                return _receive(child)[1]
            except ChildEndedError as error:
                raise RunError(
                    f"the process that prepares the scenario ended ({error}): an FMU crashed it, or it ran "
                    "out of memory."
                ) from error

    def run(self, request: ChunkRequest, report_slow: Callable[[int, float], None]) -> ChunkAnswer:
        """Run variants in sequence. One that ends its process, or takes too long, ends the chunk.

        Args:
            request: The variants.
            report_slow: Called with the number of a variant that still runs after a while, and its time in s.
        """
        outcomes, numbers, work_s = list[bytes](), request.numbers, 0.0
        limit = math.inf if request.timeout is None else request.timeout
        with self._pool.member(request.is_exclusive) as child:
            try:
                child.send(("run", request))
                _receive(child)  # the simulation is prepared, which may take any time
                while len(outcomes) < len(numbers):
                    start = time.monotonic()
                    kind, content = _receive(child, limit, partial(report_slow, numbers[len(outcomes)]))
                    if kind == ANSWER:
                        return ChunkAnswer(outcomes, *content)
                    outcomes.append(content)
                    work_s += time.monotonic() - start
                return ChunkAnswer(outcomes, *_receive(child)[1])
            except TimeoutError:
                child.kill()
                ended, timed_out = None, numbers[len(outcomes)]
            except ChildEndedError as error:
                if self._pool.is_closed:
                    raise RunError("the analysis was cancelled.") from error
                crashed = min(len(outcomes), len(numbers) - 1)  # it may end after its last variant
                ended, timed_out = (numbers[crashed], str(error)), None
                del outcomes[crashed:]
        if request.has_signals:  # they are lost with the process
            outcomes.clear()
        return ChunkAnswer(outcomes, work_s, ended=ended, timed_out=timed_out)

    def close(self) -> None:
        """End the processes, also those that run variants. The folder may remain."""
        self._pool.close(_CLOSE_S if self._is_loaded else 0.0)

    def _start_child(self) -> Child:
        """Return a new process that runs variants; raise RunError if it cannot start."""
        function = f"{__name__}:run_variants"
        environment = {
            "POLARS_MAX_THREADS": os.environ.get("POLARS_MAX_THREADS", "1"),  # each process has one core
            "TMPDIR": str(self._folder),  # for what is unpacked and what FMUs leave: it ends with the folder
        }
        try:
            return Child(function, str(self._folder), environment=environment)
        except OSError as error:
            raise RunError(f"no process can be started on {platform.node()}: {error.strerror}.") from error


def _receive(
    child: Child, limit: float = math.inf, report_slow: Callable[[float], None] | None = None
) -> tuple[str, Any]:
    """Return kind and content of the next message. Raise what the child raised.

    Raises:
        TimeoutError: There is none for `limit` seconds.
    """
    start, next_report = time.monotonic(), _SLOW_S
    while True:
        elapsed = time.monotonic() - start
        if elapsed >= limit:
            raise TimeoutError
        if elapsed >= next_report:
            next_report *= 2.0
            if report_slow is not None:
                report_slow(elapsed)
        with suppress(TimeoutError):
            kind, content = child.receive(min(next_report, limit) - elapsed)
            break
    if kind == ERROR:
        raise pickle.loads(content)
    return kind, content


_MAX_SIMULATIONS = 8
"""Most simulations that a process keeps. The least recently used one is closed."""

Send = Callable[[tuple[str, Any]], None]


class VariantProcess:
    """Answers the requests of a host, with the FMUs and systems in its folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._groups: Sequence[tuple[str, System, Options]] = ()
        self._simulations: dict[int, Simulation] = {}

    def answer(self, request: tuple[str, Any], send: Send) -> tuple[str, Any]:
        """Answer a request: `describe` with a group, or `run`. An exception is an answer, too."""
        name, argument = request
        try:
            if (
                not self._groups
            ):  # at the first request: the host writes the payload after this process starts
                self._groups, registered = pickle.loads((self._folder / PAYLOAD).read_bytes())
                register()
                for kind, registry in REGISTRIES.items():
                    registry.update(registered[kind])
            return ANSWER, self._describe(argument) if name == "describe" else self._run(argument, send)
        except BaseException as error:  # user code may raise SystemExit when it is loaded
            return ERROR, _pickle_error(error)

    def close(self) -> None:
        """End the FMUs."""
        for simulation in self._simulations.values():
            simulation.close()

    def _get_simulation(self, group: int) -> Simulation:
        """Return the simulation of a group, and close the one that was not used for the longest time.

        Raises:
            CosimError: It cannot be prepared.
        """
        simulation = self._simulations.pop(group, None)
        if simulation is not None and simulation.is_unusable:  # of a variant before
            simulation.close()
            simulation = None
        if simulation is None:
            if len(self._simulations) >= _MAX_SIMULATIONS:
                self._simulations.pop(next(iter(self._simulations))).close()
            name, system, options = self._groups[group]
            components = [replace(c, fmu=self._folder / str(c.fmu)) for c in system.components]
            system = replace(system, components=tuple(components))
            options = replace(options, threads=1)  # other processes use the other cores
            simulation = Simulation(system, options, name, unpacked=self._folder)
        self._simulations[group] = simulation
        return simulation

    def _describe(self, group: int) -> bytes:
        """Return the pickled `SimulationDescription` of a group. Raise CosimError if this fails."""
        simulation = self._get_simulation(group)
        simulation.start(recorders=[])  # variants may run although the scenario itself fails in a step
        result = simulation.so_far()
        figures = list_figures(result.metrics, result.displays)
        units, further = (
            {name: str(unit) if unit is not None else "" for name, unit in units.items()}
            for units in (simulation.units, simulation.further_units())
        )
        rows = 1 + -(-result.times.steps // count_steps_per_row(simulation.options, result.times))
        return cloudpickle.dumps(SimulationDescription(units, further, figures, rows))

    def _run(self, request: ChunkRequest, send: Send) -> tuple[float, bytes | None]:
        """Run variants in sequence, and send the outcome of each. An error in one becomes its outcome.

        Returns:
            The duration in s, and the signals as a Parquet file.
        """
        variants: Sequence[Variant]
        variants, measures = pickle.loads(request.content)
        series = list[polars.DataFrame]()
        with contextlib.suppress(CosimError):  # every variant reports it as its outcome
            self._get_simulation(request.group)
        send((READY, None))
        start = time.perf_counter()  # without the preparation, which happens once
        for variant in variants:
            outcome, result = self._run_one(request.group, variant, measures)
            if measures.signals and result is not None and result.table is not None:
                number = polars.lit(variant.number, polars.Int64).alias(VARIANT)
                series.append(measures.series(result).select(number, polars.all()))
            send((OUTCOME, cloudpickle.dumps(outcome)))
            if time.perf_counter() - start > request.seconds:
                break
        signals = to_parquet(polars.concat(series)) if series else None
        return time.perf_counter() - start, signals

    def _run_one(
        self, group: int, variant: Variant, measures: Measures
    ) -> tuple[VariantOutcome, Result | None]:
        """Run one variant. Any error becomes its outcome."""
        recorders = [TimeSeries()] if measures.read or measures.expressions or measures.functions else []
        status, problem, half = DONE, None, None
        try:
            try:
                simulation, options = self._get_simulation(group), variant.options
                if variant.is_halved:
                    half = halve_step(simulation, options)
                    options = {**options, **half.options}
                result = simulation.run(
                    recorders=recorders, signals=measures.select_signals(simulation.names), **options
                )
                problem = explain_verdicts(result.metrics)
                problem = " ".join(filter(None, (result.early_end, problem))) or None
            except RunError as error:
                if "result" not in error.fields:
                    raise
                result, status, problem = error.fields["result"], _find_status(error), str(error)
            if status == DONE and (diverged := describe_divergence(result.signals)) is not None:
                status, problem = DIVERGED, diverged
            remarks = *describe_lost_values(result.record), result.record["coupling"].get("remark")
            problem = " ".join(filter(None, (problem, *remarks))) or None
            try:
                figures = measures.of(result)
            except MeasureError as error:
                figures, status = {}, FAILED
                problem = " ".join(filter(None, (problem, str(error))))
            cut_short = "requested_end" in result.record
            outcome = VariantOutcome(variant.number, status, problem, result.end_s, figures, cut_short, half)
            return outcome, result
        except CosimError as error:
            return VariantOutcome(variant.number, REFUSED, str(error)), None
        except BaseException as error:  # from a user's metrics or algorithm
            return VariantOutcome(variant.number, FAILED, f"the run raised {error!r}."), None


def _find_status(error: RunError) -> str:
    """Return the status of a failed run that has a result."""
    if isinstance(error.__cause__, DiscardedStepError):
        return DIVERGED
    return FAILED if "time" not in error.fields or error.fields["result"].steps else REFUSED


def _pickle_error(error: BaseException) -> bytes:
    """Return an exception as bytes that the caller can read."""
    try:
        content = cloudpickle.dumps(error)
        pickle.loads(content)
    except Exception:  # an exception of the user's, with any constructor
        return pickle.dumps(RuntimeError(repr(error)))
    return content


def run_variants(channel: Channel, folder: str) -> None:
    """Answer the requests of a host. At the end, remove its folder: the host closes it, or was killed."""
    silence()
    removal = threading.Lock()

    def remove() -> None:
        with removal:  # another thread that removes it would end this process too early
            remove_folder(folder)

    channel.at_end_of_parent = remove
    process = VariantProcess(Path(folder))
    with contextlib.suppress(ConnectionError):  # the host was killed
        for request in channel.requests():
            channel.send(process.answer(request, channel.send))
        process.close()
    remove()
