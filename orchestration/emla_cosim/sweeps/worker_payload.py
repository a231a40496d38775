"""What travels to the workers, once: FMUs by their content, and the systems that are made of them."""

import copyreg
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import cloudpickle

from ..base.errors import CommandError, show_paths_relative_to
from ..base.files import hash_file
from ..base.option import BUILDING, LEFT_OUT, PREPARING, options_of
from ..base.progress import Progress
from ..fmu.interface import Interface, read_interfaces
from ..master.algorithms.registry import ALGORITHMS
from ..master.stepping.registry import STEP_SIZE_CONTROLS
from ..recorders.metrics import METRICS
from ..run.options import Options
from ..run.preparation import limit_to_data_end, prepare_system
from ..run.run_record import RunDefinition
from ..run.scenarios.scenario import Scenario
from ..system.model import System


def _by_name(module: ModuleType) -> tuple[Any, tuple[str]]:
    return import_module, (module.__name__,)


if (_kind := type(sys.modules[__name__.partition(".")[0]])) is not ModuleType:
    copyreg.pickle(_kind, _by_name)  # of lazy_loader; else no function that uses the package could travel


@dataclass(frozen=True)
class Preparation:
    """A scenario whose FMUs are built and whose components are what the options make them.

    `fmus` has the content hash of every component's FMU, `interfaces` what it shows of itself.
    """

    name: str
    system: System
    options: Options
    fmus: Mapping[str, str]
    interfaces: Mapping[str, Interface]
    files: Mapping[str, Path]
    resources: object = None
    """What has to live for the files to be there."""
    read: Mapping[Path, str] = field(default_factory=dict)
    """What else was read, and what it is."""
    scenario: Scenario | None = None
    """What it was prepared of."""

    @classmethod
    def of(cls, scenario: Scenario, progress: Progress | None = None) -> "Preparation":
        """Build what is missing, and read what is there; raises as `Scenario.prepare`."""
        options, told = limit_to_data_end(scenario.options), progress or Progress()
        with show_paths_relative_to(scenario.unpacked):
            system, fmus = prepare_system(scenario.system, options, told)
            hashes = {path: hash_file(path) for path in dict.fromkeys(fmus.values())}
            interfaces = read_interfaces(fmus)
        told.advance(1)
        usual, known = Options(), options_of(Options)
        done = {o.name for o in known if o.about.stage in (BUILDING, PREPARING)}
        if not options.follow_models:
            done.add("set")  # else it tells a variant what must not follow from its own values
        done |= {o.name for o in known if o.about.in_sweep == LEFT_OUT}
        return cls(
            scenario.name,
            system,
            replace(options, **{name: getattr(usual, name) for name in done}),
            {name: hashes[path] for name, path in fmus.items()},
            interfaces,
            {hashes[path]: path for path in hashes},
            scenario.resources,
            options.files_read(),
            scenario,
        )

    @property
    def identity(self) -> dict[str, Any]:
        """All that decides what a run gives, as plain data."""
        return RunDefinition(self.system, self.fmus, self.options).variants_identity


@dataclass(frozen=True)
class PackedPreparation:
    """A `Preparation` as it travels; `system` has no FMUs, `fmus` has them by content hash."""

    name: str
    system: System
    options: Options
    fmus: Mapping[str, str]

    def unpack_system(self, files: Mapping[str, Path]) -> System:
        """The system with the FMUs' files, given by content hash."""
        return replace(
            self.system,
            components=tuple(replace(c, fmu=files[self.fmus[c.name]]) for c in self.system.components),
        )


REGISTRIES: Mapping[str, dict[str, Any]] = {
    "metric": METRICS,
    "algorithm": ALGORITHMS,
    "step-size control": STEP_SIZE_CONTROLS,
}
"""What users register and workers need, by what messages call it."""


@dataclass(frozen=True)
class WorkerPayload:
    """All that workers need; `files` has name and content of FMU files by their hash.

    `registered` has what is in `REGISTRIES`: users register their own.
    """

    key: str
    packed: Sequence[PackedPreparation]
    files: Mapping[str, tuple[str, bytes]]
    registered: Mapping[str, Mapping[str, Any]]
    version: str

    @classmethod
    def of(cls, key: str, preparations: Sequence[Preparation]) -> "WorkerPayload":
        """Everything that these preparations need; `key` names it on the workers."""
        paths = {sha: path for p in preparations for sha, path in p.files.items()}
        return cls(
            key,
            [PackedPreparation(p.name, _remove_files(p.system), p.options, p.fmus) for p in preparations],
            {sha: (path.name, path.read_bytes()) for sha, path in paths.items()},
            {kind: dict(known) for kind, known in REGISTRIES.items()},
            version("emla-cosim"),
        )


def check_portable(kind: str, objects: Mapping[str, Any]) -> None:
    """Raise CommandError for one of these, by name, that cannot be sent to another process."""
    for name, one in objects.items():
        try:
            cloudpickle.dumps(one)
        except Exception as error:
            raise CommandError(f"the {kind} '{name}' cannot be sent to workers: {error}.") from error


def _remove_files(system: System) -> System:
    return replace(system, components=tuple(replace(c, model="", fmu=None) for c in system.components))
