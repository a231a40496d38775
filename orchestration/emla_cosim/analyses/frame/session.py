"""The session of an analysis: its folder, notes, workers and their runs."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, Generic

import polars

from ...base.extras import LEFT_OUT
from ...base.files import hash_plain_data
from ...base.interruption import catch_interrupts
from ...base.progress import Progress
from ...base.values import convert_value
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ..execution.chunk_queue import WorkPackage
from ..execution.executor import Executor, Scheduler, check_cluster, open_executor, start_workers
from ..execution.worker_payload import Preparation, WorkerPayload
from ..variants.measures import VARIANT, Chunk, Measures, SimulationDescription, Variant, VariantOutcome
from .outputs import AnalysisFolder, Outputs, R


@dataclass(frozen=True)
class Job:
    """A run: its options, the position of its prepared scenario, and whether it has half the step."""

    options: Mapping[str, Any]
    group: int = 0
    is_halved: bool = False


@dataclass
class Outcomes:
    """The outcomes of runs.

    Attributes:
        by_job: Outcomes by the position of their job.
        series: Recorded signals by the position of their job.
        complete: Whether all runs ended before an interrupt.
    """

    by_job: dict[int, VariantOutcome] = field(default_factory=dict)
    series: dict[int, polars.DataFrame] = field(default_factory=dict)
    complete: bool = False


class Runs:
    """Runs of prepared scenarios, until the user interrupts.

    Attributes:
        executor: The workers.
        interrupted: Returns whether the user interrupted.
        count: Number of runs so far.
    """

    def __init__(
        self, executor: Executor, preparations: Sequence[Preparation], interrupted: Callable[[], bool]
    ) -> None:
        self.executor, self.interrupted, self.count = executor, interrupted, 0
        steps = [run_times(preparation.options, preparation.name).steps for preparation in preparations]
        # long runs first, so that workers end together
        self._longest_first = sorted(range(len(steps)), key=lambda group: -steps[group])

    def describe(self, group: int = 0) -> SimulationDescription:
        """Describe the prepared scenario at this position. Raises CosimError if it cannot start."""
        return self.executor.describe(group)

    def run(
        self,
        jobs: Sequence[Job],
        measures: Measures,
        on_chunk: Callable[[Chunk], None] = lambda _: None,
        bytes_each: int = 0,
    ) -> Outcomes:
        """Run jobs, or those that end before an interrupt.

        Args:
            jobs: The runs.
            measures: What to record of each.
            on_chunk: Called with each part that has ended.
            bytes_each: Size of the signals of a run in bytes.

        Raises:
            RunError: The workers are lost.
        """
        first = self.count  # numbers differ between calls, so that nothing mixes them up
        self.count += len(jobs)
        outcomes = Outcomes()

        def make_variant(number: int) -> Variant:
            job = jobs[number - first]
            return Variant(number, job.options, job.is_halved)

        def add_outcomes(chunk: Chunk) -> None:
            outcomes.by_job.update({outcome.number - first: outcome for outcome in chunk.outcomes})
            if chunk.series is not None:
                series = polars.read_parquet(BytesIO(chunk.series))
                for (number,), part in series.group_by(VARIANT, maintain_order=True):
                    outcomes.series[int(str(number)) - first] = part.drop(VARIANT)
            on_chunk(chunk)

        by_group: dict[int, list[int]] = {group: [] for group in self._longest_first}
        for position, job in enumerate(jobs):
            by_group[job.group].append(first + position)
        work = [WorkPackage(group, numbers) for group, numbers in by_group.items() if numbers]
        outcomes.complete = self.executor.run(
            work, make_variant, measures, bytes_each, add_outcomes, self.interrupted
        )
        return outcomes


class Session(Generic[R]):
    """The folder, the progress and the workers of one analysis whose result is an `R`.

    Args:
        outputs: The files of the analysis.
        output: Folder for the results; None for no files.
        overwrite: Whether to replace files that emla did not write.
        plots: Whether to draw pictures into the folder.
        report: Whether to write a page into the folder.
        scheduler: Address or client of a Dask scheduler; None for this machine.
        workers: Number of processes on this machine. Default: one for each core.
        progress: Receives the progress; each note only once.
        folder: Folder of another class, instead of `output`.

    Raises:
        CommandError: The folder cannot be used, or there is no such cluster.
    """

    def __init__(
        self,
        outputs: Outputs[R],
        output: str | Path | None = None,
        overwrite: bool = False,
        plots: bool = True,
        report: bool = False,
        scheduler: Scheduler = None,
        workers: int | None = None,
        progress: Progress | None = None,
        *,
        folder: AnalysisFolder[R] | None = None,
    ) -> None:
        check_cluster(scheduler, workers)
        self.progress = NotesOnce(progress or Progress())
        self._analysis, self._cluster = outputs.subject, (scheduler, workers)
        self.folder = folder
        if output is not None:
            path = convert_value(output, Path, "the output folder")
            self.folder = AnalysisFolder(outputs, path, overwrite, plots, report)
        if self.folder is not None and self.folder.lacks_pictures:
            self.progress.note(f"Note: {LEFT_OUT}.")

    @property
    def path(self) -> Path | None:
        """The folder; None without one."""
        return None if self.folder is None else self.folder.path

    @contextmanager
    def reserve_folder(self) -> Iterator[None]:
        """Reserve the folder. Raises CommandError if another command uses it."""
        with nullcontext() if self.folder is None else self.folder.reserve():
            yield

    @contextmanager
    def with_workers(self) -> Iterator[None]:
        """Reserve the folder, and start processes of this machine, which load while scenarios are prepared.

        Raises:
            CommandError: Another command uses the folder.
            RunError: No process can start.
        """
        with self.reserve_folder(), start_workers(*self._cluster) as scheduler:
            self._cluster = scheduler, None
            yield

    def prepare(self, scenario: Scenario) -> Preparation:
        """Build missing FMUs of a scenario, and report its notes.

        Raises:
            CommandError: The scenario cannot run, or reads a file of the folder.
            RunError: An FMU cannot be built.
        """
        for note in scenario.notes:
            self.progress.note(f"Note: {note}.")
        preparation = Preparation.of(scenario, self.progress)
        self.check_unread([preparation.read])
        return preparation

    def check_unread(self, read: Sequence[Mapping[Path, str]]) -> None:
        """Raise CommandError if a file of the folder is also read; `read` describes files by path."""
        if self.folder is not None:
            self.folder.check_unread(read)

    @contextmanager
    def open_runs(self, preparations: Sequence[Preparation]) -> Iterator[Runs]:
        """Open workers for prepared scenarios. Raises RunError."""
        # with the time: several analyses may share a cluster, whose tasks and plugins have global names
        key = f"emla-{self._analysis}-{hash_plain_data((self._analysis, time.time_ns()))}"
        payload = WorkerPayload.of(key, preparations)
        with (
            catch_interrupts() as interrupted,
            open_executor(payload, *self._cluster, self.progress.note) as executor,
        ):
            yield Runs(executor, preparations, interrupted)

    def keep(self, result: R, is_final: bool = True) -> None:
        """Write the files of a result; pictures and page only of the final one. Raises RunError."""
        if self.folder is not None:
            self.folder.keep(result, is_final)


class NotesOnce(Progress):
    """Passes progress on, and each note once: those of several scenarios are alike."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._noted = progress, set[str]()
        self.begin, self.advance, self.finish = progress.begin, progress.advance, progress.finish
        self.report_replacement = progress.report_replacement

    def note(self, sentence: str) -> None:
        """Report a note or warning, unless it was reported before."""
        if sentence not in self._noted:
            self._noted.add(sentence)
            self._progress.note(sentence)
