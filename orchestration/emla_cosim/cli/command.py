"""A command of `emla`, made of the module that implements it, and options of several commands."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any

import click

from ..base.errors import CommandError, CosimError, find_exit_code
from ..base.files import get_working_folder
from ..base.interruption import on_interrupt, raise_interrupt
from ..base.option import OUTPUT, RUNS, argument, option, options_of, switch
from ..run.options import list_options
from ..views.terminal import Verbosity, show_error, show_interrupted, use_verbosity
from .help_text import format_help
from .parameters import make_parameters, read_values


@dataclass(frozen=True)
class _ReplacementOptions:
    """Options of commands that replace FMUs."""

    show_fit: bool = switch("List the variables of a replacement FMU, even if all match.", OUTPUT)


class Command(click.Command):
    """A command whose module declares its parameters.

    The module has a function `command`, and optionally: a dataclass `Parameters` with arguments and options
    of this command, `OPTIONS` with the command whose options of a run it takes, and `EXAMPLES` for the help.
    The function gets an object of `Parameters`, and the options of a run that the user wrote, by name.

    Args:
        name: Name of the command.
        about: Text for the help.
        module: Module of the command.
        is_answer: Whether `--quiet` has no effect, because the output is the purpose of the command.
        settings: Settings of the context.
    """

    def __init__(
        self, name: str, about: str, module: ModuleType, is_answer: bool, settings: dict[str, Any]
    ) -> None:
        self._module, self._is_answer = module, is_answer
        self._declared = options_of(module.Parameters) if hasattr(module, "Parameters") else []
        self._shared = list(list_options(module.OPTIONS).values()) if hasattr(module, "OPTIONS") else []
        replaces = any(o.name == "replace" for o in self._shared) and not is_answer
        self._options = [
            *self._declared,
            *self._shared,
            *(options_of(_ReplacementOptions) if replaces else ()),
        ]
        quiet = click.Option(["--quiet", "-q"], is_flag=True, help="Show only errors.", hidden=is_answer)
        parameters = [*make_parameters(self._options), quiet]
        super().__init__(name, settings, self._call, parameters, about)

    def _call(self, quiet: bool, **texts: Any) -> None:
        """Run the command; if it fails, exit with an error message and its exit code."""
        try:
            with on_interrupt(raise_interrupt):
                get_working_folder()
                self._run(quiet, texts)
        except CosimError as error:
            show_error(str(error))
            sys.exit(find_exit_code(error))
        except OSError as error:  # of a file or folder that cannot be used now
            reason = error.strerror or error
            show_error(f"'{error.filename}' cannot be used: {reason}." if error.filename else f"{reason}.")
            sys.exit(1)
        except KeyboardInterrupt:
            show_interrupted()
            sys.exit(1)

    def _run(self, quiet: bool, texts: dict[str, Any]) -> None:
        """Run the command with the texts of the command line."""
        root = click.get_current_context().find_root().params
        is_quiet = not self._is_answer and (quiet or root.get("quiet", False))
        with use_verbosity(Verbosity(is_quiet, texts.get("show_fit") or False)):
            if not hasattr(self._module, "Parameters"):
                self._module.command()
                return
            parameters = self._module.Parameters(**read_values(self._declared, texts))
            self._module.command(parameters, read_values(self._shared, texts))

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help."""
        entries = [(o.group, o.headline, o.meaning) for o in self._options]
        examples = getattr(self._module, "EXAMPLES", ())
        formatter.write(format_help(self, ctx, entries, ("Examples", examples), formatter.width))


SOURCE = (
    "Scenario: a name from `emla list`, a scenario file (.toml), an SSP (.ssp, .ssd, or a folder), an "
    "FMU (.fmu), or a run.json."
)
"""Help of the argument that names a scenario."""

scenario = partial(argument, help=SOURCE, metavar="SCENARIO")

plan = partial(
    argument,
    help="Plan: a file (.toml) or a name from `emla list`; or a scenario as for `emla run`.",
    metavar="PLAN",
)

scheduler = partial(
    option,
    help="Scheduler of a Dask cluster, such as tcp://10.0.0.1:8786. Default: the cores of this machine.",
    metavar="ADDRESS",
    group=RUNS,
)

workers = partial(option, help="Number of processes on this machine. Default: one per core.", group=RUNS)

report = partial(switch, "Write a page with all results into the output folder.", OUTPUT)


def read_factors(texts: Sequence[str]) -> dict[str, str]:
    """Return the values of factors by name. Raise CommandError for any other text, and for a name twice."""
    from ..analyses.variants.distributions import FORMS  # slow to import

    factors = dict[str, str]()
    for text in texts:
        name, equals, values = (part.strip() for part in text.partition("="))
        if not (name and equals and values):
            raise CommandError(f"--vary {text} has no name or no values; write --vary NAME={FORMS}.")
        if name in factors:
            raise CommandError(f"--vary names {name} twice.")
        factors[name] = values
    return factors
