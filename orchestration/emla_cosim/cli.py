"""The `emla` command."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from .errors import CommandError, CosimError, check_choice
from .export import export
from .master.algorithms.extrapolation import EXTRAPOLATIONS
from .master.simulation import ALGORITHMS
from .models import FLAVOURS, FMU_FOLDER, MODELS, PLATFORMS, build
from .replacement import Replacement
from .run import results_folder, run
from .scenarios.reading import describe_scenario, opened_scenario, scenario_names
from .settings import Settings
from .system.study import CONTROLLERS
from .terminal import ERR, OUT, BarProgress, show_result

app = typer.Typer(
    help="Co-simulate electromechanical linear actuators as FMUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
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


def _panel(title: str) -> Callable[..., Any]:
    """Options that the help shows under one title."""

    def option(text: str, *names: str, **more: Any) -> Any:
        return typer.Option(*names, help=text, rich_help_panel=title, **more)

    return option


_FLAVOUR = f"FMU flavour: {' or '.join(FLAVOURS)}."
_system, _stepping, _output = _panel("What is run"), _panel("How it is stepped"), _panel("What comes out")


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
    for name in scenario_names():
        scenarios.add_row(f"[bold]{name}[/]", describe_scenario(name))
    models = Table("model", "what it is", title="Models: emla build MODEL", title_justify="left")
    for name, block in MODELS.items():
        models.add_row(f"[bold]{name}[/]", (block.__doc__ or "").strip().splitlines()[0])
    choices = Table("option", "choices", title="Choices", title_justify="left")
    choices.add_row("--flavour", ", ".join(FLAVOURS))
    choices.add_row("--algorithm", ", ".join(ALGORITHMS))
    choices.add_row("--extrapolation", ", ".join(EXTRAPOLATIONS))
    choices.add_row("--controller", ", ".join(CONTROLLERS))
    for table in (scenarios, models, choices):
        OUT.print(table)


_Set = Annotated[
    list[str] | None,
    _system("Other start value (repeatable).", "--set", metavar="JOINT.COMPONENT.VARIABLE=VALUE"),
]
_Parameters = Annotated[
    list[Path] | None, _system("Start values from a file (repeatable); --set overrides.", metavar="FILE.ssv")
]
_Replace = Annotated[
    list[str] | None,
    _system("Use another FMU for a component (repeatable).", metavar="JOINT.COMPONENT=FILE.fmu"),
]
_Mapping = Annotated[
    list[str] | None,
    _system("What the other FMU calls its variables (repeatable).", metavar="JOINT.COMPONENT=FILE.ssm"),
]
_Flavour = Annotated[str | None, _system(_FLAVOUR)]
_Controller = Annotated[str | None, _system(f"Gains of controller and observer: {' or '.join(CONTROLLERS)}.")]
_Fmus = Annotated[Path, _system("Folder of our FMUs; missing ones are built.")]
_StopTime = Annotated[float | None, _stepping("End of the run in s.")]
_StepSize = Annotated[float | None, _stepping("Communication step in s.")]
_SOURCE = "Name of a scenario (`emla list` shows them), scenario file (.toml), or SSP (.ssp, .ssd, folder)."


@app.command("run")
@_one_sentence
def run_command(
    scenario: Annotated[str, typer.Argument(help=_SOURCE)],
    set_: _Set = None,
    parameters: _Parameters = None,
    replace: _Replace = None,
    mapping: _Mapping = None,
    flavour: _Flavour = None,
    controller: _Controller = None,
    fmus: _Fmus = FMU_FOLDER,
    stop_time: _StopTime = None,
    step_size: _StepSize = None,
    error_tolerance: Annotated[
        float | None, _stepping("Choose steps by their error, relative to each signal's size.")
    ] = None,
    step_multiple: Annotated[
        list[str] | None,
        _stepping("Step a component at every N-th step (repeatable).", metavar="JOINT.COMPONENT=N"),
    ] = None,
    algorithm: Annotated[str | None, _stepping(f"{', '.join(ALGORITHMS)}.")] = None,
    extrapolation: Annotated[
        str | None, _stepping(f"Inputs during a step: {', '.join(EXTRAPOLATIONS)}.")
    ] = None,
    coupling_tolerance: Annotated[
        float | None,
        _stepping("What `--algorithm strong` agrees to, relative to each signal's size; 1e-8 without."),
    ] = None,
    order: Annotated[
        str | None, _stepping("Components in the order of stepping, comma between; the graph's without.")
    ] = None,
    kernel: Annotated[bool, _stepping("Step in compiled code where that is possible.")] = True,
    realtime: Annotated[
        float | None, _stepping("Simulate so many seconds per second, not more.", metavar="FACTOR")
    ] = None,
    output: Annotated[Path | None, _output("Output folder; results/SCENARIO without.")] = None,
    signals: Annotated[
        list[str] | None,
        _output("Signals of results.csv, * for anything (repeatable); all without.", metavar="PATTERN"),
    ] = None,
    output_interval: Annotated[
        float | None, _output("Time between rows of results.csv in s; 1 ms without.")
    ] = None,
    plots: Annotated[bool | None, _output("Draw plots.")] = None,
    checkpoint: Annotated[
        Path | None, _output("Write checkpoints to this file: every minute, and at the end.")
    ] = None,
    resume: Annotated[Path | None, _output("Continue the run of this checkpoint.")] = None,
) -> None:
    """Run a scenario: progress, a table of results, and an output folder with data and plots."""
    given = _system_settings(set_, parameters, replace, mapping, flavour, fmus) | {
        "algorithm": algorithm,
        "extrapolation": extrapolation,
        "coupling_tolerance": coupling_tolerance,
        "error_tolerance": error_tolerance,
        "multiples": {n: _whole(n, text) for n, text in _pairs("--step-multiple", step_multiple).items()},
        "order": [name.strip() for name in order.split(",")] if order else None,
        "step_size": step_size,
        "stop_time": stop_time,
        "output": output,
        "output_interval": output_interval,
        "signals": signals,
        "plots": plots,
        "compiled": kernel,
        "real_time": realtime,
        "checkpoint": checkpoint,
        "resume": resume,
    }
    with opened_scenario(scenario, controller) as chosen:
        settings = Settings.merged(chosen.settings, _only_given(given))
        check_choice("flavour", settings.flavour, FLAVOURS)
        with BarProgress() as progress:
            result = run(chosen, settings, settings.output or results_folder(chosen.name), progress)
        show_result(chosen, result)
    if result.problem is not None:
        raise CosimError(f"{result.problem} What was computed is in {result.folder}.")


@app.command("export")
@_one_sentence
def export_command(
    scenario: Annotated[str, typer.Argument(help=_SOURCE)],
    file: Annotated[Path, typer.Argument(help="The package to write.", metavar="FILE.ssp")],
    nested: Annotated[
        bool, _output("One system per joint; libcosim and Ecos read flat systems only.")
    ] = False,
    set_: _Set = None,
    parameters: _Parameters = None,
    replace: _Replace = None,
    mapping: _Mapping = None,
    flavour: _Flavour = None,
    controller: _Controller = None,
    platform: Annotated[
        list[str] | None,
        _system(
            f"FMI platform of our FMUs' binaries (repeatable); this one without: {', '.join(PLATFORMS)}."
        ),
    ] = None,
    fmus: _Fmus = FMU_FOLDER,
    stop_time: _StopTime = None,
    step_size: _StepSize = None,
) -> None:
    """Write a scenario as an SSP package, which other tools run."""
    given = _system_settings(set_, parameters, replace, mapping, flavour, fmus) | {
        "platforms": platform,
        "stop_time": stop_time,
        "step_size": step_size,
    }
    with opened_scenario(scenario, controller) as chosen, BarProgress() as progress:
        settings = Settings.merged(chosen.settings, _only_given(given))
        check_choice("flavour", settings.flavour, FLAVOURS)
        export(chosen, settings, file, nested, progress)
    size = file.stat().st_size / 1024
    OUT.print(f"{file}  [dim]{size:.0f} KiB[/]", highlight=False, soft_wrap=True)


def _system_settings(
    set_: list[str] | None,
    parameters: list[Path] | None,
    replace: list[str] | None,
    mapping: list[str] | None,
    flavour: str | None,
    fmus: Path,
) -> dict[str, Any]:
    """Settings that say what is run."""
    mappings = _pairs("--mapping", mapping)
    replacements = {
        name: Replacement(Path(fmu), Path(mappings.pop(name)) if name in mappings else None)
        for name, fmu in _pairs("--replace", replace).items()
    }
    for name, file in mappings.items():
        raise CommandError(f"--mapping {name}={file} needs --replace {name}=FILE.fmu.")
    return {
        "values": _pairs("--set", set_),
        "parameter_sets": parameters,
        "replacements": replacements,
        "flavour": flavour,
        "fmus": fmus,
    }


def _only_given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _pairs(option: str, texts: list[str] | None) -> dict[str, str]:
    pairs = {}
    for text in texts or []:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise CommandError(f"{option} {text} lacks a name or a value; write {option} NAME=VALUE.")
        pairs[name.strip()] = value.strip()
    return pairs


def _whole(name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise CommandError(f"--step-multiple {name}={text} is not a whole number of steps.") from error


if __name__ == "__main__":
    app()
