"""`emla run`."""

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.errors import CosimError
from ...base.extras import LEFT_OUT, has_extra
from ...base.files import check_output_files
from ...base.interruption import catch_interrupts
from ...base.option import RUN
from ...master.stepping.checkpoint import check_checkpoint
from ...recorders.recorder import ProgressRecorder
from ...run.options import Options
from ...run.registered import list_roles
from ...run.result import Result
from ...run.run_setup import plan_run
from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...study.loading import load
from ...views.animation import check_animated
from ...views.output_folder import OutputFolder, results_folder
from ...views.terminal import BarProgress, print_line, show_result
from ..command import scenario
from .crash_rescue import CrashRecorder

OPTIONS = RUN

EXAMPLES = (
    "emla run study --stop-time 2 --gains robust",
    "emla run lift --set lift.plant.motor.R_s=0.2 --replace lift.controller=mine.fmu",
    "emla run mine.toml --output results/mine --no-plots",
)


@dataclass(frozen=True)
class Parameters:
    """Arguments of the command."""

    scenario: str = scenario()


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Run a scenario into an output folder."""
    scenario_to_run = load(parameters.scenario, **options)
    run_into(
        scenario_to_run,
        scenario_to_run.options.output or results_folder(scenario_to_run.name),
        Path(parameters.scenario),
    )


def run_into(
    scenario_to_run: Scenario,
    folder: Path,
    file: Path | None,
    on_result: Callable[[Result], None] = lambda result: None,
) -> None:
    """Run a scenario into an output folder, and show the result.

    Args:
        scenario_to_run: Scenario to run.
        folder: Output folder.
        file: File from which the scenario was read.
        on_result: Function that shows more of the result.

    Raises:
        CosimError: If the run or a requirement fails. The results are written then too.
    """
    options = scenario_to_run.options
    plan_run(options, scenario_to_run.name)  # reports wrong options before anything is built
    shown_notes = _show_actuators(scenario_to_run)
    plots = options.plots and has_extra("plots")
    missing_notes = [LEFT_OUT] if options.plots and not plots else []
    with BarProgress() as progress:
        output_options = {
            "form": options.output_format,
            "plots": plots,
            "plot_format": options.plot_format,
            "animated": options.animate,
            "report": options.report,
            "overwrite": options.overwrite,
        }
        output = OutputFolder(folder, **output_options)
        _check_files(file, options, output)
        with (
            output.reserve(),
            contextlib.closing(CrashRecorder(scenario_to_run, folder, output_options)) as crash_recorder,
            scenario_to_run.prepare(progress) as simulation,
        ):
            if options.animate:
                recorded_names = simulation.select_signals(options.signals)
                roles = list_roles(scenario_to_run.system, scenario_to_run.options)
                check_animated(scenario_to_run.name, simulation.names, recorded_names, roles)
            file_recorders = output.recorders(scenario_to_run.name, continued=options.resume is not None)
            crash_recorder.set_run(simulation, file_recorders[-1])
            recorders = [*file_recorders, ProgressRecorder(progress), crash_recorder]
            with catch_interrupts() as is_interrupted:  # from the first row to the last file
                result = simulation.attempt(recorders=recorders)
                # those of a reference are known only now
                notes = [*scenario_to_run.notes, *missing_notes, *(note.rstrip(".") for note in result.notes)]
                notes = list(dict.fromkeys(notes))
                # the termination of FMUs may still fail
                result, pictures = output.keep(
                    result,
                    plots and not is_interrupted(),
                    progress,
                    options.animate and not is_interrupted(),
                    options.report,
                    notes,
                    is_interrupted,
                )
                crash_recorder.note_files_written()
    show_result(result, [note for note in notes if note not in shown_notes], output, pictures)
    on_result(result)
    if result.problem is not None:
        raise CosimError(f"{result.problem} The results so far are in {output.path}.")


def _show_actuators(scenario: Scenario) -> Sequence[str]:
    """Show the non-default actuators of a scenario before the run: data sheet, derived model and notes.

    Return the notes that were shown.
    """
    actuators = {
        joint: actuator
        for joint, actuator in scenario.options.actuator.items()
        if isinstance(actuator, Actuator)
    }
    for joint, actuator in actuators.items():
        print_line(f"{joint} has {actuator.title or actuator.label}:")
        for conversion in actuator.conversions:
            if conversion.is_shown_before_run:
                print_line(f"  {conversion}")
    if not actuators:
        return ()
    for note in scenario.notes:
        print_line(f"Note: {note}.")
    return scenario.notes


def _check_files(file: Path | None, options: Options, output: OutputFolder) -> None:
    """Raise CommandError if an output file is also an input, is written twice, or must not be replaced."""
    results = output.roles
    read = ({} if file is None else {file: "the scenario"}) | options.files_read()
    if options.checkpoint is not None:
        check_output_files({options.checkpoint: "the checkpoint"}, results | read)
        check_checkpoint(options.checkpoint, options.overwrite)
    if options.resume is not None:
        read[options.resume] = "the checkpoint to continue"
    check_output_files(results, read)
