"""The steppers of the matrix, one entry each: every way in which the steps of a system can be done.

A new stepper is one more entry of `STEPPERS`: a function that runs a task, or options of a run. The plain
stepper of `tests/support` is the reference for all of them.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, chdir, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

import emla_cosim as ec
from tests.backends.systems import FAILING, SYSTEMS, Entry, Parts
from tests.support.generated_c import Code
from tests.support.plain_error_control import PlainErrorControlledStepSize
from tests.support.plain_stepper import PlainStepSize


@dataclass(frozen=True)
class Algorithm:
    """Options of a coupling algorithm; rows are `interval` steps apart, or after each step."""

    options: Mapping[str, Any]
    interval: int | None = None
    has: frozenset[str] | set[str] = frozenset()
    lacks: Collection[str] = ()


INPUTS = {"none": {"held inputs"}, "master": {"held inputs"}, "fmu": {"lines"}}
"""What FMUs know of their inputs within a step, by extrapolation."""


def fixed(algorithm: str, extrapolation: str = "none") -> Algorithm:
    has = {"fixed steps"} | ({"explicit"} if algorithm != "strong" else {"strong"})
    has |= {"extrapolation"} if extrapolation != "none" else set()
    options = {"algorithm": algorithm, "extrapolation": extrapolation}
    return Algorithm(options, 1, has | INPUTS[extrapolation])


def controlled(
    tolerance: float, algorithm: str, extrapolation: str = "none", interval: int | None = None
) -> Algorithm:
    options = {"algorithm": algorithm, "extrapolation": extrapolation, "error_tolerance": tolerance}
    has = {"error control"} | ({"explicit error control"} if algorithm != "strong" else {"strong"})
    has |= {"free rows"} if interval is None else set()
    return Algorithm(options, interval, has | INPUTS[extrapolation])


ALGORITHMS: dict[str, Algorithm] = {
    "jacobi": fixed("jacobi"),
    "jacobi, middles": fixed("jacobi", "master"),
    "gauss-seidel": fixed("gauss-seidel"),
    "gauss-seidel, lines": fixed("gauss-seidel", "fmu"),
    "strong": fixed("strong"),
    "strong, middles": fixed("strong", "master"),
    "strong, lines": fixed("strong", "fmu"),
    "error control, jacobi": controlled(2e-1, "jacobi"),
    "error control, gauss-seidel, lines": controlled(2e-2, "gauss-seidel", "fmu", 2),
    "error control, strong": controlled(2e-1, "strong", interval=1),
    "error control, strong, middles": controlled(2e-1, "strong", "master"),
}


@dataclass(frozen=True)
class Outcome:
    """What a stepper makes of a task.

    Attributes:
        columns: The rows, by signal; a stepper outside of this program has only outputs.
        report: What else must be the same, such as the error message; without values, nothing.
        is_whole: Whether it has all columns.
        rows: The rows of the reference that it has.
    """

    columns: Mapping[str, Any]
    report: Mapping[str, Any] = field(default_factory=dict)
    is_whole: bool = False
    rows: slice = field(default_factory=lambda: slice(None))


@dataclass(frozen=True)
class Task:
    """A system that an algorithm is to step."""

    system: str
    algorithm: str

    @property
    def entry(self) -> Entry:
        return SYSTEMS[self.system] if self.system in SYSTEMS else FAILING[self.system]

    @property
    def start(self) -> float:
        return float(self.entry.options.get("start_time", 0.0))

    def time(self, steps: int) -> float:
        """Return the time after some steps, in s."""
        return self.start + steps * self.entry.step

    def options(self) -> dict[str, Any]:
        algorithm = ALGORITHMS[self.algorithm]
        rows = None if algorithm.interval is None else algorithm.interval * self.entry.step
        return {**algorithm.options, "output_interval": rows}


class Bench:
    """Opens systems for runs; a system that is opened in a way stays open for other runs.

    `parts` is the folder with FMUs and data, to which paths in options are relative.
    """

    def __init__(self, folder: Path, fmus: Path) -> None:
        self.folder, self.fmus, self.parts = folder, fmus, folder / "parts"
        self.parts.mkdir()
        self.stack = ExitStack()
        self.scenario = cache(self._scenario)
        self.simulation = cache(self.prepare)
        self.reference = cache(self._reference)

    def _scenario(self, system: str, kind: int | str, flavour: str = "native") -> ec.Scenario:
        """Return a scenario whose FMUs have a version of FMI, or are of PythonFMU."""
        entry, parts = Task(system, "").entry, Parts(self.parts, self.fmus, kind)
        source = entry.build(parts)
        more: dict[str, Any] = {}
        if isinstance(source, str):
            more = {"fmus": self.fmus, "flavour": flavour, "replace": parts.replacements(source)}
        stop = Task(system, "").time(entry.steps)
        with chdir(self.parts):
            return ec.load(source, step_size=entry.step, stop_time=stop, **more | entry.options)

    def prepare(self, system: str, kind: int | str = 2, flavour: str = "native") -> ec.Simulation:
        """Open a system anew; `simulation` opens it once."""
        with chdir(self.parts):
            return self.stack.enter_context(self.scenario(system, kind, flavour).prepare())

    @contextmanager
    def isolated(self, system: str, first_alone: bool) -> Iterator[ec.Simulation]:
        """Open a system with all components, or its first one, in processes of their own."""
        scenario = self.scenario(system, 2)
        isolate = [scenario.system.components[0].name] if first_alone else True
        with chdir(self.parts), scenario.prepare(isolate=isolate) as simulation:
            yield simulation

    def _reference(self, task: Task) -> Outcome:
        if "fixed steps" in ALGORITHMS[task.algorithm].has:
            return run(self, task, step_size_control=PlainStepSize())
        tolerance = ALGORITHMS[task.algorithm].options["error_tolerance"]
        return run(self, task, step_size_control=PlainErrorControlledStepSize(error_tolerance=tolerance))

    def path(self, name: str) -> Path:
        """Return a path that has not been used."""
        folder = self.folder / f"{len(list(self.folder.iterdir()))}"
        folder.mkdir()
        return folder / name


# ---- ways to run ---------------------------------------------------------------------------------

DIFFERENT = {"threads", "lanes", "compiled_code_not_kept", "isolated", "why_one_thread"}
"""What steppers report differently."""

ADVICE = re.compile(
    r" (?:Parts of|It cannot do parts|The step cannot).*?\.(?= |$)| Set a smaller --step-size\.", re.DOTALL
)
"""What only the stepper in C says of discarded steps."""


def outcome_of(result: ec.Result) -> Outcome:
    stepping = {k: v for k, v in result.stepping.items() if k not in DIFFERENT and not k.endswith("_us")}
    report = {name: getattr(result, name) for name in ("steps", "end_s", "metrics")}
    # estimates of the coupling error cost time, so that not every run has one
    report["coupling"] = {name: x for name, x in result.coupling.items() if "estimated_error" not in x}
    remarks = [text for text in result.remarks if not text.startswith("Coupling error")]
    problem = result.problem or result.early_end  # an FMU may end a run without a failure
    report["problem"] = problem and ADVICE.sub("", problem)
    return Outcome(
        result.read(["time", *result.names]),
        {**report, "remarks": remarks, "stepping": stepping},
        is_whole=True,
    )


def run(bench: Bench, task: Task, kind: int | str = 2, flavour: str = "native", **options: Any) -> Outcome:
    # FMUs cannot be used again after fmi2Fatal
    prepare = bench.prepare if "fatal" in task.entry.has else bench.simulation
    simulation = prepare(task.system, kind, flavour)
    options = task.options() | options
    if isinstance(options.get("step_size_control"), PlainErrorControlledStepSize):
        del options["error_tolerance"]
    return outcome_of(simulation.attempt(recorders=[ec.TimeSeries()], **options))


def run_with_few_rows(bench: Bench, task: Task, interval: int, **options: Any) -> Outcome:
    outcome = run(bench, task, output_interval=interval * task.entry.step, **options)
    report = {k: v for k, v in outcome.report.items() if k in ("problem", "steps", "end_s", "stepping")}
    return Outcome(outcome.columns, report, outcome.is_whole, slice(None, None, interval))


def run_in_parts(bench: Bench, task: Task) -> Outcome:
    simulation, entry = bench.simulation(task.system), task.entry
    simulation.start(recorders=[ec.TimeSeries()], **task.options())
    for steps in (1, 5, entry.steps // 2, entry.steps - 1, entry.steps):
        simulation.advance(task.time(steps))
    return outcome_of(simulation.finish())


def resume(bench: Bench, task: Task) -> Outcome:
    """Save a checkpoint after half of the steps, and resume from it."""
    path = bench.path("half.checkpoint")
    half = task.time(task.entry.steps // 4 * 2)
    first = run(bench, task, stop_time=half, checkpoint=path)
    second = run(bench, task, resume=path)
    columns = {n: np.concatenate([first.columns[n], second.columns[n]]) for n in first.columns}
    report = {n: second.report[n] for n in ("problem", "end_s")}
    return Outcome(columns, report, second.is_whole)


def run_isolated(bench: Bench, task: Task, first_alone: bool) -> Outcome:
    with bench.isolated(task.system, first_alone) as simulation:
        return outcome_of(simulation.attempt(recorders=[ec.TimeSeries()], **task.options()))


def export(bench: Bench, task: Task, file: str, kind: int | str = 2, **options: Any) -> Path:
    path = bench.path(file)
    with chdir(bench.parts):
        bench.scenario(task.system, kind).export(path, outputs=["*"], **task.options(), **options)
    return path


def run_container(bench: Bench, task: Task, fmi: int, kind: int = 2) -> Outcome:
    fmu, entry = export(bench, task, "container.fmu", kind, fmi=fmi), task.entry
    variables = fmpy.read_model_description(fmu).modelVariables
    outputs = [v.name for v in variables if v.causality == "output" and v.type != "String"]
    times = {"start_time": task.start, "stop_time": task.time(entry.steps), "step_size": entry.step}
    rows = fmpy.simulate_fmu(str(fmu), **times, output_interval=entry.step, output=outputs)
    return Outcome({name: rows[name] for name in outputs})


def run_container_in_a_system(bench: Bench, task: Task) -> Outcome:
    fmu, entry = export(bench, task, "container.fmu", fmi=3), task.entry
    times = {"start_time": task.start, "stop_time": task.time(entry.steps), "step_size": entry.step}
    system = ec.System.of({"m": fmu})
    with ec.load(system, **times, output_interval=entry.step).prepare() as simulation:
        result = simulation.run()
    return Outcome({name.removeprefix("m."): result[name] for name in result.names})


def run_c_code(bench: Bench, task: Task) -> Outcome:
    code = Code(export(bench, task, "code.c", "blocks", components=["*"]))
    rows = {signal: list[float]() for signal in code.signals}
    assert code.start(task.start) is None
    for k in range(task.entry.steps + 1):
        for signal, values in rows.items():
            values.append(code.output(signal))
        assert k == task.entry.steps or code.step()
    return Outcome(rows)


# ---- the table -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stepper:
    """A way to do the steps of a task.

    Attributes:
        run: Does them.
        lacks: What it cannot do.
        needs: What a system must have, at least one of these; empty for any system.
        by_default: Systems and algorithms of the default tier, for a stepper that compiles or starts
            processes; None for each system and each algorithm.
    """

    run: Callable[[Bench, Task], Outcome]
    lacks: Collection[str] = ()
    needs: Collection[str] = ()
    by_default: Collection[tuple[str, str]] | None = None


VERSIONS = {"blocks", "scenario", "Model Exchange"}
PARTIAL_RUNS = {"failure", "error control"}
HALVES = {"failure", "free rows", "Model Exchange"}  # integrators restart at each checkpoint
OLD = {
    "lines",
    "data",
    "array loop",
}  # FMI 3.0 has no derivatives of inputs, and dependencies of whole arrays
ONE_FMU = {*PARTIAL_RUNS, "Model Exchange"}

STEPPERS: dict[str, Stepper] = {
    "C": Stepper(run),
    "two threads": Stepper(partial(run, threads=2)),
    "three threads": Stepper(
        partial(run, threads=3), by_default=[("two loops", "strong, lines"), ("lift", "jacobi")]
    ),
    "eight threads": Stepper(
        partial(run, threads=8),
        by_default=[("multirate", "gauss-seidel, lines"), ("discarded steps", "strong, lines")],
    ),
    "profiled": Stepper(
        partial(run, profile=True),
        lacks={"failure", "types of FMI 2.0"},
        by_default=[("multirate", "gauss-seidel")],
    ),
    "every third row": Stepper(
        partial(run_with_few_rows, interval=3), lacks=PARTIAL_RUNS, by_default=[("multirate", "jacobi")]
    ),
    "in parts": Stepper(
        run_in_parts,
        lacks=PARTIAL_RUNS,
        by_default=[("multirate", "strong, lines"), ("discarded steps", "strong, middles")],
    ),
    "checkpoint": Stepper(resume, lacks=HALVES),
    "isolated": Stepper(
        partial(run_isolated, first_alone=False),
        lacks={"grouped"},
        by_default=[("types of FMI 3.0", "gauss-seidel")],
    ),
    "one isolated": Stepper(
        partial(run_isolated, first_alone=True),
        lacks={"grouped"},
        by_default=[("factors, early start", "jacobi, middles"), ("NAN_Y in a line", "gauss-seidel, lines")],
    ),
    "parts of FMI 3.0": Stepper(partial(run, kind=3), lacks=OLD, needs=VERSIONS),
    "parts of both versions": Stepper(partial(run, kind="mixed"), lacks=OLD, needs=VERSIONS),
    # without directional derivatives, which strong coupling uses, and without derivatives of inputs
    "parts of PythonFMU": Stepper(
        partial(run, flavour="python"),
        lacks={"strong", "lines", "data"},
        needs={"scenario"},
        by_default=[("lift, sampled", "jacobi, middles")],
    ),
    "container of FMI 2.0": Stepper(
        partial(run_container, fmi=2), lacks=ONE_FMU, by_default=[("multirate", "strong, lines")]
    ),
    "container of FMI 3.0": Stepper(
        partial(run_container, fmi=3), lacks=ONE_FMU, by_default=[("types of FMI 3.0", "gauss-seidel")]
    ),
    "container of parts of FMI 3.0": Stepper(
        partial(run_container, fmi=3, kind=3), lacks={*ONE_FMU, *OLD}, needs=VERSIONS, by_default=()
    ),
    "container in a system": Stepper(run_container_in_a_system, lacks=ONE_FMU, by_default=()),
    "C code": Stepper(
        run_c_code,
        lacks={
            *ONE_FMU,
            "data",
            "events",
            "strong",
            "extrapolation",
            "multirate",
            "transformations",
            "direct loop",
        },
        needs={"blocks"},
        by_default=[("discrete states", "gauss-seidel")],
    ),
}


def can_step(stepper: str, system: str, algorithm: str) -> bool:
    """Return whether a stepper, a system and an algorithm go together."""
    way, entry, coupling = STEPPERS[stepper], Task(system, algorithm).entry, ALGORITHMS[algorithm]
    has = {*entry.has, *coupling.has}
    lacks = {*way.lacks, *entry.lacks, *coupling.lacks}
    if has >= {"discarded steps", "explicit"} and stepper.startswith("container"):
        return False  # an exported system divides the steps of loops only
    return not has & lacks and (not way.needs or bool(has & set(way.needs)))
