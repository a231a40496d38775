"""The `emla` command. Each subcommand is imported when it is called.

`emla --help` needs only this module.
"""

from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from .conversion import PlainCommand
from .imports import quick_imports

COMMANDS = {
    "build": "Build the built-in FMUs, or FMUs from your Python blocks, for other tools and platforms.",
    "list": "List the named scenarios, plans, models, controllers and gain sets.",
    "info": "Show the variables of an FMU, an SSP or a scenario, and which of them you can set.",
    "schema": "Print the JSON Schema of a kind of file, with which editors complete and check.",
    "run": "Run a scenario: metrics on the screen; data, plots and a record in a folder.",
    "rerun": "Repeat a run from its run.json, and report differences.",
    "plot": "Plot signals of one or more recorded runs.",
    "sweep": "Run many variants of a scenario in parallel: grids, Monte Carlo, sensitivities.",
    "compare": "Compare several controllers in the same scenario, also as in the paper's tables.",
    "tune": "Tune gains: optimise them in simulated cases, and validate them with other seeds.",
    "identify": "Estimate parameters from measured data, with the certainty of each.",
    "size": "Size actuators: torque, temperature, energy and life over a cycle, and a verdict per limit.",
    "linearize": "Compute frequency responses and stability margins at a time of a run.",
    "trajectory": "Optimise the manipulator's motion for actuator power, within all bounds.",
    "verify": "Verify FMUs of any tool: conformance to the standard, and agreement with references.",
    "export": "Export a scenario as an SSP package for other tools.",
}
"""Commands in the order of the help. Each is the function `command` of its module in `commands`."""

ANSWERS = ("list", "info", "schema")
"""Commands whose output is their purpose; `--quiet` does not suppress it."""

QUIET = ("--quiet", "-q")

_SETTINGS = {"help_option_names": ["-h", "--help"]}


class _LazyCommand(TyperCommand):
    """A command that is imported when it is called."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Return the context of the imported command. Completion of the first argument needs no import."""
        if extra.get("resilient_parsing") and not args:
            return super().make_context(info_name, args, parent=parent, **extra)
        return self._import_command(info_name, args, parent, **extra)

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Complete the first argument without an import; import the command for all others."""
        from .completion import complete_first_argument

        if (
            not incomplete.startswith("-")
            and (names := complete_first_argument(str(self.name), incomplete)) is not None
        ):
            return names
        meant = self._import_command(ctx.info_name, [], ctx.parent, resilient_parsing=True)
        return meant.command.shell_complete(meant, incomplete)

    def _import_command(self, info_name: str | None, args: list[str], parent: Any, **extra: Any) -> Any:
        with quick_imports():
            return self._make_command_context(info_name, args, parent, **extra)

    def _make_command_context(self, info_name: str | None, args: list[str], parent: Any, **extra: Any) -> Any:
        module = import_module(f"emla_cosim.cli.commands.{self.name}")
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, context_settings=_SETTINGS)
        examples = "\n\n".join(("Examples:", *getattr(module, "EXAMPLES", ())))
        epilog = examples if hasattr(module, "EXAMPLES") else None
        alone.command(self.name, cls=PlainCommand, help=self.help, epilog=epilog)(
            _bind_command(module, quiet=self.name not in ANSWERS)
        )
        command = typer.main.get_command(alone)
        if self.name in ANSWERS:
            args = [a for a in args if a not in QUIET]
        if extra.get("resilient_parsing"):
            from .completion import add_completion

            add_completion(command)
        if not command.params and not args:
            command.add_help_option = False  # see `_CommandGroup.parse_args`
        return command.make_context(info_name, _complete(module, args), parent=parent, **extra)


def _complete(module: Any, args: list[str]) -> list[str]:
    """Add the values of flags that were written without one."""
    taken = getattr(module, "OPTIONS", None)
    if taken is None:
        return args
    from .commands.options import add_flag_values

    return add_flag_values(args, taken, getattr(module, "ALONE", {}))


def _bind_command(module: Any, quiet: bool) -> Any:
    """Add the options to the function of a command, and make it end with an error message if it fails."""
    from .commands.error_exit import exit_on_error

    command, taken = module.command, getattr(module, "OPTIONS", None)
    if taken is not None:
        from .commands.options import with_options

        command = with_options(command, taken)
    if quiet:
        from .commands.verbosity import with_verbosity

        command = with_verbosity(command, replaces=taken is not None and _can_replace(taken))
    return exit_on_error(command)


def _can_replace(taken: str) -> bool:
    from ..run.options import list_options

    return "replace" in list_options(taken)


class _CommandGroup(TyperGroup):
    """All commands, which are imported later."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read what comes before the command.

        If the command comes first, no option is parsed: parsing one imports more than `emla list` needs.
        """
        before = next((i for i, a in enumerate(args) if a not in QUIET), 0)
        if before and args[before] in COMMANDS:
            args = [args[before], QUIET[0], *args[before + 1 :]]
        if args and args[0] in COMMANDS:
            self.params, self.add_help_option = [], False
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command, or None if the name is unknown."""
        return _LazyCommand(cmd_name, help=COMMANDS[cmd_name]) if cmd_name in COMMANDS else None


app = typer.Typer(
    cls=_CommandGroup,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings=_SETTINGS,
    epilog="Start with: emla run study",
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"emla-cosim {version('emla-cosim')}")
        raise typer.Exit


def _explain_completion(wanted: bool, install: bool) -> None:
    if not wanted:
        return
    from . import completion

    try:
        typer.echo(completion.install() if install else completion.script())
    except ValueError as error:
        typer.echo(f"Error: {error}.", err=True)
        raise typer.Exit(1) from error
    raise typer.Exit


def _install_completion(wanted: bool) -> None:
    _explain_completion(wanted, install=True)


def _show_completion(wanted: bool) -> None:
    _explain_completion(wanted, install=False)


@app.callback()
def emla(
    version_: Annotated[
        bool,
        typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True),
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Show only errors. Can also follow the command.")
    ] = False,
    install_completion: Annotated[
        bool,
        typer.Option(
            "--install-completion",
            help="Install completion of commands, options and names for your shell.",
            callback=_install_completion,
            is_eager=True,
        ),
    ] = False,
    show_completion: Annotated[
        bool,
        typer.Option(
            "--show-completion",
            help="Show the script that --install-completion installs.",
            callback=_show_completion,
            is_eager=True,
        ),
    ] = False,
) -> None:
    """Co-simulate electromechanical linear actuators as FMUs."""
