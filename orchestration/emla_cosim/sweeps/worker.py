"""What runs on a worker: simulations prepared once, and the variants of a chunk run on them."""

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
from ..recorders.metrics import MetricsRecorder, Shown
from ..recorders.recorder import Outline, Recorder
from ..recorders.time_series import TimeSeries
from ..run.requirements import flatten_figures
from ..run.result import Result
from ..run.simulation import Simulation
from ..study.loading import register
from .data import DIVERGED, DONE, FAILED, REFUSED, VARIANT
from .measures import MeasureError, Measures, reason_not_held
from .worker_payload import REGISTRIES, WorkerPayload

_PREPARED_AT_MOST = 8
"""Simulations that one thread keeps; the one that was not used for longest goes."""


@dataclass(frozen=True)
class Variant:
    """One run: its number, and the options that are its own."""

    number: int
    options: Mapping[str, Any]


@dataclass(frozen=True)
class VariantOutcome:
    """What a variant gave: how it ended, why, at which time in s, and its figures."""

    number: int
    status: str
    problem: str | None = None
    end_s: float | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Chunk:
    """What the variants of a chunk gave, how long they took in s, and their signals as a Parquet file."""

    outcomes: Sequence[VariantOutcome]
    wall_s: float
    series: bytes | None = None


@dataclass(frozen=True)
class SimulationDescription:
    """What a prepared simulation gives: signals with units, figures, and how people see these."""

    units: Mapping[str, str]
    figures: Mapping[str, bool]
    """Whether each is a truth."""
    shown: Mapping[str, Shown]
    rows: int
    """Of a table, for the options as they are."""


class SweepPlugin(WorkerPlugin):
    """Holds on every worker what a sweep needs there: FMUs in a folder, simulations by thread."""

    def __init__(self, shipment: WorkerPayload) -> None:
        self._shipment = shipment
        self.name = shipment.key

    def setup(self, worker: Any) -> None:
        """Unpack what has travelled, on the worker. Raises CommandError where it is of another version."""
        shipment = self._shipment
        if (here := version("emla-cosim")) != shipment.version:
            raise CommandError(
                f"the worker {worker.address} has emla-cosim {here}, not {shipment.version}; install that."
            )
        register()
        self._new = {kind: shipment.registered[kind].keys() - known for kind, known in REGISTRIES.items()}
        for kind, known in REGISTRIES.items():
            known.update(shipment.registered[kind])
        self._folder = tempfile.TemporaryDirectory(
            prefix="emla-sweep-",
            dir=worker.local_directory,  # which Dask removes if the worker is killed
            ignore_cleanup_errors=True,
        )
        self._place = Path(self._folder.name).resolve()
        self._files = {}
        for sha, (name, content) in shipment.files.items():
            place = self._place / sha[:16] / name
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(content)
            self._files[sha] = place
        self._simulations: dict[tuple[int, int], Simulation] = {}
        self._turn = threading.Lock()

    def teardown(self, worker: Any) -> None:
        """Free everything."""
        with self._turn:
            for simulation in self._simulations.values():
                simulation.close()
            self._simulations.clear()
        for kind, names in self._new.items():  # the next sweep here may be somebody else's
            for name in names:
                REGISTRIES[kind].pop(name, None)
        self._folder.cleanup()

    def simulation(self, group: int) -> Simulation:
        """The simulation of a preparation that belongs to this thread. Raises CosimError."""
        key = (group, threading.get_ident())
        with self._turn:
            found = self._simulations.pop(key, None)
            ours = [k for k in self._simulations if k[1] == key[1]]
            if found is None and len(ours) >= _PREPARED_AT_MOST:
                self._simulations.pop(ours[0]).close()
        if found is None:
            shipped = self._shipment.packed[group]
            system = shipped.unpack_system(self._files)
            alone = replace(shipped.options, threads=1)  # other workers have the other cores
            found = Simulation(system, alone, shipped.name, unpacked=self._place)
        with self._turn:
            self._simulations[key] = found
        return found


def describe(key: str, group: int) -> SimulationDescription:
    """Tell what the simulation of a preparation gives. Raises CosimError where there is none."""
    simulation = _plugin(key).simulation(group)
    outline = _OutlineRecorder()
    with contextlib.suppress(RunError):  # a variant may be fine where the scenario itself is not
        simulation.start(recorders=[outline])
    found = outline.outline
    if found is None:
        simulation.run()
        raise RunError(f"'{simulation.name}' cannot be started.")
    recorder = MetricsRecorder()
    recorder.begin(found)
    shown = {}
    for name, kind in recorder.kinds.items():
        seen = {s.name: s for s in kind.shown}
        for of, figures in recorder.figures()[name].items():
            shown |= {f"{of}.{figure}": seen[figure] for figure in figures if figure in seen}
    units = {name: str(unit) if unit is not None else "" for name, unit in simulation.units.items()}
    rows = 1 + -(-found.times.steps // found.every)
    figures = {
        name: isinstance(value, bool) for name, value in flatten_figures(recorder.figures(), {}).items()
    }
    return SimulationDescription(units, figures, shown, rows)


def run_chunk(key: str, group: int, variants: Sequence[Variant], measures: Measures) -> Chunk:
    """Run these variants one after the other; what goes wrong in one is its outcome."""
    plugin = _plugin(key)
    outcomes, series = list[VariantOutcome](), list[polars.DataFrame]()
    with contextlib.suppress(CosimError):  # which is the outcome of every variant then
        plugin.simulation(group)
    began = time.perf_counter()  # for what is done again and again
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
    """Run one variant; whatever goes wrong is told as what came out of it."""
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
        try:
            figures = measures.of(result)
        except MeasureError as error:
            figures, status = {}, FAILED
            problem = " ".join(filter(None, (problem, str(error))))
        return VariantOutcome(variant.number, status, problem, result.end_s, figures), result
    except CosimError as error:
        return VariantOutcome(variant.number, REFUSED, str(error)), None
    except BaseException as error:  # of somebody's metrics or algorithm; SystemExit would end the thread
        return VariantOutcome(variant.number, FAILED, f"the run raised {error!r}."), None


def _status(error: RunError) -> str:
    """How a run ended that has a result."""
    if isinstance(error.__cause__, DiscardedStepError):
        return DIVERGED
    return FAILED if "time" not in error.fields or error.fields["result"].steps else REFUSED


def _plugin(key: str) -> SweepPlugin:
    return cast(SweepPlugin, get_worker().plugins[key])


def to_parquet(table: polars.DataFrame) -> bytes:
    """A table as a Parquet file."""
    stream = BytesIO()
    table.write_parquet(stream)
    return stream.getvalue()


class _OutlineRecorder(Recorder):
    """Remembers what it is told of a run."""

    outline: Outline | None = None

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """A run begins."""
        self.outline = outline
