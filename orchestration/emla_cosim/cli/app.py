"""The `emla` command. Each subcommand is imported when it is called.

`emla --help` needs only this module.
"""

import contextlib
import gc
import os
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import click

COMMANDS = {
    "build": "Build FMUs of built-in models, your Python blocks or data, for other tools and platforms.",
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
    "trajectory": "Optimise a machine's motion for actuator power, within all bounds.",
    "verify": "Verify FMUs of any tool: conformance to the standard, and agreement with references.",
    "repair": "Mend the text of an FMU: lists, units, dates, encodings; show and record each change.",
    "export": "Export a scenario as an SSP package for other tools.",
}
"""Commands in the order of the help. Each is the function `command` of its module in `commands`."""

_EXTRAS = {
    **dict.fromkeys(("sweep", "compare", "tune", "identify", "size", "linearize"), ("analyses",)),
    "plot": ("plots",),
    "trajectory": ("analyses", "build"),
}
"""Extras without which a command can do nothing; others are checked where they are needed."""

ANSWERS = ("list", "info", "schema")
"""Commands whose output is their purpose; `--quiet` does not suppress it."""

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
"""Settings of all commands."""

_BLAS_THREADS = "OPENBLAS_NUM_THREADS"


class _FirstArgument(click.Command):
    """A command of which only the first argument is to be completed, which needs no import of its module."""

    def shell_complete(self, ctx: click.Context, incomplete: str) -> Any:
        """Return completions of the first argument; of options those of the imported command."""
        from .completion import complete_first_argument

        names = None if incomplete.startswith("-") else complete_first_argument(str(self.name), incomplete)
        if names is not None:
            return names
        with load_command(str(self.name)).make_context(
            self.name, [], ctx.parent, resilient_parsing=True
        ) as real:
            return real.command.shell_complete(real, incomplete)


class _Commands(click.Group):
    """All commands, which are imported when they are called."""

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run a command and exit. A wrong command line gives one error message and the exit code 2."""
        try:
            # in its standalone mode, click would print messages of its own and exit
            code = super().main(*args, standalone_mode=False, **extra)
        except click.Abort as error:
            raise KeyboardInterrupt from error
        except click.exceptions.NoArgsIsHelpError as error:
            error.show(sys.stdout)
            code = error.exit_code
        except click.UsageError as error:
            _show_usage_error(error)
            code = error.exit_code
        except ImportError as error:
            code = _show_missing_package(error)
        sys.exit(code or 0)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command, or None if the name is unknown."""
        return load_command(cmd_name) if cmd_name in COMMANDS else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return name, command and other arguments of a command line.

        Raises:
            click.UsageError: There is no command of this name.
        """
        name, *remaining = args
        if name not in COMMANDS and not ctx.resilient_parsing:
            from ..base.errors import suggest_names

            raise click.UsageError(
                f"there is no command '{name}'; {suggest_names(name, COMMANDS, most=20)}", ctx
            )
        # importing the module of a command takes too long for a key press
        if name in COMMANDS and ctx.resilient_parsing and not remaining:
            return name, _FirstArgument(name), remaining
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Return the commands that begin with a text, or the options of `emla`."""
        from click.shell_completion import CompletionItem

        names = [CompletionItem(n, help=text) for n, text in COMMANDS.items() if n.startswith(incomplete)]
        return names + click.Command.shell_complete(self, ctx, incomplete)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help, which imports no command."""
        from .help_text import format_help

        entries = (("Commands", name, text) for name, text in COMMANDS.items())
        formatter.write(format_help(self, ctx, entries, ("Start with", ("emla run study",)), formatter.width))


@contextlib.contextmanager
def quick_imports() -> Iterator[None]:
    """Import without searching for garbage, and without threads for the linear algebra of NumPy.

    Modules stay, so there is no garbage. Such a thread takes up to 0.1 s of CPU time when it starts, and the
    matrices here are too small for it. The environment is restored: FMUs may have their own linear algebra.
    """
    before = os.environ.get(_BLAS_THREADS)
    os.environ.setdefault(_BLAS_THREADS, "1")
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        if before is None:
            os.environ.pop(_BLAS_THREADS, None)


def load_command(name: str) -> click.Command:
    """Import the module of a command, and return the command. Raise MissingExtraError without its extras."""
    with quick_imports():
        from ..base.extras import require_extras
        from .command import Command

        require_extras(_EXTRAS.get(name, ()), f"`emla {name}`")

        module = import_module(f"emla_cosim.cli.commands.{name}")
        return Command(name, COMMANDS[name], module, name in ANSWERS, SETTINGS)


def _show_usage_error(error: click.UsageError) -> None:
    from ..views.terminal import show_error

    text = error.format_message().rstrip(".")
    if isinstance(error, click.NoSuchOption):
        near = f"; did you mean {' or '.join(error.possibilities)}?" if error.possibilities else "."
        text = f"there is no option '{error.option_name}'{near}"
    end = "" if text.endswith((".", "?")) else "."
    hint = f" See `{error.ctx.command_path} --help`." if error.ctx is not None else ""
    show_error(f"{text}{end}{hint}")


def _show_missing_package(error: ImportError) -> int:
    """Show which extra a command lacks, and return the exit code. Other errors are raised again."""
    from ..base.extras import explain_missing
    from ..views.terminal import show_error

    explained = explain_missing(error, "this command")
    if explained is None:
        raise error
    show_error(str(explained))
    return explained.exit_code


def _show_version(emla: click.Command) -> str:
    from importlib.metadata import version

    return f"emla-cosim {version('emla-cosim')}"


def _install_completion(emla: click.Command) -> str:
    from .completion import install

    return install(emla)


def _show_completion(emla: click.Command) -> str:
    from .completion import make_script

    return make_script(emla)


def _make_action(flag: str, help: str, action: Callable[[click.Command], str]) -> click.Option:
    """Return an option that prints a text in place of running a command."""

    def call(ctx: click.Context, parameter: click.Parameter, is_set: bool) -> None:
        if not is_set or ctx.resilient_parsing:
            return
        try:
            click.echo(action(ctx.command))
        except ValueError as error:
            click.echo(f"Error: {error}.", err=True)
            ctx.exit(1)
        ctx.exit()

    return click.Option([flag], is_flag=True, expose_value=False, is_eager=True, callback=call, help=help)


app = _Commands(
    "emla",
    context_settings=SETTINGS,
    no_args_is_help=True,
    help="Co-simulate electromechanical linear actuators as FMUs.",
    params=[
        _make_action("--version", "Show the version and exit.", _show_version),
        click.Option(["--quiet", "-q"], is_flag=True, help="Show only errors. Can also follow the command."),
        _make_action(
            "--install-completion",
            "Install completion of commands, options and names for your shell.",
            _install_completion,
        ),
        _make_action(
            "--show-completion", "Show the script that --install-completion installs.", _show_completion
        ),
    ],
)
