"""A system that is prepared once and run many times."""

import contextlib
import math
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

from ..base.errors import CommandError, RunError, show_paths_relative_to
from ..base.faults import accept_faults
from ..base.files import get_working_folder
from ..base.option import SHARING, SHOWING
from ..base.progress import Progress
from ..base.signal_types import SignalType
from ..base.units import IDENTITY, SiUnit
from ..base.values import convert_value
from ..fmu.variables import convert_start_value
from ..inputs.events import input_events, row_distance
from ..inputs.loaded_input import DataSpan
from ..inputs.stored_runs import StoredRun, open_stored_run
from ..master.algorithms.continuous_connections import list_continuous_connections
from ..master.assembly import Assembly
from ..master.coupling.estimate import ALLOWANCE, SHARE, CouplingError
from ..master.coupling.sampling import Sampling, find_sampling
from ..master.instances.integrator_settings import IntegratorSettings
from ..master.stepping.checkpoint import prepare_checkpoint
from ..master.stepping.fixed_steps import FixedSteps
from ..master.stepping.pacing import Pacing
from ..master.stepping.profiler import Profiler
from ..master.stepping.step_size_control import StepRequest
from ..master.stepping.stepping_base import ROUNDING, Stepping
from ..recorders.checkpoints import Checkpoints, find_resumable_checkpoint
from ..recorders.coupling.bond_energy import select_applicable
from ..recorders.coupling.bonds import COUPLING
from ..recorders.metrics import SIGNALS, MetricsRecorder
from ..recorders.recorder import Outline, Recorder
from ..recorders.table import Table, TimeSeries
from ..stepper.library import find_stepper
from ..system.model import System, Value
from ..system.names import Names
from .agreement import (
    agreement_record,
    compare_with_stored,
    describe_disagreement,
    describe_missing_part,
    find_common_signals,
)
from .coupling_summary import EARLIER_RUN, CouplingSummary
from .execution import Run
from .option_types import RunOptions
from .options import Options, list_options, read_options
from .origin import RunOrigin
from .preparation import limit_to_data_end, prepare_system
from .registered import following_values
from .remarks import (
    choose_fallback_signals,
    describe_disabled_event_mode,
    describe_idle_clocks,
    describe_lost_values,
)
from .requirements import (
    Requirement,
    StopCondition,
    describe_unmet,
    parse_requirement,
    resolve_requirements,
    resolve_stop_conditions,
)
from .result import Result, run_figures
from .run_record import RunDefinition, build_run_record
from .run_setup import (
    describe_interval,
    run_times,
    select_components,
    select_signals,
    steps_per_row,
)
from .stored_margins import read_margins


