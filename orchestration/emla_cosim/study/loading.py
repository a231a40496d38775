"""The one way to a scenario, whatever it is made of."""

from pathlib import Path
from typing import Unpack

from ..run.option_types import LoadOptions
from ..run.scenarios.loading import load_scenario
from ..run.scenarios.scenario import Scenario
from ..system.model import System
from .registration import register

register()


def load(source: str | Path | System, **options: Unpack[LoadOptions]) -> Scenario:
    """A scenario: built-in by its name, from a file (.toml, .ssp, .ssd, .fmu, a folder), or of a system.

    `options` are those of `Options`, by name, and win over what a file says. Raises CommandError for
    whatever is wrong.
    """
    return load_scenario(source, options)
