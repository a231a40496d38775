"""A system prepared once and run many times: what every run in this project goes through."""

import contextlib
import math
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ..base.errors import CommandError, RunError, called_as_in
from ..base.files import present_folder
from ..base.option import SHOWING
from ..base.progress import Progress
from ..base.units import Unit
from ..base.values import converted
from ..fmu.variables import find_variable, start_value
from ..inputs.events import input_events, row_distance
from ..master.algorithms.exchanged import list_exchanged
from ..master.assembly import Assembly
from ..master.stepping.checkpoint import checkpoint_place
from ..master.stepping.compilation import compile_kernel
from ..master.stepping.fixed_steps import FixedSteps
from ..master.stepping.pacing import Pacing
from ..master.stepping.step_size_control import StepRequest
from ..master.stepping.stepping import ROUNDING, Stepping
from ..recorders.checkpoints import Checkpoints, resumable
from ..recorders.coupling.bond_energy import applicable
from ..recorders.coupling.coupling import COUPLING
from ..recorders.metrics import SIGNALS, MetricsRecorder
from ..recorders.recorder import Outline, Recorder
from ..recorders.stored import StoredRun, stored_run
from ..recorders.table import Table
from ..recorders.time_series import TimeSeries
from ..system.model import System, Value
from ..system.start_values import start_values
from .agreement import agreement, agreement_record, common, disagreement
from .experiment import isolated, run_times, selected, steps_per_row
from .followers import following_values
from .options import Options, read_options, table
from .origin import Origin
from .preparation import prepared, until_data_end
from .requirements import Requirement, check_requirements, requirement, unmet
from .result import Result, run_figures
from .run_record import RunDefinition, run_record
from .running import Run


