"""Code that runs on a worker: prepare simulations once, and run the variants of a chunk."""

import contextlib
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import polars
from distributed import WorkerPlugin, get_worker

from ..base.errors import CommandError, CosimError, RunError
from ..master.instances.fmu_instance import DiscardedStepError
from ..recorders.metrics import MetricDisplay, MetricsRecorder
from ..recorders.recorder import Outline, Recorder
from ..recorders.time_series import TimeSeries
from ..run.lost_values import describe_lost_values
from ..run.requirements import flatten_figures
from ..run.result import Result
from ..run.simulation import Simulation
from ..study.loading import register
from .data import DIVERGED, DONE, FAILED, REFUSED, VARIANT
from .measures import MeasureError, Measures, reason_not_held
from .worker_payload import REGISTRIES, WorkerPayload

_PREPARED_AT_MOST = 8
"""Most simulations that one thread keeps. The least recently used one is closed."""


@dataclass(frozen=True)
class Variant:
    """One variant: its number, and its own options."""

    number: int
    options: Mapping[str, Any]


@dataclass(frozen=True)
class VariantOutcome:
    """The outcome of a variant: status, reason, end time in s, and figures."""

    number: int
    status: str
    problem: str | None = None
    end_s: float | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Chunk:
    """The outcomes of a chunk, its duration in s, and its signals as a Parquet file."""

    outcomes: Sequence[VariantOutcome]
    wall_s: float
    series: bytes | None = None


@dataclass(frozen=True)
class SimulationDescription:
    """The signals (with units) and figures of a prepared simulation, and how to display figures."""

    units: Mapping[str, str]
    further: Mapping[str, str]
    """Other variables that metrics can name, with units."""
    figures: Mapping[str, bool]
    """Figures by name, with whether each is Boolean."""
    shown: Mapping[str, MetricDisplay]
    rows: int
    """Rows of a table with the options of the scenario."""


class SweepPlugin(WorkerPlugin):
    """Stores on every worker the FMUs of a sweep in a folder, and simulations by thread."""

    def __init__(self, payload: WorkerPayload) -> None:
        self._payload = payload
        self.name = payload.key

    def setup(self, worker: Any) -> None:
        """Unpack the payload on the worker. Raise CommandError if its version differs."""
        payload = self._payload
        if (here := version("emla-cosim")) != payload.version:
            raise CommandError(
                f"the worker {worker.address} has emla-cosim {here}, not {payload.version}; install that."
            )
        register()
        self._new = {kind: payload.registered[kind].keys() - known for kind, known in REGISTRIES.items()}
        for kind, known in REGISTRIES.items():
            known.update(payload.registered[kind])
        self._folder = tempfile.TemporaryDirectory(
            prefix="emla-sweep-",
            dir=worker.local_directory,  # Dask removes it even if the worker is killed
            ignore_cleanup_errors=True,
        )
        self._place = Path(self._folder.name).resolve()
        self._files = {}
        for sha, (name, content) in payload.files.items():
            place = self._place / sha[:16] / name
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(content)
            self._files[sha] = place
        self._simulations: dict[tuple[int, int], Simulation] = {}
        self._turn = threading.Lock()

    def teardown(self, worker: Any) -> None:
        """Close simulations and remove files and registrations."""
        with self._turn:
            for simulation in self._simulations.values():
                simulation.close()
            self._simulations.clear()
        for kind, names in self._new.items():  # the next sweep may be another user's
            for name in names:
                REGISTRIES[kind].pop(name, None)
        self._folder.cleanup()

    def simulation(self, group: int) -> Simulation:
        """Return this thread's simulation of a group. Raise CosimError if it cannot be prepared."""
        key = (group, threading.get_ident())
        with self._turn:
            found = self._simulations.pop(key, None)
            ours = [k for k in self._simulations if k[1] == key[1]]
            if found is None and len(ours) >= _PREPARED_AT_MOST:
                self._simulations.pop(ours[0]).close()
        if found is None:
            packed = self._payload.packed[group]
            system = packed.unpack_system(self._files)
            alone = replace(packed.options, threads=1)  # other workers use the other cores
            found = Simulation(system, alone, packed.name, unpacked=self._place)
        with self._turn:
            self._simulations[key] = found
        return found


