"""Exit codes and error messages of commands that fail."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import typer

from ...base.errors import CosimError, find_exit_code
from ...base.files import get_working_folder
from ...sandbox.interruption import raise_on_interrupt


def exit_on_error(command: Callable[..., None]) -> Callable[..., None]:
    """Make a command that fails end with an error message and its exit code."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        from ...views.terminal import show_error, show_interrupted

        try:
            with raise_on_interrupt():
                get_working_folder()
                command(*args, **kwargs)
        except CosimError as error:
            show_error(str(error))
            raise typer.Exit(find_exit_code(error)) from error
        except OSError as error:  # of a file or folder that cannot be used now
            reason = error.strerror or error
            show_error(f"'{error.filename}' cannot be used: {reason}." if error.filename else f"{reason}.")
            raise typer.Exit(1) from error
        except KeyboardInterrupt as error:
            show_interrupted()
            raise typer.Exit(1) from error

    return guarded
