"""What a scenario is: a system, and how it is run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ...base.errors import CommandError, called_as_in
from ...base.progress import Progress
from ...ssp.writer.writing import Experiment, check_package, write_ssp
from ...system.model import System
from ..experiment import run_times
from ..options import Options, read_options, table
from ..origin import Origin
from ..preparation import prepared, until_data_end
from ..simulation import Simulation


@dataclass(frozen=True)
class Scenario:
    """A system and how it is run.

    `notes` are sentences, without their stops, that the user should read before a run: on what was read but
    means nothing, and what `remarks` say of the system with these options. FMUs of a package are in the
    folder `unpacked` as long as the scenario, or a simulation of it, lives. `origin` is what was named
    and given to make it.
    """

    name: str
    description: str
    system: System
    options: Options = field(default_factory=Options)
    notes: Sequence[str] = ()
    unpacked: Path | None = field(default=None, compare=False)
    holds: object = field(default=None, compare=False, repr=False)
    origin: Origin = field(default_factory=Origin, compare=False, repr=False)
    remarks: Callable[[System, Options], Sequence[str]] | None = field(
        default=None, compare=False, repr=False
    )

    def with_options(self, given: Mapping[str, Any]) -> "Scenario":
        """Return the scenario with other options, by name, and with the notes that belong to them.

        Raises CommandError for options that its system was made of, and for what cannot be run with these.
        """
        if not given:
            return self
        for name, option in table().items():
            if name in given and option.about.makes:
                raise CommandError(
                    f"the system of '{self.name}' is made already; give {name} where a scenario is loaded.",
                    option=name,
                )
        values = read_options(given)
        options = self.options.merged(values)
        notes = self.notes_with(options)
        return replace(self, options=options, notes=notes, origin=self.origin.updated(values))

    def notes_with(self, options: Options) -> Sequence[str]:
        """Return the notes on a run with these options; CommandError for what cannot be run."""
        return self.notes if self.remarks is None else tuple(self.remarks(self.system, options))

    def prepare(self, progress: Progress | None = None, **options: Any) -> Simulation:
        """Build and load all FMUs and compile the loop, so that it can be run many times.

        `options` are those of `Options`, by name. Raises CommandError for what does not fit,
        RunError where FMUs cannot be built.
        """
        chosen = self.with_options(options)
        return Simulation(
            self.system,
            chosen.options,
            self.name,
            progress,
            self.unpacked,
            self.holds,
            chosen.origin,
            self.notes_with,
        )

    def export(
        self, file: str | Path, nested: bool = False, progress: Progress | None = None, **options: Any
    ) -> Path:
        """Write the system, with all that the options change, and its FMUs as an SSP package.

        `nested` makes one system of all components with the same first part of their names. A file that is
        no package of ours is only replaced with the option `overwrite`. Raises CommandError for what does not
        fit, RunError where something cannot be built or written.
        """
        chosen = until_data_end(self.with_options(options).options)
        check_package(Path(file), chosen.overwrite)
        told = progress or Progress()
        times = run_times(chosen, self.name)
        experiment = Experiment(times.start, times.stop, times.step)
        with called_as_in(self.unpacked):
            system, fmus = prepared(self.system, chosen, told)
            system = replace(system, bonds={**system.bonds, **chosen.read_bonds()})
            write_ssp(
                Path(file), self.name, self.description, system, fmus, experiment, nested, chosen.overwrite
            )
        told.advance(1)
        return Path(file)
