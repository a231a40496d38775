"""The `emla` command."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from .command_options import takes_options
from .errors import CommandError, CosimError, check_choice
from .loading import load
from .models import FLAVOURS, FMU_FOLDER, MODELS, PLATFORMS, build
from .option import EXPORT, RUN
from .options import table
from .output_folder import OutputFolder, results_folder
from .recorders.progress import ProgressRecorder
from .scenarios.built_in import SCENARIOS
from .scenarios.reading import describe_scenario
from .study.controllers import CONTROLLERS
from .terminal import ERR, OUT, BarProgress, show_result

app = typer.Typer(
    help="Co-simulate electromechanical linear actuators as FMUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _one_sentence(command: Callable[..., None]) -> Callable[..., None]:
    """End a command that fails with one sentence and its exit code."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except CosimError as error:
            ERR.print(f"[bold red]Error:[/] {escape(str(error))}", highlight=False, soft_wrap=True)
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt as error:
            ERR.print("[bold red]Interrupted.[/]")
            raise typer.Exit(1) from error

    return guarded


_SOURCE = "Name of a scenario (`emla list` shows them), scenario file (.toml), or SSP (.ssp, .ssd, folder)."
_FLAVOUR = f"FMU flavour: {' or '.join(FLAVOURS)}."


@app.command("build")
@_one_sentence
def build_command(
    models: Annotated[list[str] | None, typer.Argument(help="Models; all without any.")] = None,
    flavour: Annotated[str, typer.Option(help=_FLAVOUR)] = "native",
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help=f"FMI platform of a native FMU's binaries (repeatable); all without: {', '.join(PLATFORMS)}."
        ),
    ] = None,
    output: Annotated[Path, typer.Option(help="Folder to build to.")] = FMU_FOLDER,
) -> None:
    """Build the FMUs of our models."""
    chosen = models or list(MODELS)
    check_choice("flavour", flavour, FLAVOURS)
    if platform and flavour != "native":
        raise CommandError("PythonFMU FMUs bring PythonFMU's own binaries; leave --platform out.")
    platforms = platform or list(PLATFORMS)
    for model in chosen:
        check_choice("model", model, MODELS)
    with BarProgress() as progress:
        paths = []
        for model in chosen:
            progress.begin(model, len(platforms) if flavour == "native" else 1)
            paths.append(build(model, flavour, platforms, output, lambda: progress.advance(1)))
            progress.finish()
    for path in paths:
        OUT.print(f"{path}  [dim]{path.stat().st_size / 1024:.0f} KiB[/]", highlight=False, soft_wrap=True)


@app.command("list")
@_one_sentence
def list_command() -> None:
    """List scenarios, models and what else can be chosen."""
    scenarios = Table("scenario", "what it is", title="Scenarios: emla run SCENARIO", title_justify="left")
    for name in SCENARIOS:
        scenarios.add_row(f"[bold]{name}[/]", describe_scenario(name))
    models = Table("model", "what it is", title="Models: emla build MODEL", title_justify="left")
    for name, block in MODELS.items():
        models.add_row(f"[bold]{name}[/]", (block.__doc__ or "").strip().splitlines()[0])
    choices = Table("option", "choices", title="Choices", title_justify="left")
    for option in table().values():
        if option.about.choices is not None:
            choices.add_row(option.flag, ", ".join(option.about.choices()))
    choices.add_row("--controller", ", ".join(CONTROLLERS))
    for name, controller in CONTROLLERS.items():
        choices.add_row(f"--gains, for {name}", ", ".join(controller.gains))
    for shown in (scenarios, models, choices):
        OUT.print(shown)


@app.command("run")
@_one_sentence
@takes_options(RUN)
def run_command(
    scenario: Annotated[str, typer.Argument(help=_SOURCE)], given: dict[str, Any] | None = None
) -> None:
    """Run a scenario: progress, a table of results, and an output folder with data and plots."""
    chosen = load(scenario, **(given or {}))
    options = chosen.options
    with BarProgress() as progress:
        output = OutputFolder(options.output or results_folder(chosen.name), options.output_format)
        with chosen.prepare(progress) as simulation:
            recorders = [*output.recorders(continued=options.resume is not None), ProgressRecorder(progress)]
            result = simulation.attempt(recorders=recorders)
        result, pictures = output.keep(result, options.plots, progress)
    show_result(result, chosen.notes, output, pictures)
    if result.problem is not None:
        raise CosimError(f"{result.problem} What was computed is in {output.path}.")


@app.command("export")
@_one_sentence
@takes_options(EXPORT)
def export_command(
    scenario: Annotated[str, typer.Argument(help=_SOURCE)],
    file: Annotated[Path, typer.Argument(help="The package to write.", metavar="FILE.ssp")],
    nested: Annotated[
        bool, typer.Option(help="One system per joint; libcosim and Ecos read flat systems only.")
    ] = False,
    given: dict[str, Any] | None = None,
) -> None:
    """Write a scenario as an SSP package, which other tools run."""
    with BarProgress() as progress:
        load(scenario, **(given or {})).export(file, nested, progress)
    size = file.stat().st_size / 1024
    OUT.print(f"{file}  [dim]{size:.0f} KiB[/]", highlight=False, soft_wrap=True)


if __name__ == "__main__":
    app()