def describe(key: str, group: int) -> SimulationDescription:
    """Describe the simulation of a group. Raise CosimError if it cannot be prepared."""
    simulation = _plugin(key).simulation(group)
    outline = _OutlineRecorder()
    with contextlib.suppress(RunError):  # variants may run although the scenario itself fails
        simulation.start(recorders=[outline])
    begun = outline.outline
    if begun is None:
        simulation.run()
        raise RunError(f"'{simulation.name}' cannot be started.")
    recorder = MetricsRecorder()
    recorder.begin(begun)
    shown = {}
    for name, kind in recorder.kinds.items():
        seen = {s.name: s for s in kind.shown}
        for of, figures in recorder.figures()[name].items():
            shown |= {f"{of}.{figure}": seen[figure] for figure in figures if figure in seen}
    units, further = (
        {name: str(unit) if unit is not None else "" for name, unit in found.items()}
        for found in (simulation.units, simulation.further_units())
    )
    rows = 1 + -(-begun.times.steps // begun.every)
    figures = {
        name: isinstance(value, bool) for name, value in flatten_figures(recorder.figures(), {}).items()
    }
    return SimulationDescription(units, further, figures, shown, rows)


def run_chunk(key: str, group: int, variants: Sequence[Variant], measures: Measures) -> Chunk:
    """Run variants in sequence. An error in one becomes its outcome."""
    plugin = _plugin(key)
    outcomes, series = list[VariantOutcome](), list[polars.DataFrame]()
    with contextlib.suppress(CosimError):  # every variant reports it as its outcome
        plugin.simulation(group)
    began = time.perf_counter()  # without the preparation, which happens once
    for variant in variants:
        outcome, result = _run(plugin, group, variant, measures)
        outcomes.append(outcome)
        if measures.signals and result is not None and result.table is not None:
            number = polars.lit(variant.number, polars.Int64).alias(VARIANT)
            series.append(measures.series(result).select(number, polars.all()))
    kept = to_parquet(polars.concat(series)) if series else None
    return Chunk(outcomes, time.perf_counter() - began, kept)


def _run(
    plugin: SweepPlugin, group: int, variant: Variant, measures: Measures
) -> tuple[VariantOutcome, Result | None]:
    """Run one variant. Any error becomes its outcome."""
    recorders = [TimeSeries()] if measures.read or measures.expressions or measures.functions else []
    status, problem = DONE, None
    try:
        try:
            simulation = plugin.simulation(group)
            result = simulation.run(
                recorders=recorders, signals=measures.reading(simulation.names), **variant.options
            )
            problem = reason_not_held(result)
        except RunError as error:
            if "result" not in error.fields:
                raise
            result, status, problem = error.fields["result"], _status(error), str(error)
        problem = " ".join(filter(None, (problem, *describe_lost_values(result.record)))) or None
        try:
            figures = measures.of(result)
        except MeasureError as error:
            figures, status = {}, FAILED
            problem = " ".join(filter(None, (problem, str(error))))
        return VariantOutcome(variant.number, status, problem, result.end_s, figures), result
    except CosimError as error:
        return VariantOutcome(variant.number, REFUSED, str(error)), None
    except BaseException as error:  # from a user's metrics or algorithm; SystemExit would end the thread
        return VariantOutcome(variant.number, FAILED, f"the run raised {error!r}."), None


def _status(error: RunError) -> str:
    """Return the status of a failed run that has a result."""
    if isinstance(error.__cause__, DiscardedStepError):
        return DIVERGED
    return FAILED if "time" not in error.fields or error.fields["result"].steps else REFUSED


def _plugin(key: str) -> SweepPlugin:
    return cast(SweepPlugin, get_worker().plugins[key])


def to_parquet(table: polars.DataFrame) -> bytes:
    """Return a table as the content of a Parquet file."""
    stream = BytesIO()
    table.write_parquet(stream)
    return stream.getvalue()


class _OutlineRecorder(Recorder):
    """Stores the outline of a run."""

    outline: Outline | None = None

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Store the outline."""
        self.outline = outline
