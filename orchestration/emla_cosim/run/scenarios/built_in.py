"""Registries of built-in systems and scenarios."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from ...base.option import FileOrObject
from ...system.model import System, Value
from ..options import Options
from .scenario_file import ScenarioFile, parse_scenario

SYSTEMS: dict[str, Callable[..., System]] = {}
"""Functions that make a system from a controller and a gain set, by name; None means the default."""

FOLLOWING: set[str] = set()
"""Systems that can also be made from a trajectory file, with the argument `trajectory`."""

CHANGES: dict[
    str,
    Callable[
        [str, Mapping[str, Any], Mapping[str, Value], Mapping[str, FileOrObject]], Mapping[str, FileOrObject]
    ],
] = {}
"""Functions that make objects for the joints of a system, by option, such as `actuator`. They take the name
of the system, files or objects by joint, other values by JOINT.TABLE.ENTRY, and the objects that the joints
have without. They raise CommandError.
"""

EXTENSIONS: dict[str, Callable[[System], System]] = {}
"""Functions that return a built-in system with further components, by the option that adds them."""

STEPPING: list[Callable[[System, Mapping[str, Any]], Mapping[str, Any]]] = []
"""Functions that return further options of the algorithm for a built-in system, from those that are set."""

REMARKS: list[Callable[[System, Options], Sequence[str]]] = []
"""Functions that check a built-in system. They return remarks without full stops or raise CommandError."""

SCENARIOS: dict[str, Callable[[], str]] = {}
"""Functions that return the text of a scenario file, by scenario."""

PLANS: dict[str, Callable[[], str]] = {}
"""Functions that return the text of a sweep plan, by plan."""

TUNINGS: dict[str, Callable[[], str]] = {}
"""Functions that return the text of a tuning plan, by plan."""


@cache
def find_built_in(name: str) -> ScenarioFile:
    """Return the scenario file of a built-in scenario."""
    return parse_scenario(SCENARIOS[name](), name, Path())
