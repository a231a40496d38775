"""One run from a scenario to its output folder."""

import contextlib
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .checkpoints import Checkpoints, resumable, run_identity
from .errors import CommandError, RunError
from .interruption import interruption
from .master.assembly import Assembly, assembled
from .master.simulation import simulate
from .master.stepping.checkpoint import Checkpoint, check_can_save
from .master.stepping.pacing import Pacing
from .master.stepping.stepping import Stepping
from .master.stepping.timing import Timing, timing
from .preparation import prepared
from .progress import Progress
from .results.metrics import JointMetrics, as_json
from .results.output_folder import METRICS, RECORD, OutputFolder, Recording
from .results.plots import FIGURES
from .results.run_record import run_record, stepping_record
from .scenarios.scenario import Scenario
from .settings import Settings
from .system.model import System

FLUSH_INTERVAL = 1.0
"""Wall time in s after which rows go to disk even if there are few."""


@dataclass(frozen=True)
class RunResult:
    """How a run ended. `problem` is None, or the sentence that says why it ended early.

    `steps`, `simulated_s` and `wall_s` are those of this run, which may have continued another
    one; `end_s` is the simulated time reached. `stepping` says how the steps were made.
    """

    folder: Path
    metrics: dict[str, JointMetrics]
    times: Timing
    steps: int
    simulated_s: float
    end_s: float
    wall_s: float
    stepping: dict[str, Any]
    pictures: list[Path]
    pacing: Pacing | None
    problem: str | None


def run(scenario: Scenario, settings: Settings, folder: Path, progress: Progress) -> RunResult:
    """Run a scenario and write results.csv, metrics.json, run.json and plots to `folder`.

    A run that fails or is interrupted (Ctrl-C) leaves what was computed there and says so in
    `RunResult.problem`. Raises CommandError for a command that makes no sense, before anything
    is run, and RunError where FMUs cannot be built or refuse their start values.
    """
    name = settings.algorithm or scenario.algorithm
    algorithm = settings.make_algorithm(name)
    times = run_times(scenario, settings)
    every = settings.steps_per_row(times)
    pacing = Pacing(settings.real_time) if settings.real_time is not None else None
    output = OutputFolder(folder)
    system, fmus = prepared(scenario.system, settings, progress)
    with contextlib.ExitStack() as held:
        assembly = held.enter_context(assembled(system, fmus))
        selected = settings.selected(assembly.network.names)
        if settings.order:
            assembly.network.reorder(settings.order)
        algorithm.setup(assembly.network)
        held.callback(algorithm.close)
        stepping = settings.make_stepping(algorithm, times)
        held.callback(stepping.close)
        progress.advance(1)  # the stepping may have been compiled
        identity = run_identity(system, assembly, name, settings, times)
        resumed = resumable(settings.resume, identity, times) if settings.resume else None
        if settings.checkpoint is not None:
            check_can_save(settings.checkpoint, assembly.network)
        checkpoints = Checkpoints(settings.checkpoint, identity)
        simulation = _Simulation(assembly, stepping, pacing, checkpoints, resumed, progress)
        result = simulation.run(output, system, every, selected)
        effective = settings.record(name, times)
        record = run_record(
            scenario.name, effective, system, assembly, result.stepping, result.problem, scenario.unpacked
        )
    drawn = list(result.metrics) if settings.plots else []
    return _reported(result, output, record, drawn, progress)


def results_folder(name: str) -> Path:
    """Where the results of a scenario go unless told otherwise; a name cannot lead elsewhere."""
    return Path("results") / (re.sub(r"[^\w.-]+", "_", name).strip("._") or "run")


def run_times(scenario: Scenario, settings: Settings) -> Timing:
    """The communication points of a run; CommandError where nobody says how long it is or its steps."""
    stop = scenario.stop_time if settings.stop_time is None else settings.stop_time
    step = scenario.step_size if settings.step_size is None else settings.step_size
    if stop is None:
        raise CommandError(f"'{scenario.name}' does not say when to stop; give --stop-time.")
    if step is None:
        raise CommandError(f"'{scenario.name}' does not say how long a step is; give --step-size.")
    return timing(stop, step, scenario.start_time)


