"""run.json: everything needed to repeat a run."""

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..master.assembly import Assembly
from ..system.model import System

_PACKAGES = ("emla-cosim", "fmpy", "numpy", "casadi", "ziglang", "pythonfmu")


def run_record(
    scenario: str, settings: Mapping[str, Any], system: System, assembly: Assembly, problem: str | None
) -> dict[str, Any]:
    """The record of a run of this system; `problem` says why it ended early, if it did."""
    return {
        "scenario": scenario,
        "status": "completed" if problem is None else problem,
        "settings": {name: _plain(value) for name, value in settings.items()},
        "versions": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            **{package: version(package) for package in _PACKAGES},
        },
        "components": {
            c.name: {
                "fmu": str(assembly.files[c.name].path),
                "sha256": assembly.files[c.name].sha256,
                "guid": assembly.files[c.name].description.guid,
                "parameters": dict(c.parameters),
            }
            for c in system.components
        },
        "connections": [f"{x.source}.{x.output} -> {x.target}.{x.input}" for x in system.connections],
    }


def _plain(value: Any) -> Any:
    """A setting as JSON has it."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    return str(value) if isinstance(value, Path) else value