class Simulation:
    """A system with loaded FMUs and a compiled loop, which can run many times.

    `run` simulates from start to stop. `start`, `advance` and `finish` do the same in parts; between them you
    can read variables and set inputs by name. Each run begins from the same initial state. `close`, or the
    end of a `with` block, frees the FMUs.

    Examples:
        >>> import emla_cosim as ec
        >>> with ec.load("lift", stop_time=0.01).prepare() as simulation:
        ...     simulation.advance(0.005)
        ...     position = simulation["lift.plant.x_L"]
        ...     result = simulation.finish()
        >>> round(position, 2)
        0.24
    """

    def __init__(
        self,
        system: System,
        options: Options | None = None,
        name: str = "system",
        progress: Progress | None = None,
        unpacked: Path | None = None,
        holds: object = None,
        origin: RunOrigin | None = None,
        notes: Callable[[Options], Sequence[str]] | None = None,
        accepted: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Prepare a system.

        Args:
            system: System to prepare.
            options: Options for all runs.
            name: Name for messages and records.
            progress: Receives the progress of preparing.
            unpacked: Folder with the FMUs of a package.
            holds: Object to keep alive as long as the simulation.
            origin: Origin for the records of runs.
            notes: Function that returns the notes on a run with its options.
            accepted: Violations of the standard that were accepted while the system was read, by file.

        Raises:
            CommandError: If an option does not fit the system.
            RunError: If an FMU cannot be built, or rejects its start values.
        """
        self.name = name
        self.options = limit_to_data_end(options or Options())
        self._unpacked, self._holds = unpacked, holds
        self._origin = origin or RunOrigin()
        self._notes = notes or (lambda _: ())
        told = progress or Progress()
        self._here = get_working_folder()  # an FMU may change the working folder
        self._as_made = system
        self._data = [DataSpan.of(s, self.options.start_time or 0.0) for s in self.options.input]
        # report wrong names before anything is built
        apart = select_components(self.options.isolate, system, "--isolate without a name isolates all.")
        with show_paths_relative_to(unpacked), accept_faults(self.options.lenient) as self._faults:
            self._faults.merge(accepted or {})
            prepared = prepare_system(system, self.options, told)
            self.system = prepared.system
            self._assembly = Assembly(self.system, prepared.fmus, apart, self.options.integrate_together)
        self._finalizer = weakref.finalize(self, self._assembly.close)
        self._run: _ActiveRun | None = None
        self._error: RunError | None = None
        self._profiler: Profiler | None = None
        self._is_worn = False  # whether an FMU failed in repeated steps
        self._estimated_key: tuple[Any, ...] = ()  # of the run whose coupling error was estimated last
        self._estimated, self._saved_s = CouplingError(), 0.0
        self._spent: Stepping | None = None  # freed late, because freeing an FMU may fail
        self._turn, self._busy = threading.RLock(), False
        find_stepper()  # which builds it if necessary, so that no run waits for it
        told.advance(1)

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the FMUs, and end the current run."""
        with self._lock_use():
            try:
                self._abandon()
            finally:
                self._finalizer()

    @property
    def names(self) -> list[str]:
        """Names of all signals that are recorded by default: outputs that are no Strings, Reals first."""
        return list(self.units)

    @property
    def further_names(self) -> list[str]:
        """Names of all other variables that the option `signals` can name."""
        return [name for name in self._assembly.unexchanged if name not in self.units]

    def select_signals(self, patterns: Sequence[str]) -> list[str]:
        """Return the signals that patterns of the option `signals` name; without any, all outputs.

        For the main component, or the only one, the name of the variable is enough.

        Raises:
            CommandError: a pattern has no match.
        """
        further = self.further_names if patterns else []
        return select_signals(patterns, self.names, further, self.system.main_name)

    def _complete(self, name: str) -> str:
        """Return the full name of a variable of the main component; other names unchanged."""
        matching = self._names.match(name) if self.system.main_name else []
        return matching[0].full_name if len(matching) == 1 else name

    def _resolve_stop_conditions(self, texts: Sequence[str]) -> list[Requirement]:
        if not texts:
            return []
        signals = (self._names.find(name) for name in (*self.names, *self.further_names))
        units = {signal.full_name: signal.unit for signal in signals if not signal.column_type.is_text}
        return resolve_stop_conditions(texts, units, self.system.main_name)

    def further_units(self) -> dict[str, SiUnit | None]:
        """Return the unit of each of `further_names`; None where the FMU declares none."""
        return {name: self._names.find(name).unit for name in self.further_names}

    @cached_property
    def units(self) -> Mapping[str, SiUnit | None]:
        """Unit of each signal by name; None where the FMU declares none."""
        outputs = self._assembly.list_outputs()
        return {name: self._names.find(name).unit for name in outputs}

    @property
    def _names(self) -> Names:
        return self._assembly.names

    @cached_property
    def _sampling(self) -> Sampling:
        """Which components sample."""
        declared = [c.name for c in self.system.components if c.samples]
        return find_sampling(self._assembly.files, declared)

    def run(
        self,
        *,
        recorders: Sequence[Recorder] | None = None,
        fresh: bool = False,
        **options: Unpack[RunOptions],
    ) -> Result:
        """Simulate from start to stop.

        Ctrl-C ends the run after the current step; the result contains everything until then.

        Args:
            recorders: what keeps the rows. Default: a `TimeSeries`, which keeps the table in memory. Metrics
                are always computed.
            fresh: create new FMU instances instead of resetting them.
            **options: values by name, for this run only, such as `stop_time`, `step_size`, `algorithm` and
                `set`.

        Returns:
            Signals, metrics and the record of the run.

        Raises:
            CommandError: an option does not fit. Nothing was run; the simulation can still be used.
            RunError: the run failed, or a condition of `require` does not hold. `fields["result"]` has the
                results until then.

        Examples:
            >>> import emla_cosim as ec
            >>> simulation = ec.load("lift").prepare()
            >>> result = simulation.run(stop_time=0.01, set={"lift.plant.motor.R_s": 0.2})
            >>> result["lift.plant.x_L"].shape
            (11,)
        """
        with self._lock_use():
            return self._check_complete(self._attempt(recorders, fresh, options))

    def attempt(
        self,
        *,
        recorders: Sequence[Recorder] | None = None,
        fresh: bool = False,
        **options: Unpack[RunOptions],
    ) -> Result:
        """Run as `run` does, but return the result of a failed run instead of raising RunError.

        Args:
            recorders: as for `run`.
            fresh: as for `run`.
            **options: as for `run`.

        Returns:
            The result. Its `problem` is the error message of a failed run, otherwise None.

        Raises:
            CommandError: an option does not fit.
        """
        with self._lock_use():
            return self._attempt(recorders, fresh, options)

    def _attempt(
        self, recorders: Sequence[Recorder] | None, fresh: bool, options: Mapping[str, Any]
    ) -> Result:
        self._start(recorders, fresh, options)
        assert self._run is not None
        with self._abandon_on_error():
            self._run.run.advance(self._run.run.stepping.times.stop)
        return self._ended()

    def so_far(self) -> Result:
        """Return the results of the current run up to now; raise CommandError if there is no run."""
        if self._run is None:
            raise CommandError("there is no current run; call `start` first.")
        return self._result(self._run)

    def start(
        self,
        *,
        recorders: Sequence[Recorder] | None = None,
        fresh: bool = False,
        **options: Unpack[RunOptions],
    ) -> None:
        """Begin a run, which `advance` continues and `finish` ends.

        Args:
            recorders: as for `run`.
            fresh: as for `run`.
            **options: as for `run`.

        Raises:
            CommandError: an option does not fit.
            RunError: an FMU fails during initialization.
        """
        with self._lock_use():
            self._start(recorders, fresh, options)

    def _start(self, recorders: Sequence[Recorder] | None, fresh: bool, options: Mapping[str, Any]) -> None:
        if not self._finalizer.alive:
            raise CommandError("the simulation is closed; prepare it again.")
        values = self._read(options)
        chosen, origin = self.options.merged(values), self._origin.updated(values)
        chosen = replace(chosen, roles={role: self._complete(name) for role, name in chosen.roles.items()})
        notes = self._notes(chosen)
        self._abandon()
        required = [parse_requirement(text) for text in chosen.require]
        stored, start = None, chosen.start_time or 0.0
        if chosen.reference is not None:
            stored = open_stored_run(chosen.reference, start=start)
            notes = [*notes, *stored.notes]
        margins = read_margins(chosen.margins) if chosen.margins is not None else None
        if stored is not None and len(self._as_made.components) == 1:  # inputs and faults add components
            stored = stored.of_component(self._as_made.components[0].name)
        control = chosen.make_step_size_control()
        times = run_times(chosen, self.name)
        for span in self._data:
            span.check_overlap(times.start, times.stop)
        every = steps_per_row(chosen, times)
        pacing = Pacing(chosen.real_time) if chosen.real_time is not None else None
        system = self._with_values({name: chosen.set[name] for name in values.get("set", {})}, chosen)
        algorithm = chosen.make_algorithm()
        assembly = self._assembly
        with show_paths_relative_to(self._unpacked):
            integrator = IntegratorSettings(method=chosen.integrator, largest=chosen.integrator_step)
            assembly.start(
                system, fresh or self._error is not None or self._is_worn, chosen.fmi_tolerance, integrator
            )
        self._error, self._is_worn = None, False
        recorded, fallback = self.select_signals(chosen.signals), None
        conditions = self._resolve_stop_conditions(chosen.stop_when)
        others = assembly.unexchanged
        if not recorded:
            recorded, fallback = choose_fallback_signals(others.values())
        watched = [condition.figure for condition in conditions]
        assembly.observe([n for n in dict.fromkeys([*self.names, *recorded, *watched]) if n in others], every)
        self._profiler = Profiler(assembly.network.instances) if chosen.profile else None
        names = [*assembly.network.names, *assembly.network.observer.names]
        signals = {name: self._names.find(name) for name in names}
        units = {name: signal.unit for name, signal in signals.items()}
        types = {name: signal.column_type for name, signal in signals.items()}
        algorithm.setup(assembly.network)
        sampled = any(c.samples for c in system.components)
        request = StepRequest(
            times,
            chosen.output_interval,
            sampled,
            chosen.threads,
            lambda: input_events(chosen.input, chosen.fault, assembly.parameters(), times.start, times.stop),
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
                    resumed = find_resumable_checkpoint(chosen.resume, identity, times, self._here)
                if chosen.checkpoint is not None:
                    file = prepare_checkpoint(
                        chosen.checkpoint, assembly.network, self._here, chosen.overwrite
                    )
                    taking.append(Checkpoints(file, identity))
            if stored is not None:
                _check_comparable(stored, recorded, taking)
            parameters = assembly.parameters()
            declared = [c.name for c in system.components if c.samples]
            wanted = chosen.estimate_coupling
            coupling = CouplingSummary.of(algorithm, stepping, self._sampling, wanted)
            exchanged = list_continuous_connections(algorithm, declared)
            bonds = select_applicable(system.bonds, names, exchanged)
            place = {name: i for i, name in enumerate(names)}
            outline = Outline(
                names,
                list(units.values()),
                times,
                [place[name] for name in recorded],
                every,
                parameters,
                chosen.roles,
                chosen.criteria,
                exchanged,
                {**bonds, **chosen.read_bonds()},
                watched=not control.is_regular,
                halved=control.is_halved,
                multiples={
                    instance.name: int(multiple)
                    for instance, multiple in zip(
                        assembly.network.instances, algorithm.multiples, strict=True
                    )
                    if multiple > 1
                },
                types={n: t for n, t in types.items() if t.is_discrete and place[n] not in assembly.shown},
                texts=assembly.network.observer.texts,
                notes=stepping.notes(),
            )
            if required:
                before = MetricsRecorder.before(outline)
                if figures := {**coupling.figures(None), **before.get(COUPLING, {})}:
                    before[COUPLING] = figures
                required = resolve_requirements(required, before, run_figures(), system.main_name)
            stops = [
                StopCondition(c, 1 + (i := place[c.figure]), assembly.shown.get(i, IDENTITY))
                for c in conditions
            ]
            run = Run(stepping, outline, taking, assembly.shown, pacing, resumed, stops, self._profiler)
            stepping.watch = metrics.watcher(assembly.shown)
        except BaseException:
            _close_stepping(stepping)
            raise
        self._run = _ActiveRun(
            run,
            definition,
            origin,
            metrics,
            taking,
            every,
            required,
            stored,
            notes,
            units,
            outline.types,
            coupling,
            fallback=fallback,
            margins=margins,
        )
        with self._abandon_on_error():
            # the states in a checkpoint would limit a continued run to the stop time of this run
            run.begin(times.stop if times.steps and chosen.checkpoint is None else None)

    def advance(self, time: float) -> None:
        """Simulate up to a time. Without `start`, this begins a run with the options of the simulation.

        If an FMU or a condition of `stop_when` ends the run before that time, `time` stays where it ended,
        `so_far().early_end` says why, and the next call raises CommandError.

        Args:
            time: communication point to reach, in s.

        Raises:
            CommandError: the time is not a communication point, it is after the stop time, or an earlier call
                has ended the run before it.
            RunError: a step failed.
            KeyboardInterrupt: Ctrl-C was pressed. The run can continue or be finished.
        """
        with self._lock_use():
            interrupted = self._advance(time)
        if interrupted:
            raise KeyboardInterrupt

    def _advance(self, time: float) -> bool:
        """Advance as `advance` does, and return whether Ctrl-C interrupted it."""
        if self._run is None:
            self._start(None, False, {})
        assert self._run is not None
        times = self._run.run.stepping.times
        time = convert_value(time, float, "the time to advance to")
        if isinstance(self._run.run.stepping, FixedSteps):
            ahead = (time - times.start) / times.step
            if not math.isfinite(ahead) or abs(ahead - round(ahead)) > ROUNDING * max(1.0, abs(ahead) * 1e-3):
                raise CommandError(
                    f"t = {time:.9g} s is no communication point; the step size is {times.step:g} s.",
                    time=time,
                )
        if time > times.stop + ROUNDING * times.step:
            raise CommandError(
                f"t = {time:.9g} s is after the stop time {times.stop:g} s; start with a later stop_time.",
                time=time,
            )
        if (ended := self._run.run.early_end) is not None and not self._run.run.stepping.reached(time):
            raise CommandError(f"{ended.rstrip('.')}. It cannot continue; call `finish`.", time=time)
        with self._abandon_on_error():
            self._run.run.advance(time)
        if self._run.run.error is not None:
            self._finish()
        return self._run is not None and self._run.run.interrupted

    def finish(self) -> Result:
        """End the current run.

        Returns:
            The result up to the time that was reached.

        Raises:
            CommandError: there is no current run.
            RunError: as for `run`.
        """
        with self._lock_use():
            return self._finish()

    def _finish(self) -> Result:
        if self._run is None:
            raise CommandError("there is no current run; call `run`, or `start` and `advance`.")
        return self._check_complete(self._ended())

    def _check_complete(self, result: Result) -> Result:
        """Return a result, or raise the error of its run with the result in `fields`."""
        if (error := self._error) is not None:
            error.fields["result"] = result
            raise error
        return result

    @property
    def time(self) -> float:
        """Time of the current run in s; the start time if there is no run."""
        if self._run is None:
            return self.options.start_time or 0.0
        return self._run.run.stepping.time

    @property
    def stepping(self) -> Stepping:
        """What does the steps of the current run; raise CommandError if there is no run."""
        if self._run is None:
            raise CommandError("there is no current run; call `start` first.")
        return self._run.run.stepping

    def __getitem__(self, name: str) -> Any:
        """Return the current value of a variable, in its unit.

        Without a current run, this begins one.

        Args:
            name: full name, `component.variable`.

        Raises:
            CommandError: the variable does not exist.
        """
        with self._lock_to_thread():
            return self._value(name)

    def _value(self, name: str) -> Any:
        if self._run is None:
            self.start()
        found = self._names.find(name)
        value = self._assembly.instances[found.component.name].value(found.variable)
        to_fmu = found.component.alias(found.name).transformation
        return to_fmu.inverse()(value) if to_fmu != IDENTITY else value

    def __setitem__(self, name: str, value: Any) -> None:
        """Set an input that has no connection. It keeps the value until you set it again.

        Without a current run, this begins one.

        Args:
            name: full name, `component.variable`.
            value: value in the unit of the variable.

        Raises:
            CommandError: the variable does not exist, is not an unconnected input, or the value does not fit.
        """
        with self._lock_to_thread():
            self._set(name, value)

    def _set(self, name: str, value: Any) -> None:
        if self._run is None:
            self.start()
        target = self._names.find(name)
        if target.variable.causality != "input":
            raise CommandError(
                f"{name} cannot be set during a run: it is not an input. Set start values with `set`."
            )
        self._names.resolve(name)
        if isinstance(stepping := self.stepping, FixedSteps):
            stepping.note_change()
        component = target.component
        to_fmu = component.alias(target.name).transformation
        given = to_fmu(float(value)) if component.aliases else value
        instance = self._assembly.instances[component.name]
        instance.set_value(
            target.variable,
            convert_start_value(component.name, instance.file.interface, target.variable, given),
        )

    @contextlib.contextmanager
    def _lock_use(self) -> Iterator[None]:
        """Reserve the FMUs. Raise CommandError if another thread or a recorder uses them."""
        with self._lock_to_thread():
            if self._busy:
                raise CommandError("the simulation is running; a recorder cannot run, end or close it.")
            self._busy = True
            try:
                yield
            finally:
                self._busy = False

    @contextlib.contextmanager
    def _lock_to_thread(self) -> Iterator[None]:
        """Exclude other threads. Raise CommandError if one uses the FMUs."""
        if not self._turn.acquire(blocking=False):
            raise CommandError("another thread uses this simulation; prepare one simulation for each thread.")
        try:
            yield
        finally:
            self._turn.release()

    def _read(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Read the options of a run. Raise CommandError for options that only `prepare` accepts."""
        known = list_options() if given else {}
        for option in (known[name] for name in given if name in known):
            if option.is_prepared:
                raise CommandError(
                    f"the option '{option.name}' cannot change between runs; pass it to `prepare`."
                )
            if option.stage == SHOWING:
                raise CommandError(
                    f"the option '{option.name}' is for the command line; use `save` of the result."
                )
            if option.stage == SHARING:
                raise CommandError(f"the option '{option.name}' is for sweeps, comparisons and tunings.")
        return read_options(given)

    def _with_values(self, values: Mapping[str, Value], chosen: Options) -> System:
        """Return the system with further start values, and the values that follow from them."""
        followers = following_values(self._as_made, chosen) if values else {}
        return self.system.with_parameters(self._names.start_values(values) | followers)

    def _ended(self) -> Result:
        """End the current run and return its result. Store the error of a failed run in `_error`."""
        assert self._run is not None
        going = self._run
        with self._abandon_on_error():
            going.run.end()
        self._run = None
        result = self._result(going, self._estimate_coupling(going))
        self._spent = going.run.stepping
        self._error = going.run.error
        if self._error is None:
            result = _compare_with_stored(going, result)
            if (problem := _describe_unmet(going, result)) is not None:
                self._error = RunError(problem)
                result = replace(result, problem=problem, record={**result.record, "status": problem})
        return result

    def _estimate_coupling(self, going: "_ActiveRun") -> CouplingError:
        """Return the coupling error of a run that has ended. Its FMUs cannot be used afterwards."""
        run, stepping = going.run, going.run.stepping
        estimate = stepping.estimate if isinstance(stepping, FixedSteps) else None
        if estimate is None or run.error is not None or run.interrupted or run.requested_end is not None:
            return going.coupling.without_estimate()
        key = str(stepping.algorithm), stepping.times, going.definition.system, run.steps
        if key == self._estimated_key:
            return self._estimated
        share = SHARE * run.wall_s
        # preparing a first run with such steps takes far longer; the runs that follow save up their shares
        allowed = share + (ALLOWANCE if key[:2] != self._estimated_key[:2] else self._saved_s)
        self._saved_s = 0.0 if allowed >= ALLOWANCE else allowed
        if allowed < ALLOWANCE:
            return CouplingError(not_estimated=EARLIER_RUN)
        with self._abandon_on_error():
            found = estimate.estimate(allowed, run.wall_s / max(run.steps, 1))
        self._is_worn, self._estimated_key, self._estimated = found.is_fault, key, found
        return found

    def _abandon(self) -> None:
        """End the current run if there is one, and free the resources of the last one."""
        if self._run is not None:
            self._ended()
        if self._spent is not None:
            _close_stepping(self._spent)
            self._spent = None
        if self._profiler is not None:  # of a run that could not begin
            self._profiler.close()
            self._profiler = None

    @contextlib.contextmanager
    def _abandon_on_error(self) -> Iterator[None]:
        """Abandon the run and end its recorders if an error is raised that is no failure of the run."""
        try:
            yield
        except BaseException:
            going, self._run = self._run, None
            if going is not None:
                self._spent = going.run.stepping
                self._error = RunError("the run was abandoned")  # makes the next run use new instances
                going.run.abandon()
            raise

    def _held_data(self, start: float, end: float, step: float) -> list[str]:
        """Return remarks on data of inputs that do not cover a run from its start to its end, in s."""
        return [text for span in self._data if (text := span.describe_held(start, end, step)) is not None]

    def _result(self, going: "_ActiveRun", error: CouplingError | None = None) -> Result:
        figures, error = going.coupling.figures(error), error or going.coupling.without_estimate()
        run, stepping = going.run, going.run.stepping
        if run.problem is not None:
            going.metrics.ended_early(run.problem)
        elif run.early_end is not None:
            going.metrics.ended_early(run.early_end)
        report, units, types = stepping.report(), going.units, going.types
        record = build_run_record(
            self.name,
            going.origin,
            going.definition,
            self._assembly,
            stepping.times,
            going.every,
            units,
            types,
            report,
            run.problem,
            self._unpacked,
        )
        record["accepted_faults"] = self._faults.shown(self._unpacked)
        if run.stopped is not None:
            condition, at = run.stopped
            record["stopped_when"] = {"condition": str(condition), "time_s": at}
        if run.requested_end is not None:
            component = run.requested_end.fields["component"]
            record["requested_end"] = {"component": component, "time_s": stepping.time}
        record["remarks"] = [
            *([] if run.early_end is None else [run.early_end]),
            *self._faults.remarks(self._unpacked),
            *describe_disabled_event_mode(self.system),
            *describe_lost_values(record),
            *describe_idle_clocks(self._assembly.idle_clocks),
            *(f"{text}." for text in self._assembly.violations),
            *([] if going.fallback is None else [going.fallback]),
            *describe_interval(going.definition.options, stepping.times),
            *self._held_data(stepping.times.start, stepping.time, stepping.times.step),
            *going.metrics.remarks(),
            *going.coupling.remarks(error),
            *stepping.remarks(),
        ]
        record["coupling"] = going.coupling.record(error)
        if going.margins is not None:
            record["margins"] = going.margins
        profile = run.profile()
        if profile is not None:
            record["profile"] = profile
        return Result(
            name=self.name,
            units=units,
            types=types,
            times=stepping.times,
            table=next((r for r in going.recorders if isinstance(r, Table)), None),
            metrics=going.metrics.figures(),
            shown={name: kind.shown for name, kind in going.metrics.kinds.items()},
            remarks=record["remarks"],
            steps=run.steps,
            simulated_s=run.simulated_s,
            end_s=stepping.time,
            wall_s=run.wall_s,
            stepping=report,
            pacing=run.pacing.report() if run.pacing is not None else None,
            problem=run.problem,
            interrupted=run.interrupted,
            stopped_when=None if run.stopped is None else str(run.stopped[0]),
            early_end=run.early_end,
            discrete=frozenset(name for name in units if self._names.find(name).is_discrete),
            record=record,
            parameters=self._assembly.parameters(),
            signals=going.metrics.signals(),
            coupling={**figures, **going.metrics.coupling()},
            roles=going.definition.options.roles,
            notes=going.notes,
            profile=profile,
        )


@dataclass(frozen=True)
class _ActiveRun:
    """The current run, and what its result needs."""

    run: Run
    definition: RunDefinition
    origin: RunOrigin
    metrics: MetricsRecorder
    recorders: Sequence[Recorder]
    every: int
    required: Sequence[Requirement]
    stored: StoredRun | None
    notes: Sequence[str]
    units: Mapping[str, SiUnit | None]
    types: Mapping[str, SignalType]
    coupling: CouplingSummary
    fallback: str | None
    margins: Mapping[str, Any] | None


def _recorders(given: Any) -> list[Recorder]:
    """Return the recorders as a list. Raise CommandError for other objects and duplicates."""
    if isinstance(given, Recorder) or not isinstance(given, Iterable):
        raise CommandError(f"the recorders are {given!r}; they must be a list.")
    found = list(given)
    if wrong := [r for r in found if not isinstance(r, Recorder)]:
        raise CommandError(f"{wrong[0]!r} is no Recorder.")
    if len({id(r) for r in found}) < len(found):
        raise CommandError("the list of recorders has a recorder twice.")
    return found


def _check_comparable(stored: StoredRun, names: Sequence[str], recorders: Iterable[Recorder]) -> None:
    """Raise CommandError if there will be nothing to compare with a stored run."""
    find_common_signals(names, stored)
    if not any(isinstance(r, Table) for r in recorders):
        raise CommandError("the option 'reference' needs a recorder that keeps a table, such as TimeSeries.")


def _compare_with_stored(going: _ActiveRun, result: Result) -> Result:
    """Return the result with its comparisons to the stored run, if there is one."""
    if going.stored is None or result.interrupted:
        return result
    tolerance = going.definition.options.tolerance
    found = compare_with_stored(
        result.names, result.read, result.units, going.stored, tolerance, result.discrete, result.types
    )
    record = {**result.record, "reference": agreement_record(found, going.stored)}
    return replace(result, comparisons=found, record=record)


def _describe_unmet(going: _ActiveRun, result: Result) -> str | None:
    """Return a message on requirements that are not met, or None."""
    wanted = [str(r) for r in going.required]
    if going.stored is not None:
        wanted.append(f"it agrees with '{going.stored.path}'")
    if going.run.interrupted and wanted:
        return (
            f"interrupted at t = {result.end_s:.6g} s, before these requirements could be checked: "
            f"{'; '.join(wanted)}."
        )
    figures = {**result.metrics, COUPLING: result.coupling, SIGNALS: result.signals}
    found = [describe_unmet(going.required, figures, result.run_figures)]
    if going.stored is not None:
        found.append(describe_disagreement(result.comparisons, going.stored))
        if going.run.requested_end is not None:
            found.append(describe_missing_part(result.end_s, result.times.step, going.stored))
    return " ".join(filter(None, found)) or None


def _close_stepping(stepping: Stepping) -> None:
    stepping.close()
    stepping.algorithm.close()
