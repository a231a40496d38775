"""A scenario written as an SSP package."""

from pathlib import Path

from .preparation import prepared
from .progress import Progress
from .run import run_times
from .scenarios.scenario import Scenario
from .settings import Settings
from .ssp.writer.writing import Experiment, write_ssp


def export(scenario: Scenario, settings: Settings, file: Path, nested: bool, progress: Progress) -> None:
    """Write the system of a scenario, with all that the settings change, and its FMUs to `file`.

    `nested` makes one system per joint. Raises CommandError for what does not fit, RunError where
    something cannot be built or written.
    """
    times = run_times(scenario, settings)
    system, fmus = prepared(scenario.system, settings, progress)
    experiment = Experiment(times.start, times.stop, times.step)
    write_ssp(file, scenario.name, scenario.description, system, fmus, experiment, nested)
    progress.advance(1)
