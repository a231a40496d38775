"""The process that prepares simulations and runs variants for a host: an FMU may end it or never return."""

import contextlib
import pickle
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cloudpickle
import polars

from fmublock.leftovers import remove_folder

from ...base.channel import Channel
from ...base.errors import CosimError, RunError
from ...base.process import silence
from ...master.instances.fmu_instance import DiscardedStepError
from ...recorders.metrics import describe_divergence, explain_verdicts, list_figures
from ...recorders.table import TimeSeries
from ...run.half_step import halve_step
from ...run.options import Options
from ...run.remarks import describe_lost_values
from ...run.result import Result
from ...run.run_setup import steps_per_row
from ...run.simulation import Simulation
from ...study.loading import register
from ...system.model import System
from ..variants.data import (
    DIVERGED,
    DONE,
    FAILED,
    REFUSED,
    VARIANT,
    SimulationDescription,
    Variant,
    VariantOutcome,
    to_parquet,
)
from ..variants.measures import MeasureError, Measures
from .chunk_queue import ChunkRequest
from .variant_host import ANSWER, ERROR, OUTCOME, PAYLOAD, READY
from .worker_payload import REGISTRIES

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
        """Return the simulation of a group. Raise CosimError if it cannot be prepared."""
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
        rows = 1 + -(-result.times.steps // steps_per_row(simulation.options, result.times))
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
