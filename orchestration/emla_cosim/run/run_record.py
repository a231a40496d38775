"""Write run.json, which has everything needed to repeat a run, and the identity of checkpoints."""

import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ..base.arrays import COLUMN_TYPES, write_types
from ..base.files import hash_if_readable
from ..base.option import FileOrObject, Option
from ..master.algorithms.algorithm import Algorithm
from ..master.assembly import Assembly
from ..recorders.recorder import RunLayout
from ..system.model import System
from .options import Options, list_options
from .origin import RunOrigin
from .run_setup import RunPlan

PYTHON = "python"
"""Key for an object that only Python can make; the value is the name of its class."""

COMPLETED = "completed"
"""Status of a run that reached its stop time."""

_PACKAGES = ("emla-cosim", "fmpy", "numpy", "casadi", "ziglang", "pythonfmu")


@dataclass(frozen=True)
class RunDefinition:
    """Everything that determines a run's result. `fmus` has the content hash of every component's FMU.

    run.json, checkpoints and the records of many runs contain parts of it, under names of their own.
    """

    system: System
    fmus: Mapping[str, str]
    options: Options

    @property
    def checkpoint_identity(self) -> dict[str, Any]:
        """What must be equal to continue a run, by its name in messages."""
        # without the stop time: a run can continue beyond it
        times = {"start time": self.options.start_time or 0.0, "step size": self.options.step_size}
        return {**self._system, **self.values(lambda o: o.identity), **times}

    @property
    def variants_identity(self) -> dict[str, Any]:
        """What must be equal to continue many runs of one preparation."""
        times = self.options.start_time, self.options.stop_time, self.options.step_size
        recorded_options = self.values(lambda o: o.name if o.recorded else "")
        kinds = {c.name: c.kind for c in self.system.components}
        return {
            **self._system,
            "kinds": kinds,
            "options": recorded_options,
            "times": times,
            "by": recorded_options["algorithm"],
        }

    @property
    def _system(self) -> dict[str, Any]:
        """What defines the system, by its name in messages."""
        components = self.system.components
        disabled = {c.name: "not used" for c in components if not c.event_mode}
        return {
            "FMUs": dict(self.fmus),
            "components": [c.name for c in components],
            "values set": {
                f"{c.name}.{n}": str(v) for c in components for n, v in sorted(c.parameters.items())
            },
            "mappings": {f"{c.name}.{n}": str(a) for c in components for n, a in c.aliases.items()},
            "connections": [f"{x} {x.transformation}" for x in self.system.connections],
            **({"uses of event mode": disabled} if disabled else {}),
        }

    def values(self, name: Callable[[Option], str]) -> dict[str, Any]:
        """Return the options in effect as JSON, by their `name`, without those whose name is empty."""
        selected = {
            "algorithm": self.options.algorithm_name,
            "step_size_control": self.options.step_size_control_name,
        }
        return {
            name(o): selected[o.name] if o.name in selected else to_plain(value)
            for o, value in self.options.list_effective_values()
            if name(o)
        }


def build_run_record(
    scenario: str,
    definition: RunDefinition,
    assembly: Assembly,
    plan: RunPlan,
    layout: RunLayout,
    stepping: Mapping[str, Any],
    problem: str | None,
    unpacked: Path | None,
) -> dict[str, Any]:
    """Return the content of run.json.

    `problem` says why the run ended early. FMUs in the folder `unpacked` have their names in the package.
    """
    system, origin, types = definition.system, plan.origin, layout.types
    units = zip(layout.names, layout.units, strict=True)
    return {
        "scenario": scenario,
        "source": origin.source,
        "source_sha256": origin.sha256,
        "changed": list_overrides(origin),
        "status": COMPLETED if problem is None else problem,
        "settings": _list_settings(definition, plan),
        "stepping": stepping,
        "versions": dict(list_versions()),
        "components": {
            c.name: {
                "fmu": _format_path(assembly.files[c.name].path, unpacked),
                "sha256": definition.fmus[c.name],
                "kind": assembly.files[c.name].kind,
                "guid": assembly.files[c.name].description.guid,
                "parameters": dict(c.parameters),
                "changed": assembly.list_non_default_values(c),
                "not_taken": assembly.list_rejected_start_values(c),
                "tolerance": assembly.instances[c.name].tolerance,
                "mapping": {n: f"{a.variable} = {n} {a.transformation}" for n, a in c.aliases.items()},
            }
            for c in system.components
        },
        "connections": [
            f"{x} {x.transformation}" if x.transformation is not None else str(x) for x in system.connections
        ],
        "units": {name: str(unit) for name, unit in units if unit is not None},
        **({COLUMN_TYPES: write_types(types)} if types else {}),
        **system.record,
    }


def _list_settings(definition: RunDefinition, plan: RunPlan) -> dict[str, Any]:
    """Return the options in effect and the times of the run, as run.json has them."""
    options, times = plan.options, plan.times
    settings = definition.values(lambda o: o.record if o.recorded else "")
    del settings["mapping"]  # it is part of the replacement
    interval = plan.steps_per_row * times.step if plan.control.is_regular else options.output_interval
    return settings | {
        "start_time_s": times.start,
        "stop_time_s": times.stop,
        "step_size_s": times.step,
        "output_interval_s": interval,
        "replace": {name: to_plain(r) for name, r in options.replacements().items()},
        "parameters": [_hash_file(file) for file in options.parameters],
        "trajectory": None if options.trajectory is None else _hash_file(options.trajectory),
    }


def list_overrides(origin: RunOrigin) -> dict[str, Any]:
    """Return the options set for the scenario, without those that cannot change a result.

    Objects of Python appear as `{"python": name}`, with the name of their class.
    """
    options = list_options()
    overrides = {name: value for name, value in origin.overrides.items() if options[name].recorded}
    return {name: _convert_to_json(value, options[name].takes) for name, value in overrides.items()}


def _convert_to_json(value: Any, takes: type | None) -> Any:
    """Convert the value of an option to JSON that can be read back; mark objects of the type `takes`."""
    if isinstance(value, Mapping):
        return {key: _convert_to_json(inner, takes) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_convert_to_json(inner, takes) for inner in value]
    if isinstance(value, FileOrObject) and (definition := value.repeatable()) is not None:
        return definition
    if isinstance(value, FileOrObject):
        return {PYTHON: to_plain(type(value))}
    if takes not in (None, bool) and isinstance(value, takes):
        return {PYTHON: to_plain(value if isinstance(value, type) else type(value))}
    return to_plain(value)


def _hash_file(path: Path) -> dict[str, str | None]:
    """Return a file with the hash of its content, which is None if it cannot be read."""
    return {"file": str(path), "sha256": hash_if_readable(path)}


def _format_path(path: Path, unpacked: Path | None) -> str:
    """Return a path; that of a file in the folder `unpacked` is relative to it."""
    if unpacked is not None and path.is_relative_to(unpacked):
        path = path.relative_to(unpacked)
    return str(path)


@cache
def list_versions() -> dict[str, str | None]:
    """Return the versions of Python and of the packages that affect results; None for missing packages."""
    versions: dict[str, str | None] = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    return versions


def to_plain(value: Any) -> Any:
    """Convert the value of an option to JSON."""
    if isinstance(value, Algorithm):
        return to_plain(type(value))
    if isinstance(value, FileOrObject):
        return to_plain(value.record())
    if isinstance(value, Mapping):
        return {str(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(v) for v in value]
    if is_dataclass(value) and not isinstance(value, type):
        return to_plain(asdict(value))
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__}"
    return str(value) if isinstance(value, Path) else value
