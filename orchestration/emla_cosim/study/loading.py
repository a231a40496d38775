"""Load a scenario from any source."""

from pathlib import Path
from typing import Unpack

from ..run.option_types import RunOptions
from ..run.scenarios.loading import load_scenario
from ..run.scenarios.scenario import Scenario
from ..system.model import System
from .registration import register

register()


def load(source: str | Path | System, **options: Unpack[RunOptions]) -> Scenario:
    """Load a scenario: a system of FMUs, and the options to run it with.

    Args:
        source: name of a built-in scenario, path of a file (.toml, .ssp, .ssd, .fmu) or of a folder of
            results, or a `System`.
        **options: values by name, as in the table of options. They take precedence over those of a file.

    Returns:
        The scenario. Nothing is built or run yet.

    Raises:
        CommandError: the source does not exist or cannot be read, or an option does not fit.

    Examples:
        >>> import emla_cosim as ec
        >>> scenario = ec.load("lift", step_size=5e-5, stop_time="10 ms")
        >>> scenario.options.stop_time
        0.01
    """
    return load_scenario(source, options)