@dataclass
class _Simulation:
    """The part of a run in which time passes."""

    assembly: Assembly
    stepping: Stepping
    pacing: Pacing | None
    checkpoints: Checkpoints
    resumed: Checkpoint | None
    progress: Progress

    def run(
        self, output: OutputFolder, system: System, every: int, selected: Sequence[int] | None
    ) -> RunResult:
        """Step to the end, or as far as it goes, recording to the output folder."""
        stepping, names = self.stepping, self.assembly.network.names
        after = self.resumed.notes["recording"] if self.resumed is not None else None
        began, recording, problem = time.perf_counter(), None, None
        first = (0, stepping.times.start)
        try:
            shown = self.assembly.shown
            recording = Recording(output, system.joints, names, every, after, selected, shown)
            try:
                with interruption() as interrupted:
                    first = self._begin(recording)
                    began = time.perf_counter()
                    problem = self._step(recording, interrupted)
            except RunError as error:
                problem = f"the run ended at t = {stepping.time:.6g} s: {error}"
            finally:
                recording.recorder.close()
        except OSError as error:
            problem = f"{output.results} cannot be written: {error.strerror or error}."
        return RunResult(
            folder=output.path,
            times=stepping.times,
            metrics=recording.metrics() if recording is not None else {},
            steps=stepping.steps - first[0],
            simulated_s=stepping.time - first[1],
            end_s=stepping.time,
            wall_s=time.perf_counter() - began,
            stepping=stepping_record(stepping, system),
            pictures=[],
            pacing=self.pacing,
            problem=problem,
        )

    def _begin(self, recording: Recording) -> tuple[int, float]:
        """Initialize, or continue where a checkpoint is; returns steps and time in s there."""
        stepping, times = self.stepping, self.stepping.times
        # the states in a checkpoint would hold a continued run to this run's stop time
        stop = times.stop if self.checkpoints.path is None else None
        stepping.algorithm.initialize(times.start, stop)
        if self.resumed is None:
            stepping.record(recording.recorder)
        else:
            self.resumed.restore(stepping)
        return stepping.steps, stepping.time

    def _step(self, recording: Recording, interrupted: Callable[[], bool]) -> str | None:
        """Step until the end; returns why not, if it was interrupted."""
        stepping, times = self.stepping, self.stepping.times
        self.progress.begin("simulating", times.steps)
        shown, flushed = 0, time.monotonic()

        def between() -> None:
            nonlocal shown, flushed
            reached = round((stepping.time - times.start) / times.step)
            self.progress.advance(reached - shown)
            shown = reached
            if time.monotonic() - flushed >= FLUSH_INTERVAL:
                recording.recorder.flush()
                flushed = time.monotonic()
            self.checkpoints.save_when_due(stepping, recording)

        between()
        if self.pacing is not None:
            self.pacing.begin(stepping.time)
        simulate(stepping, recording.recorder, interrupted, self.pacing, between)
        self.checkpoints.save(stepping, recording)
        return None if stepping.finished else f"interrupted at t = {stepping.time:.6g} s."


def _reported(
    result: RunResult, output: OutputFolder, record: object, plotted: list[str], progress: Progress
) -> RunResult:
    """Write the JSON files and the plots of these joints; a full disk becomes the run's problem."""
    run_metrics: dict[str, Any] = {
        "steps": result.steps,
        "wall_s": result.wall_s,
        "steps_per_s": result.steps / result.wall_s if result.wall_s > 0 else 0.0,
    }
    if result.pacing is not None:
        run_metrics["real_time"] = result.pacing.report()
    try:
        output.write_json(METRICS, {"joints": as_json(result.metrics), "run": run_metrics})
        output.write_json(RECORD, record)
        if not plotted or result.steps == 0:
            return result
        progress.begin("drawing plots", len(FIGURES))
        return replace(result, pictures=output.draw(plotted, lambda _: progress.advance(1)))
    except OSError as error:
        full = f"the output folder '{result.folder}' cannot be written: {error.strerror or error}."
        return replace(result, problem=result.problem or full)
