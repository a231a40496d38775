"""A system that is prepared once and run many times."""

import contextlib
import math
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

from ..base.errors import CommandError, RunError, show_paths_relative_to
from ..base.faults import accept_faults
from ..base.files import get_working_folder
from ..base.option import SHARING, SHOWING
from ..base.progress import Progress
from ..base.units import IDENTITY, SiUnit
from ..base.values import convert_value
from ..fmu.cvode import IntegratorSettings
from ..fmu.variables import convert_start_value
from ..inputs.loaded_input import DataSpan
from ..master.assembly import Assembly
from ..master.coupling.estimate import CouplingError
from ..master.instances.in_process_instance import is_unusable
from ..master.stepping.step_size_control import FixedSteps
from ..master.stepping.stepping_base import ROUNDING, Stepping
from ..recorders.metrics import default_roles
from ..recorders.recorder import Recorder
from ..stepper.library import require_stepper
from ..system.model import System, count_parts, render_cell
from .execution import ActiveRun, CouplingEstimates
from .option_types import RunOptions
from .options import Options, list_options, read_options
from .origin import RunOrigin
from .outcome import build_result, check_result
from .preparation import limit_to_data_end, prepare_system
from .registered import following_values
from .requirements import Requirement, resolve_stop_conditions
from .result import Result
from .run_setup import describe_times, plan_run, select_components, select_signals
from .wiring import wire_run


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
        resources: object = None,
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
            resources: Object to keep alive as long as the simulation.
            origin: Origin for the records of runs.
            notes: Function that returns the notes on a run with its options.
            accepted: Violations of the standard that were accepted while the system was read, by file.

        Raises:
            CommandError: If an option does not fit the system.
            RunError: If an FMU cannot be built, or rejects its start values.
        """
        self.name = name
        self.options = limit_to_data_end(options or Options())
        self._unpacked, self._resources = unpacked, resources
        self._origin = origin or RunOrigin()
        self._notes = notes or (lambda _: ())
        progress = progress or Progress()
        self._working_folder = get_working_folder()  # an FMU may change the working folder
        self._initial_system = system
        self._data = [DataSpan.of(s, self.options.start_time or 0.0) for s in self.options.input]
        # report wrong names before anything is built
        isolated = select_components(self.options.isolate, system, "--isolate without a name isolates all.")
        with show_paths_relative_to(unpacked), accept_faults(self.options.lenient) as self._faults:
            self._faults.merge(accepted or {})
            prepared = prepare_system(system, self.options, progress)
            self.system = prepared.system
            self._assembly = Assembly(self.system, prepared.fmus, isolated, self.options.integrate_together)
        # frees the FMUs of a simulation that is not closed
        self._finalizer = weakref.finalize(self, self._assembly.close)
        self._run: ActiveRun | None = None
        self._last_run: ActiveRun | None = None  # freed late, because freeing an FMU may fail
        self._needs_new_instances = False
        self._coupling_estimates = CouplingEstimates()
        self._lock, self._is_in_use = threading.RLock(), False
        require_stepper()  # which builds it if necessary, so that no run waits for it
        progress.advance(1)

    def __repr__(self) -> str:
        """Return one line: name, system, times, and whether it is closed."""
        state = "" if self._finalizer.alive else "closed "
        facts = [*count_parts(self.system), *describe_times(self.options)]
        return f"<{state}Simulation of {self.name}: {', '.join(facts)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: times, and the system with its inputs and faults."""
        return render_cell(self.system, f"Simulation of {self.name}", facts=describe_times(self.options))

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the FMUs, and end the current run."""
        with self._reserve():
            try:
                self._discard_run()
            finally:
                self._finalizer()

    @property
    def is_unusable(self) -> bool:
        """Whether an FMU returned fmi2Fatal. Then this cannot run again; another simulation can."""
        return any(map(is_unusable, self._assembly.files.values()))

    @property
    def names(self) -> list[str]:
        """Names of all signals that are recorded by default: outputs that are no Strings, Reals first."""
        return list(self._assembly.outputs)

    @property
    def further_names(self) -> list[str]:
        """Names of all other variables that the option `signals` can name."""
        return [name for name in self._assembly.unconnected_variables if name not in self.units]

    def select_signals(self, patterns: Sequence[str]) -> list[str]:
        """Return the signals that patterns of the option `signals` name; without any, all outputs.

        For the main component, or the only one, the name of the variable is enough.

        Raises:
            CommandError: a pattern has no match.
        """
        further = self.further_names if patterns else []
        return select_signals(patterns, self.names, further, self.system.main_name)

    def _complete_name(self, name: str) -> str:
        """Return the full name of a variable of the main component; other names unchanged."""
        matching = self._assembly.names.match(name) if self.system.main_name else []
        return matching[0].full_name if len(matching) == 1 else name

    @cached_property
    def _default_roles(self) -> dict[str, str]:
        """Roles that follow from the system, without those whose signal was replaced."""
        roles = default_roles(map(str, self._initial_system.connections))
        names = set(self.names)
        return {role: name for role, name in roles.items() if name in names}

    def _resolve_stop_conditions(self, texts: Sequence[str]) -> list[Requirement]:
        if not texts:
            return []
        signals = (self._assembly.names.find(name) for name in (*self.names, *self.further_names))
        units = {signal.full_name: signal.unit for signal in signals if not signal.column_type.is_text}
        return resolve_stop_conditions(texts, units, self.system.main_name)

    def further_units(self) -> dict[str, SiUnit | None]:
        """Return the unit of each of `further_names`; None if the FMU declares none."""
        return {name: self._assembly.names.find(name).unit for name in self.further_names}

    @cached_property
    def units(self) -> Mapping[str, SiUnit | None]:
        """Unit of each signal by name; None if the FMU declares none."""
        return {name: self._assembly.names.find(name).unit for name in self._assembly.outputs}

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
        with self._reserve():
            return _require_success(*self._run_to_end(recorders, fresh, options))

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
        with self._reserve():
            return self._run_to_end(recorders, fresh, options)[0]

    def _run_to_end(
        self, recorders: Sequence[Recorder] | None, fresh: bool, options: Mapping[str, Any]
    ) -> tuple[Result, RunError | None]:
        """Run from start to stop. Return the result, and the error if it failed or misses a requirement."""
        run = self._start(recorders, fresh, options)
        with self._discard_on_error():
            run.advance(run.plan.times.stop)
        return self._end()

    def so_far(self) -> Result:
        """Return the results of the current run up to now; raise CommandError if there is no run."""
        if self._run is None:
            raise CommandError("there is no current run; call `start` first.")
        return self._build_result(self._run)

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
        with self._reserve():
            self._start(recorders, fresh, options)

    def _start(
        self, recorders: Sequence[Recorder] | None, fresh: bool, options: Mapping[str, Any]
    ) -> ActiveRun:
        """Begin a run as `start` does, and return it."""
        if not self._finalizer.alive:
            raise CommandError("the simulation is closed; prepare it again.")
        values = self._read_options(options)
        run_options = self.options.merged(values)
        # of the main component, the name of a variable is enough
        roles = {role: self._complete_name(name) for role, name in run_options.roles.items()}
        run_options = replace(run_options, roles=self._default_roles | roles)
        plan = replace(
            plan_run(run_options, self.name, self._notes(run_options)),
            origin=self._origin.updated(values),
            recorded=self.select_signals(run_options.signals),
            conditions=self._resolve_stop_conditions(run_options.stop_when),
        )
        if plan.stored is not None and len(self._initial_system.components) == 1:
            only = self._initial_system.components[0].name  # inputs and faults add components
            plan = replace(plan, stored=plan.stored.of_component(only))
        for span in self._data:
            span.check_overlap(plan.times.start, plan.times.stop)
        # only now: a wrong option must not end the current run
        self._discard_run()
        # the system has those of the simulation already
        changes = {name: run_options.set[name] for name in values.get("set", {})}
        followers = following_values(self._initial_system, run_options) if changes else {}
        system = self.system.with_parameters(self._assembly.names.start_values(changes) | followers)
        with show_paths_relative_to(self._unpacked):
            integrator = IntegratorSettings(
                method=run_options.integrator, largest=run_options.integrator_step
            )
            is_fresh = fresh or self._needs_new_instances
            self._assembly.start(system, is_fresh, run_options.fmi_tolerance, integrator)
        self._needs_new_instances = False
        self._run = wire_run(plan, system, self._assembly, recorders, self._working_folder)
        with self._discard_on_error():
            self._run.begin()
        return self._run

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
        with self._reserve():
            interrupted = self._advance(time)
        if interrupted:
            raise KeyboardInterrupt

    def _advance(self, time: float) -> bool:
        """Advance as `advance` does, and return whether Ctrl-C interrupted it."""
        run = self._run or self._start(None, False, {})
        time = convert_value(time, float, "the time to advance to")
        times = run.plan.times
        if isinstance(run.stepping, FixedSteps):
            steps = (time - times.start) / times.step
            if not math.isfinite(steps) or abs(steps - round(steps)) > ROUNDING * max(1.0, abs(steps) * 1e-3):
                raise CommandError(
                    f"t = {time:.9g} s is not a communication point; the step size is {times.step:g} s.",
                    time=time,
                )
        if time > times.stop + ROUNDING * times.step:
            raise CommandError(
                f"t = {time:.9g} s is after the stop time {times.stop:g} s; start with a later stop_time.",
                time=time,
            )
        if (end := run.early_end) is not None and not run.stepping.reached(time):
            raise CommandError(f"{end.rstrip('.')}. It cannot continue; call `finish`.", time=time)
        with self._discard_on_error():
            run.advance(time)
        if run.error is not None:
            _require_success(*self._end())
        return run.interrupted

    def finish(self) -> Result:
        """End the current run.

        Returns:
            The result up to the time that was reached.

        Raises:
            CommandError: there is no current run.
            RunError: as for `run`.
        """
        with self._reserve():
            if self._run is None:
                raise CommandError("there is no current run; call `run`, or `start` and `advance`.")
            return _require_success(*self._end())

    @property
    def time(self) -> float:
        """Time of the current run in s; the start time if there is no run."""
        if self._run is None:
            return self.options.start_time or 0.0
        return self._run.stepping.time

    @property
    def stepping(self) -> Stepping:
        """What does the steps of the current run; raise CommandError if there is no run."""
        if self._run is None:
            raise CommandError("there is no current run; call `start` first.")
        return self._run.stepping

    def __getitem__(self, name: str) -> Any:
        """Return the current value of a variable, in its unit.

        Without a current run, this begins one.

        Args:
            name: full name, `component.variable`.

        Raises:
            CommandError: the variable does not exist.
        """
        with self._reserve(during_run=True):
            if self._run is None:
                self.start()
            variable = self._assembly.names.find(name)
            value = self._assembly.instances[variable.component.name].value(variable.variable)
            to_fmu = variable.component.alias(variable.name).transformation
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
        with self._reserve(during_run=True):
            if self._run is None:
                self.start()
            target = self._assembly.names.find(name)
            if target.variable.causality != "input":
                raise CommandError(
                    f"{name} cannot be set during a run: it is not an input. Set start values with `set`."
                )
            self._assembly.names.resolve(name)
            if isinstance(stepping := self.stepping, FixedSteps):
                stepping.note_change()
            component = target.component
            instance = self._assembly.instances[component.name]
            in_fmu = component.alias(target.name).transformation(float(value)) if component.aliases else value
            interface = instance.file.interface
            typed = convert_start_value(component.name, interface, target.variable, in_fmu)
            instance.set_value(target.variable, typed)

    @contextlib.contextmanager
    def _reserve(self, during_run: bool = False) -> Iterator[None]:
        """Reserve the FMUs.

        Args:
            during_run: Whether a recorder may call this during a run.

        Raises:
            CommandError: Another thread, or a recorder, uses the FMUs.
        """
        if not self._lock.acquire(blocking=False):
            raise CommandError("another thread uses this simulation; prepare one simulation for each thread.")
        is_in_use = self._is_in_use
        try:
            if is_in_use and not during_run:
                raise CommandError("the simulation is running; a recorder cannot run, end or close it.")
            self._is_in_use = is_in_use or not during_run
            yield
        finally:
            self._is_in_use = is_in_use
            self._lock.release()

    def _read_options(self, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Read the options of a run. Raise CommandError for options that only `prepare` accepts."""
        options = list_options() if values else {}
        for option in (options[name] for name in values if name in options):
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
        return read_options(values)

    def _end(self) -> tuple[Result, RunError | None]:
        """End the current run. Return its result, and its error if it failed or misses a requirement."""
        run = self._run
        assert run is not None
        with self._discard_on_error():
            run.end()
        self._run, self._last_run = None, run
        # it may step the FMUs again, in which one can fail
        with self._discard_on_error():
            error = self._coupling_estimates.estimate(run)
        self._needs_new_instances = run.error is not None or self._coupling_estimates.has_failed
        return check_result(run, self._build_result(run, error))

    def _build_result(self, run: ActiveRun, error: CouplingError | None = None) -> Result:
        return build_result(self.name, run, self._assembly, self._faults, self._data, self._unpacked, error)

    def _discard_run(self) -> None:
        """End the current run if there is one, and free the resources of the last one."""
        if self._run is not None:
            self._end()
        if self._last_run is not None:
            self._last_run.close()
            self._last_run = None

    @contextlib.contextmanager
    def _discard_on_error(self) -> Iterator[None]:
        """Discard the run and end its recorders if an error is raised that is not a failure of the run."""
        try:
            yield
        except BaseException:
            run, self._run = self._run, None
            if run is not None:
                self._last_run, self._needs_new_instances = run, True
                run.discard()
            raise


def _require_success(result: Result, error: RunError | None) -> Result:
    """Return a result, or raise the error of its run with the result in `fields`."""
    if error is not None:
        error.fields["result"] = result
        raise error
    return result
