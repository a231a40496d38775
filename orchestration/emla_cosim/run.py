"""One run from a scenario to its output folder."""

import json
import platform
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from types import FrameType

from .errors import CommandError, RunError
from .master.assembly import Assembly, assembled
from .master.simulation import ALGORITHMS, Timing, simulate, timing
from .master.slave import SlaveError, Vector
from .models import FMU_FOLDER, build, check_choice
from .results.csv_file import CsvFile
from .results.metrics import JointMetrics, MetricsSink, as_json
from .results.plots import FIGURES, plot_run
from .results.recorder import Recorder, Sink
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
    is run, and RunError where FMUs cannot be built.
    """
    check_choice("algorithm", settings.algorithm or scenario.algorithm, ALGORITHMS)
    system = scenario.system.with_parameters(settings.values).with_fmus(settings.replacements)
    times = timing(
        _given(settings.stop_time, scenario.stop_time), _given(settings.step_size, scenario.step_size)
    )
    every = _rows_per_interval(settings.output_interval, times)
    _create_folder(folder)
    fmus = _fmu_files(system, settings, progress)
    with assembled(system, fmus) as assembly, _interruption() as interrupted:
        metrics = MetricsSink(system.joints, assembly.signal_names)
        problem: str | None = None
        started, steps = time.perf_counter(), _Counter()
        try:
            sinks: list[Sink] = [
                CsvFile(folder / RESULTS, assembly.signal_names, every),
                metrics,
                _ProgressSink(progress),
            ]
            recorder = Recorder(assembly.network.signals, sinks, BLOCK_ROWS)
            progress.begin("simulating", times.steps + 1)
            problem = _simulate(scenario, settings, assembly, times, recorder, interrupted, steps)
        except OSError as error:
            problem = f"{folder / RESULTS} cannot be written: {error.strerror or error}."
        wall = time.perf_counter() - started
        result = RunResult(folder, metrics.results(), steps.count, wall, times, [], problem)
        record = _run_record(scenario, settings, assembly, system, times, every, problem)
        return _finish(result, record, system, settings, progress)


class _Counter:
    count = 0


def _simulate(
    scenario: Scenario,
    settings: Settings,
    assembly: Assembly,
    times: Timing,
    recorder: Recorder,
    interrupted: Callable[[], bool],
    steps: _Counter,
) -> str | None:
    """Step to the end, recording; returns why it ended early, if it did. Raises OSError."""
    algorithm = ALGORITHMS[settings.algorithm or scenario.algorithm]()
    recorded = -1

    def record(t: float) -> None:
        nonlocal recorded
        recorder.record(t)
        recorded += 1

    try:
        done = simulate(assembly.network, algorithm, times, record, interrupted)
        if done < times.steps:
            return f"interrupted at t = {times.start + done * times.step:.6g} s."
        return None
    except (SlaveError, RunError) as error:
        t = times.start + max(recorded, 0) * times.step
        return f"the run ended at t = {t:.6g} s: {error}"
    finally:
        steps.count = max(recorded, 0)
        recorder.close()


def _given(value: float | None, default: float) -> float:
    return default if value is None else value


def _rows_per_interval(interval: float | None, times: Timing) -> int:
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
    """Make the output folder, and remove what an earlier run left there under the same names."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (RESULTS, METRICS, RECORD, *(f"{figure}.png" for figure in FIGURES)):
            (folder / name).unlink(missing_ok=True)
        (folder / RECORD).touch()
    except OSError as error:
        raise CommandError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error


def _fmu_files(system: System, settings: Settings, progress: Progress) -> dict[str, Path]:
    """The FMU file of every component, ours built where missing or out of date."""
    models = list(dict.fromkeys(c.model for c in system.components if c.fmu is None))
    progress.begin("preparing FMUs", len(models))
    built = {}
    for model in models:
        built[model] = build(model, settings.flavour, [], settings.fmus)
        progress.advance(1)
    return {c.name: c.fmu if c.fmu is not None else built[c.model] for c in system.components}


@contextmanager
def _interruption() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a flag, so that a run ends between two steps."""
    requested = False

    def request(signum: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    try:
        previous = signal.signal(signal.SIGINT, request)
    except ValueError:  # not in the main thread: signals are not ours to take
        yield lambda: False
        return
    try:
        yield lambda: requested
    finally:
        signal.signal(signal.SIGINT, previous)


def _run_record(
    scenario: Scenario,
    settings: Settings,
    assembly: Assembly,
    system: System,
    times: Timing,
    every: int,
    problem: str | None,
) -> dict[str, object]:
    """Everything needed to repeat the run."""
    packages = ("emla-cosim", "fmpy", "numpy", "casadi", "ziglang", "pythonfmu")
    return {
        "scenario": scenario.name,
        "status": "completed" if problem is None else problem,
        "settings": {
            "algorithm": settings.algorithm or scenario.algorithm,
            "start_time_s": times.start,
            "stop_time_s": times.stop,
            "step_size_s": times.step,
            "output_interval_s": every * times.step,
            "flavour": settings.flavour,
            "set": dict(settings.values),
            "replace": {name: str(path) for name, path in settings.replacements.items()},
        },
        "versions": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            **{package: version(package) for package in packages},
        },
        "components": {
            c.name: {
                "fmu": str(assembly.files[c.name].path),
                "sha256": assembly.files[c.name].sha256,
                "guid": assembly.files[c.name].description.guid,
                "parameters": dict(c.parameters),
            }
            for c in system.components
        },
        "connections": [f"{x.source}.{x.output} -> {x.target}.{x.input}" for x in system.connections],
    }


def _finish(
    result: RunResult, record: dict[str, object], system: System, settings: Settings, progress: Progress
) -> RunResult:
    """Write the JSON files and the plots; a full disk adds to the run's problem."""
    run_metrics = {
        "steps": result.steps,
        "wall_s": result.wall_s,
        "steps_per_s": result.steps / result.wall_s if result.wall_s > 0 else 0.0,
    }
    problem, pictures = result.problem, []
    try:
        _write_json(result.folder / METRICS, {"joints": as_json(result.metrics), "run": run_metrics})
        _write_json(result.folder / RECORD, record)
        if settings.plots and result.steps > 0:
            progress.begin("drawing plots", len(FIGURES))
            pictures = plot_run(
                result.folder / RESULTS, system.joints, result.folder, lambda name: progress.advance(1)
            )
    except OSError as error:
        problem = (
            problem or f"the output folder '{result.folder}' cannot be written: {error.strerror or error}."
        )
    return RunResult(
        result.folder, result.metrics, result.steps, result.wall_s, result.times, pictures, problem
    )


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
