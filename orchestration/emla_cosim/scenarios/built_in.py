"""Systems and scenarios that can be called by name, once they are registered here."""

from collections.abc import Callable

from ..system.model import System

SYSTEMS: dict[str, Callable[[str | type | None, str | type | None], System]] = {}
"""What makes a system of a controller and a set of gains, by name; None is the usual one."""

SCENARIOS: dict[str, Callable[[], str]] = {}
"""What reads the text of a scenario file, by the name of the scenario."""
