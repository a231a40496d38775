"""run.json: everything needed to repeat a run."""

import platform
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ..master.algorithms.explicit import Explicit
from ..master.algorithms.jacobi import Jacobi
from ..master.algorithms.strong import Strong
from ..master.assembly import Assembly
from ..master.stepping.error_control import ErrorControl
from ..master.stepping.fixed_steps import FixedSteps
from ..master.stepping.stepping import Stepping
from ..system.model import System

_PACKAGES = ("emla-cosim", "fmpy", "numpy", "numba", "casadi", "ziglang", "pythonfmu")


def run_record(
    scenario: str,
    settings: Mapping[str, Any],
    system: System,
    assembly: Assembly,
    stepping: Mapping[str, Any],
    problem: str | None,
    unpacked: Path | None = None,
) -> dict[str, Any]:
    """The record of a run of this system; `problem` says why it ended early, if it did.

    FMUs in the folder `unpacked` are called as in their package.
    """
    return {
        "scenario": scenario,
        "status": "completed" if problem is None else problem,
        "settings": {name: _plain(value) for name, value in settings.items()},
        "stepping": stepping,
        "versions": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            **{package: _version(package) for package in _PACKAGES},
        },
        "components": {
            c.name: {
                "fmu": _file(assembly.files[c.name].path, unpacked),
                "sha256": assembly.files[c.name].sha256,
                "guid": assembly.files[c.name].description.guid,
                "parameters": dict(c.parameters),
                "mapping": {n: f"{a.variable} = {n} {a.transformation}" for n, a in c.aliases.items()},
            }
            for c in system.components
        },
        "connections": [
            f"{x} {x.transformation}" if x.transformation is not None else str(x) for x in system.connections
        ],
    }


def stepping_record(stepping: Stepping, system: System) -> dict[str, Any]:
    """How the steps were made: compiled or not, in which order, what came late, and what it took."""
    algorithm = stepping.algorithm
    links = zip(system.connections, algorithm.network.links, strict=True)
    late = algorithm.late()
    slaves = algorithm.network.slaves
    record: dict[str, Any] = {
        "steps": stepping.steps,
        "late_connections": [str(x) for x, link in links if link in late],
    }
    if isinstance(stepping, FixedSteps) and isinstance(algorithm, Explicit):
        record["compiled"] = stepping.compiled
    if isinstance(stepping, ErrorControl):
        record["rejected_steps"] = stepping.control.rejected
    if isinstance(algorithm, Strong):
        record["sweeps_over_loops"] = algorithm.sweeps
        record["loops"] = [[slaves[i].name for i in loop] for loop in algorithm.loops]
    if not isinstance(algorithm, Jacobi):
        record["order"] = [slaves[i].name for i in algorithm.network.order]
    return record


def _file(path: Path, unpacked: Path | None) -> str:
    if unpacked is not None and path.is_relative_to(unpacked):
        path = path.relative_to(unpacked)
    return str(path)


def _version(package: str) -> str | None:
    """The version of a package; None for one that this host lacks."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _plain(value: Any) -> Any:
    """A setting as JSON has it."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    return str(value) if isinstance(value, Path) else value
