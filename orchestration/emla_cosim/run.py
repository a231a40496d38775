"""One run from a scenario to its output folder."""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryFile

from .errors import CommandError, RunError, check_choice
from .interruption import interruption
from .master.assembly import Assembly, assembled
from .master.network import Network
from .master.simulation import ALGORITHMS, Timing, simulate, timing
from .master.slave import Vector
from .models import FMU_FOLDER, build
from .results.csv_file import CsvFile
from .results.metrics import JointMetrics, MetricsSink, as_json
from .results.plots import FIGURES, plot_run
from .results.recorder import Recorder
from .results.run_record import run_record
from .system.model import System, Value
from .system.scenarios import Scenario

BLOCK_ROWS = 500
RESULTS, METRICS, RECORD = "results.csv", "metrics.json", "run.json"
DEFAULT_INTERVAL = 1e-3
"""Time in s between rows of results.csv unless told otherwise."""


@dataclass(frozen=True)
class Settings:
    """What the user may change about a run; None takes the scenario's. Times in s."""

    values: Mapping[str, Value] = field(default_factory=dict)
    replacements: Mapping[str, Path] = field(default_factory=dict)
    algorithm: str | None = None
    step_size: float | None = None
    stop_time: float | None = None
    output_interval: float | None = None
    flavour: str = "native"
    fmus: Path = FMU_FOLDER
    plots: bool = True


@dataclass(frozen=True)
class RunResult:
    """How a run ended. `problem` is None, or the sentence that says why it ended early."""

    folder: Path
    metrics: dict[str, JointMetrics]
    steps: int
    wall_s: float
    times: Timing
    pictures: list[Path]
    problem: str | None


class Progress:
    """What a run tells while it goes on; this one keeps quiet."""

    def begin(self, task: str, total: int) -> None:
        """A task of `total` units begins."""

    def advance(self, count: int) -> None:
        """So many units more are done."""


class _ProgressSink:
    """Moves the progress on as rows are recorded."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def write(self, rows: Vector) -> None:
        self._progress.advance(len(rows))

    def close(self) -> None:
        pass


def run(scenario: Scenario, settings: Settings, folder: Path, progress: Progress) -> RunResult:
    """Run a scenario and write results.csv, metrics.json, run.json and plots to `folder`.

    A run that fails or is interrupted (Ctrl-C) leaves what was computed there and says so in
    `RunResult.problem`. Raises CommandError for a command that makes no sense, before anything
    is run, and RunError where FMUs cannot be built or refuse their start values.
    """
    algorithm = settings.algorithm or scenario.algorithm
    check_choice("algorithm", algorithm, ALGORITHMS)
    system = scenario.system.with_parameters(settings.values).with_fmus(settings.replacements)
    times = timing(
        _given(settings.stop_time, scenario.stop_time), _given(settings.step_size, scenario.step_size)
    )
    every = _steps_per_row(settings.output_interval, times)
    _create_folder(folder)
    fmus = _fmu_files(system, settings, progress)
    with assembled(system, fmus) as assembly:
        result = _simulated(assembly, system, algorithm, times, every, folder, progress)
        effective = {
            "algorithm": algorithm,
            "start_time_s": times.start,
            "stop_time_s": times.stop,
            "step_size_s": times.step,
            "output_interval_s": every * times.step,
            "flavour": settings.flavour,
            "set": settings.values,
            "replace": settings.replacements,
        }
        record = run_record(scenario.name, effective, system, assembly, result.problem)
    return _reported(result, record, system.joints if settings.plots else [], progress)


def _given(value: float | None, default: float) -> float:
    return default if value is None else value


def _steps_per_row(interval: float | None, times: Timing) -> int:
    """How many steps make an output interval; without one 1 ms, or every step if that does not fit."""
    chosen = DEFAULT_INTERVAL if interval is None else interval
    if not 0.0 < chosen < float("inf"):
        raise CommandError(f"the output interval {chosen:g} s must be a positive number of seconds.")
    every = round(chosen / times.step)
    if every >= 1 and abs(every * times.step - chosen) <= 1e-9 * chosen:
        return every
    if interval is None:
        return max(every, 1)
    raise CommandError(
        f"the output interval {chosen:g} s is not a whole number of steps of {times.step:g} s."
    )


def _create_folder(folder: Path) -> None:
    """Make the output folder and see that it can be written; an earlier run's files stay for now."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise CommandError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error


