"""Load a scenario from any source."""

from pathlib import Path
from typing import Any

from ..run.scenarios.loading import load_scenario
from ..run.scenarios.scenario import Scenario
from ..system.model import System
from .registration import register

register()


def load(source: str | Path | System, **options: Any) -> Scenario:
    """Load a scenario: by its name, from a file (.toml, .ssp, .ssd, .fmu, a folder), or from a system.

    Args:
        source: The name, the path, or the system.
        options: Options by name, which override those of a file; see `Options`.

    Raises:
        CommandError: The source or an option is invalid.
    """
    return load_scenario(source, options)
