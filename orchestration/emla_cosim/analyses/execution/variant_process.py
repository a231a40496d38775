"""The process that prepares simulations and runs variants for a worker: an FMU may end it or never return."""

import contextlib
import pickle
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import cloudpickle
import polars

from ...base.channel import Channel
from ...base.errors import CosimError, RunError
from ...master.instances.fmu_instance import DiscardedStepError
from ...recorders.metrics import describe_divergence, explain_verdicts, list_figures
from ...recorders.table import TimeSeries
from ...run.half_step import halve_step
from ...run.remarks import describe_lost_values
from ...run.result import Result
from ...run.run_setup import steps_per_row
from ...run.simulation import Simulation
from ...study.loading import register
from ..variants.data import (
    DIVERGED,
    DONE,
    FAILED,
    REFUSED,
    VARIANT,
    SimulationDescription,
    Variant,
    VariantOutcome,
)
from ..variants.measures import MeasureError, Measures
from .idle_processes import ANSWER, ERROR, OUTCOME, PAYLOAD, READY
from .worker_payload import REGISTRIES, PackedPreparation

_PREPARED_AT_MOST = 8
"""Most simulations that a process keeps. The least recently used one is closed."""

Send = Callable[[tuple[str, Any]], None]


class VariantProcess:
    """Answers the requests of a worker. One sweep is open at a time."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._removal = threading.Lock()
        self._packed: Sequence[PackedPreparation] = ()
        self._files: Mapping[str, Path] = {}
        self._new: Mapping[str, set[str]] = {}
        self._simulations: dict[int, Simulation] = {}

    def answer(self, request: tuple[Any, ...], send: Send) -> tuple[str, Any]:
        """Answer a request, the name of a method with its arguments. An exception is an answer, too."""
        name, *arguments = request
        try:
            return ANSWER, getattr(self, f"_{name}")(send, *arguments)
        except BaseException as error:  # user code may raise SystemExit when it is loaded
            return ERROR, _pickle_error(error)

    def remove_files(self) -> None:
        """Remove the folder of the open sweep: the worker, which would do it, was killed."""
        with self._removal:  # another thread that removes them would end this process too early
            if self._folder is not None:
                shutil.rmtree(self._folder, ignore_errors=True)

    def _open(self, send: Send, folder: str, files: Mapping[str, str]) -> None:
        """Open the sweep in a folder, with its FMU files by hash."""
        if self._folder == Path(folder):
            return
        self._close(send)
        self._folder, tempfile.tempdir = Path(folder), folder  # FMUs are unpacked there
        self._files = {sha: Path(folder) / file for sha, file in files.items()}
        self._packed, registered = pickle.loads((self._folder / PAYLOAD).read_bytes())
        register()
        self._new = {kind: registered[kind].keys() - known for kind, known in REGISTRIES.items()}
        for kind, known in REGISTRIES.items():
            known.update(registered[kind])

    def _close(self, send: Send) -> None:
        """Close the open sweep: simulations and registrations. The next one may be another user's."""
        for simulation in self._simulations.values():
            simulation.close()
        self._simulations.clear()
        for kind, names in self._new.items():
            for name in names:
                REGISTRIES[kind].pop(name, None)
        self._folder, tempfile.tempdir, self._new = None, None, {}

    def _simulation(self, group: int) -> Simulation:
        """Return the simulation of a group. Raise CosimError if it cannot be prepared."""
        found = self._simulations.pop(group, None)
        if found is None:
            if len(self._simulations) >= _PREPARED_AT_MOST:
                self._simulations.pop(next(iter(self._simulations))).close()
            packed = self._packed[group]
            alone = replace(packed.options, threads=1)  # other processes use the other cores
            found = Simulation(packed.unpack_system(self._files), alone, packed.name, unpacked=self._folder)
        self._simulations[group] = found
        return found

    def _describe(self, send: Send, group: int) -> bytes:
        """Describe the simulation of a group. Raise CosimError if it cannot be prepared."""
        return cloudpickle.dumps(_describe(self._simulation(group)))

    def _run(self, send: Send, group: int, request: bytes, seconds: float) -> tuple[float, bytes | None]:
        """Run variants in sequence, and send the outcome of each. An error in one becomes its outcome.

        Args:
            send: Sends messages to the worker.
            group: Position of the preparation.
            request: The variants and measures, pickled.
            seconds: Time in s after which no further variant begins.

        Returns:
            The duration in s, and the signals as a Parquet file.
        """
        variants: Sequence[Variant]
        variants, measures = pickle.loads(request)
        series = list[polars.DataFrame]()
        with contextlib.suppress(CosimError):  # every variant reports it as its outcome
            self._simulation(group)
        send((READY, None))
        began = time.perf_counter()  # without the preparation, which happens once
        for variant in variants:
            outcome, result = self._run_one(group, variant, measures)
            if measures.signals and result is not None and result.table is not None:
                number = polars.lit(variant.number, polars.Int64).alias(VARIANT)
                series.append(measures.series(result).select(number, polars.all()))
            send((OUTCOME, cloudpickle.dumps(outcome)))
            if time.perf_counter() - began > seconds:
                break
        kept = to_parquet(polars.concat(series)) if series else None
        return time.perf_counter() - began, kept

    def _run_one(
        self, group: int, variant: Variant, measures: Measures
    ) -> tuple[VariantOutcome, Result | None]:
        """Run one variant. Any error becomes its outcome."""
        recorders = [TimeSeries()] if measures.read or measures.expressions or measures.functions else []
        status, problem, half = DONE, None, None
        try:
            try:
                simulation, options = self._simulation(group), variant.options
                if variant.is_halved:
                    half = halve_step(simulation, options)
                    options = {**options, **half.options}
                result = simulation.run(
                    recorders=recorders, signals=measures.reading(simulation.names), **options
                )
                problem = explain_verdicts(result.metrics)
                problem = " ".join(filter(None, (result.early_end, problem))) or None
            except RunError as error:
                if "result" not in error.fields:
                    raise
                result, status, problem = error.fields["result"], _status(error), str(error)
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


def _describe(simulation: Simulation) -> SimulationDescription:
    simulation.start(recorders=[])  # variants may run although the scenario itself fails in a step
    result = simulation.so_far()
    figures = list_figures(result.metrics, result.shown)
    units, further = (
        {name: str(unit) if unit is not None else "" for name, unit in units.items()}
        for units in (simulation.units, simulation.further_units())
    )
    rows = 1 + -(-result.times.steps // steps_per_row(simulation.options, result.times))
    return SimulationDescription(units, further, figures, rows)


def _status(error: RunError) -> str:
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


def to_parquet(table: polars.DataFrame) -> bytes:
    """Return a table as the content of a Parquet file."""
    stream = BytesIO()
    table.write_parquet(stream)
    return stream.getvalue()


def run_variants(channel: Channel) -> None:
    """Answer the requests of a worker. If it was killed, remove the files of its sweep."""
    process = VariantProcess()
    channel.at_end_of_parent = process.remove_files
    try:
        for request in channel.requests():
            channel.send(process.answer(request, channel.send))
    finally:
        process.remove_files()