def _clear_folder(folder: Path) -> None:
    """Remove what an earlier run left under the same names, now that a new run begins."""
    for name in (RESULTS, METRICS, RECORD, *(f"{figure}.png" for figure in FIGURES)):
        (folder / name).unlink(missing_ok=True)


def _fmu_files(system: System, settings: Settings, progress: Progress) -> dict[str, Path]:
    """The FMU file of every component, ours built where missing or out of date."""
    models = list(dict.fromkeys(c.model for c in system.components if c.fmu is None))
    progress.begin("preparing FMUs", len(models))
    built = {}
    for model in models:
        built[model] = build(model, settings.flavour, [], settings.fmus)
        progress.advance(1)
    return {c.name: c.fmu if c.fmu is not None else built[c.model] for c in system.components}


def _simulated(
    assembly: Assembly,
    system: System,
    algorithm: str,
    times: Timing,
    every: int,
    folder: Path,
    progress: Progress,
) -> RunResult:
    """Step the assembly to the end, or as far as it goes, recording to results.csv."""
    network, names = assembly.network, assembly.signal_names
    metrics = MetricsSink(system.joints, names)
    progress.begin("simulating", times.steps + 1)
    started, rows, problem = time.perf_counter(), 0, None
    try:
        _clear_folder(folder)
        csv_file = CsvFile(folder / RESULTS, names, every)
        recorder = Recorder(network.signals, [csv_file, metrics, _ProgressSink(progress)], BLOCK_ROWS)
        try:
            with interruption() as interrupted:
                problem = _stepped(network, algorithm, times, recorder, interrupted)
        finally:
            rows = recorder.rows
            recorder.close()
    except OSError as error:
        problem = f"{folder / RESULTS} cannot be written: {error.strerror or error}."
    wall = time.perf_counter() - started
    return RunResult(folder, metrics.results(), max(rows - 1, 0), wall, times, [], problem)


def _stepped(
    network: Network, algorithm: str, times: Timing, recorder: Recorder, interrupted: Callable[[], bool]
) -> str | None:
    """Step to the end; returns why it ended early, if it did. Raises OSError from the recorder."""
    try:
        done = simulate(network, ALGORITHMS[algorithm](), times, recorder.record, interrupted)
    except RunError as error:
        t = times.start + max(recorder.rows - 1, 0) * times.step
        return f"the run ended at t = {t:.6g} s: {error}"
    if done < times.steps:
        return f"interrupted at t = {times.start + done * times.step:.6g} s."
    return None


def _reported(result: RunResult, record: object, plotted: list[str], progress: Progress) -> RunResult:
    """Write the JSON files and the plots of these joints; a full disk becomes the run's problem."""
    run_metrics = {
        "steps": result.steps,
        "wall_s": result.wall_s,
        "steps_per_s": result.steps / result.wall_s if result.wall_s > 0 else 0.0,
    }
    try:
        _write_json(result.folder / METRICS, {"joints": as_json(result.metrics), "run": run_metrics})
        _write_json(result.folder / RECORD, record)
        if not plotted or result.steps == 0:
            return result
        progress.begin("drawing plots", len(FIGURES))
        csv_file = result.folder / RESULTS
        return replace(
            result, pictures=plot_run(csv_file, plotted, result.folder, lambda _: progress.advance(1))
        )
    except OSError as error:
        full = f"the output folder '{result.folder}' cannot be written: {error.strerror or error}."
        return replace(result, problem=result.problem or full)


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
