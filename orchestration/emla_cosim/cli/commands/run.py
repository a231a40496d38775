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
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show_result
from .crash_record import CrashRecorder
from .options import scenario

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


def command(chosen: Parameters, given: dict[str, Any]) -> None:
    """Run a scenario into an output folder."""
    loaded = load(chosen.scenario, **given)
    run_into(loaded, loaded.options.output or results_folder(loaded.name), Path(chosen.scenario))


def run_into(
    chosen: Scenario, folder: Path, file: Path | None, tell: Callable[[Result], None] = lambda result: None
) -> None:
    """Run a scenario into an output folder, and show the result.

    Args:
        chosen: Scenario to run.
        folder: Output folder.
        file: File from which the scenario was read.
        tell: Function that shows more of the result.

    Raises:
        CosimError: If the run or a requirement fails. The results are written then too.
    """
    options = chosen.options
    plan_run(options, chosen.name)
    told = _show_actuators(chosen)
    plots = options.plots and has_extra("plots")
    left_out = [LEFT_OUT] if options.plots and not plots else []
    with BarProgress() as progress:
        described = {
            "form": options.output_format,
            "plots": plots,
            "plot_format": options.plot_format,
            "animated": options.animate,
            "report": options.report,
            "overwrite": options.overwrite,
        }
        output = OutputFolder(folder, **described)
        _check_places(file, options, output)
        with (
            output.alone(),
            contextlib.closing(CrashRecorder(chosen, folder, described)) as remembered,
            chosen.prepare(progress) as simulation,
        ):
            if options.animate:
                kept = simulation.select_signals(options.signals)
                roles = list_roles(chosen.system, chosen.options)
                check_animated(chosen.name, simulation.names, kept, roles)
            writing = output.recorders(chosen.name, continued=options.resume is not None)
            remembered.watch(simulation, writing[-1])
            recorders = [*writing, ProgressRecorder(progress), remembered]
            with catch_interrupts() as asked:  # from the first row to the last file
                result = simulation.attempt(recorders=recorders)
                # those of a reference are known only now
                notes = [*chosen.notes, *left_out, *(note.rstrip(".") for note in result.notes)]
                notes = list(dict.fromkeys(notes))
                # the termination of FMUs may still fail
                result, pictures = output.keep(
                    result,
                    plots and not asked(),
                    progress,
                    options.animate and not asked(),
                    options.report,
                    notes,
                    asked,
                )
                remembered.keep()
    show_result(result, [note for note in notes if note not in told], output, pictures)
    tell(result)
    if result.problem is not None:
        raise CosimError(f"{result.problem} The results so far are in {output.path}.")


def _show_actuators(scenario: Scenario) -> Sequence[str]:
    """Show the non-default actuators of a scenario before the run: data sheet, derived model and notes.

    Return the notes that were shown.
    """
    own = {joint: one for joint, one in scenario.options.actuator.items() if isinstance(one, Actuator)}
    for joint, one in own.items():
        print_line(f"{joint} has {one.title or one.label}:")
        for conversion in one.conversions:
            if conversion.is_short:
                print_line(f"  {conversion}")
    if not own:
        return ()
    for note in scenario.notes:
        print_line(f"Note: {note}.")
    return scenario.notes


def _check_places(file: Path | None, options: Options, output: OutputFolder) -> None:
    """Raise CommandError if an output file is also an input, or would be written twice."""
    results = output.roles
    read = ({} if file is None else {file: "the scenario"}) | options.files_read()
    if options.checkpoint is not None:
        check_output_files({options.checkpoint: "the checkpoint"}, results | read)
        check_checkpoint(options.checkpoint, options.overwrite)
    if options.resume is not None:
        read[options.resume] = "the checkpoint to continue"
    check_output_files(results, read)
