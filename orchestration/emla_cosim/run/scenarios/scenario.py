"""A scenario: a system with the options to run it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

from fmublock.platforms import host_platform

from ...base.errors import CommandError, show_paths_relative_to
from ...base.extras import require_extra
from ...base.faults import accept_faults
from ...base.progress import Progress
from ...recorders.metrics import TRACKED
from ...system.model import System, render_cell
from ..option_types import RunOptions
from ..options import Options, list_options, read_options
from ..origin import RunOrigin
from ..preparation import limit_to_data_end, prepare_system
from ..registered import list_roles
from ..remarks import describe_disabled_event_mode, describe_lost_values
from ..run_setup import describe_times, run_times
from ..simulation import Simulation

SSP, FMU, C = ".ssp", ".fmu", ".c"
"""Ends of names; a file with another end is an SSP."""

NAMES = {SSP: "an SSP", FMU: "an FMU", C: "a C file"}
"""What messages call them."""

_STEPPED = ("algorithm", "extrapolation", "step_multiples", "order", "coupling_tolerance")
_ASKED_FOR = ("no_event_mode", "fmi", "inputs", "outputs", "components", "precision", "platform")
"""Options whose value was asked for if it is not the default, also in a scenario file: all of exports only,
and one that would silently change results."""

_NOT_IN = {
    SSP: (*_STEPPED, "no_event_mode", "fmi", "inputs", "outputs", "components", "precision"),
    FMU: ("components", "precision"),
    C: ("no_event_mode", "fmi", "inputs", "platform"),
}


@dataclass(frozen=True)
class Scenario:
    """A system, and the options to run it with. `load` makes one.

    Attributes:
        name: name of the scenario.
        description: one line on its purpose.
        system: the simulated system.
        options: values of all options.
        notes: warnings to read before a run, without full stops.
        unpacked: folder with the FMUs of an SSP. It exists as long as the scenario, or a simulation of it.
        resources: object that keeps the folder in existence.
        origin: source and options that made the scenario.
        remarks: function that computes further notes from a system and its options.
        accepted: violations of the standard that were accepted while reading, by file.

    Examples:
        >>> import emla_cosim as ec
        >>> scenario = ec.load("lift")
        >>> [component.name for component in scenario.system.components][:2]
        ['lift.reference', 'lift.plant']
    """

    name: str
    description: str
    system: System
    options: Options = field(default_factory=Options)
    notes: Sequence[str] = ()
    unpacked: Path | None = field(default=None, compare=False)
    resources: object = field(default=None, compare=False, repr=False)
    origin: RunOrigin = field(default_factory=RunOrigin, compare=False, repr=False)
    remarks: Callable[[System, Options], Sequence[str]] | None = field(
        default=None, compare=False, repr=False
    )
    accepted: Mapping[str, Sequence[str]] = field(default_factory=dict, compare=False, repr=False)

    def __repr__(self) -> str:
        """Return one line: name, number of components and description."""
        return f"<Scenario {self.name}: {len(self.system.components)} components; {self.description}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: description, times, notes and system."""
        return render_cell(self.system, self.name, self.description, describe_times(self.options), self.notes)

    def with_options(self, overrides: Mapping[str, Any]) -> "Scenario":
        """Return the scenario with other options, and with the notes that belong to them.

        Args:
            overrides: values by name, as for `load`.

        Raises:
            CommandError: an option does not fit, or it decides how the system is made, such as `controller`.
        """
        if not overrides:
            return self
        for name, option in list_options().items():
            if name in overrides and option.makes:
                raise CommandError(
                    f"the system of '{self.name}' exists already; set {name} when you load the scenario.",
                    option=name,
                )
        values = read_options(overrides)
        options = self.options.merged(values)
        notes = self.notes_with(options)
        return replace(self, options=options, notes=notes, origin=self.origin.updated(values))

    def notes_with(self, options: Options) -> Sequence[str]:
        """Return the notes on a run with these options. Raise CommandError if the system cannot be run."""
        notes = self.notes if self.remarks is None else self.remarks(self.system, options)
        return tuple(dict.fromkeys((*notes, *options.overridden_notes())))

    def prepare(self, progress: Progress | None = None, **options: Unpack[RunOptions]) -> Simulation:
        """Build and load all FMUs and compile the loop, so that the scenario can run many times.

        Args:
            progress: receives the progress of building FMUs.
            **options: values by name, for all runs of the simulation.

        Returns:
            The simulation. Close it, or use it in a `with` block, to free its FMUs.

        Raises:
            CommandError: options, connections or units do not fit.
            RunError: an FMU cannot be built or refuses its start values.

        Examples:
            >>> import emla_cosim as ec
            >>> with ec.load("lift").prepare(stop_time=0.01) as simulation:
            ...     result = simulation.run()
            >>> result.steps
            100
        """
        scenario = self.with_options(options)
        return Simulation(
            self.system,
            scenario.options,
            self.name,
            progress,
            self.unpacked,
            self.resources,
            scenario.origin,
            self.notes_with,
            self.accepted,
        )

    def export(
        self, file: str | Path, progress: Progress | None = None, **options: Unpack[RunOptions]
    ) -> Path:
        """Write the system as an SSP, as one FMU, or components as plain C, with all changes by the options.

        The FMU steps the components as a run of the scenario does; see docs/containers.md. A C file has a
        header beside it; see docs/c-code.md.

        Args:
            file: path, which ends in .ssp, .fmu or .c.
            progress: receives the progress of building FMUs.
            **options: values by name. With `overwrite`, a file that emla did not write is replaced.

        Returns:
            The path of the file.

        Raises:
            CommandError: an option does not fit the system or the file, or a file must not be replaced.
            RunError: an FMU cannot be built, or the file cannot be written.

        Examples:
            >>> import emla_cosim as ec
            >>> ec.load("lift").export("lift.ssp").name
            'lift.ssp'
        """
        # an exported system has no data that could end it
        limited_options = limit_to_data_end(self.with_options(options).options)
        kind = find_kind(Path(file))
        refuse_unsuited(kind, _list_explicit_options(limited_options))
        if kind != SSP:
            require_extra("build", f"writing a file '*{kind}'")
        # before FMUs are built, which takes minutes
        if kind == FMU:
            from ...container.writer import check_container

            check_container(Path(file), limited_options.overwrite)
        elif kind == C:
            from ...c_code.writer import check_code

            check_code(Path(file), limited_options.overwrite)
        else:
            from ...ssp.writer.package_writer import check_package

            check_package(Path(file), limited_options.overwrite)
        progress = progress or Progress()
        times = run_times(limited_options, self.name)
        with show_paths_relative_to(self.unpacked), accept_faults(limited_options.lenient) as faults:
            faults.merge(self.accepted)
            built = limited_options
            if kind != SSP and built.platform:
                # this machine starts the FMUs to read their initial values
                built = replace(built, platform=sorted({*built.platform, host_platform()}))
            prepared = prepare_system(self.system, built, progress)
            system, fmus = prepared.system, prepared.fmus
            system = replace(system, bonds={**system.bonds, **limited_options.read_bonds()})
            if kind == FMU:
                progress.advance(1)  # compiling is another task
                self._write_fmu(Path(file), system, fmus, limited_options, progress)
            elif kind == C:
                from ...c_code.writer import write_code

                progress.advance(1)
                write_code(
                    Path(file),
                    system,
                    fmus,
                    limited_options.components,
                    limited_options.make_algorithm(),
                    times,
                    limited_options.outputs,
                    limited_options.precision,
                    limited_options.overwrite,
                )
            else:
                from ...ssp.writer.package_writer import SystemTimes, write_ssp

                experiment = SystemTimes(times.start, times.stop, times.step)
                write_ssp(
                    Path(file),
                    self.name,
                    self.description,
                    system,
                    fmus,
                    experiment,
                    limited_options.overwrite,
                )
                progress.advance(1)
        for remark in (*describe_disabled_event_mode(system), *faults.remarks(self.unpacked)):
            progress.note(f"Note: {remark}")
        return Path(file)

    def _write_fmu(
        self, file: Path, system: System, fmus: Mapping[str, Path], options: Options, progress: Progress
    ) -> None:
        """Write the prepared system as one FMU, and show remarks on start values that FMUs did not take."""
        from ...container.writer import write_container

        if not options.make_step_size_control().is_regular:
            raise CommandError("an FMU of a system has steps of one size; remove the error tolerance.")
        rejected_values = write_container(
            file,
            self.name,
            self.description,
            system,
            fmus,
            options.make_algorithm(),
            run_times(options, self.name),
            options.inputs,
            options.outputs,
            lambda names: _list_tracked(names, list_roles(self.system, options)),
            options.platform,
            options.fmi,
            options.overwrite,
            progress,
        )
        for remark in describe_lost_values(
            {"components": {c: {"not_taken": v} for c, v in rejected_values.items()}}
        ):
            progress.note(f"Note: {remark}")


def _list_tracked(names: Collection[str], roles: Mapping[str, str]) -> list[str]:
    """Return the signals that are compared with a reference, and the references."""
    pairs = [pair for find in TRACKED.values() for pair in find(names, roles).values()]
    return [signal for pair in pairs for signal in pair]


def find_kind(file: Path) -> str:
    """Return the kind of a file by its ending; any other ending means an SSP."""
    end = file.suffix.lower()
    return end if end in NAMES else SSP


def refuse_unsuited(kind: str, options: Collection[str]) -> None:
    """Raise CommandError if an option is set that a kind of file has no place for."""
    if unsuited := [name for name in _NOT_IN[kind] if name in options]:
        flag = list_options()[unsuited[0]].flag
        ends = [end for end, names in _NOT_IN.items() if unsuited[0] not in names]
        raise CommandError(
            f"{NAMES[kind]} cannot hold {flag}; leave it out, or export to a file that ends in "
            f"{' or '.join(ends)}."
        )


def _list_explicit_options(options: Options) -> list[str]:
    """Return the options of `_ASKED_FOR` that differ from their defaults."""
    defaults = Options()
    return [name for name in _ASKED_FOR if getattr(options, name) not in (getattr(defaults, name), False)]
