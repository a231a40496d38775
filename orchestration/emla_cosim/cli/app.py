"""The `emla` command: its parts, each imported when it is called.

`emla --help` needs nothing but these lines.
"""

from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

COMMANDS = {
    "build": "Build our FMUs, or yours from a Python block, for other tools and all platforms.",
    "list": "List the scenarios, plans, models and gains that have names.",
    "info": "Tell what an FMU, an SSP or a scenario is made of: variables, and what can be set.",
    "run": "Run a scenario: figures on the screen; data, pictures and a record in a folder.",
    "rerun": "Repeat a run from its run.json, and say what is not as it was.",
    "plot": "Draw signals of runs that were kept, one over the other.",
    "sweep": "Run many variants of a scenario side by side: grids, Monte Carlo, sensitivities.",
    "compare": "Run a scenario with several controllers side by side, also as the paper's tables.",
    "tune": "Find gains: optimised over cases that are simulated, validated on other seeds.",
    "trajectory": "Find the manipulator's motion: optimised for actuator power, within all bounds.",
    "verify": "Check FMUs of any tool: do they follow the standard, and still do what they did?",
    "export": "Write a scenario as an SSP package, which other tools run.",
}
"""Commands in the order of the help; each is `command` of the module of its name in `commands`."""

ANSWERS = ("list", "info")
"""Commands whose output is what they were asked for, quiet or not."""

QUIET = ("--quiet", "-q")

_SETTINGS = {"help_option_names": ["-h", "--help"]}


class _LazyCommand(TyperCommand):
    """A command that is imported when it is called."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """A context of the command itself, unless a shell asks what may come first, which takes no import."""
        if extra.get("resilient_parsing") and not args:
            return super().make_context(info_name, args, parent=parent, **extra)
        return self._import_command(info_name, args, parent, **extra)

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """What may come first after the command."""
        from .completion import complete_first_argument

        if (
            not incomplete.startswith("-")
            and (names := complete_first_argument(str(self.name), incomplete)) is not None
        ):
            return names
        meant = self._import_command(ctx.info_name, [], ctx.parent, resilient_parsing=True)
        return meant.command.shell_complete(meant, incomplete)

    def _import_command(self, info_name: str | None, args: list[str], parent: Any, **extra: Any) -> Any:
        module = import_module(f"emla_cosim.cli.commands.{self.name}")
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, context_settings=_SETTINGS)
        examples = "\n\n".join(("Examples:", *getattr(module, "EXAMPLES", ())))
        epilog = examples if hasattr(module, "EXAMPLES") else None
        alone.command(self.name, help=self.help, epilog=epilog)(
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
    """The arguments of a command as it reads them."""
    taken = getattr(module, "OPTIONS", None)
    if taken is None:
        return args
    from .commands.options import add_flag_values

    return add_flag_values(args, taken, getattr(module, "ALONE", {}))


def _bind_command(module: Any, quiet: bool) -> Any:
    """The function of a command with the options it takes, which ends with a sentence where it fails."""
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
    """Return whether a command replaces components."""
    from ..run.options import list_options

    return "replace" in list_options(taken)


class _CommandGroup(TyperGroup):
    """All commands, none of which is imported yet."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take what stands before the command.

        Where that comes first, no option is looked at: to read one imports more than `emla list` needs.
        """
        before = next((i for i, a in enumerate(args) if a not in QUIET), 0)
        if before and args[before] in COMMANDS:
            args = [args[before], QUIET[0], *args[before + 1 :]]
        if args and args[0] in COMMANDS:
            self.params, self.add_help_option = [], False
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """One of them; None for a name that is not there."""
        return _LazyCommand(cmd_name, help=COMMANDS[cmd_name]) if cmd_name in COMMANDS else None


app = typer.Typer(
    cls=_CommandGroup,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings=_SETTINGS,
    epilog="Begin with: emla run study",
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
        bool, typer.Option("--quiet", "-q", help="Say nothing but errors; also after the command.")
    ] = False,
    install_completion: Annotated[
        bool,
        typer.Option(
            "--install-completion",
            help="Make your shell complete commands, options and names.",
            callback=_install_completion,
            is_eager=True,
        ),
    ] = False,
    show_completion: Annotated[
        bool,
        typer.Option(
            "--show-completion",
            help="Show what --install-completion would install.",
            callback=_show_completion,
            is_eager=True,
        ),
    ] = False,
) -> None:
    """Co-simulate electromechanical linear actuators as FMUs."""
