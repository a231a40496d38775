"""The data sent to the workers once: FMUs by their content, and the systems that use them."""

import copyreg
import dataclasses
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import cloudpickle

from ...base.errors import CommandError, show_paths_relative_to
from ...base.faults import accept_faults
from ...base.files import hash_file
from ...base.option import BUILDING, LEFT_OUT, PREPARING, options_of
from ...base.progress import Progress
from ...fmu.interface import Interface
from ...inputs.loaded_input import DataSpan
from ...master.algorithms.registry import ALGORITHMS
from ...master.stepping.step_size_control import STEP_SIZE_CONTROLS
from ...recorders.metrics import METRICS
from ...recorders.registry import RECORDERS
from ...run.options import Options
from ...run.preparation import limit_to_data_end, prepare_system
from ...run.remarks import describe_disabled_event_mode
from ...run.run_record import RunDefinition
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ...system.model import System

if (_kind := type(sys.modules[__name__.partition(".")[0]])) is not ModuleType:
    # lazy_loader's module type; else functions that use it cannot be sent
    copyreg.pickle(_kind, lambda module: (import_module, (module.__name__,)))


def _find_sentinel_name(sentinel: object) -> str:
    """Return the name of an object of `dataclasses`, by which it is pickled."""
    return next(name for name, value in vars(dataclasses).items() if value is sentinel)


for _sentinel in ("MISSING", "KW_ONLY", "_FIELD", "_HAS_DEFAULT_FACTORY"):
    # dataclasses compare these by identity, but cloudpickle copies them with a class that a script defines
    copyreg.pickle(type(getattr(dataclasses, _sentinel)), _find_sentinel_name)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Preparation:
    """A scenario with built FMUs and components as its options define them.

    `fmus` has the content hash of every component's FMU, `interfaces` its variables and units.
    """

    name: str
    system: System
    options: Options
    fmus: Mapping[str, str]
    interfaces: Mapping[str, Interface]
    files: Mapping[str, Path]
    resources: object = None
    """Objects that keep the files alive."""
    read: Mapping[Path, str] = field(default_factory=dict)
    """Other files that were read, with their descriptions."""
    scenario: Scenario | None = None
    """The scenario that was prepared."""

    @classmethod
    def of(cls, scenario: Scenario, progress: Progress | None = None) -> "Preparation":
        """Prepare a scenario: check its data, build missing FMUs, read interfaces, and report notes.

        Errors are those of `Scenario.prepare`.
        """
        options, progress = limit_to_data_end(scenario.options), progress or Progress()
        with show_paths_relative_to(scenario.unpacked), accept_faults(options.lenient) as faults:
            faults.merge(scenario.accepted)
            constant_inputs = list[str]()
            for source in options.input:
                times = run_times(options, scenario.name)
                span = DataSpan.of(source, times.start)
                span.check_overlap(times.start, times.stop)
                constant_inputs += filter(None, [span.describe_held(times.start, times.stop, times.step)])
            prepared = prepare_system(scenario.system, options, progress)
            hashes = {path: hash_file(path) for path in dict.fromkeys(prepared.fmus.values())}
        for remark in (
            *describe_disabled_event_mode(prepared.system),
            *constant_inputs,
            *faults.remarks(scenario.unpacked),
        ):
            progress.note(f"Note: {remark}")
        progress.advance(1)
        # what the preparation has used must not be part of the identity of a run
        defaults, options_of_runs = Options(), options_of(Options)
        reset = {o.name for o in options_of_runs if o.stage in (BUILDING, PREPARING)}
        if not options.follow_models:
            reset.add("set")  # else it tells a variant which parameters must not follow its own values
        reset |= {o.name for o in options_of_runs if o.in_sweep == LEFT_OUT}
        return cls(
            scenario.name,
            prepared.system,
            replace(options, **{name: getattr(defaults, name) for name in reset}),
            {name: hashes[path] for name, path in prepared.fmus.items()},
            prepared.interfaces,
            {hashes[path]: path for path in hashes},
            scenario.resources,
            options.files_read(),
            scenario,
        )

    def system_with(self, files: Mapping[str, Path]) -> System:
        """Return the system with FMU files, which `files` has by content hash."""
        components = [replace(c, model="", fmu=files[self.fmus[c.name]]) for c in self.system.components]
        return replace(self.system, components=tuple(components))

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that determines the result of a run, as plain data."""
        return RunDefinition(self.system, self.fmus, self.options).variants_identity


REGISTRIES: Mapping[str, dict[str, Any]] = {
    "metric": METRICS,
    "algorithm": ALGORITHMS,
    "step-size control": STEP_SIZE_CONTROLS,
    "recorder": RECORDERS,
}
"""Registries that users extend and workers need, by their names in messages."""


@dataclass(frozen=True)
class WorkerPayload:
    """What processes need to run the variants of an analysis.

    Attributes:
        key: Name of the analysis on a cluster.
        files: Paths of FMU files, relative to a folder, with their contents.
        content: By group: name, system with these paths, and options; and `REGISTRIES`. Pickled.
        timeouts: Longest time of a variant in s by group; None without a limit.
        patience: Seconds to wait for a cluster without workers.
    """

    key: str
    files: Mapping[str, bytes]
    content: bytes
    timeouts: Sequence[float | None]
    patience: float

    @classmethod
    def of(cls, key: str, preparations: Sequence[Preparation]) -> "WorkerPayload":
        """Return the payload of these preparations.

        Raises:
            CommandError: A registered object cannot be sent to another process.
        """
        for kind, entries in REGISTRIES.items():
            check_portable(kind, entries)
        files = {sha: path for p in preparations for sha, path in p.files.items()}
        names = {sha: Path(sha[:16], path.name) for sha, path in files.items()}
        groups = [(p.name, p.system_with(names), p.options) for p in preparations]
        return cls(
            key,
            {names[sha].as_posix(): path.read_bytes() for sha, path in files.items()},
            cloudpickle.dumps((groups, REGISTRIES)),
            [p.options.timeout for p in preparations],
            max(p.options.patience for p in preparations),
        )


def check_portable(kind: str, objects: Mapping[str, Any]) -> None:
    """Raise CommandError if one of these objects cannot be sent to another process."""
    for name, value in objects.items():
        try:
            cloudpickle.dumps(value)
        except Exception as error:
            raise CommandError(f"the {kind} '{name}' cannot be sent to workers: {error}.") from error
