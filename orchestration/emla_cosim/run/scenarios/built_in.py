"""Systems and scenarios that can be called by name, once they are registered here."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from ...base.option import FileOrObject
from ...system.model import System
from ..options import Options
from .scenario_file import ScenarioFile, parse_scenario

SYSTEMS: dict[str, Callable[..., System]] = {}
"""What makes a system of a controller and a set of gains, by name; None is the usual one."""

FOLLOWING: set[str] = set()
"""Systems that are made of the file of a trajectory too, if there is one: `trajectory`."""

READERS: dict[str, Callable[[Path], FileOrObject]] = {}
"""What reads the files that an option names for joints, by the option: `actuator`."""

REMARKS: list[Callable[[System, Options], Sequence[str]]] = []
"""What looks at a built-in system before it is run: sentences without their stops, or CommandError."""

SCENARIOS: dict[str, Callable[[], str]] = {}
"""What reads the text of a scenario file, by the name of the scenario."""

PLANS: dict[str, Callable[[], str]] = {}
"""What reads the text of a plan of a sweep, by the name of the plan."""

TUNINGS: dict[str, Callable[[], str]] = {}
"""What reads the text of a plan of a tuning, by the name of the plan."""


@cache
def find_built_in(name: str) -> ScenarioFile:
    """The scenario file of this name."""
    return parse_scenario(SCENARIOS[name](), name, Path())