class Simulation:
    """A system whose FMUs are built, loaded and wired, and whose loop is compiled.

    `run` runs it from start to stop; `start`, `advance` and `finish` do the same in parts, and between
    them values can be read and set by name: `simulation["lift.plant.x_L"]`. Every run begins anew, with
    other options if any are given. `close` frees the FMUs; so does the end of a `with` block, and the end
    of the object.
    """

    def __init__(
        self,
        system: System,
        options: Options | None = None,
        name: str = "system",
        progress: Progress | None = None,
        unpacked: Path | None = None,
        holds: object = None,
        origin: Origin | None = None,
        notes: Callable[[Options], Sequence[str]] | None = None,
    ) -> None:
        """Prepare a system with these options.

        FMUs of a package are in the folder `unpacked`; `holds` is what must live as long as this. `origin`
        is told by the records of runs. `notes` computes those on a run with its options.

        Raises CommandError for what does not fit, RunError where FMUs cannot be built or refuse their
        start values.
        """
        self.name = name
        self.options = until_data_end(options or Options())
        self._unpacked, self._holds = unpacked, holds
        self._origin = origin or Origin()
        self._notes = notes or (lambda _: ())
        told = progress or Progress()
        self._here = present_folder()  # an FMU may go elsewhere
        self._as_made = system
        apart = isolated(self.options.isolated, system)  # a wrong name is told before anything is built
        with called_as_in(unpacked):
            self.system, fmus = prepared(system, self.options, told)
            self._assembly = Assembly(self.system, fmus, apart)
        self._finalizer = weakref.finalize(self, self._assembly.close)
        self._run: _Going | None = None
        self._error: RunError | None = None
        self._spent: Stepping | None = None  # freed late: an FMU may fail even there
        self._turn, self._busy = threading.RLock(), False
        if self.options.compiled:
            self._compile()
        told.advance(1)

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the FMUs and what was unpacked; a run that goes on is ended."""
        with self._alone():
            try:
                self._abandon()
            finally:
                self._finalizer()

    @property
    def names(self) -> list[str]:
        """Names of all signals: component.variable."""
        return list(self._assembly.network.names)

    @cached_property
    def units(self) -> Mapping[str, Unit | None]:
        """The unit of every signal, by name."""
        found = {}
        for name in self._assembly.network.names:
            component, variable = self.system.split(name)
            alias = component.aliases.get(variable)
            interface = self._assembly.files[component.name].interface
            found[name] = alias.unit if alias is not None else interface.unit(variable)
        return found

    def run(
        self, *, recorders: Sequence[Recorder] | None = None, fresh: bool = False, **options: Any
    ) -> Result:
        """Run from start to stop and return what came out.

        `options` are those of `Options`, by name, and hold for this run only: `stop_time`, `step_size`,
        `algorithm`, `set` ... Without `recorders`, the table of results is kept in memory; metrics are
        always computed. `fresh` makes new instances of the FMUs instead of resetting them. Ctrl-C ends
        the run between two steps, and the result has what was computed. Raises CommandError for options
        that do not fit; RunError, whose `fields` have the `result` so far, for a run that fails, or whose
        figures are not as `require` says.
        """
        with self._alone():
            return self._whole(self._attempt(recorders, fresh, options))

    def attempt(
        self, *, recorders: Sequence[Recorder] | None = None, fresh: bool = False, **options: Any
    ) -> Result:
        """`run`, but a run that fails is a result too: its `problem` says why it ended."""
        with self._alone():
            return self._attempt(recorders, fresh, options)

    def _attempt(
        self, recorders: Sequence[Recorder] | None, fresh: bool, options: Mapping[str, Any]
    ) -> Result:
        self._start(recorders, fresh, options)
        assert self._run is not None
        with self._abandoning_on_error():
            self._run.run.advance(self._run.run.stepping.times.stop)
        return self._ended()

    def so_far(self) -> Result:
        """What came out of the run that goes on; CommandError where none does."""
        if self._run is None:
            raise CommandError("no run goes on; `start` begins one.")
        return self._result(self._run)

    def start(
        self, *, recorders: Sequence[Recorder] | None = None, fresh: bool = False, **options: Any
    ) -> None:
        """Begin a run that `advance` brings forward; what is given is as in `run`."""
        with self._alone():
            self._start(recorders, fresh, options)

    def _start(self, recorders: Sequence[Recorder] | None, fresh: bool, options: Mapping[str, Any]) -> None:
        if not self._finalizer.alive:
            raise CommandError("the simulation is closed; prepare it anew.")
        values = self._read(options)
        chosen, origin = self.options.merged(values), self._origin.updated(values)
        notes = self._notes(chosen)
        self._abandon()
        required = [requirement(text) for text in chosen.require]
        stored = stored_run(chosen.reference) if chosen.reference is not None else None
        control = chosen.make_step_size_control()
        times = run_times(chosen, self.name)
        every = steps_per_row(chosen, times)
        pacing = Pacing(chosen.real_time) if chosen.real_time is not None else None
        system = self._with_values({name: chosen.set[name] for name in values.get("set", {})}, chosen)
        algorithm = chosen.make_algorithm()
        assembly = self._assembly
        with called_as_in(self._unpacked):
            assembly.start(system, fresh or self._error is not None)
        self._error = None
        recorded = selected(chosen.signals, assembly.network.names)
        algorithm.setup(assembly.network)
        sampled = any(c.samples for c in system.components)
        request = StepRequest(
            times,
            chosen.output_interval,
            sampled,
            chosen.compiled,
            chosen.threads,
            lambda: input_events(chosen.input, chosen.fault, assembly.parameters(), times.stop),
            lambda: row_distance(chosen.input),
        )
        stepping = control.stepping(algorithm, request)
        try:
            fmus = {name: file.sha256 for name, file in assembly.files.items()}
            definition = RunDefinition(system, fmus, chosen)
            metrics, resumed = MetricsRecorder(), None
            taking = [metrics, *([TimeSeries()] if recorders is None else _recorders(recorders))]
            taking += chosen.make_recorders()
            if chosen.resume or chosen.checkpoint:
                identity = definition.checkpoint_identity
                if chosen.resume is not None:
                    resumed = resumable(chosen.resume, identity, times, self._here)
                if chosen.checkpoint is not None:
                    place = checkpoint_place(
                        chosen.checkpoint, assembly.network, self._here, chosen.overwrite
                    )
                    taking.append(Checkpoints(chosen.checkpoint, identity, place))
            if stored is not None:
                _check_comparable(stored, [assembly.network.names[i] for i in recorded], taking)
            units, parameters = list(self.units.values()), assembly.parameters()
            exchanged = list_exchanged(algorithm, [c.name for c in system.components if c.samples])
            bonds = applicable(system.bonds, assembly.network.names, exchanged)
            outline = Outline(
                assembly.network.names,
                units,
                times,
                recorded,
                every,
                parameters,
                chosen.roles,
                chosen.criteria,
                exchanged,
                {**bonds, **chosen.read_bonds()},
                watched=not control.is_regular,
                halved=control.is_halved,
            )
            if required:
                check_requirements(required, MetricsRecorder.before(outline), run_figures())
            run = Run(stepping, outline, taking, assembly.shown, pacing, resumed)
            stepping.watch = metrics.watcher(assembly.shown)
        except BaseException:
            _freed(stepping)
            raise
        self._run = _Going(run, definition, origin, metrics, taking, every, required, stored, notes)
        with self._abandoning_on_error():
            # the states in a checkpoint would hold a continued run to this run's stop time
            run.begin(times.stop if chosen.checkpoint is None else None)

    def advance(self, time: float) -> None:
        """Step to a time in s, which must be a communication point; begins a run if none goes on.

        Raises CommandError for another time, RunError where a step fails, and KeyboardInterrupt for
        Ctrl-C, after the step that was being done: the run can go on then, or be finished.
        """
        with self._alone():
            interrupted = self._advance(time)
        if interrupted:
            raise KeyboardInterrupt

    def _advance(self, time: float) -> bool:
        """See `advance`; whether Ctrl-C ended it."""
        if self._run is None:
            self._start(None, False, {})
        assert self._run is not None
        times = self._run.run.stepping.times
        time = converted(time, float, "the time to advance to")
        if isinstance(self._run.run.stepping, FixedSteps):
            ahead = (time - times.start) / times.step
            if not math.isfinite(ahead) or abs(ahead - round(ahead)) > ROUNDING * max(1.0, abs(ahead) * 1e-3):
                raise CommandError(
                    f"t = {time:.9g} s is no communication point: steps have {times.step:g} s.", time=time
                )
        if time > times.stop + ROUNDING * times.step:
            raise CommandError(
                f"t = {time:.9g} s is beyond the stop time {times.stop:g} s; start with a later stop_time.",
                time=time,
            )
        with self._abandoning_on_error():
            self._run.run.advance(time)
        if self._run.run.error is not None:
            self._finish()
        return self._run is not None and self._run.run.interrupted

    def finish(self) -> Result:
        """End the run that goes on, and return what came out; see `run` for errors."""
        with self._alone():
            return self._finish()

    def _finish(self) -> Result:
        if self._run is None:
            raise CommandError("no run goes on; `run`, or `start` and `advance`, begin one.")
        return self._whole(self._ended())

    def _whole(self, result: Result) -> Result:
        """A result, but for that of a run that failed: RunError that has it."""
        if (error := self._error) is not None:
            error.fields["result"] = result
            raise error
        return result

    @property
    def time(self) -> float:
        """Where the run is, in s; its start before it begins."""
        if self._run is None:
            return self.options.start_time or 0.0
        return self._run.run.stepping.time

    def __getitem__(self, name: str) -> Any:
        """The present value of a variable, by its full name and in its unit there.

        Begins a run if none goes on. Raises CommandError for a name that is not there.
        """
        with self._here_only():
            return self._value(name)

    def _value(self, name: str) -> Any:
        if self._run is None:
            self.start()
        component, variable = self.system.split(name)
        alias = component.alias(variable)
        slave = self._assembly.slaves[component.name]
        value = slave.value(find_variable(component.name, slave.file.variables, alias.variable))
        return alias.transformation.inverse()(value) if component.aliases else value

    def __setitem__(self, name: str, value: Any) -> None:
        """Set an input that nothing drives; it holds until it is set again.

        Begins a run if none goes on. Raises CommandError for other variables and for values that do not fit.
        """
        with self._here_only():
            self._set(name, value)

    def _set(self, name: str, value: Any) -> None:
        if self._run is None:
            self.start()
        component, variable = self.system.split(name)
        alias = component.alias(variable)
        slave = self._assembly.slaves[component.name]
        found = find_variable(component.name, slave.file.variables, alias.variable)
        driver = next((x for x in self.system.into(component.name) if x.input == found.name), None)
        if driver is not None:
            raise CommandError(f"{name} cannot be set: it is driven by {driver.source}.{driver.output}.")
        if found.causality != "input":
            raise CommandError(
                f"{name} cannot be set while a run goes on: it is no input. Give start values in `set`."
            )
        given = alias.transformation(float(value)) if component.aliases else value
        slave.set_value(found, start_value(component.name, slave.file.interface, found, given))

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Nothing else uses the FMUs meanwhile; CommandError where another thread or a recorder does."""
        with self._here_only():
            if self._busy:
                raise CommandError("the simulation is running; a recorder cannot run, end or close it.")
            self._busy = True
            try:
                yield
            finally:
                self._busy = False

    @contextlib.contextmanager
    def _here_only(self) -> Iterator[None]:
        """No other thread uses the FMUs meanwhile; CommandError where one does."""
        if not self._turn.acquire(blocking=False):
            raise CommandError("another thread uses this simulation; prepare one for each thread.")
        try:
            yield
        finally:
            self._turn.release()

    def _read(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Read the options of a run; CommandError for one that was needed to prepare."""
        known = table() if given else {}
        for option in (known[name] for name in given if name in known):
            if option.is_prepared:
                raise CommandError(
                    f"the option '{option.name}' belongs to what is prepared; give it to `prepare`."
                )
            if option.about.stage == SHOWING:
                raise CommandError(
                    f"the option '{option.name}' is for the command line; use `save` of the result."
                )
        return read_options(given)

    def _with_values(self, values: Mapping[str, Value], chosen: Options) -> System:
        """The system with further start values, and what follows from them with the options of a run."""
        interfaces = {name: file.interface for name, file in self._assembly.files.items()}
        followers = following_values(self._as_made, chosen) if values else {}
        return self.system.with_parameters(start_values(self.system, interfaces, values) | followers)

    def _compile(self) -> None:
        """Compile the loop, or load what was compiled, so that no run has to wait for it."""
        with contextlib.suppress(CommandError):  # a run says what is wrong with its algorithm
            algorithm = self.options.make_algorithm()
            algorithm.setup(self._assembly.network)
            compile_kernel(algorithm)
            algorithm.close()

    def _ended(self) -> Result:
        """End the run that goes on; `_error` is then what made it fail, if anything did."""
        assert self._run is not None
        going = self._run
        with self._abandoning_on_error():
            going.run.end()
        self._run = None
        result = self._result(going)
        self._spent = going.run.stepping
        self._error = going.run.error
        if self._error is None:
            result = _compared(going, result)
            if (problem := _unmet(going, result)) is not None:
                self._error = RunError(problem)
                result = replace(result, problem=problem, record={**result.record, "status": problem})
        return result

    def _abandon(self) -> None:
        """End the run that goes on, if one does, and free what the last one used."""
        if self._run is not None:
            self._ended()
        if self._spent is not None:
            _freed(self._spent)
            self._spent = None

    @contextlib.contextmanager
    def _abandoning_on_error(self) -> Iterator[None]:
        """Where something raises what is no failure of a run, no run goes on, and its recorders are ended."""
        try:
            yield
        except BaseException:
            going, self._run = self._run, None
            if going is not None:
                self._spent = going.run.stepping
                self._error = RunError("the run was left")  # so that the next one trusts no instance
                going.run.abandon()
            raise

    def _result(self, going: "_Going") -> Result:
        run, stepping = going.run, going.run.stepping
        if run.problem is not None:
            going.metrics.ended_early(run.problem)
        report, units = stepping.report(), self.units
        record = run_record(
            self.name,
            going.origin,
            going.definition,
            self._assembly,
            stepping.times,
            going.every,
            units,
            report,
            run.problem,
            self._unpacked,
        )
        return Result(
            name=self.name,
            units=units,
            times=stepping.times,
            table=next((r for r in going.recorders if isinstance(r, Table)), None),
            metrics=going.metrics.figures(),
            shown={name: kind.shown for name, kind in going.metrics.kinds.items()},
            remarks=[*going.metrics.remarks(), *stepping.remarks()],
            steps=run.steps,
            simulated_s=run.simulated_s,
            end_s=stepping.time,
            wall_s=run.wall_s,
            stepping=report,
            pacing=run.pacing.report() if run.pacing is not None else None,
            problem=run.problem,
            interrupted=run.interrupted,
            record=record,
            parameters=self._assembly.parameters(),
            signals=going.metrics.signals(),
            coupling=going.metrics.coupling(),
            roles=going.definition.options.roles,
            notes=going.notes,
        )


@dataclass(frozen=True)
class _Going:
    """A run that goes on, and what its result needs."""

    run: Run
    definition: RunDefinition
    origin: Origin
    metrics: MetricsRecorder
    recorders: Sequence[Recorder]
    every: int
    required: Sequence[Requirement]
    stored: StoredRun | None
    notes: Sequence[str]


def _recorders(given: Any) -> list[Recorder]:
    """What was handed in as recorders; CommandError for anything else, and for one that is there twice."""
    if isinstance(given, Recorder) or not isinstance(given, Iterable):
        raise CommandError(f"the recorders are {given!r}; they must be a list.")
    found = list(given)
    if wrong := [r for r in found if not isinstance(r, Recorder)]:
        raise CommandError(f"{wrong[0]!r} is no Recorder.")
    if len({id(r) for r in found}) < len(found):
        raise CommandError("a recorder is handed in twice; it would take every row twice.")
    return found


def _check_comparable(stored: StoredRun, names: Sequence[str], recorders: Iterable[Recorder]) -> None:
    """Raise CommandError where nothing will be there to be held against a run that was kept."""
    common(names, stored)
    if not any(isinstance(r, Table) for r in recorders):
        raise CommandError("the option 'reference' needs a recorder that keeps a table, such as TimeSeries.")


def _compared(going: _Going, result: Result) -> Result:
    """The result of a whole run with its signals beside those of the one that it is held against."""
    if going.stored is None or result.interrupted:
        return result
    found = agreement(
        result.names, result.read, result.units, going.stored, going.definition.options.tolerance
    )
    record = {**result.record, "reference": agreement_record(found, going.stored)}
    return replace(result, comparisons=found, record=record)


def _unmet(going: _Going, result: Result) -> str | None:
    """The sentence that says what is not as required; None where everything is."""
    wanted = [str(r) for r in going.required]
    if going.stored is not None:
        wanted.append(f"it agrees with '{going.stored.path}'")
    if going.run.interrupted and wanted:
        return (
            f"interrupted at t = {result.end_s:.6g} s, before it could be judged whether {'; '.join(wanted)}."
        )
    figures = {**result.metrics, COUPLING: result.coupling, SIGNALS: result.signals}
    found = [unmet(going.required, figures, result.run_figures)]
    if going.stored is not None:
        found.append(disagreement(result.comparisons, going.stored))
    return " ".join(filter(None, found)) or None


def _freed(stepping: Stepping) -> None:
    stepping.close()
    stepping.algorithm.close()
