"""Runs of scenarios with their results in a folder, as the command makes them."""

from pathlib import Path
from typing import Any

from emla_cosim.base.progress import Progress
from emla_cosim.run.result import Result
from emla_cosim.run.scenarios.scenario import Scenario
from emla_cosim.views.output_folder import OutputFolder


def run_scenario(scenario: Scenario, folder: Path, **options: Any) -> Result:
    """Run a scenario with other options, quietly and without plots."""
    settings = scenario.options.updated({"plots": False, **options})
    output = OutputFolder(folder, settings.output_format)
    with output.reserve():
        with scenario.prepare(**options) as simulation:
            recorders = output.recorders(scenario.name, continued=settings.resume is not None)
            result = simulation.attempt(recorders=recorders)
        return output.keep(result, settings.plots, Progress())[0]
